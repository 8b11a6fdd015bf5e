"""Robots as processes over UDP on this machine: rounds a second, late rounds, datagrams a round.

Late means that a robot's proposal was not there at the deadline, so that it skipped. Robots count
together (leader_elect.krd). The datagrams are all that were sent in the run, starting included; a
multicast counts once; the paper's middleware sends N² packets. On a busy machine robots are late
because they do not get to run. What robots take of a processor is that of all processes, reports
and claims included, without the start: a shorter run is subtracted.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from harness import EXAMPLES, Column, Report, main, measure, note
from protocol import plot

PROGRAM = str(EXAMPLES / "leader_elect.krd")


@dataclass(frozen=True, slots=True)
class Case:
    """A run: how many robots, how long its rounds are (0: as fast as it goes), how many.

    ``processes`` share the robots; None: each has its own.
    """

    robots: int
    delta_s: float
    rounds: int
    processes: int | None = None


CASES = (
    Case(8, 0.0, 3000),
    Case(8, 0.0, 3000, processes=2),
    Case(8, 0.0, 3000, processes=1),
    Case(64, 0.0, 400),
    Case(64, 0.0, 400, processes=2),
    *(Case(robots, 0.1, 600) for robots in (4, 8, 16, 32, 64, 128)),
)
QUICK = (Case(4, 0.0, 50), Case(4, 0.05, 20))


def words(case: Case, folder: Path) -> list[str]:
    config = folder / f"{case.robots}.yaml"
    config.write_text(f"num_robots: {case.robots}\n", encoding="utf-8")
    pace = ["--delta", str(case.delta_s)] if case.delta_s else ["--as-fast-as-possible"]
    if case.processes is not None:
        pace += ["--processes", str(case.processes)]
    run = [PROGRAM, str(config), "--all-local", "--json", "--rounds", str(case.rounds), *pace]
    return [sys.executable, "-m", "koord", "deploy", *run]


def benchmark(report: Report) -> None:
    table = report.table(
        "Rounds over UDP",
        Column("robots", "robots"),
        Column("processes", "processes"),
        Column("delta_s", "δ s", 2),
        Column("rounds", "rounds"),
        Column("per_s", "rounds/s", 1),
        Column("late", "late, % of robot-rounds", 2),
        Column("overdue", "rounds 1.5 δ or longer"),
        Column("datagrams", "datagrams a round", 1),
        Column("limit", "2N + 2"),
        Column("paper", "paper: N²"),
        Column("cpu_s", "CPU s", 1),
        Column("cpu_us", "CPU µs a robot and round", 0),
        Column("load", "load", 1),
    )
    with tempfile.TemporaryDirectory() as folder:
        for case in QUICK if report.quick else CASES:
            note(f"{case.robots} robots")
            load = os.getloadavg()[0]
            done = measure(words(case, Path(folder)), timeout_s=300)
            said = done.json()
            told = f"{case}: code {done.code}, {done.errors[-300:]}"
            if not report.expect(done.code == 0 and said is not None, told):
                continue
            robots, cpu_us = said["robots"], None
            if not case.delta_s:
                begun = Case(case.robots, 0.0, case.rounds // 6, case.processes)
                start = measure(words(begun, Path(folder)), timeout_s=300)
                spent_s = done.cpu_s - start.cpu_s
                cpu_us = 1e6 * spent_s / (case.rounds - begun.rounds) / case.robots
            report.expect({r["round"] for r in robots} == {case.rounds}, f"{case}: not all done")
            table.rows.append(
                {
                    "robots": case.robots,
                    "processes": case.processes or case.robots,
                    "delta_s": case.delta_s,
                    "rounds": case.rounds,
                    "per_s": (case.rounds - 1) / max(r["took_s"] for r in robots),
                    "late": 100 * sum(r["late"] for r in robots) / case.robots / case.rounds,
                    "overdue": max(r["overdue"] for r in robots) if case.delta_s else None,
                    "datagrams": sum(r["sent"] for r in robots) / (case.rounds + 1),
                    "limit": 2 * case.robots + 2,
                    "paper": case.robots**2,
                    "cpu_s": done.cpu_s,
                    "cpu_us": cpu_us,
                    "load": load,
                }
            )
    if not report.quick:
        plot([row for row in table.rows if row["delta_s"]], "deployed")


if __name__ == "__main__":
    sys.exit(main("deployed", __doc__ or "", benchmark))
