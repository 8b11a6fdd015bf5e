"""Rare violations: counted in runs by chance, and by splitting.

A walk goes up by one in one of three cases and down in the others, from 1 until 0 or the goal, so
the probability that it comes there is known: 1 / (2 ^ goal − 1). Two drones hover beside each other
in gusts of wind, so near that they rarely come nearer than is safe; that probability nobody knows.

Both ways tell a probability with an interval of 95 %, and take CPU seconds of one process. What
counting would take for an interval as narrow as that of splitting is worked out from what a run
took: *as narrow, s*. Where the probability is known both intervals have to be right, up to the five
in a hundred that may be wrong: they fail here if they are off by twice their reach.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from harness import Cell, Column, Report, koord, main, note

WALK = """\
param int goal = 8

using Coin:
    sensors:
        int side
    environment:
        side = 2 * (choose(0, 2) / 2) - 1

local:
    int x = 1

Step:
    pre: 0 < x and x < goal
    eff: x = x + Coin.side

Over:
    pre: x <= 0 or goal <= x
    eff: stop

assume: Coin.side == 0
invariant Below: x < goal
"""

POINT = """\
agents: [{pid: 0, on_device: point}]
devices: {point: {bot_type: IDEAL, planner: STRAIGHT}}
"""

HOVERING = """\
using Motion:
    sensors:
        pos psn
    actuators:
        pos target

local:
    int rounds = 0

Wait:
    eff: rounds = rounds + 1
"""

GUSTS = """\
agents:
    - {pid: 0, on_device: drone, position: [0, 0, 1.5]}
    - {pid: 1, on_device: drone, position: [1.0, 0, 1.5]}
devices:
    drone:
        bot_type: QUAD
        planner: RRT_DRONE
        simulation: {wind: {gust: 2.0}}
monitor: {safety: 0.8}
"""

#: Program, configuration, claim, goal, its probability, simulated seconds.
CASES = (
    ("walk to 4", WALK, POINT, "Below", 4, 1 / 15, "60"),
    ("walk to 8", WALK, POINT, "Below", 8, 1 / 255, "60"),
    ("walk to 12", WALK, POINT, "Below", 12, 1 / 4095, "60"),
    ("walk to 20", WALK, POINT, "Below", 20, 1 / (2**20 - 1), "60"),
    ("two drones", HOVERING, GUSTS, "separation", None, None, "2"),
)


def rare(report: Report) -> None:
    """One table."""
    table = report.table(
        "Counted, and by splitting",
        Column("case", "case"),
        Column("how", "how"),
        Column("runs", "runs"),
        Column("rate", "rate", places=7),
        Column("low", "from", places=7),
        Column("high", "to", places=7),
        Column("known", "known", places=7),
        Column("cpu_s", "CPU s"),
        Column("narrow_s", "as narrow, s"),
    )
    count, particles, times = (60, 10, 5) if report.quick else (1000, 50, 20)
    with tempfile.TemporaryDirectory() as folder:
        for name, program, configuration, claim, goal, known, time_s in CASES:
            files = [Path(folder) / "case.krd", Path(folder) / "case.yaml"]
            for file, text in zip(files, (program, configuration), strict=True):
                file.write_text(text, encoding="utf-8")
            words = ["sim", *map(str, files), "--time", time_s, "--json"]
            words += [] if goal is None else ["--set", f"goal={goal}"]
            note(f"{name}, counted")
            crude = koord(*words, "--runs", str(count), "--until", "broken=1e-9", timeout_s=900)
            if not report.expect(crude.code in (0, 1), f"{name}: {crude.errors[-300:]}"):
                continue
            rows = crude.json()["runs"]
            (found,) = crude.json()["intervals"].values()
            counted = found["mean"], found["low"], found["high"]
            note(f"{name}, by splitting")
            split = koord(
                *(*words, "--splitting", claim),
                *("--particles", str(particles), "--runs", str(times)),
                timeout_s=900,
            )
            if not report.expect(split.code in (0, 1), f"{name}: {split.errors[-300:]}"):
                continue
            told = split.json()
            sought = told["rate"], told["low"], told["high"]
            reach, (rate, _, _) = (told["high"] - told["low"]) / 2, sought
            needed = rate * (1 - rate) * (1.96 / reach) ** 2 if reach else None
            for how, runs, (mean, low, high), cpu_s, narrow_s in (
                ("counted", len(rows), counted, crude.cpu_s, needed),
                ("splitting", told["runs"], sought, split.cpu_s, None),
            ):
                cells: dict[str, Cell] = {"case": name, "how": how, "runs": runs, "known": known}
                cells |= {"rate": mean, "low": low, "high": high, "cpu_s": round(cpu_s, 1)}
                if narrow_s is not None:
                    cells["narrow_s"] = round(narrow_s * cpu_s / runs)
                table.rows.append(cells)
                if known is not None:
                    off = max(low - known, known - high, 0.0)
                    report.expect(off <= high - low, f"{name}, {how}: {low} to {high} is wrong")


if __name__ == "__main__":
    sys.exit(main("rare", __doc__, rare))
