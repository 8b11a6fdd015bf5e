"""``koord verify`` on the published programs: seconds and verdicts beside the published ones.

The published times are those of Koordinator's bounded checker and of the provers before it, on an
i7-4960X with 64 GB; where a range was given, the shorter end counts. Theirs are of one property,
given the lemmas; ours are of every invariant of the program and of freedom from faults, and of one
command from start to end, the best of three. *Ratio* is theirs over our time on the clock, *of CPU*
theirs over the CPU time of all our processes, which is what the clock says at most where the
machine has nothing else to do. By that it is judged: wanted is at least 20 in each row, and 150 for
the geometric mean of the bounded ones.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field
from functools import partial
from statistics import geometric_mean
from typing import Any

from harness import (
    EXAMPLES,
    RESULTS,
    TIMES,
    Column,
    Measured,
    Report,
    Table,
    best,
    gave_up,
    koord,
    main,
    note,
    times,
)

PATIENCE_S = 120.0

#: How many runs of a row are made; the one of them with the least CPU time counts.
RUNS = 3

#: What a row's ratio is to be at least, and the geometric mean of the ratios of a table.
LEAST_RATIO = 20.0
LEAST_MEAN = {"bounded": 150.0}

BROKEN = "broken/"


@dataclass(frozen=True)
class Published:
    """A row of a published table, and the example that it is compared with.

    ``claim`` is what is violated in an unsafe program; where there is none, all claims hold.
    """

    program: str
    file: str
    robots: int
    seconds: float
    rounds: int = 20
    delta: str = "0.1"
    claim: str | None = None
    set: dict[str, str] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        return "unsafe" if self.claim else "safe"


def bounded() -> list[Published]:
    """The table of the bounded checker."""
    rows = [Published("Waypoint", "waypoints", n, s, 4, "50") for n, s in zip_to("38.5 59.9 81.2")]
    rows += [
        Published("HVAC1", "hvac", 1, 26.2, 10, "40"),
        Published("HVAC2", BROKEN + "hvac2_wide_band", 1, 39.8, 10, "40", "Comfort"),
        Published("LineForm", "lineform", 3, 20.2, 4, "10"),
        Published("LineForm", "lineform", 5, 28.1, 4, "10"),
        Published("Fischer1", "fischer", 2, 479.9, 10, "1", None, {"Td": "2", "Tk": "3"}),
        Published("Fischer2", BROKEN + "fischer2_no_deadline", 2, 771.1, 10, "1", "Exclusive"),
    ]
    for td, tk, seconds in (("3", "3", 343.8), ("4", "2", 773.1)):
        timing = {"Td": td, "Tk": tk}
        rows += [Published("Fischer", "fischer", 2, seconds, 10, "1", "Exclusive", timing)]
    for slow, fast, seconds, claim in (
        ("0.0", "0.0", 1079, None),
        ("-0.3", "0.3", 1519, "Exclusive"),
        ("-0.3", "0.2", 1430, "Exclusive"),
    ):
        drift = {"slow": slow, "fast": fast}
        rows += [Published("FischerDrift", "fischer_drift", 2, seconds, 20, "1", claim, drift)]
    rows += [
        Published("SATS1", "sats", 2, 32.5, 4, "50"),
        Published("SATS1", "sats", 3, 38.4, 4, "50"),
        Published("SATS2", BROKEN + "sats2_out_of_turn", 3, 49.2, 4, "50", "Separation"),
        Published("Traffic", "traffic", 2, 40.5, 5, "3"),
        Published("Traffic", "traffic", 3, 131.4, 5, "3"),
    ]
    for delta, rounds, claim in (
        ("40", 10, None),
        ("50", 8, None),
        ("75", 8, None),
        ("100", 6, "Comfort"),
        ("125", 6, "Comfort"),
    ):
        rows += [Published("HVAC", "hvac", 1, 24.0, rounds, delta, claim)]
    return rows


def inductive() -> list[Published]:
    """The table of the provers; all of it holds. Sums are of the lemmas, or of the two steps."""
    rows = [
        Published("HVAC", "hvac", 1, 8.0, delta="40"),
        Published("LeaderElect", "leader_elect", 3, 9.1),
        Published("LeaderElect", "leader_elect", 4, 11.2),
        Published("ShortestPath", "shortest_path", 7, 14.2),
        Published("ShortestPath", "shortest_path", 8, 16.5),
        Published("LineForm", "lineform", 4, 11.8),
        Published("Fischer, six lemmas", "fischer", 2, 6 * 5.8, delta="1"),
        Published("SATS, four lemmas", "sats", 3, 4 * 7.1, delta="50"),
    ]
    for file, dimensions in (("lineform_1d", 1), ("lineform", 3)):
        for robots, seconds in ((3, 9.1), (4, 12.2), (5, 18.5), (10, 32.3), (15, 53.9)):
            rows += [Published(f"geofence, {dimensions}D", file, robots, 4.2 + seconds)]
    for robots, seconds in ((3, 10.6), (4, 11.8), (5, 14.9), (10, 18.3)):
        rows += [Published("Delivery", "delivery", robots, 9.8 + seconds)]
    for robots, seconds in ((3, 14.5), (4, 19.3), (5, 24.3), (10, 59.8)):
        rows += [Published("Mapping", "mapping", robots, 9.2 + seconds)]
    return rows


def zip_to(seconds: str) -> list[tuple[int, float]]:
    """Times for 2, 3, … robots."""
    return [(robots, float(text)) for robots, text in enumerate(seconds.split(), 2)]


def invariants(row: Published) -> list[str]:
    """What is asked for: all but liveness, of which the published tables say nothing."""
    text = (EXAMPLES / f"{row.file}.krd").read_text("utf-8")
    return [*re.findall(r"^invariant (\w+)", text, re.MULTILINE), "no fault"]


def verified(row: Published, *flags: str) -> Measured:
    words = ["--robots", str(row.robots), "--rounds", str(row.rounds), "--delta", row.delta]
    for name, value in row.set.items():
        words += ["--set", f"{name}={value}"]
    for name in invariants(row):
        words += ["--property", name]
    return koord(
        *("verify", str(EXAMPLES / f"{row.file}.krd"), *words, *flags, "--json"),
        *("--timeout", str(PATIENCE_S)),
        timeout_s=PATIENCE_S + 30,
    )


def verdict(row: Published, found: Any) -> str:
    """What was found, in the words of the published tables."""
    if found is None:
        return "unknown"
    claims = {claim["name"]: claim for claim in found["claims"]}
    if row.claim is not None and claims[row.claim]["violated"] is not None:
        return "unsafe"
    words = {"holds": "safe", "violated": "unsafe", "unknown": "unknown"}
    return words[found["outcome"]]


def reach(row: Published, found: Any) -> str:
    """How far what was found reaches, and by which engine; of an unsafe program, its claim's."""
    if found is None:
        return "given up"
    claims = [claim for claim in found["claims"] if row.claim in (None, claim["name"])]
    engines = ", ".join(sorted({claim["engine"] for claim in claims}))
    if row.claim is not None:
        broken = claims[0]["violated"]
        return f"round {broken['round']}, {engines}" if broken else engines
    if all(claim["all_rounds"] for claim in claims):
        return f"every round, {engines}"
    return f"{min(claim['through_round'] or 0 for claim in claims)} rounds, {engines}"


def compare(report: Report, title: str, rows: list[Published], *flags: str) -> Table:
    table = report.table(
        title,
        Column("program", "program"),
        Column("settings", "settings"),
        Column("robots", "robots"),
        Column("delta", "δ s"),
        Column("rounds", "rounds"),
        Column("published_s", "published s", 1),
        *TIMES,
        Column("ratio", "ratio", 0),
        Column("cpu_ratio", "of CPU", 0),
        Column("met", f"≥ {LEAST_RATIO:g}"),
        Column("expected", "expected"),
        Column("verdict", "verdict"),
        Column("reach", "how far, by what"),
    )
    for row in rows:
        if not (EXAMPLES / f"{row.file}.krd").exists():
            note(f"there is no {row.file}.krd")
            continue
        settings = " ".join(f"{name}={value}" for name, value in row.set.items())
        what = f"{row.program}, {row.robots} robots{', ' * bool(settings)}{settings}"
        note(what)
        done = best(1 if report.quick else RUNS, partial(verified, row, *flags))
        found = done.report()
        got = verdict(row, found)
        said = "" if found is not None else f" ({done.errors[-300:]})"
        right = got == row.verdict or (got == "unknown" and gave_up(done))
        report.expect(right, f"{what}: {got}, published as {row.verdict}{said}")
        table.rows.append(
            {
                "program": row.program,
                "file": row.file,
                "settings": settings or None,
                "robots": row.robots,
                "delta": row.delta,
                "rounds": row.rounds,
                "published_s": row.seconds,
                **times(done),
                "ratio": row.seconds / done.wall_s,
                "cpu_ratio": row.seconds / done.cpu_s,
                "met": row.seconds / done.cpu_s >= LEAST_RATIO,
                "expected": row.verdict,
                "verdict": got,
                "reach": reach(row, found),
            }
        )
    return table


def sum_up(report: Report, compared: dict[str, Table]) -> None:
    """How much quicker than published, over the rows of a table, by CPU time."""
    table = report.table(
        "Published time over our CPU time",
        Column("rows", "rows"),
        Column("count", "how many"),
        Column("right", "as published"),
        Column("least", "least", 0),
        Column("below", f"below {LEAST_RATIO:g}"),
        Column("mean", "geometric mean", 0),
        Column("wanted", "wanted", 0),
        Column("met", "met"),
        Column("most", "most", 0),
        Column("longest_s", "longest of ours on the clock, s", 2),
    )
    for name, of in compared.items():
        ratios = [float(row["cpu_ratio"] or 0) for row in of.rows]
        mean, wanted = geometric_mean(ratios), LEAST_MEAN.get(name)
        below = sum(ratio < LEAST_RATIO for ratio in ratios)
        table.rows.append(
            {
                "rows": name,
                "count": len(of.rows),
                "right": sum(row["verdict"] == row["expected"] for row in of.rows),
                "least": min(ratios),
                "below": below,
                "mean": mean,
                "wanted": wanted,
                "met": below == 0 and (wanted is None or mean >= wanted),
                "most": max(ratios),
                "longest_s": max(float(row["wall_s"] or 0) for row in of.rows),
            }
        )


def draw(compared: dict[str, Table]) -> None:
    """Published times and ours beside the results, if matplotlib is there."""
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError:
        return
    rows = [row for table in compared.values() for row in table.rows][::-1]
    figure = Figure(figsize=(8, 0.22 * len(rows) + 1), layout="constrained")
    axes = figure.subplots()
    at = range(len(rows))
    published = [float(row["published_s"] or 0) for row in rows]
    ours = [float(row["wall_s"] or 0) for row in rows]
    axes.hlines(at, ours, published, color="0.8", zorder=1)
    axes.scatter(published, at, marker="s", color="tab:red", label="published", zorder=2)
    axes.scatter(ours, at, marker="o", color="tab:blue", label="koord verify", zorder=2)
    axes.set_yticks(at, [f"{row['program']}, {row['robots']}, δ {row['delta']}" for row in rows])
    axes.tick_params(axis="y", labelsize=7)
    axes.set_xscale("log")
    axes.set_xlabel("seconds, from start to end")
    axes.legend(loc="upper left")
    figure.savefig(RESULTS / "verify_examples.svg", metadata={"Date": None})


def verify_examples(report: Report) -> None:
    most = 4 if report.quick else 100
    rows = [row for row in bounded() if row.robots <= most]
    compared = {"bounded": compare(report, "Bounded: koord verify --rounds R", rows)}
    rows = [row for row in inductive() if row.robots <= most]
    title = "Inductive: koord verify --engine induction"
    compared["inductive"] = compare(report, title, rows, "--engine", "induction")
    sum_up(report, compared)
    if not report.quick:
        draw(compared)


if __name__ == "__main__":
    sys.exit(main("verify_examples", __doc__ or "", verify_examples))
