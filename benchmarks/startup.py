"""The CPU time of starting koord, the best of several runs.

The limit is 0.15 s for ``koord --help``. The commands that read a program load the parser and the
checker as well, and have no limit of their own; it is shown how far they are from that one.
"""

from __future__ import annotations

import sys
from functools import partial

from harness import EXAMPLES, LIMITS, Column, Report, best, limited, main, measure, note

LIMIT_S = 0.15

TASK = str(EXAMPLES / "task.krd")

#: What is started, its words, and whether the limit is its own.
PROGRAMS: tuple[tuple[str, tuple[str, ...], bool], ...] = (
    ("python -c pass", ("-c", "pass"), False),
    ("import koord", ("-c", "import koord"), True),
    ("koord --help", ("-m", "koord", "--help"), True),
    ("koord explain K204", ("-m", "koord", "explain", "K204"), True),
    ("koord check --help", ("-m", "koord", "check", "--help"), False),
    ("koord check task.krd", ("-m", "koord", "check", TASK), False),
    ("koord fmt --check task.krd", ("-m", "koord", "fmt", "--check", TASK), False),
    ("koord verify --help", ("-m", "koord", "verify", "--help"), False),
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
    for what, words, has_limit in PROGRAMS:
        note(what)
        done = best(runs, partial(measure, [sys.executable, *words], timeout_s=30))
        report.expect(done.code in (0, 1), f"{what}: exit code {done.code}, {done.errors[-500:]}")
        table.rows.append(
            {
                "what": what,
                "cpu_s": round(done.cpu_s, 4),
                "wall_s": round(done.wall_s, 4),
                "peak_mib": round(done.peak_mib, 1),
                **limited(done.cpu_s, LIMIT_S if has_limit else None, "s CPU"),
            }
        )


if __name__ == "__main__":
    sys.exit(main("startup", __doc__ or "", startup))
