"""While somebody types: verdicts after edits of Task, in one session that knows those before.

Each edit leaves the proofs as they are, and is undone before the next one. What is told are CPU
seconds of this process and of those that it starts, from the text to the verdicts, and seconds of
the wall. Each text is verified by itself, too, which has to say the same (not with ``--quick``).
"""

from __future__ import annotations

import resource
import statistics
import sys
import time

import koord
from harness import EXAMPLES, Column, Report, main
from koord.verify.verdicts import Outcome

#: Kind of edit, what it is, and what stands in whose place.
EDITS = (
    ("text", "a comment", (("init:", "# about init\ninit:"),)),
    ("text", "a blank line", (("init:", "\ninit:"),)),
    ("text", "a comment behind a line", (("pre: not isOnTask", "pre: not isOnTask  # free"),)),
    ("text", "spaces", (("mine = i\n", "mine  =  i\n"),)),
    ("variable", "a local", (("    int mine", "    int spare = 0\n    int mine"),)),
    (
        "variable",
        "an allwrite",
        (("    Task[tasks] list", "    int spare = 0\n    Task[tasks] list"),),
    ),
    (
        "variable",
        "a local that is counted",
        (
            ("    int mine", "    int spare = 0\n    int mine"),
            ("        isOnTask = false\n", "        isOnTask = false\n        spare = spare + 1\n"),
        ),
    ),
    ("param", "a param", (("param int tasks", "param int spare = 7\nparam int tasks"),)),
    ("param", "another value", (("tasks = 4", "tasks = 5"),)),
    (
        "param",
        "a param that is used",
        (("tasks = 4", "tasks = 4\nparam int first = -1"), ("mine = -1", "mine = first")),
    ),
    (
        "claim",
        "one more",
        (
            (
                "invariant Route:",
                "invariant More: forall i: isOnTask@i implies mine@i >= 0\ninvariant Route:",
            ),
        ),
    ),
    (
        "claim",
        "one more, of all",
        (
            (
                "invariant Route:",
                "invariant More: forall i, j: i != j implies pathsClear(route[j], route[i])\n"
                "invariant Route:",
            ),
        ),
    ),
    ("claim", "in other words", (("mine@i != mine@j\n", "mine@j != mine@i\n"),)),
    (
        "claim",
        "weaker",
        (
            (
                "i != j implies pathsClear(route[i], route[j])\n\nassume Arr",
                "i < j implies pathsClear(route[i], route[j])\n\nassume Arr",
            ),
        ),
    ),
    ("claim", "another name", (("invariant Route:", "invariant Routes:"),)),
    ("claim", "one less", (("invariant Route: forall i: route[i] == Motion.path@i\n", ""),)),
    (
        "claim",
        "of whole runs, in other words",
        (
            (
                "allAssigned(list) and forall i: not isOnTask@i",
                "(forall i: not isOnTask@i) and allAssigned(list)",
            ),
        ),
    ),
    ("guard", "stronger", (("pre: not isOnTask", "pre: not isOnTask and mine < tasks"),)),
    ("guard", "turned round", (("isOnTask and Motion.reached", "Motion.reached and isOnTask"),)),
    (
        "effect",
        "one more",
        (("        isOnTask = false\n", "        isOnTask = false\n        mine = -1\n"),),
    ),
    (
        "effect",
        "in another order",
        (
            (
                "                        isOnTask = true\n                        mine = i\n",
                "                        mine = i\n                        isOnTask = true\n",
            ),
        ),
    ),
    ("effect", "of INIT", (("init:\n", "init:\n    isOnTask = false\n"),)),
    (
        "event",
        "one that does nothing",
        (
            (
                "assume: forall k",
                "Wait:\n    pre: isOnTask\n    eff: mine = mine\n\nassume: forall k",
            ),
        ),
    ),
)


#: For so long a text is verified by itself, in seconds of the wall.
PATIENCE_S = 20.0


def _cpu_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _alone(report: Report, text: str, found: koord.VerifyReport, what: str) -> float:
    """The CPU seconds of a verification that knows nothing, which has to say what was found.

    What it leaves open in so many seconds may be known of a claim that is there no more.
    """
    cpu_s = _cpu_s()
    fresh = koord.verify(koord.Source("task.krd", text), timeout_s=PATIENCE_S)
    for one, other in zip(found.verdicts, fresh.verdicts, strict=True):
        same = (one.name, one.outcome, one.rounds) == (other.name, other.outcome, other.rounds)
        is_open = one.name == other.name and other.outcome is Outcome.UNKNOWN
        report.expect(same or is_open, f"{what}: {one!r}, and by itself {other!r}")
    if fresh.holds:
        same = [repr(each) for each in found.vacuities] == [repr(each) for each in fresh.vacuities]
        report.expect(same, f"{what}: {found.vacuities}, and by itself {fresh.vacuities}")
    return _cpu_s() - cpu_s


def edits(report: Report) -> None:
    """Measure each edit, and the medians of all and of each kind."""
    text = (EXAMPLES / "task.krd").read_text("utf-8")
    session = koord.Session()
    table = report.table(
        "Task: verdicts after an edit",
        Column("kind", "kind"),
        Column("edit", "edit"),
        Column("asked", "claims asked", 0),
        Column("cpu_s", "CPU s"),
        Column("wall_s", "wall s"),
        Column("alone_s", "by itself, CPU s"),
    )
    measured: list[tuple[str, float, float]] = []
    for kind, what, changes in (("first", "nothing known", ()), *EDITS):
        now = text
        for old, new in changes:
            assert old in now, what
            now = now.replace(old, new, 1)
        cpu_s, wall_s = _cpu_s(), time.perf_counter()
        found = session.verify(koord.Source("task.krd", now))
        cpu_s, wall_s = _cpu_s() - cpu_s, time.perf_counter() - wall_s
        report.expect(found.holds, f"{kind}, {what}: {found!r}")
        alone_s = None if report.quick else _alone(report, now, found, f"{kind}, {what}")
        asked = sum(not verdict.kept for verdict in found.verdicts)
        table.rows.append(
            {
                "kind": kind,
                "edit": what,
                "asked": asked,
                "cpu_s": cpu_s,
                "wall_s": wall_s,
                "alone_s": alone_s,
            }
        )
        if changes:
            measured.append((kind, cpu_s, wall_s))
    medians = report.table(
        "Medians",
        Column("kind", "kind"),
        Column("edits", "edits", 0),
        Column("cpu_s", "CPU s"),
        Column("wall_s", "wall s"),
    )
    for kind in (*dict.fromkeys(each for each, _, _ in measured), "all"):
        own = [(cpu, wall) for each, cpu, wall in measured if kind in (each, "all")]
        medians.rows.append(
            {
                "kind": kind,
                "edits": len(own),
                "cpu_s": statistics.median(cpu for cpu, _ in own),
                "wall_s": statistics.median(wall for _, wall in own),
            }
        )


if __name__ == "__main__":
    sys.exit(main("edits", __doc__ or "", edits))
