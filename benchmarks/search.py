"""The explicit search: states per second, and how far it comes with a Task-like model.

The model is Task without geometry: rounds, robots in any order, one atomic assignment a round, and
any way may be clear or not. Other tools were given models of their own of the same, so their times,
published or measured on two cores, stand beside ours as a scale, and for no more.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

from harness import EXAMPLES, Cell, Column, Report, in_child, main, note

TASK = """\
param int tasks = 4

def fun wayIsClear(int task) -> bool: extern fresh

local:
  bool onTask = false
  int mine = -1

allwrite:
  int[tasks] owner

init:
  for i = 0, tasks:
    owner[i] = -1

Assign:
  pre: not onTask
  eff:
    atomic:
      for i = 0, tasks:
        if owner[i] == -1 and not onTask:
          if wayIsClear(i):
            onTask = true
            mine = i
            owner[i] = pid

Complete:
  pre: onTask
  eff: onTask = false

invariant Exclusive: forall i, j: i != j and mine@i >= 0 implies mine@i != mine@j
invariant Owned: forall i: mine@i >= 0 implies owner[mine@i] == i
"""

#: Robots, tasks, and what other tools took: with symmetry, and without.
SIZES: tuple[tuple[int, int, str, str], ...] = (
    (3, 4, "", "SPIN 0.55 s"),
    (4, 5, "", "SPIN 11.6 s, TLC 42 s"),
    (5, 6, "rumur 2.5 s", "SPIN > 250 s"),
    (6, 6, "rumur 6.5 s", ""),
)

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


def searched(
    name: str, tasks: int, robots: int, reduced: bool, patience_s: float
) -> dict[str, Any]:
    """One search to its end, or for so many seconds of CPU time, with all reductions or none."""
    from koord.semantics.liveness import LIVENESS
    from koord.syntax.elaboration.settings import Settings
    from koord.syntax.load import load
    from koord.syntax.source import Source
    from koord.syntax.system import dealt
    from koord.verify.engines.explicit.limits import Limits, resident_mb
    from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
    from koord.verify.engines.explicit.search import survey

    text = TASK if tasks else Path(EXAMPLES / f"{name}.krd").read_text("utf-8")
    settings = Settings({"tasks": tasks}) if tasks else Settings()
    program = load(Source(f"{name}.krd", text), settings).program
    assert program is not None
    system = dealt(program, robots)
    begun = time.process_time()
    found = survey(
        system,
        [p for p in program.properties if p.kind not in LIVENESS],
        Limits(states=10_000_000, deadline_s=begun + patience_s),
        symmetry=reduced,
        order_reduction=reduced,
        clock=time.process_time,
    )
    cpu_s = time.process_time() - begun
    end = found.end
    finite = isinstance(end, Exhausted | OutOfBounds)
    return {
        "states": end.states if isinstance(end, Exhausted | OutOfBounds) else 0,
        "rounds": end.depth if isinstance(end, Exhausted | OutOfBounds) else 0,
        "ended": "all states"
        if isinstance(end, Exhausted)
        else end.reason
        if finite
        else "not finite",
        "violated": [violation.claim.name for violation in found.violated],
        "cpu_s": cpu_s,
        "mib": resident_mb() * 1e6 / 2**20,
    }


def tables(report: Report) -> None:
    columns = (
        Column("reductions", "reductions"),
        Column("ended", "ended with"),
        Column("states", "states"),
        Column("rounds", "rounds"),
        Column("cpu_s", "CPU s"),
        Column("per_s", "states/s", 0),
        Column("mib", "MiB", 0),
    )
    patience_s = PATIENCE_S / 6 if report.quick else PATIENCE_S
    by_size = report.table(
        f"A Task-like model, at most {patience_s:g} s CPU; others with models of their own",
        Column("robots", "robots"),
        Column("tasks", "tasks"),
        *columns,
        Column("others", "others"),
    )
    for robots, tasks, reduced, plain in SIZES[:2] if report.quick else SIZES:
        for on, others in ((True, reduced), (False, plain)):
            if not on and (robots, tasks) > (5, 6):
                continue  # hopeless
            note(f"{robots} robots, {tasks} tasks, reductions {'on' if on else 'off'}")
            row = measured(report, "task-like", tasks, robots, on, patience_s)
            by_size.rows.append({"robots": robots, "tasks": tasks, **row, "others": others or None})
    by_program = report.table(
        f"Programs of specs/examples, at most {patience_s:g} s CPU",
        Column("program", "program"),
        Column("robots", "robots"),
        *columns,
    )
    for name, robots in PROGRAMS[:2] if report.quick else PROGRAMS:
        for on in (True, False):
            note(f"{name}, {robots} robots, reductions {'on' if on else 'off'}")
            row = measured(report, name, 0, robots, on, patience_s)
            by_program.rows.append({"program": name, "robots": robots, **row})


def measured(
    report: Report, name: str, tasks: int, robots: int, reduced: bool, patience_s: float
) -> dict[str, Cell]:
    """The cells of one search. All that is searched here holds."""
    found = in_child(searched, name, tasks, robots, reduced, patience_s, timeout_s=600)
    story = f"{name}, {robots} robots: violated {', '.join(found['violated'])}"
    report.expect(not found["violated"], story)
    row: dict[str, Cell] = {**found, "violated": None}
    row["reductions"] = "on" if reduced else "off"
    row["per_s"] = found["states"] / found["cpu_s"] if found["cpu_s"] else None
    return row


if __name__ == "__main__":
    sys.exit(main("search", __doc__ or "", tables))
