"""The reference interpreter: events per second, and ``koord run`` for 10 robots and 1,000 rounds.

*Rules alone* is a recorded run made again by the rules: nothing is chosen, nothing watched.
*Run* is the same run in the making: a policy asks which events are enabled, arbitrary values are
drawn such that assumptions hold, and every invariant is looked at after every step.
"""

from __future__ import annotations

import sys
import time
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

from harness import EXAMPLES, TIMES, Cell, Column, Report, in_child, koord, main, note, times

ROBOTS = 10
ROUNDS = 1_000
DELTA_S = 1

#: Programs, the numbers that they run on, and the policy.
RUNS: tuple[tuple[str, str, str], ...] = (
    ("sum_of_ids", "exact", "first"),
    ("lineform", "exact", "first"),
    ("lineform", "double", "first"),
    ("task", "exact", "first"),
    ("task", "exact", "random"),
    ("fischer", "exact", "random"),
    ("fischer", "double", "random"),
)


def interpreted(name: str, numbers_name: str, policy_name: str, rounds: int) -> dict[str, Any]:
    """CPU seconds and numbers of steps of a run, and of the same run made again."""
    from koord.sampling.monitors import Monitor
    from koord.sampling.policies import AtRandom, First, Play
    from koord.sampling.running import new_run
    from koord.semantics.recordings import execute
    from koord.syntax.load import load
    from koord.syntax.source import Source
    from koord.syntax.system import dealt
    from koord.traces.trace import Numbers

    path = EXAMPLES / f"{name}.krd"
    program = load(Source(path.name, Path(path).read_text("utf-8"))).program
    assert program is not None
    system, numbers, rng = (
        dealt(program, ROBOTS, Fraction(DELTA_S)),
        Numbers(numbers_name),
        Random(0),
    )
    run = new_run(system, numbers, rng)
    policy = First() if policy_name == "first" else AtRandom(rng)
    play = Play(run, policy, rounds, Monitor(run.d, system, run.inputs))
    begun = time.process_time()
    rules = [taken.step.rule for taken in play.steps()]
    made = time.process_time()
    again = [step.rule for step in execute(numbers.domain, system, play.recording())]
    done = time.process_time()
    return {
        "rounds": run.round,
        "events": rules.count("EVENT-TRANS"),
        "steps": len(rules),
        "same": rules == again,
        "broken": play.violation is not None or run.configuration.fault is not None,
        "run_s": made - begun,
        "rules_s": done - made,
    }


def interpreter(report: Report, rounds: int) -> None:
    table = report.table(
        f"The interpreter, {ROBOTS} robots, at most {rounds} rounds, CPU time without start-up",
        Column("program", "program"),
        Column("numbers", "numbers"),
        Column("policy", "policy"),
        Column("rounds", "rounds"),
        Column("events", "events"),
        Column("steps", "steps"),
        Column("rules_s", "rules alone s"),
        Column("rules_per_s", "steps/s", 0),
        Column("run_s", "run s"),
        Column("run_per_s", "steps/s", 0),
    )
    for name, numbers, policy in RUNS:
        note(f"{name}, {numbers}, {policy}")
        found = in_child(interpreted, name, numbers, policy, rounds, timeout_s=300)
        what = f"{name}, {numbers}, {policy}"
        report.expect(found["same"], f"{what}: the run made again is another")
        report.expect(
            not found["broken"], f"{what}: a fault or a violation in a program that holds"
        )
        row: dict[str, Cell] = {"program": name, "numbers": numbers, "policy": policy, **found}
        row["rules_per_s"] = found["steps"] / found["rules_s"]
        row["run_per_s"] = found["steps"] / found["run_s"]
        table.rows.append(row)


def commands(report: Report, rounds: int) -> None:
    table = report.table(
        f"koord run --robots {ROBOTS} --rounds {rounds} --delta {DELTA_S}, with start-up",
        Column("program", "program"),
        Column("numbers", "--numbers"),
        Column("policy", "--policy"),
        *TIMES,
        Column("output_mib", "output MiB", 1),
    )
    for name, numbers, policy in RUNS:
        note(f"koord run {name}, {numbers}, {policy}")
        done = koord(
            *("run", str(EXAMPLES / f"{name}.krd"), "--numbers", numbers, "--policy", policy),
            *("--robots", str(ROBOTS), "--rounds", str(rounds), "--delta", str(DELTA_S)),
            timeout_s=300,
        )
        ending = "too long" if done.timed_out else f"exit code {done.code}: {done.errors[-300:]}"
        report.expect(done.code == 0, f"koord run {name}: {ending}")
        table.rows.append(
            {
                "program": name,
                "numbers": numbers,
                "policy": policy,
                **times(done),
                "output_mib": len(done.output) / 2**20,
            }
        )


def semantics(report: Report) -> None:
    rounds = ROUNDS // 10 if report.quick else ROUNDS
    interpreter(report, rounds)
    commands(report, rounds)


if __name__ == "__main__":
    sys.exit(main("semantics", __doc__ or "", semantics))
