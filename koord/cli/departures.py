"""What a compiled program did of a recorded run, as text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from koord.cli.terminal import visible
from koord.traces.changes import Change
from koord.traces.json_reader import shortened
from koord.traces.trace import BEFORE_ROUNDS

if TYPE_CHECKING:
    from koord.refinement.compiled_replay import Rerun

_WIDEST = 40


def rerun_lines(departure: Rerun) -> Iterator[str]:
    """Whether the compiled program does the same, and where it does not."""
    from koord.refinement.rounding import Unjudged  # what it loads only violations need

    if departure is None:
        yield "  the compiled program does the same, state for state"
        return
    if isinstance(departure, Unjudged):
        yield "  the compiled program comes to the same states, up to rounding; whether it breaks"
        yield f"  the claim there is not known: {visible(departure.reason)}"
        return
    where = f"round {departure.round + 1}" if departure.round != BEFORE_ROUNDS else "the start"
    yield f"  the compiled program departs at {where}: {visible(departure.reason)}"
    yield from told_apart(departure.changes, "recorded", "compiled")


def told_apart(changes: Iterable[Change], old: str, new: str) -> Iterator[str]:
    """The locations that differ, as a table with these headings; nothing if there are none."""
    rows = [(_location(change), change.old, change.new) for change in changes]
    if not rows:
        return
    cut = [
        tuple(shortened(visible(cell), _WIDEST) for cell in row) for row in [("", old, new), *rows]
    ]
    widths = [max(len(row[k]) for row in cut) for k in range(3)]
    for row in cut:
        yield "  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()


def _location(change: Change) -> str:
    return change.name if change.robot is None else f"{change.name} of robot {change.robot}"
