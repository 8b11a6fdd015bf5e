"""Certificates of the examples, rechecked with cvc5: what is confirmed, and in what time.

A certificate is written by ``koord verify --certificate`` and settled by ``koord recheck``; both
are whole processes. Not every proof has one: claims that only a search has settled are left out.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from harness import EXAMPLES, NOTHING, Column, Report, main, measure, note

#: Example, robots, delta, and whether it belongs to a quick run.
CASES: tuple[tuple[str, str, str, bool], ...] = (
    ("allstop", "2", "0.1", True),
    ("allstop", "3", "0.1", True),
    ("cars_and_drones", "3", "0.1", False),
    ("delivery", "3", "0.1", False),
    ("fischer", "2", "1", True),
    ("fischer", "5", "1", False),
    ("fischer_drift", "2", "1", True),
    ("follow_path", "3", "0.1", True),
    ("follow_points", "3", "0.1", False),
    ("hvac", "1", "40", True),
    ("leader_elect", "3", "0.1", True),
    ("leader_elect", "10", "0.1", False),
    ("lineform", "3", "0.1", True),
    ("lineform", "10", "0.1", False),
    ("lineform_1d", "5", "10", True),
    ("lineform_1d", "15", "10", False),
    ("mapping", "3", "0.1", False),
    ("sats", "2", "50", True),
    ("sats", "3", "50", False),
    ("shapeform", "9", "0.1", False),
    ("shortest_path", "4", "0.1", True),
    ("shortest_path", "7", "0.1", False),
    ("shortest_path_any_graph", "3", "0.1", False),
    ("shortest_path_any_graph", "4", "0.1", False),
    ("sum_of_ids", "5", "0.1", True),
    ("task", "2", "0.1", True),
    ("task", "3", "0.1", False),
    ("traffic", "2", "3", True),
    ("traffic", "3", "3", False),
    ("waypoints", "2", "50", False),
    ("waypoints", "4", "50", False),
)

#: What rechecking one certificate may take before it is given up.
TIMEOUT_S = 300


def recheck(report: Report) -> None:
    table = report.table(
        "Certificates, rechecked",
        Column("program", "program"),
        Column("robots", "robots"),
        Column("claims", "claims"),
        Column("everyone", "for every N"),
        Column("made_s", "verify, CPU s", 2),
        Column("kib", "KiB", 0),
        Column("verdict", "verdict"),
        Column("met", "obligations met"),
        Column("scripts", "scripts agreed with"),
        Column("cpu_s", "recheck, CPU s", 2),
    )
    koord = [sys.executable, "-m", "koord"]
    for name, robots, delta, quick in CASES:
        if report.quick and not quick:
            continue
        note(f"{name}, {robots} robots")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "certificate.json"
            program = str(EXAMPLES / f"{name}.krd")
            words = ["verify", program, "--robots", robots, "--delta", delta, "--rounds", "1"]
            made = measure([*koord, *words, "--certificate", str(path)], timeout_s=120)
            if not path.exists():
                report.expect(False, f"{name}, {robots} robots: no certificate: {made.errors}")
                continue
            size = path.stat().st_size / 1024
            again = [*koord, "recheck", str(path), "--json", "--timeout", str(TIMEOUT_S)]
            done = measure(again, timeout_s=2 * TIMEOUT_S)
        said = done.json()
        report.expect(
            said is not None and said["verdict"] != "refuted",
            f"{name}, {robots} robots: {done.errors[-300:] or said}",
        )
        if said is None:
            continue
        met = [one["answer"] == "met" for one in said["obligations"]]
        agreed = [one["answer"] == "met" for one in said["scripts"]]
        table.rows.append(
            {
                "program": name,
                "robots": robots,
                "claims": len(said["claims"]),
                "everyone": len(said["confirmed"]["every_number_of_robots"]),
                "made_s": round(made.cpu_s, 2),
                "kib": round(size, 1),
                "verdict": said["verdict"] + (f": {said['reason']}" if said["reason"] else ""),
                "met": f"{sum(met)}/{len(met)}" if met else NOTHING,
                "scripts": f"{sum(agreed)}/{len(agreed)}",
                "cpu_s": round(done.cpu_s, 2),
            }
        )


if __name__ == "__main__":
    sys.exit(main("recheck", __doc__ or "", recheck))
