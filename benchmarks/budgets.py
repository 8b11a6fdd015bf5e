"""How well budgets are kept: each engine on programs that are hard for it, with limits of time.

Shown is what a command took on the clock beyond its start-up, beside what it was given: `--timeout`
is for all of it. `--property-timeout` is for each property: there the longest time that a row says
counts. 10 % and a few tenths of a second are the promise; on a busy machine the clock runs on while
others work, so nothing fails because of it, and a line tells how many are over.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from harness import EXAMPLES, Column, Report, best, koord, main, note

#: What is over the budget and no breach of the promise: so many percent, and so many seconds.
PERCENT, SECONDS = 10.0, 0.3

ENGINES = ("auto", "bits", "bmc", "spacer", "search", "induction")

#: Products of reals, which solvers can take for ever.
HARD = """
local:
    float x = 0
    float y = 1
Step:
    pre: x < 100
    eff:
        x = x + y * y
        y = y * 0.9 + x * x * 0.01
invariant A: forall i: y@i * y@i * y@i < 1000000 + x@i * x@i
invariant B: forall i, j: x@i * y@j < 100000 + x@j * x@j * y@i
eventually C: forall i: x@i > 99
"""

#: A list that doubles with every event.
DOUBLING = """
local:
    int[] x = [1]
Grow:
    eff:
        for i in x:
            x.append(i)
invariant Small: forall i: len(x@i) < 100000000
"""

#: Simple, but of as many robots as there may be.
MANY = """
allwrite:
    int n = 0
local:
    int v = 0
Grow:
    pre: v < 5
    eff:
        atomic:
            n = n + 1
        v = n
invariant Small: n < 100000000
eventually Full: forall i: v@i > 4
"""


def budgets(report: Report) -> None:
    seconds = 3.0 if report.quick else 8.0
    with tempfile.TemporaryDirectory() as folder:
        programs: list[tuple[str, tuple[str, ...]]] = []
        for name, text, more in (
            ("hard", HARD, ()),
            ("doubling", DOUBLING, ()),
            ("many", MANY, ("--robots", "10000")),
        ):
            path = Path(folder) / f"{name}.krd"
            path.write_text(text, encoding="utf-8")
            programs.append((name, (str(path), *more)))
        sats = str(EXAMPLES / "broken" / "sats_report_for_ever.krd")
        programs.append(("sats_report_for_ever", (sats,)))
        start = best(3, lambda: koord("verify", str(EXAMPLES / "hvac.krd"), "--rounds", "0"))
        late = 0
        table = report.table(
            f"Limits of {seconds:g} s",
            Column("program", "program"),
            Column("engine", "engine"),
            Column("limit", "limit"),
            Column("wall_s", "wall s", 2),
            Column("cpu_s", "CPU s", 2),
            Column("took_s", "of the budget s", 2),
            Column("over_percent", "over %", 1),
            Column("exit", "exit"),
        )
        for name, words in programs:
            for engine in ENGINES:
                for limit in ("--timeout", "--property-timeout"):
                    is_of_each = limit == "--property-timeout"
                    if is_of_each and engine not in ("auto", "bits"):
                        continue
                    note(f"{name} {engine} {limit}")
                    flags = ("--engine", engine, limit, str(seconds), "--jobs", "1", "--json")
                    done = koord("verify", *words, *flags, timeout_s=20 * seconds)
                    report.expect(done.code in (0, 1, 3, 4), f"{name}, {engine}: {done.code}")
                    found = done.report()
                    claims = [claim["seconds"] for claim in found["claims"]] if found else []
                    took = max(claims, default=0.0) if is_of_each else done.wall_s - start.wall_s
                    over = max(0.0, took - seconds)
                    late += over > PERCENT / 100 * seconds + SECONDS
                    table.rows.append(
                        {
                            "program": name,
                            "engine": engine,
                            "limit": limit,
                            "wall_s": round(done.wall_s, 3),
                            "cpu_s": round(done.cpu_s, 3),
                            "took_s": round(took, 3),
                            "over_percent": round(over / seconds * 100, 1),
                            "exit": done.code,
                        }
                    )
        told = report.table(
            "Over by more than promised",
            Column("over", "over"),
            Column("commands", "of"),
            Column("start_s", "start-up s", 2),
        )
        told.rows.append({"over": late, "commands": len(table.rows), "start_s": start.wall_s})


if __name__ == "__main__":
    sys.exit(main("budgets", __doc__ or "", budgets))
