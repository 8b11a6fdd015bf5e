"""Footprints: the variables that parts of a program read, write after INIT, and update.

Where induction starts from *any* configuration, this says what the configuration cannot have
forgotten: variables that no event writes keep the value they had after INIT; lists that are only
written element by element keep their length; an atom that is set is never unset.

A robot that updates a shared variable, that is computes its new value from the old one, outside of
an atomic block, loses the other's work if another robot writes the same location in the same round.
[LOST-UPDATE]
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from enum import IntEnum

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.core import Direction, Home, slot_in
from koord.syntax.source import Span
from koord.syntax.system import Status
from koord.syntax.types import GrowingType
from koord.syntax.walk import children, nodes, statements, written


class Reads(Struct, frozen=True):
    """The slots that a part of a program reads, by home.

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
        """True if the robot's number may matter: ``pid``, or its place among all entries."""
        return self.pid or bool(self.arrays)


def reads_of(
    program: core.Program, *parts: core.Expr | core.Block, agent: core.Agent | None = None
) -> Reads:
    """The reads of parts of a program. In properties, ``agent`` says whose slots are meant."""
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
    """The union of several reads."""
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
        """Visit a place that is written: only what is left of the variable is read."""
        own = place.variable.home is Home.ALLREAD and _is_own(place)
        if len(place.steps) > own:
            self._read(place)


def _is_own(place: core.Place) -> bool:
    """Return whether a place lies in the robot's own entry."""
    first = place.steps[0] if place.steps else None
    return isinstance(first, core.IndexStep) and isinstance(first.index, core.Pid)


_RESIZING = core.Append | core.Remove | core.Pop


class WriteExtent(IntEnum):
    """The extent to which a variable may change."""

    NEVER = 0
    PARTS = 1  #: elements or fields below an atom, never the atom as such
    WHOLE = 2


Footprint = dict[tuple[Home, int, int], WriteExtent]
"""(home, agent kind or 0 for shared variables, slot) → how it is written; NEVER is left out."""


def footprint(program: core.Program) -> Footprint:
    """The extent to which events and environments of a program write each variable."""
    found: Footprint = {}
    for kind, agent in enumerate(program.agents):
        for event in agent.events:
            for place in _changed(event.effect):
                _note(found, kind, place)
        for module in agent.modules:
            for place in _changed(module.environment or ()):
                _note(found, kind, place)
            if module.environment is None:
                for position in module.ports:
                    port = agent.ports[position]
                    if port.direction is Direction.SENSOR:
                        slot = port.declaration.variable.slot
                        found[Home.PORT, kind, slot] = WriteExtent.WHOLE
    return found


def statuses(program: core.Program) -> tuple[frozenset[Status], ...]:
    """The statuses that robots of each kind may have between rounds. [STOP]"""
    asking = any(_has(agent, core.TryStop) for agent in program.agents)
    found = []
    for agent in program.agents:
        possible = {Status.RUNNING}
        if asking or _has(agent, core.Stop):
            possible.add(Status.STOPPED)
        if _has(agent, core.TryStop):
            possible.add(Status.ASKED)
        found.append(frozenset(possible))
    return tuple(found)


def _has(agent: core.Agent, kind: type[core.Stop] | type[core.TryStop]) -> bool:
    return any(
        isinstance(statement, kind)
        for block in (agent.init, *(event.effect for event in agent.events))
        for statement in statements(block)
    )


def stops_show(program: core.Program) -> bool:
    """Return whether a property can tell stopped robots from ones that asked to stop. [STOP]"""
    asks = any(
        isinstance(node, core.TryStop)
        for agent in program.agents
        for node in nodes((agent.init, agent.events))
    )
    looks = any(isinstance(node, core.Stopped) for node in nodes(program.properties))
    return asks and looks


def _note(found: Footprint, kind: int, place: core.Place) -> None:
    variable = place.variable
    own = variable.home in (Home.LOCAL, Home.PORT)
    key = (variable.home, kind if own else 0, variable.slot)
    how = WriteExtent.PARTS if _inside_list(place) else WriteExtent.WHOLE
    found[key] = max(found.get(key, WriteExtent.NEVER), how)


def _inside_list(place: core.Place) -> bool:
    """Return whether a place is in a list, so that writing to it keeps the list's length.

    Writing at a map's key may add the key, so that changes the map as a whole.
    """
    inside = False
    type_ = place.variable.type
    for step in place.steps:
        if isinstance(step, core.KeyStep):
            return False
        inside = inside or isinstance(type_, GrowingType)
        type_ = step.type
    return inside


def _changed(block: core.Block) -> Iterator[core.Place]:
    """Yield the places that a block writes; a whole variable if a list in it changes its length."""
    for statement in statements(block):
        resized = statement.place if isinstance(statement, _RESIZING) else None
        for place in written(statement):
            yield core.Place(place.variable) if place is resized else place


def rewritten(program: core.Program) -> dict[tuple[int, int], frozenset[int]]:
    """For each event (agent kind, position) the allwrite slots it updates outside of ``atomic``."""
    found = {}
    for kind, agent in enumerate(program.agents):
        for position, event in enumerate(agent.events):
            slots = frozenset(slot for slot, _ in updates(event.effect))
            if slots:
                found[kind, position] = slots
    return found


def updates(effect: core.Block) -> Iterator[tuple[int, Span]]:
    """The statements of an effect that update allwrite variables, each with its slot.

    To update is, outside of ``atomic``, to write a value that is computed from the variable's own
    old value, in the same statement or by way of others; to append, remove or pop; or to write a
    part of a map's entry, which writes the rest of the entry as it was read.
    """
    givers = _givers(effect)
    for statement in statements(effect, atomic=False):
        match statement:
            case core.Assign(place=place, value=value):
                if place.variable.home is Home.ALLWRITE and (
                    place.is_below_key or place.variable in _origins(givers, _read(value))
                ):
                    yield place.variable.slot, statement.span
            case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
                if place.variable.home is Home.ALLWRITE:
                    yield place.variable.slot, statement.span
                into = statement.into if isinstance(statement, core.Pop) else None
                if into is not None and into.variable.home is Home.ALLWRITE and into.is_below_key:
                    yield into.variable.slot, statement.span
            case _:
                pass


def _givers(effect: core.Block) -> dict[core.Variable, set[core.Variable]]:
    """The variables whose values flow into each variable in the statements of an effect."""
    found: dict[core.Variable, set[core.Variable]] = defaultdict(set)
    for statement in statements(effect):
        match statement:
            case core.Assign(place=place, value=value) | core.Append(place=place, value=value):
                found[place.variable].update(_read(value))
            case core.Pop(place=place, into=core.Place(variable=into)):
                found[into].add(place.variable)
            case core.ForEach(key=key, value=variable, sequence=sequence):
                for bound in (key, variable):
                    if bound is not None:
                        found[bound].update(_read(sequence))
            case _:
                pass
    return found


def _origins(
    givers: dict[core.Variable, set[core.Variable]], read: Iterable[core.Variable]
) -> set[core.Variable]:
    """The variables that are read, and those whose values flow into them."""
    found: set[core.Variable] = set()
    waiting = list(read)
    while waiting:
        variable = waiting.pop()
        if variable not in found:
            found.add(variable)
            waiting += givers.get(variable, ())
    return found


def _read(value: core.Expr) -> Iterator[core.Variable]:
    """Every variable read in an expression."""
    return (node.variable for node in nodes(value) if isinstance(node, core.Place))
