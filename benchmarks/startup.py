"""The CPU time of starting koord, the best of several runs.

The limit is 0.15 s for ``koord --help``, and what reads a program has limits of its own: it loads
the parser and the checker as well, and ``koord verify`` engines and a solver. Simulated fleets of
*Squares* (``benchmarks/simulated.py``) are measured until their first round begins: then all is
read, checked, compiled and placed, and INIT is over. Those limits are 0.5 s for 16 robots and
1.5 s for 10,000.
"""

from __future__ import annotations

import sys
import tempfile
from functools import partial
from pathlib import Path

from harness import (
    EXAMPLES,
    LIMITS,
    Cell,
    Column,
    Measured,
    Report,
    best,
    limited,
    main,
    measure,
    note,
)
from simulated import SQUARES, squares

LIMIT_S = 0.15
CHECK_S = 0.25
VERIFY_S = 0.35

TASK = str(EXAMPLES / "task.krd")
LEADER = str(EXAMPLES / "leader_elect.krd")

#: What is started, its words, and its limit in seconds of CPU, if it has one.
PROGRAMS: tuple[tuple[str, tuple[str, ...], float | None], ...] = (
    ("python -c pass", ("-c", "pass"), None),
    ("import koord", ("-c", "import koord"), LIMIT_S),
    ("koord --help", ("-m", "koord", "--help"), LIMIT_S),
    ("koord explain K204", ("-m", "koord", "explain", "K204"), LIMIT_S),
    ("koord check --help", ("-m", "koord", "check", "--help"), None),
    ("koord check task.krd", ("-m", "koord", "check", TASK), CHECK_S),
    ("koord fmt --check task.krd", ("-m", "koord", "fmt", "--check", TASK), None),
    ("koord verify --help", ("-m", "koord", "verify", "--help"), None),
    ("koord verify leader_elect.krd", ("-m", "koord", "verify", LEADER), VERIFY_S),
)

#: `koord sim` until the first round would begin.
UNTIL_FIRST_ROUND = """\
import os
from koord.cli.lazy_resources import load_msgspec, put_off
put_off()
load_msgspec()
from koord.cli.main import entry
from koord.sim.running import Simulation
Simulation.round = lambda run: os._exit(0)
entry()
"""

#: Devices, robots, and the limit in seconds of CPU.
FLEETS = (
    ("drone", 16, 0.5),
    ("car", 16, 0.5),
    ("drone", 1_000, None),
    ("drone", 10_000, 1.5),
    ("car", 10_000, 1.5),
)


#: What all that is started costs.
COSTS = (
    Column("cpu_s", "CPU s", 3),
    Column("wall_s", "wall s", 3),
    Column("peak_mib", "MiB", 0),
    *LIMITS,
)


def costs(done: Measured, limit_s: float | None) -> dict[str, Cell]:
    """The cells of these columns."""
    return {
        "cpu_s": round(done.cpu_s, 4),
        "wall_s": round(done.wall_s, 4),
        "peak_mib": round(done.peak_mib, 1),
        **limited(done.cpu_s, limit_s, "s CPU"),
    }


def startup(report: Report) -> None:
    """Commands, then fleets."""
    commands(report)
    fleets(report)


def fleets(report: Report) -> None:
    """What passes before the first round of a simulated fleet."""
    runs = 2 if report.quick else 7
    table = report.table(
        f"Until the first round, best of {runs}",
        Column("device", "robots of kind"),
        Column("count", "robots", 0),
        *COSTS,
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = folder / "squares.krd"
        program.write_text(SQUARES, "utf-8")
        for device, count, limit_s in FLEETS:
            note(f"{count} robots of kind {device}")
            fleet = folder / f"{device}_{count}.yaml"
            fleet.write_text(squares((device,), count), "utf-8")
            words = ("-c", UNTIL_FIRST_ROUND, "sim", str(program), str(fleet), "--no-html")
            done = best(runs, partial(measure, [sys.executable, *words], timeout_s=60))
            told = f"{count} robots of kind {device}: exit code {done.code}, {done.errors[-500:]}"
            report.expect(done.code == 0, told)
            table.rows.append(
                {
                    "device": device,
                    "count": count,
                    **costs(done, limit_s),
                }
            )


def commands(report: Report) -> None:
    """Commands, to their end."""
    runs = 3 if report.quick else 15
    table = report.table(
        f"Starting, best of {runs}",
        Column("what", "what"),
        *COSTS,
    )
    for what, words, limit_s in PROGRAMS:
        note(what)
        done = best(runs, partial(measure, [sys.executable, *words], timeout_s=30))
        report.expect(done.code in (0, 1), f"{what}: exit code {done.code}, {done.errors[-500:]}")
        table.rows.append(
            {
                "what": what,
                **costs(done, limit_s),
            }
        )


if __name__ == "__main__":
    sys.exit(main("startup", __doc__ or "", startup))
