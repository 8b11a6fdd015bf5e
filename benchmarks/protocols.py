"""``koord verify`` on the protocols of specs/examples/protocols: how far each safe claim is proved.

It prints the table that stands in the README there. A claim is proved for every number of robots,
for the number that was asked about in every round, or holds for some rounds; a claim that is
violated is wrong. Each protocol is asked about twice: for a few robots by whichever engine, and by
``--robots any`` for every number of them.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from harness import EXAMPLES, Column, Measured, Report, koord, main, note

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
        Column("any", "--robots any"),
        Column("any_cpu_s", "CPU s"),
    )
    sums: Counter[str] = Counter()
    of_any: Counter[str] = Counter()
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
        anybody, any_cpu_s = for_any(path, patience_s)
        for claim in found["claims"]:
            if claim["name"] not in claims:
                continue
            how_far = reach(claim)
            report.expect(how_far != VIOLATED, f"{name}: {claim['name']} is violated")
            shown = anybody.get(claim["name"], UNKNOWN)
            report.expect(shown != VIOLATED, f"{name}: {claim['name']} is violated")
            sums[how_far] += 1
            of_any[shown] += 1
            table.rows.append(
                {
                    "protocol": name,
                    "published": ", ".join(entry["published"]) or None,
                    "claim": claim["name"],
                    "reach": how_far,
                    "robots": robots,
                    "engine": claim["engine"],
                    "cpu_s": round(done.cpu_s, 2),
                    "any": shown,
                    "any_cpu_s": round(any_cpu_s, 2),
                }
            )
    summary = report.table(
        "claims",
        Column("reach", "holds for"),
        Column("claims", "claims"),
        Column("any", "--robots any"),
    )
    summary.rows.extend(
        {"reach": each, "claims": sums[each], "any": of_any[each]}
        for each, _ in (sums + of_any).most_common()
    )


def whole_runs(report: Report) -> None:
    """Claims about whole runs: proved for every number of robots, under which fairness."""
    table = report.table(
        "claims about whole runs, for every number of robots",
        Column("protocol", "protocol"),
        Column("claim", "claim"),
        Column("text", "in every fair run"),
        Column("reach", "holds for"),
        Column("fairness", "rests on fairness to"),
        Column("cpu_s", "CPU s of all claims"),
    )
    patience_s = QUICK_S if report.quick else PATIENCE_S
    for path in sorted(PROTOCOLS.glob("*.krd")):
        texts = dict(re.findall(r"^eventually (\w+): (.*)", path.read_text("utf-8"), re.MULTILINE))
        if not texts:
            continue
        note(path.stem)
        done = verified_for_any(path, patience_s)
        found = done.report()
        if not report.expect(found is not None, f"{path.stem}: {done.errors[-300:]}"):
            continue
        for claim in found["claims"]:
            if claim["name"] in texts:
                # Of whole runs there are no rounds: a proof for every number is one of all of them.
                everyone = claim["every_number_of_robots"] and claim["outcome"] == "holds"
                row = {
                    "protocol": path.stem,
                    "claim": claim["name"],
                    "text": texts[claim["name"]],
                    "reach": EVERY_NUMBER if everyone else UNKNOWN,
                    "fairness": ", ".join(claim["fairness"] or ()) or None,
                    "cpu_s": round(done.cpu_s, 2),
                }
                table.rows.append(row)


def both(report: Report) -> None:
    """Print all tables: claims about configurations, and about whole runs."""
    protocols(report)
    whole_runs(report)


@cache
def verified_for_any(path: Path, patience_s: float) -> Measured:
    """A verification for every number of robots, of which both tables tell."""
    words = ["--robots", "any", "--json", "--timeout", str(patience_s)]
    return koord("verify", str(path), *words, timeout_s=patience_s + 30)


def for_any(path: Path, patience_s: float) -> tuple[dict[str, str], float]:
    """How far claims hold by proofs for every number of robots, and the seconds of CPU."""
    done = verified_for_any(path, patience_s)
    found = done.report()
    claims = [] if found is None else found["claims"]
    return {claim["name"]: reach(claim) for claim in claims}, done.cpu_s


if __name__ == "__main__":
    sys.exit(main("protocols", __doc__, both))
