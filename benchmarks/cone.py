"""What a claim cannot depend on costs nothing: programs as they are, and with more in their text.

Each kind of addition is something that no claim of the program can depend on [T-CONE]: sensors that
nobody reads, variables that are written only, events and locks of their own. ``koord verify`` is
asked plainly of both texts. Costs are CPU seconds of the whole command, so that reading the longer
text is among them; *more* is what the addition costs, *limit* 10 % and 0.1 s of what the program
itself does. A verdict, or a number of rounds, that an addition changes is a wrong answer.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from harness import EXAMPLES, Column, Measured, Report, best, koord, main, note

PATIENCE_S = 200.0

#: What an addition may cost: a share of what is there, and seconds.
SHARE, SECONDS = 0.1, 0.1

SMALL = """\
local:
    int x = 0
Up:
    pre: x < 6
    eff: x = x + 2
invariant Small: forall i: x@i < 4
"""

#: Of how a robot that drives comes to what it is sent to.
DRIVING = """\
using Motion:
    sensors:
        bool reached
    actuators:
        int target = 0
local:
    int leg = 0
Go:
    pre: leg < 3 and Motion.target == leg
    eff: Motion.target = leg + 1
Come:
    pre: Motion.target > leg and Motion.reached
    eff: leg = Motion.target
assume Arrives: Motion.target > leg leadsto ran(Come)
invariant Legs: forall i: leg@i <= 3
eventually All: forall i: leg@i == {last}
"""

RIGHT = ("leader_elect", "sum_of_ids", "shortest_path", "delivery", "mapping", "fischer")
BROKEN = (
    "leader_elect_early",
    "leader_elect_restless",
    "sum_of_ids_no_lock",
    "traffic_no_lock",
    "follow_points_ahead",
    "mapping_race",
    "hvac_may_sleep",
)


def programs() -> dict[str, str]:
    """The texts that are added to, by name."""
    found = {"small": SMALL, "driving": DRIVING.format(last=3)}
    found["driving, broken"] = DRIVING.format(last=4)
    found |= {name: (EXAMPLES / f"{name}.krd").read_text("utf-8") for name in RIGHT}
    found |= {name: (EXAMPLES / "broken" / f"{name}.krd").read_text("utf-8") for name in BROKEN}
    return found


# --- additions ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Addition:
    """Something that no claim depends on.

    An event is not such a thing where an event of the program is urgent (any other meets the
    obligation as well), or where whole runs are claimed about (a robot may go on with it for ever).
    """

    declared: str  #: sections
    done: str = ""  #: a statement that every event runs besides
    event: str = ""

    def fits(self, text: str) -> bool:
        return not self.event or not re.search(r"^(urgent|eventually)\b", text, re.MULTILINE)

    def to(self, text: str) -> str:
        """The text with the addition in it."""
        if self.done:
            text = re.sub(r"^( +)eff:[ ]*(?=\S|$)", self._doing, text, flags=re.MULTILINE)
        for place, added in ((_FIRST_EVENT, self.event), (_FIRST_SECTION, self.declared)):
            begins = place.search(text)
            assert begins is not None
            text = text[: begins.start()] + added + text[begins.start() :]
        return text

    def _doing(self, found: re.Match[str]) -> str:
        inner = found[1] + "    "
        ends = found.string[found.end() : found.end() + 1] == "\n"
        return f"{found[1]}eff:\n{inner}{self.done}" + ("" if ends else f"\n{inner}")


_FIRST_EVENT = re.compile(r"^(?!init\b)\w+:\n    (pre|eff):", re.MULTILINE)
_FIRST_SECTION = re.compile(r"^(using .*|allread|allwrite|local|init|agent .*):", re.MULTILINE)

_EVENT = "Spare:\n    pre: {guard}\n    eff:\n        {effect}\n"

ADDITIONS = {
    "sensor pos": Addition("using Spare:\n    sensors:\n        pos place\n"),
    "sensors": Addition(
        "using Spare:\n    sensors:\n        float level\n        int[4] counts\n"
        "        Map<int, int> seen\n        pos[] way\n"
    ),
    "contract": Addition(
        "using Spare:\n    sensors:\n        float level\n    contract Rises:\n"
        "        ensures: level' > level\n"
    ),
    "counter": Addition("local:\n    int spare = 0\n", "spare = spare + 1"),
    "array": Addition("local:\n    int[4] spare = [0, 0, 0, 0]\n", "spare[0] = spare[1] + 1"),
    "map": Addition("local:\n    Map<int, int> spare = {}\n", "spare[numAgents] = 1"),
    "path": Addition("local:\n    pos[] spare = []\n", "spare = [pos(0, 0, 0)]"),
    "allread": Addition("allread:\n    int[] spare = 0\n", "spare[pid] = spare[pid] + 1"),
    "output": Addition("local:\n    int spare = 0\n", "stdout << spare"),
    "event": Addition(
        "local:\n    int spare = 0\n",
        event=_EVENT.format(guard="spare >= 0", effect="spare = spare + 1"),
    ),
    "lock": Addition(
        "allwrite:\n    int spare = 0\n",
        event=_EVENT.format(guard="true", effect="atomic: spare = spare + 1"),
    ),
    "assumption": Addition("local:\n    int spare\nassume: spare > 5\n"),
}

FEW = ("sensor pos", "counter", "event")


# --- the measurement ------------------------------------------------------------------------------


def asked(text: str) -> Measured:
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "program.krd"
        path.write_text(text, "utf-8")
        return koord(
            *("verify", str(path), "--json", "--jobs", "1", "--timeout", str(PATIENCE_S)),
            timeout_s=PATIENCE_S + 30,
        )


#: The outcome of each claim, the round that breaks it or through which it holds, and its loop.
Said: TypeAlias = dict[str, tuple[str, int | None, int | None]]


def said(measured: Measured, names: Collection[str] | None = None) -> Said | None:
    """What is said of each claim, or of the named ones; None if there was no answer."""
    report = measured.report()
    if report is None:
        return None
    found: Said = {}
    for claim in report["claims"]:
        if names is None or claim["name"] in names:
            broken = claim["violated"] or {"round": claim["through_round"], "loop": None}
            found[claim["name"]] = (claim["outcome"], broken["round"], broken["loop"])
    return found


def cone(report: Report) -> None:
    chosen = [a for a in ADDITIONS if not report.quick or a in FEW]
    table = report.table(
        "koord verify, of programs with something that no claim can depend on",
        Column("program", "program"),
        Column("addition", "addition"),
        Column("plain_s", "plain CPU s"),
        Column("cpu_s", "with it"),
        Column("more_s", "more"),
        Column("limit_s", "limit"),
        Column("met", "met"),
        Column("same", "same verdicts"),
    )
    for name, text in programs().items():
        _compare(report, table.rows.append, name, text, chosen)


def _compare(
    report: Report, tell: Callable[[Any], None], name: str, text: str, chosen: list[str]
) -> None:
    note(name)
    runs = 1 if report.quick else 2
    plain = best(runs, lambda: asked(text))
    verdicts = said(plain)
    for addition in chosen:
        if not ADDITIONS[addition].fits(text):
            continue
        note(f"{name}, {addition}")
        longer = ADDITIONS[addition].to(text)
        measured = best(runs, lambda longer=longer: asked(longer))  # type: ignore[misc]
        more = measured.cpu_s - plain.cpu_s
        limit = SHARE * plain.cpu_s + SECONDS
        others = said(measured, verdicts or {})
        same = verdicts is not None and others == verdicts
        report.expect(same, f"{name}, {addition}: {others} where it was {verdicts}")
        tell(
            {
                "program": name,
                "addition": addition,
                "plain_s": round(plain.cpu_s, 2),
                "cpu_s": round(measured.cpu_s, 2),
                "more_s": round(more, 2),
                "limit_s": round(limit, 2),
                "met": more <= limit,
                "same": same,
            }
        )


if __name__ == "__main__":
    sys.exit(main("cone", __doc__ or "", cone))
