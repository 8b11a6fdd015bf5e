"""``koord verify`` on the protocols of specs/examples/protocols: how far each safe claim is proved.

It prints the table that stands in the README there. A claim is proved for every number of robots,
for the number that was asked about in every round, or holds for some rounds; a claim that is
violated is wrong.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from typing import Any

import yaml

from harness import EXAMPLES, Column, Report, koord, main, note

PROTOCOLS = EXAMPLES / "protocols"
PATIENCE_S = 30.0
QUICK_S = 10.0

#: So many robots are asked about, where the protocol does not say how many it is for.
ROBOTS = 3

EVERY_NUMBER = "every N"
EVERY_ROUND = "every round"
ROUNDS = "some rounds"
UNKNOWN = "unknown"
VIOLATED = "violated"


def reach(claim: Any) -> str:
    """How far a claim is known to hold."""
    if claim["violated"] is not None:
        return VIOLATED
    if claim["outcome"] != "holds":
        return UNKNOWN
    if not claim["all_rounds"]:
        return ROUNDS
    return EVERY_NUMBER if claim["every_number_of_robots"] else EVERY_ROUND


def protocols(report: Report) -> None:
    table = report.table(
        "protocols, their claims alone",
        Column("protocol", "protocol"),
        Column("published", "published in"),
        Column("claim", "claim"),
        Column("reach", "holds for"),
        Column("robots", "robots asked"),
        Column("engine", "engine"),
        Column("cpu_s", "CPU s of all claims"),
    )
    sums: Counter[str] = Counter()
    expected = yaml.safe_load((PROTOCOLS / "expected.yaml").read_text("utf-8"))
    patience_s = QUICK_S if report.quick else PATIENCE_S
    for name, entry in expected.items():
        note(name)
        path = PROTOCOLS / f"{name}.krd"
        claims = re.findall(r"^invariant (\w+)", path.read_text("utf-8"), re.MULTILINE)
        robots = min(ROBOTS, max(entry["robots"]))
        words = ["--robots", str(robots), "--json", "--timeout", str(patience_s)]
        done = koord("verify", str(path), *words, timeout_s=patience_s + 30)
        found = done.report()
        if not report.expect(found is not None, f"{name}: {done.errors[-300:]}"):
            continue
        for claim in found["claims"]:
            if claim["name"] not in claims:
                continue
            how_far = reach(claim)
            report.expect(how_far != VIOLATED, f"{name}: {claim['name']} is violated")
            sums[how_far] += 1
            table.rows.append(
                {
                    "protocol": name,
                    "published": ", ".join(entry["published"]) or None,
                    "claim": claim["name"],
                    "reach": how_far,
                    "robots": robots,
                    "engine": claim["engine"],
                    "cpu_s": round(done.cpu_s, 2),
                }
            )
    summary = report.table("claims", Column("reach", "holds for"), Column("claims", "claims"))
    summary.rows.extend({"reach": each, "claims": count} for each, count in sums.most_common())


if __name__ == "__main__":
    sys.exit(main("protocols", __doc__, protocols))
