"""``koord verify`` with 64 robots: proofs for every number of robots, and what makes them say less.

What is proved is the same for any number, and what never happens is looked for with a few: so the
number that is asked for is to cost nothing. Limits are on seconds of the clock, from start to end.
"""

from __future__ import annotations

import sys
from functools import partial

from harness import EXAMPLES, LIMITS, TIMES, Column, Report, best, koord, limited, main, note, times

ROBOTS = 64
PATIENCE_S = 60.0

#: What is verified, and its limit in seconds of the clock.
PROGRAMS = (("task", 1.5), ("delivery", 2.5), ("sum_of_ids", 2.0))


def many_robots(report: Report) -> None:
    runs = 1 if report.quick else 5
    table = report.table(
        f"koord verify --robots {ROBOTS}, best of {runs}",
        Column("program", "program"),
        *TIMES,
        *LIMITS,
    )
    for program, limit_s in PROGRAMS:
        note(program)
        words = ("verify", str(EXAMPLES / f"{program}.krd"), "--robots", str(ROBOTS), "--json")
        done = best(runs, partial(koord, *words, timeout_s=PATIENCE_S))
        found = done.report()
        claims = [] if found is None else found["claims"]
        proved = [c for c in claims if c["engine"] == "every N" and c["outcome"] == "holds"]
        story = f"{program}: {len(proved)} of {len(claims)} claims hold for every number of robots"
        report.expect(bool(claims) and len(proved) == len(claims), story)
        table.rows.append(
            {"program": program, **times(done), **limited(done.wall_s, limit_s, "s wall")}
        )


if __name__ == "__main__":
    sys.exit(main("many_robots", __doc__ or "", many_robots))
