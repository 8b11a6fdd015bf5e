"""``koord run``: how many rounds a second it makes, all claims watched and the trace told.

A long run and a short one of each program: what the long one costs more is what its rounds cost,
without the start. Runs by code are the rules' own to the last draw (tests/agreement).
"""

from __future__ import annotations

import sys
from functools import partial

from harness import EXAMPLES, Column, Measured, Report, best, koord, main, note

#: Programs, robots, and the rounds of the short run and of the long one.
ROWS = (
    ("fischer.krd", 10, 200, 20_000),
    ("leader_elect.krd", 10, 200, 20_000),
    ("sum_of_ids.krd", 10, 200, 20_000),
    ("sats.krd", 10, 200, 20_000),
)

#: So many rounds of Fischer's protocol a second are wanted: fifty times what the rules alone made.
WANTED = {"fischer.krd": 6_250}


def run(name: str, robots: int, rounds: int) -> Measured:
    path = str(EXAMPLES / name)
    words = ["--robots", str(robots), "--rounds", str(rounds), "--policy", "random"]
    return koord("run", path, *words, timeout_s=120)


def runs(report: Report) -> None:
    table = report.table(
        "koord run",
        Column("program", "program"),
        Column("robots", "robots"),
        Column("rounds", "rounds"),
        Column("cpu_s", "CPU s"),
        Column("rounds_s", "rounds/s", places=0),
        Column("wanted", "wanted"),
    )
    for name, robots, few, many in ROWS:
        note(name)
        many = few + (many - few) // (4 if report.quick else 1)
        tries = 1 if report.quick else 3
        short = best(tries, partial(run, name, robots, few))
        long = best(tries, partial(run, name, robots, many))
        if not report.expect(short.code == long.code == 0, f"{name}: {long.errors[-300:]}"):
            continue
        made = (many - few) / (long.cpu_s - short.cpu_s)
        table.rows.append(
            {
                "program": name,
                "robots": robots,
                "rounds": many,
                "cpu_s": round(long.cpu_s, 3),
                "rounds_s": round(made),
                "wanted": WANTED.get(name),
            }
        )


if __name__ == "__main__":
    sys.exit(main("runs", __doc__, runs))
