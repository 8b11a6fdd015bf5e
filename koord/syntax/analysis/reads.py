"""What a part of a program reads: what its outcome can depend on. Read off the text."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.core import Home, slot_in
from koord.syntax.walk import children


class Reads(Struct, frozen=True):
    """Slots that are read, by home.

    ``entries`` are allread variables read at the robot's own entry, ``arrays`` those read anywhere
    else. A variable that is written in part counts as read: what becomes of it depends on the rest.
    """

    locals: tuple[int, ...] = ()
    ports: tuple[int, ...] = ()
    entries: tuple[int, ...] = ()
    arrays: tuple[int, ...] = ()
    allwrite: tuple[int, ...] = ()
    pid: bool = False  #: other than as the index of the own entry
    ran: bool = False
    status: bool = False

    @property
    def is_placed(self) -> bool:
        """Whether the robot's number may matter: by name, or as its place among all entries."""
        return self.pid or bool(self.arrays)


def reads_of(
    program: core.Program, *parts: core.Expr | core.Block, agent: core.Agent | None = None
) -> Reads:
    """What some parts of a program read. In properties, ``agent`` says whose slots are meant."""
    reader = _Reader(program, agent)
    reader.visit(parts)
    return Reads(
        _ordered(reader.found[Home.LOCAL]),
        _ordered(reader.found[Home.PORT]),
        _ordered(reader.entries),
        _ordered(reader.found[Home.ALLREAD]),
        _ordered(reader.found[Home.ALLWRITE]),
        reader.pid,
        reader.ran,
        reader.status,
    )


def together(reads: Iterable[Reads]) -> Reads:
    """What several parts read."""
    listed = list(reads)
    return Reads(
        _ordered(x for r in listed for x in r.locals),
        _ordered(x for r in listed for x in r.ports),
        _ordered(x for r in listed for x in r.entries),
        _ordered(x for r in listed for x in r.arrays),
        _ordered(x for r in listed for x in r.allwrite),
        any(r.pid for r in listed),
        any(r.ran for r in listed),
        any(r.status for r in listed),
    )


def _ordered(slots: Iterable[int]) -> tuple[int, ...]:
    return tuple(sorted(set(slots)))


class _Reader(Struct):
    program: core.Program
    agent: core.Agent | None
    found: dict[Home, set[int]] = field(default_factory=lambda: {home: set() for home in Home})
    entries: set[int] = field(default_factory=set)
    pid: bool = False
    ran: bool = False
    status: bool = False

    def visit(self, part: object) -> None:
        match part:
            case core.Assign(place=place, value=value):
                self.visit(value)
                self._written(place)
            case core.Pop(place=place, into=into):
                self.visit(place)
                if into is not None:
                    self._written(into)
            case core.Place():
                self._read(part)
            case core.Call(function=name):
                self.visit(part.arguments)
                self.visit(self.program.function(name).body)
            case core.Pid():
                self.pid = True
            case core.Ran():
                self.ran = True
                self.visit(part.robot)
            case core.Stopped():
                self.status = True
                self.visit(part.robot)
            case _:
                for below in children(part):
                    self.visit(below)

    def _read(self, place: core.Place) -> None:
        variable = place.variable
        self.visit((place.robot,))
        if variable.home is Home.ALLREAD and _is_own(place):
            self.entries.add(variable.slot)
            self.visit(place.steps[1:])
            return
        slot: int | None = variable.slot
        if self.agent is not None and variable.home in (Home.LOCAL, Home.PORT):
            # Kinds of robots may number a name differently.
            slot = slot_in(self.agent, variable)
        if slot is not None:
            self.found[variable.home].add(slot)
        self.visit(place.steps)

    def _written(self, place: core.Place) -> None:
        """A place that is written: only what is left of the variable is read."""
        own = place.variable.home is Home.ALLREAD and _is_own(place)
        if len(place.steps) > own:
            self._read(place)


def _is_own(place: core.Place) -> bool:
    """Whether a place lies in the robot's own entry."""
    first = place.steps[0] if place.steps else None
    return isinstance(first, core.IndexStep) and isinstance(first.index, core.Pid)
