"""The explicit search: states per second, and how far it comes with the claiming model.

The model is Task without geometry: rounds, robots in any order, one atomic assignment a round, and
any way may be clear or not (`programs/claiming.krd`, with its lemma). It is searched by the road of
Python, with all reductions and with none, and on machine code with symmetry and without, and by
SPIN in the same run, where it is installed: on the model of `claiming.py`, which reaches the same
configurations, counted here. Translating and compiling SPIN's model is counted as koord's machine
code is, which is made anew for each search; a column holds all against SPIN's search alone.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from claiming import LEMMA, PROGRAM, spin
from harness import EXAMPLES, Cell, Column, Report, in_child, main, note

#: Robots and tasks.
SIZES = ((3, 4), (4, 5), (5, 6), (6, 6))

#: Roads of the search: whether machine code is used, symmetry, and the reduction of orders.
ROADS = {
    "Python": (False, True, True),
    "Python, no reductions": (False, False, False),
    "machine code": (True, True, True),
    "machine code, no symmetry": (True, False, True),
}

#: Sizes for which a search of all configurations is hopeless, and one by Python.
TOO_LARGE, TOO_LARGE_FOR_PYTHON = (6, 6), (5, 6)

#: Programs of ``specs/examples`` whose configurations are finitely many, and numbers of robots.
PROGRAMS: tuple[tuple[str, int], ...] = (
    ("sum_of_ids", 5),
    ("sum_of_ids", 7),
    ("leader_elect", 4),
    ("allstop", 6),
    ("fischer", 3),
)

#: When a search is given up, in seconds of CPU time.
PATIENCE_S = 60.0


def searched(name: str, tasks: int, robots: int, road: str, patience_s: float) -> dict[str, Any]:
    """One search to its end, or for so many seconds of CPU time, on one of the roads."""
    from koord.semantics.liveness import LIVENESS
    from koord.syntax.elaboration.settings import Settings
    from koord.syntax.load import load
    from koord.syntax.source import Source
    from koord.syntax.system import dealt
    from koord.verify.engines.explicit.cost import COMPILED_FROM
    from koord.verify.engines.explicit.limits import Limits, resident_mb
    from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
    from koord.verify.engines.explicit.search import survey

    is_compiled, symmetry, order_reduction = ROADS[road]
    text = "".join(path.read_text("utf-8") for path in paths(name, tasks))
    settings = Settings({"tasks": tasks}) if tasks else Settings()
    program = load(Source(f"{name}.krd", text), settings).program
    assert program is not None
    begun = time.process_time()
    found = survey(
        dealt(program, robots),
        [p for p in program.properties if p.kind not in LIVENESS],
        Limits(states=10_000_000, deadline_s=begun + patience_s),
        symmetry=symmetry,
        order_reduction=order_reduction,
        compiled_from=COMPILED_FROM if is_compiled else None,
        clock=time.process_time,
    )
    cpu_s = time.process_time() - begun
    end = found.end
    if isinstance(end, Exhausted):
        ended = "all states"
    else:
        ended = end.reason if isinstance(end, OutOfBounds) else "not finite"
    return {
        "states": end.states if isinstance(end, Exhausted | OutOfBounds) else 0,
        "rounds": end.depth if isinstance(end, Exhausted | OutOfBounds) else 0,
        "ended": ended,
        "violated": [violation.claim.name for violation in found.violated],
        "cpu_s": cpu_s,
        "mib": resident_mb() * 1e6 / 2**20,
    }


def paths(name: str, tasks: int) -> tuple[Path, ...]:
    """The files of a program: the claiming model and its lemma, or an example."""
    return (PROGRAM, LEMMA) if tasks else (EXAMPLES / f"{name}.krd",)


def tables(report: Report) -> None:
    columns = (
        Column("road", "road"),
        Column("ended", "ended with"),
        Column("states", "states"),
        Column("rounds", "rounds"),
        Column("cpu_s", "CPU s"),
        Column("per_s", "states/s", 0),
        Column("mib", "MiB", 0),
    )
    patience_s = PATIENCE_S / 6 if report.quick else PATIENCE_S
    by_size = report.table(
        f"The claiming model, at most {patience_s:g} s CPU",
        Column("robots", "robots"),
        Column("tasks", "tasks"),
        *columns,
        Column("by_spin", "times SPIN's"),
        Column("by_search", "times SPIN's search alone"),
    )
    for robots, tasks in SIZES[:2] if report.quick else SIZES:
        known = by_spin(report, robots, tasks, patience_s)
        if known is not None:
            by_size.rows.append({"robots": robots, "tasks": tasks, "road": "SPIN", **known})
        for road, (is_compiled, symmetry, _) in ROADS.items():
            if not symmetry and (robots, tasks) >= TOO_LARGE:
                continue
            if not symmetry and not is_compiled and (robots, tasks) >= TOO_LARGE_FOR_PYTHON:
                continue
            note(f"{robots} robots, {tasks} tasks, {road}")
            row = measured(report, "claiming", tasks, robots, road, patience_s)
            if known is not None and known["states"] and not symmetry:
                compared(report, row, known)
            by_size.rows.append({"robots": robots, "tasks": tasks, **row})
    by_program = report.table(
        f"Programs of specs/examples, at most {patience_s:g} s CPU",
        Column("program", "program"),
        Column("robots", "robots"),
        *columns,
    )
    for name, robots in PROGRAMS[:2] if report.quick else PROGRAMS:
        for road in ROADS:
            note(f"{name}, {robots} robots, {road}")
            row = measured(report, name, 0, robots, road, patience_s)
            by_program.rows.append({"program": name, "robots": robots, **row})


def by_spin(report: Report, robots: int, tasks: int, patience_s: float) -> dict[str, Cell] | None:
    """The cells of SPIN's search of all configurations; None where it is not installed."""
    if shutil.which("spin") is None or (robots, tasks) >= TOO_LARGE:
        return None
    note(f"{robots} robots, {tasks} tasks, SPIN")
    with tempfile.TemporaryDirectory() as folder:
        answer = spin(robots, tasks, Path(folder), patience_s)
    report.expect(answer.word in ("holds", "gave up"), f"SPIN: {answer.word}")
    note(f"SPIN's search alone: {answer.search_s} s CPU")
    states = answer.states - 1 if answer.states is not None else None  # one is before its start
    cpu_s = answer.measured.cpu_s if answer.measured is not None else None
    row: dict[str, Cell] = {"states": states, "cpu_s": cpu_s}
    if cpu_s and answer.search_s is not None:
        row["by_spin"], row["by_search"] = 1.0, cpu_s / answer.search_s if answer.search_s else None
    row["ended"] = "all states" if states is not None else answer.word
    row["per_s"] = states / cpu_s if states and cpu_s else None
    row["mib"] = answer.measured.peak_mib if answer.measured is not None else None
    return row


def compared(report: Report, row: dict[str, Cell], known: dict[str, Cell]) -> None:
    """Hold a search of all configurations against SPIN's of the same."""
    if row["ended"] == "all states":
        same = row["states"] == known["states"]
        report.expect(same, f"{row['states']} states, {known['states']} of SPIN")
        ours, theirs = row["cpu_s"], known["cpu_s"]
        if isinstance(ours, float) and isinstance(theirs, float):
            row["by_spin"] = ours / theirs
            whole = known.get("by_search")
            if isinstance(whole, float):
                row["by_search"] = ours / theirs * whole


def measured(
    report: Report, name: str, tasks: int, robots: int, road: str, patience_s: float
) -> dict[str, Cell]:
    """The cells of one search. All that is searched here holds."""
    found = in_child(searched, name, tasks, robots, road, patience_s, timeout_s=600)
    story = f"{name}, {robots} robots: violated {', '.join(found['violated'])}"
    report.expect(not found["violated"], story)
    row: dict[str, Cell] = {**found, "violated": None, "road": road}
    row["per_s"] = found["states"] / found["cpu_s"] if found["cpu_s"] else None
    return row


if __name__ == "__main__":
    sys.exit(main("search", __doc__ or "", tables))
