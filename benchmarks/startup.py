"""The CPU time of starting koord, the best of several runs.

The limit is 0.15 s for ``koord --help``, and what reads a program has limits of its own: it loads
the parser and the checker as well, and ``koord verify`` engines and a solver.
"""

from __future__ import annotations

import sys
from functools import partial

from harness import EXAMPLES, LIMITS, Column, Report, best, limited, main, measure, note

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


def startup(report: Report) -> None:
    runs = 3 if report.quick else 15
    table = report.table(
        f"Starting, best of {runs}",
        Column("what", "what"),
        Column("cpu_s", "CPU s", 3),
        Column("wall_s", "wall s", 3),
        Column("peak_mib", "MiB", 0),
        *LIMITS,
    )
    for what, words, limit_s in PROGRAMS:
        note(what)
        done = best(runs, partial(measure, [sys.executable, *words], timeout_s=30))
        report.expect(done.code in (0, 1), f"{what}: exit code {done.code}, {done.errors[-500:]}")
        table.rows.append(
            {
                "what": what,
                "cpu_s": round(done.cpu_s, 4),
                "wall_s": round(done.wall_s, 4),
                "peak_mib": round(done.peak_mib, 1),
                **limited(done.cpu_s, limit_s, "s CPU"),
            }
        )


if __name__ == "__main__":
    sys.exit(main("startup", __doc__ or "", startup))
