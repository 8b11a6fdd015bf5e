"""Values that grow without end: a run stops before the machine does."""

from __future__ import annotations

from msgspec import Struct, field

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.recordings import Concrete
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.values import Rec, Seq, Table
from koord.syntax.diagnostics import refusal

#: What one variable holds has at most so many parts. Fixed arrays have a limit of their own.
MOST_LISTED = 100_000


def check_lengths(before: Configuration[Constant], after: Configuration[Constant]) -> None:
    """Raise KoordError if a step made a list that is too long to go on with."""
    for old, new in zip(before.robots, after.robots, strict=True):
        if old is not new:
            _check_all(old.locals, new.locals)
            _check_all(old.ports, new.ports)
    _check_all(before.store.allread, after.store.allread)
    _check_all(before.store.allwrite, after.store.allwrite)


def _check_all(before: tuple[Storage[Constant], ...], after: tuple[Storage[Constant], ...]) -> None:
    scale = _Scale()
    for old, new in zip(before, after, strict=True):
        if old is not new and scale.listed(new) > MOST_LISTED:
            raise refusal(
                "K924",
                "koord run",
                f"a list has grown to more than {MOST_LISTED} parts",
                "run for fewer rounds, or take out of lists what is no more needed",
            )


class _Scale(Struct):
    """Counts the parts of lists, those of lists within lists too.

    A list may hold one and the same list many times over, and that one another: each is counted
    once, and the counts are added up.
    """

    _known: dict[int, int] = field(default_factory=dict)

    def listed(self, part: Storage[Constant] | Concrete) -> int:
        """How many parts the lists in storage or a value have; other parts count nothing."""
        match part:
            case Cell(value=value):
                return self.listed(value)
            case Tree(parts=parts):
                return sum(map(self.listed, parts))
            case Rec(fields=fields):
                return sum(map(self.listed, fields))
            case Seq(items=items):
                if id(part) not in self._known:
                    self._known[id(part)] = len(items) + sum(map(self.listed, items))
                return self._known[id(part)]
            case Table(entries=entries):
                inside = sum(self.listed(k) + self.listed(v) for k, v in entries)
                return 2 * len(entries) + inside
            case _:
                return 0
