"""Minutes on a bad Ethernet: rounds, refinement, and how soon a dead coordinator is succeeded.

Eight robots, one process and one network namespace each; every frame passes a hub that loses 30 %,
doubles 5 %, and delays by up to 50 ms, so that frames overtake each other. Everything that robots
did is judged by the reference semantics. A run in which all robots stop is begun again until the
time is over. Needs Linux, and root. *Succeeded* is the time from the coordinator's death to the
first decision of another; the limit is 5 δ and the timeout of silence.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass

from harness import EXAMPLES, Column, Report, main, note
from koord.refinement.deployed import Expedition
from koord.refinement.running import ready
from koord.runtime.chaos.network import Faults
from koord.runtime.protocol.setup import Timing
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.traces.trace import Sources
from tests.refinement.ethernet import why_not
from tests.refinement.storms import Stormy, storm

ROBOTS = 8
DELTA_S = 0.1
CLEAN = Faults(least_delay_s=0.0, most_delay_s=0.0)
STORM = Faults(loss=0.3, duplication=0.05, least_delay_s=0.0, most_delay_s=0.05)

#: Least progress on the bad network, of that on the clean one.
LEAST = 0.8


@dataclass(frozen=True, slots=True)
class Case:
    """A network, for so long."""

    name: str
    faults: Faults
    lasts_s: float
    kill_every_s: float | None = None


CASES = (
    Case("clean", CLEAN, 60.0),
    Case("storm", STORM, 600.0),
    Case("clean, coordinator killed", CLEAN, 120.0, 20.0),
    Case("storm, coordinator killed", STORM, 120.0, 20.0),
)
QUICK = (
    Case("clean", CLEAN, 4.0),
    Case("storm", STORM, 8.0),
    Case("storm, coordinator killed", STORM, 10.0, 4.0),
)

PROGRAMS = ("sum_of_ids", "leader_elect", "task")


def runs(name: str, case: Case) -> list[Stormy]:
    """Runs of a program that together last as long as the case says."""
    path = EXAMPLES / f"{name}.krd"
    source = Source(path.name, path.read_text("utf-8"))
    program = load(source).program
    assert program is not None
    made, system = ready(program), dealt(program, ROBOTS)
    done: list[Stormy] = []
    left_s = case.lasts_s
    while left_s > 1.0:
        lasts_s = min(left_s, 60.0)
        expedition = Expedition(made, system, Sources(source), None, len(done))
        done.append(storm(expedition, case.faults, lasts_s, case.kill_every_s))
        left_s -= max(done[-1].took_s, 1.0)
    return done


def benchmark(report: Report, programs: tuple[str, ...] = PROGRAMS) -> None:
    limit_s = 5 * DELTA_S + Timing.of(DELTA_S, ROBOTS).silence_s
    table = report.table(
        f"{ROBOTS} robots in network namespaces, δ = {DELTA_S} s",
        Column("program", "program"),
        Column("network", "network"),
        Column("runs", "runs"),
        Column("took_s", "s", 0),
        Column("rounds", "rounds"),
        Column("progress", f"of the clean network (≥ {LEAST})", 2),
        Column("steps", "steps judged"),
        Column("refused", "refused"),
        Column("kills", "coordinators killed"),
        Column("longest", f"succeeded after at most s (≤ {limit_s:.1f})", 2),
        Column("load", "load", 1),
    )
    reason = why_not()
    if reason is not None:
        note(f"left out: {reason}")
        return
    for program in programs:
        clean = 0.0
        for case in QUICK if report.quick else CASES:
            note(f"{program}, {case.name}")
            done = runs(program, case)
            rounds, took_s = sum(run.rounds for run in done), sum(run.took_s for run in done)
            progress = rounds / took_s / clean if clean else 1.0
            clean = clean or rounds / took_s
            refused = [run.judged.refused for run in done if run.judged.refused is not None]
            successions = [after_s for run in done for after_s in run.successions]
            what = f"{program}, {case.name}"
            report.expect(not refused, f"{what}: {refused[:1]}")
            table.rows.append(
                {
                    "program": program,
                    "network": case.name,
                    "runs": len(done),
                    "took_s": took_s,
                    "rounds": rounds,
                    "progress": progress,
                    "steps": sum(run.judged.steps for run in done),
                    "refused": len(refused),
                    "kills": sum(run.kills for run in done),
                    "longest": max(successions, default=None),
                    "load": os.getloadavg()[0],
                }
            )


if __name__ == "__main__":
    sys.exit(main("storms", __doc__ or "", benchmark))
