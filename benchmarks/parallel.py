"""``koord verify --jobs 2`` beside ``--jobs 1``: what the second core is good for.

*Gain* is the time on the clock of one process over that of two; it says nothing where other work
goes on, which is why CPU times stand beside it: what two processes take more of them is the price
of sharing. What is printed must be the same, except for times.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from typing import Any

from harness import BENCHMARKS, EXAMPLES, NOTHING, Column, Measured, Report, koord, main, note

PATIENCE_S = 600.0

JOBS = 2


@dataclass(frozen=True)
class Question:
    """A command, and its exit code. ``what`` is done at a time."""

    what: str
    files: tuple[str, ...]
    flags: str
    code: int = 0

    @property
    def words(self) -> list[str]:
        return [*(str(EXAMPLES / f"{file}.krd") for file in self.files), *self.flags.split()]


WHOLE_RUNS = f"--with {BENCHMARKS / 'programs' / 'task_whole_runs.krd'}"
QUESTIONS = (
    Question("whole runs", ("task",), f"{WHOLE_RUNS} --robots 5 --set tasks=5"),
    Question("whole runs", ("task",), f"{WHOLE_RUNS} --robots 8 --set tasks=8"),
    Question("rounds", ("sats",), "--engine bmc --robots 4 --delta 1"),
    Question("rounds", ("task",), "--engine bmc --robots 3 --rounds 6", 3),
    Question("numbers of robots", ("task",), "--robots 2..8"),
    Question("numbers of robots", ("sats",), "--robots 2..5 --delta 5"),
    Question(
        "programs",
        ("delivery", "mapping", "traffic", "lineform", "sum_of_ids", "fischer", "waypoints"),
        "--robots 4",
    ),
    Question("other violations", ("broken/delivery_no_lock",), "--max-violations 4", 1),
)


def asked(question: Question, jobs: int) -> Measured:
    note(f"{question.what}: {' '.join(question.files)}, {jobs} at a time")
    words = (*question.words, "--jobs", str(jobs), "--json")
    return koord("verify", *words, timeout_s=PATIENCE_S)


def timeless(found: Any) -> Any:
    """What was printed, without times."""
    match found:
        case dict():
            return {k: timeless(v) for k, v in found.items() if k not in ("seconds", "time_s")}
        case list():
            return [timeless(each) for each in found]
        case _:
            return found


def parallel(report: Report) -> None:
    table = report.table(
        f"--jobs {JOBS} beside --jobs 1 ({os.cpu_count()} cores)",
        Column("what", "at a time"),
        Column("program", "program"),
        Column("flags", "flags"),
        Column("wall_1_s", "wall s, 1"),
        Column("wall_s", f"wall s, {JOBS}"),
        Column("gain", "gain"),
        Column("cpu_1_s", "CPU s, 1"),
        Column("cpu_s", f"CPU s, {JOBS}"),
        Column("load", "load", 1),
    )
    for question in QUESTIONS[:1] if report.quick else QUESTIONS:
        one, several = asked(question, 1), asked(question, JOBS)
        story = f"{question.what}, {' '.join(question.files)}: "
        for done in (one, several):
            report.expect(
                done.code == question.code, f"{story}{done.code} {done.errors.strip()[-300:]}"
            )
        report.expect(timeless(one.json()) == timeless(several.json()), f"{story}answers differ")
        table.rows.append(
            {
                "what": question.what,
                "program": question.files[0] if len(question.files) == 1 else "several",
                "flags": question.flags.removeprefix(f"{WHOLE_RUNS} ") or NOTHING,
                "wall_1_s": round(one.wall_s, 3),
                "wall_s": round(several.wall_s, 3),
                "gain": round(one.wall_s / several.wall_s, 2),
                "cpu_1_s": round(one.cpu_s, 3),
                "cpu_s": round(several.cpu_s, 3),
                "load": round(os.getloadavg()[0], 1),
            }
        )


if __name__ == "__main__":
    sys.exit(main("parallel", __doc__ or "", parallel))
