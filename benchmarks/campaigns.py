"""Campaigns: what a run costs besides its rounds, and what more processes make of it.

The fixed cost is that of a run without rounds: from the order to INIT and the row, in CPU
milliseconds, after the first run of the process. *Anew* is the same with nothing kept from the run
before: text elaborated, program and claims compiled. Rows of the two have to be equal, with rounds,
too.

A campaign with several jobs has to tell the rows of one job. Its speed-up is of wall seconds, with
the start of interpreters and workers, and says little on a machine that others use: the CPU
seconds say how much of it is more work.
"""

from __future__ import annotations

import csv
import os
import sys
import tempfile
import time
from pathlib import Path

from harness import EXAMPLES, LIMITS, Cell, Column, Report, in_child, koord, limited, main, note

#: Program and configuration.
FIXED = (
    ("task.krd", "task.yaml"),
    ("task.krd", "task_mixed.yaml"),
    ("delivery.krd", "delivery.yaml"),
    ("lineform.krd", "lineform.yaml"),
    ("shapeform.krd", "shapeform_36.yaml"),
    ("mapping.krd", "mapping.yaml"),
    ("follow_path.krd", ""),
    ("fischer.krd", ""),
)

#: So much a run may cost besides its rounds, in CPU milliseconds.
FIXED_MS = 5.0

#: Program, configuration, runs, simulated seconds, and the least speed-up by two jobs.
JOBS = (("task.krd", "task.yaml", 60, "60"), ("follow_path.krd", "", 200, "20"))
SPEED_UP = 1.8


def fixed(program: str, configuration: str, runs: int) -> list[Cell]:
    """CPU milliseconds of a run, kept and anew, and whether rows are equal."""
    from msgspec.structs import replace

    from koord.api.campaign_runs import Order, Row, row_of
    from koord.api.fitting import fit_request
    from koord.api.reseeding import Reseeding

    config = str(EXAMPLES / configuration) if configuration else None
    request = fit_request(str(EXAMPLES / program), config, None, None, 0, None)

    def made(first: int, count: int, time_s: float) -> tuple[list[Row], float]:
        began, rows = time.process_time(), []
        for seed in range(first, first + count):
            row = row_of(Order(replace(request, seed=seed), None, time_s, False, ""))
            assert row is not None
            rows.append(replace(row, wall_s=0.0))
        return rows, (time.process_time() - began) / count * 1e3

    made(0, 1, 0.0)
    rows, kept_ms = made(1, runs, 0.0)
    moved, _ = made(1, 3, 1.0)
    Reseeding._fitted = lambda *_: None  # type: ignore[method-assign]
    others, anew_ms = made(1, max(runs // 4, 3), 0.0)
    equal = others == rows[: len(others)] and made(1, 3, 1.0)[0] == moved
    return [round(kept_ms, 3), round(anew_ms, 3), equal]


def campaigns(report: Report) -> None:
    """All tables."""
    table = report.table(
        "A run without rounds, CPU ms",
        Column("program", "program"),
        Column("kept_ms", "ms"),
        Column("anew_ms", "anew, ms"),
        *LIMITS,
    )
    for program, configuration in FIXED:
        note(program)
        kept_ms, anew_ms, equal = in_child(
            fixed, program, configuration, 12 if report.quick else 60
        )
        name = f"{program} {configuration}".strip()
        report.expect(bool(equal), f"{name}: rows differ from those of runs made anew")
        limits = limited(kept_ms, FIXED_MS, "ms CPU")
        table.rows.append({"program": name, "kept_ms": kept_ms, "anew_ms": anew_ms, **limits})
    _jobs(report)


def _jobs(report: Report) -> None:
    table = report.table(
        "Campaigns with --jobs",
        Column("campaign", "campaign"),
        Column("jobs", "jobs"),
        Column("wall_s", "wall s"),
        Column("cpu_s", "CPU s"),
        Column("speed_up", "speed-up"),
        Column("least", "least"),
        Column("load", "load before"),
    )
    for program, configuration, runs, time_s in JOBS:
        runs = runs // 6 if report.quick else runs
        name = " ".join(filter(None, (program, configuration, f"× {runs}")))
        told, walls = [], []
        for jobs in (1, 2):
            note(f"{name}, {jobs} jobs")
            load = os.getloadavg()[0]
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "runs.csv"
                files = [str(EXAMPLES / one) for one in (program, configuration) if one]
                words = ["--runs", str(runs), "--time", time_s, "--jobs", str(jobs)]
                done = koord("sim", *files, *words, "--csv", str(file), timeout_s=900)
                if not report.expect(done.code in (0, 1, 5), f"{name}: {done.errors[-300:]}"):
                    return
                told.append(_rows(file))
            walls.append(done.wall_s)
            row: dict[str, Cell] = {
                "campaign": name,
                "jobs": jobs,
                "wall_s": round(done.wall_s, 2),
                "cpu_s": round(done.cpu_s, 2),
                "load": round(load, 1),
            }
            more = {"speed_up": round(walls[0] / done.wall_s, 2), "least": SPEED_UP}
            table.rows.append(row | (more if jobs > 1 else {}))
        report.expect(told[0] == told[1], f"{name}: rows hang on the number of jobs")


def _rows(path: Path) -> list[dict[str, str]]:
    """The rows of a campaign, without what hangs on the clock."""
    with path.open(encoding="utf-8", newline="") as file:
        return [{k: v for k, v in row.items() if k != "wall_s"} for row in csv.DictReader(file)]


if __name__ == "__main__":
    sys.exit(main("campaigns", __doc__, campaigns))
