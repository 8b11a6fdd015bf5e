"""Campaigns: what a run costs besides its rounds, and what more processes make of it.

The fixed cost is that of a run without rounds: from the order to INIT and the row, in CPU
milliseconds, after the first run of the process. *Anew* is the same with nothing kept from the run
before: text elaborated, program and claims compiled. Rows of the two have to be equal, with rounds,
too.

A campaign with two jobs has to tell the rows of one job. Its speed-up is of wall seconds, with the
start of interpreters and workers. What the machine has to give just then is measured beside: two
campaigns of one job at the same time in one session, each with half of the runs. On a machine that
others use no speed-up says much by itself; two jobs beside two campaigns do. Linux deals out cores
by sessions (autogroups): beside others all processes of one session together are given what one
would be, so that two jobs are no quicker than one there, and slower by what their start takes.
What is koord's own is the time in
which a job is at no run: it starts, hands out, waits for the last run. *Cores* are those that a
campaign was given on average: two jobs that were given one core are no quicker than one job, and a
campaign that was given 0.4 says nothing. Seconds in which nothing here went on at all (the machine
did something else, or somebody stopped the processes) are told and left out.

Campaigns that end when an interval is narrow enough have to end after the same runs with one job
and with two.
"""

from __future__ import annotations

import csv
import json
import os
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from harness import (
    EXAMPLES,
    LIMITS,
    Cell,
    Column,
    Measured,
    Report,
    in_child,
    limited,
    main,
    measure,
    note,
)

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
JOBS = (("task.krd", "task.yaml", 48, "30"), ("follow_path.krd", "", 240, "10"))
SPEED_UP = 1.8

#: It is looked so often whether anything goes on, and a look that is so late was kept from it, in
#: seconds.
_LOOK_S, _PAUSE_S = 0.05, 0.5


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
            rows.append(replace(row, wall_s=0.0, cpu_s=0.0, memory_mib=0.0, threads=0))
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
    _until(report)


def _jobs(report: Report) -> None:
    table = report.table(
        "Campaigns with --jobs",
        Column("campaign", "campaign"),
        Column("how", "how"),
        Column("runs", "runs"),
        Column("wall_s", "wall s"),
        Column("cpu_s", "CPU s"),
        Column("cores", "cores"),
        Column("beside_s", "s at no run"),
        Column("stopped_s", "s stopped"),
        Column("speed_up", "speed-up"),
        Column("least", "least"),
        Column("load", "load before"),
    )
    for program, configuration, runs, time_s in JOBS:
        runs = runs // 6 if report.quick else runs
        files = [str(EXAMPLES / one) for one in (program, configuration) if one]
        name = " ".join(filter(None, (program, configuration)))

        half, rest = str(runs // 2), str(runs - runs // 2)
        tries: dict[str, list[list[str]]] = {
            "one job": [["--runs", str(runs)]],
            "two jobs": [["--runs", str(runs), "--jobs", "2"]],
            "two campaigns": [["--runs", half], ["--runs", rest, "--seed", half]],
        }
        walls, told = dict[str, float](), dict[str, list[dict[str, str]]]()
        for how, words in tries.items():
            note(f"{name}, {how}")
            load = os.getloadavg()[0]
            with Pauses() as pauses:
                made = _campaigns([[*files, "--time", time_s, *one] for one in words])
            if not report.expect(made.done.code in (0, 1, 5), how):
                return
            wall_s, cpu_s, jobs = made.done.wall_s, made.done.cpu_s, 1 + (how != "one job")
            walls[how] = wall_s - pauses.stopped_s
            told[how] = made.rows
            table.rows.append(
                {
                    "campaign": name,
                    "how": how,
                    "runs": runs,
                    "wall_s": round(walls[how], 2),
                    "cpu_s": round(cpu_s, 2),
                    "cores": round(cpu_s / walls[how], 2),
                    "beside_s": round(wall_s - made.at_runs_s / jobs, 2),
                    "stopped_s": round(pauses.stopped_s, 1),
                    "speed_up": round(walls["one job"] / walls[how], 2),
                    "least": SPEED_UP if how == "two jobs" else None,
                    "load": round(load, 1),
                }
            )
        first = _nameless(told["one job"])
        same = all(_nameless(rows) == first for rows in told.values())
        report.expect(same, f"{name}: rows hang on who makes them")


def _until(report: Report) -> None:
    table = report.table(
        "Campaigns that end when an interval is narrow enough",
        Column("until", "until"),
        Column("jobs", "jobs"),
        Column("runs", "runs"),
        Column("low", "from", places=3),
        Column("high", "to", places=3),
        Column("cpu_s", "CPU s"),
    )
    files = [str(EXAMPLES / "task.krd"), str(EXAMPLES / "task.yaml"), "--time", "3"]
    for until in ("distance=0.2", "broken=0.08"):
        ends = set()
        for jobs in ("1", "2"):
            made = _campaign(*files, "--until", until, "--jobs", jobs, "--json")
            if not report.expect(
                made.done.code in (0, 1, 5), f"{until}: {made.done.errors[-300:]}"
            ):
                return
            (found,) = made.done.json()["intervals"].values()
            ends.add((len(made.rows), found["low"], found["high"]))
            bounds = {"low": found["low"], "high": found["high"]}
            cells: dict[str, Cell] = {"until": until, "jobs": int(jobs), "runs": len(made.rows)}
            table.rows.append(cells | bounds | {"cpu_s": round(made.done.cpu_s, 2)})
        report.expect(len(ends) == 1, f"{until}: the end hangs on the number of jobs")


class Made(NamedTuple):
    """A campaign that was made, and its rows without what hangs on the clock."""

    done: Measured
    rows: list[dict[str, str]]
    at_runs_s: float  #: on the wall, of all jobs together


class Pauses:
    """How long nothing went on within the context: a thread that looks often has not looked."""

    def __init__(self) -> None:
        self.stopped_s = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> Pauses:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _look(self) -> None:
        last_s = time.perf_counter()
        while not self._over.wait(_LOOK_S):
            now_s = time.perf_counter()
            if now_s - last_s > _PAUSE_S:
                self.stopped_s += now_s - last_s - _LOOK_S
            last_s = now_s


#: Runs commands at the same time, in one session; its exit code is the last one.
_TOGETHER = """
import json, subprocess, sys
begun = [subprocess.Popen(words) for words in json.loads(sys.argv[1])]
sys.exit(max([one.wait() for one in begun], key=lambda code: (code not in (0, 1, 5), code)))
"""


def _campaign(*words: str) -> Made:
    return _campaigns([words])


def _campaigns(each: Sequence[Sequence[str]]) -> Made:
    """Campaigns at the same time, and the rows of all."""
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"runs{k}.csv" for k in range(len(each))]
        commands = [
            [sys.executable, "-m", "koord", "sim", *words, "--csv", str(file)]
            for words, file in zip(each, files, strict=True)
        ]
        if len(commands) == 1:
            done = measure(commands[0], timeout_s=900)
        else:
            together = [sys.executable, "-c", _TOGETHER, json.dumps(commands)]
            done = measure(together, timeout_s=900)
        found = [_rows(file) for file in files if file.exists()]
        rows = [row for one, _ in found for row in one]
        return Made(done, rows, sum(took_s for _, took_s in found))


def _nameless(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Rows without the name of their campaign, which hangs on the first seed."""
    return [{k: v for k, v in row.items() if k != "campaign"} for row in rows]


def _rows(path: Path) -> tuple[list[dict[str, str]], float]:
    """The rows of a campaign without what hangs on the clock, and the seconds that all took."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    took_s = sum(float(row.pop("wall_s")) for row in rows)
    for row in rows:
        for measured in ("cpu_s", "memory_mib", "threads"):
            row.pop(measured)
    return rows, took_s


if __name__ == "__main__":
    sys.exit(main("campaigns", __doc__, campaigns))
