"""Compiled programs and the in-process engine, side by side with the reference interpreter.

*Event* is one event of one robot, run into a buffer and kept: guard, effect, and all that the round
would need of it. A *whole round* is in one process: propose, decide, commit, environment. The
reference makes the same turn of the same program over doubles, rule by rule.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from random import Random
from typing import Any

from harness import LIMITS, Column, Report, in_child, main, note

#: What an event may cost at most, and how many robot-rounds a second there must be.
EVENT_LIMIT_US = 3.0
ROUNDS_LIMIT_PER_S = 20_000.0

#: Programs of one event each; the first of them is what a simple event is.
EVENTS: dict[str, str] = {
    "two locals": "local:\n  int n = 0\n  float x = 0.0\n"
    "E:\n  pre: n >= 0\n  eff:\n    n = n + 1\n    x = x + 0.5 * delta\n",
    "guard not met": "local:\n  int n = 0\nE:\n  pre: n > 0\n  eff:\n    n = n + 1\n",
    "own entry": "allread:\n  int[] x = 0\nE:\n  eff:\n    x[pid] = x[pid] + 1\n",
    "shared, atomic": "allwrite:\n  int sum = 0\nE:\n  eff:\n    atomic:\n      sum = sum + 1\n",
    "a record": "local:\n  pos p = pos(0.0, 0.0, 0.0)\n"
    "E:\n  eff:\n    p = pos(p.x + 1.0, p.y, p.z - 1.0)\n",
    "a loop of 10 over a list": "local:\n  int n = 0\n"
    "  int[] xs = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n"
    "E:\n  eff:\n    for x in xs:\n      n = n + x % 3\n",
    "a field of a list": "allwrite:\n  Task[8] list\ninit:\n  for i = 0, 8:\n"
    "    list[i] = Task(loc = pos(0.0, 0.0, 0.0))\n"
    "E:\n  eff:\n    list[3].assignedTo = pid\n",
}

ROBOTS = 8

#: The program of whole rounds: what robots do that count together.
COUNTING = (
    "allwrite:\n  int sum = 0\nallread:\n  int[] mine = 0\nlocal:\n  int n = 0\n"
    "Count:\n  pre: n >= mine[pid]\n  eff:\n    n = n + 1\n    mine[pid] = n\n"
)


class Nothing:
    """A host for programs that leave nothing open."""

    def start(self, robot: int | None, name: str) -> Any:
        raise AssertionError(name)

    def read(self, robot: object) -> Mapping[str, Any]:
        return {}

    def ask(self, *question: object) -> Any:
        raise AssertionError(question)

    def choose(self, *question: object) -> Any:
        raise AssertionError(question)


def seconds(work: Callable[[], object], times: int) -> float:
    """CPU seconds of one call, of many; the best of three."""
    found = []
    for _ in range(3):
        begun = time.process_time()
        for _ in range(times):
            work()
        found.append((time.process_time() - begun) / times)
    return min(found)


def event(name: str, times: int) -> dict[str, Any]:
    """Microseconds of an event, compiled and by the reference."""
    from koord.refinement.running import ready
    from koord.runtime.engine import RoundEngine
    from koord.sampling.sampled_inputs import SampledInputs
    from koord.sampling.values import Sampler
    from koord.semantics.domain import DOUBLES
    from koord.semantics.rounds import enabled, initialised, run_event, run_skip
    from koord.syntax.load import load
    from koord.syntax.source import Source
    from koord.syntax.system import dealt
    from koord.traces.trace import Numbers

    program = load(Source("event.krd", EVENTS[name])).program
    assert program is not None
    system = dealt(program, ROBOTS)
    fleet = RoundEngine(ready(program).classes, system.kinds, 0.1, Nothing())
    fleet.begin()
    robot = fleet.robots[0]
    buffers = robot._buffers

    def compiled() -> None:
        buffers.clear()
        buffer = robot.try_event(0)
        if buffer is not None:
            robot.__dict__ = buffer.state

    buffers.clear()
    robot._buffers = buffers
    inputs = SampledInputs(Sampler(system, Numbers.DOUBLE, Random(0)))
    start = initialised(DOUBLES, system, inputs).configuration

    def by_the_rules() -> None:
        if enabled(DOUBLES, system, start, 0, inputs):
            run_event(DOUBLES, system, start, 0, 0, inputs)
        else:
            run_skip(DOUBLES, system, start, 0, inputs)

    return {
        "compiled_us": 1e6 * seconds(compiled, times),
        "reference_us": 1e6 * seconds(by_the_rules, max(times // 50, 20)),
    }


def rounds(robots: int, turns: int) -> dict[str, Any]:
    """Robot-rounds a second of the engine, and whether everyone counted right."""
    from koord.refinement.running import ready
    from koord.runtime.engine import Deployed, RoundEngine
    from koord.syntax.load import load
    from koord.syntax.source import Source

    program = load(Source("counting.krd", COUNTING)).program
    assert program is not None
    fleet = RoundEngine(ready(program).classes, (0,) * robots, 0.1, Nothing())
    fleet.begin()
    schedule = Deployed()

    def one_round() -> None:
        fleet.program_turns(schedule)
        fleet.environment_turn()

    taken_s = seconds(one_round, max(turns // robots, 5))
    return {
        "round_us": 1e6 * taken_s,
        "robot_rounds_per_s": robots / taken_s,
        "right": fleet.store.values["mine"] == (fleet.round,) * robots,
    }


def refinement(runs: int) -> dict[str, Any]:
    """CPU seconds of so many generated programs, compiled, run, and judged."""
    from koord.refinement.cases import all_generated, tried

    begun = time.process_time()
    cases = all_generated(Random(0), 8)
    found = [tried(next(cases)) for _ in range(runs)]
    return {
        "cpu_s": time.process_time() - begun,
        "steps": sum(t.judged.steps for t in found if t.judged is not None),
        "violations": sum(t.failed for t in found),
    }


def compiled(report: Report) -> None:
    times = 2_000 if report.quick else 40_000
    table = report.table(
        f"One event of one of {ROBOTS} robots, CPU time",
        Column("event", "event"),
        Column("compiled_us", "compiled µs"),
        Column("reference_us", "reference µs", 1),
        Column("factor", "factor", 0),
        *LIMITS,
    )
    for number, name in enumerate(EVENTS):
        note(name)
        found = in_child(event, name, times)
        row = {"event": name, **found, "factor": found["reference_us"] / found["compiled_us"]}
        if number == 0:
            met = found["compiled_us"] <= EVENT_LIMIT_US
            row |= {"limit": f"{EVENT_LIMIT_US:g} µs", "met": met}
        table.rows.append(row)

    whole = report.table(
        "Whole rounds in one process, CPU time",
        Column("robots", "robots"),
        Column("round_us", "round µs", 0),
        Column("robot_rounds_per_s", "robot-rounds/s", 0),
        *LIMITS,
    )
    for robots in (1, 4, 8, 64, 256, 1_000):
        note(f"{robots} robots")
        found = in_child(rounds, robots, times)
        report.expect(found["right"], f"{robots} robots did not count right")
        met = found["robot_rounds_per_s"] >= ROUNDS_LIMIT_PER_S
        limit = f"{ROUNDS_LIMIT_PER_S:,.0f}/s"
        whole.rows.append({"robots": robots, **found, "limit": limit, "met": met})

    judged = report.table(
        "Generated programs, compiled, run for 8 rounds, and judged by the reference",
        Column("runs", "runs"),
        Column("steps", "steps"),
        Column("violations", "violations"),
        Column("cpu_s", "CPU s", 1),
        *LIMITS,
    )
    runs = 50 if report.quick else 1_000
    note(f"{runs} generated programs")
    found = in_child(refinement, runs, timeout_s=500)
    report.expect(found["violations"] == 0, "a compiled program does not refine its source")
    met = found["cpu_s"] <= 120
    judged.rows.append({"runs": runs, **found, "limit": "120 s", "met": met})


if __name__ == "__main__":
    sys.exit(main("compiled", __doc__ or "", compiled))
