"""Instances: a program with its robots, and facts of its text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction

from msgspec.structs import replace

from koord.recheck.terms import Term
from koord.recheck.values import Values
from koord.syntax import core
from koord.syntax.core import Direction, Home
from koord.syntax.types import ArrayType, GrowingType, ListType, MapType, Type
from koord.syntax.walk import blocks, nodes, written

#: A variable: its home, the kind of robot (0 for shared ones), its slot.
Key = tuple[Home, int, int]


class Instance:
    """A program, the kind of each robot, and the length of a round in seconds.

    Without ``kinds`` there is any number of robots, each of any kind.
    """

    def __init__(self, program: core.Program, kinds: tuple[int, ...], delta_s: Fraction) -> None:
        self.program = program
        self.kinds = kinds
        self.delta_s = delta_s
        pairs = list(_written(self.program))
        #: Variables that events or the environment may write; as a whole, or an element of a list.
        self.written: frozenset[Key] = frozenset(key for key, _ in pairs)
        moved = frozenset(key for key, _ in _by_events(self.program))
        #: Those that events may write.
        self.moved: frozenset[Key] = moved
        whole = frozenset(key for key, place in pairs if place is None or not _in_list(place))
        self.rewritten: frozenset[Key] = whole
        #: Lists that the program makes, compares and hands on, but never looks into.
        self.sealed: frozenset[Type] = _sealed(self.program)

    @property
    def robots(self) -> int | None:
        """The number of robots; None is any number."""
        return len(self.kinds) or None

    def is_of(self, v: Values, index: Term, kind: int) -> Term:
        """The condition that a robot is of a kind, where the number of robots is open."""
        if len(self.program.agents) == 1:
            return v.t.truth(True)
        return v.t.equal(v.kind(index, len(self.program.agents)), v.t.integer(kind))

    def agent(self, robot: int) -> core.Agent:
        return self.program.agents[self.kinds[robot]]

    def slot_of(self, kind: int, variable: core.Variable) -> int | None:
        """The slot of a local or port of a name in robots of a kind. [PROP-READ]"""
        agent = self.program.agents[kind]
        own = agent.locals if variable.home is Home.LOCAL else _ports(agent)
        here = [d.variable for d in own if d.variable.name == variable.name]
        for found in here:
            if found.slot == variable.slot:
                return found.slot
        return here[0].slot if here else None

    def guarding(self, slot: int, fields: Sequence[int] | None = None) -> int | None:
        """The lock class whose blocks alone write an allwrite variable, if there is one.

        With ``fields`` the positions of fields on the way to a part of it, whatever the indices:
        then the class whose blocks alone write that part.
        """
        classes = {
            lock
            for agent in self.program.agents
            for event in agent.events
            for place, lock in _places(event.effect, None)
            if place.variable.home is Home.ALLWRITE and place.variable.slot == slot
            if fields is None or _may_meet(place, fields)
        }
        return classes.pop() if len(classes) == 1 else None

    def mentions(self, kind: type) -> bool:
        """Return whether a property contains a node of a class."""
        return any(isinstance(node, kind) for node in nodes(self.program.properties))

    @property
    def promised(self) -> bool:
        """True if contracts restrict the environment."""
        modules = [module for agent in self.program.agents for module in agent.modules]
        return any(m.contracts for m in modules if m.environment is None)

    def asks(self) -> bool:
        """Return whether some robot may call ``trystop``."""
        bodies = tuple((agent.init, agent.events) for agent in self.program.agents)
        return any(isinstance(node, core.TryStop) for node in nodes(bodies))

    def stops(self) -> bool:
        bodies = tuple((agent.init, agent.events) for agent in self.program.agents)
        return any(isinstance(node, core.Stop | core.TryStop) for node in nodes(bodies))

    def urgent(self) -> bool:
        return any(event.urgent for agent in self.program.agents for event in agent.events)


def _ports(agent: core.Agent) -> tuple[core.Declaration, ...]:
    return tuple(port.declaration for port in agent.ports)


# --- what may be written --------------------------------------------------------------------------


def _places(block: core.Block, lock: int | None) -> Iterator[tuple[core.Place, int | None]]:
    """The places that a block writes, each with the lock class around it."""
    for s in block:
        yield from ((place, lock) for place in written(s))
        inner = s.lock_class if isinstance(s, core.Atomic) else lock
        for below in blocks(s):
            yield from _places(below, inner)


def _by_events(program: core.Program) -> Iterator[tuple[Key, core.Place | None]]:
    """The variables that events may change, each with the place; None where a list's length may."""
    for kind, agent in enumerate(program.agents):
        for event in agent.events:
            yield from _by_block(kind, event.effect)


def _written(program: core.Program) -> Iterator[tuple[Key, core.Place | None]]:
    """The variables that may change after INIT, by events or the environment's turn."""
    yield from _by_events(program)
    for kind, agent in enumerate(program.agents):
        for module in agent.modules:
            if module.environment is not None:
                yield from _by_block(kind, module.environment)
                continue
            for position in module.ports:
                port = agent.ports[position]
                if port.direction is Direction.SENSOR:
                    yield (Home.PORT, kind, port.declaration.variable.slot), None


def _by_block(kind: int, block: core.Block) -> Iterator[tuple[Key, core.Place | None]]:
    changes = _list_changes(block)
    for place, _ in _places(block, None):
        own = place.variable.home in (Home.LOCAL, Home.PORT)
        key = (place.variable.home, kind if own else 0, place.variable.slot)
        yield key, None if place in changes else place


def _list_changes(block: core.Block) -> set[core.Place]:
    """The places whose lists change their length in a block."""
    kinds = core.Append | core.Remove | core.Pop
    return {node.place for node in nodes(block) if isinstance(node, kinds)}


def _may_meet(place: core.Place, fields: Sequence[int]) -> bool:
    """Return whether a place and a path of fields may overlap."""
    own = [step.position for step in place.steps if isinstance(step, core.FieldStep)]
    return all(x == y for x, y in zip(own, fields, strict=False))


def _in_list(place: core.Place) -> bool:
    """Return whether a place is inside a list, so that writing to it keeps the length."""
    type_ = place.variable.type
    for step in place.steps:
        if isinstance(type_, GrowingType | MapType):
            return isinstance(type_, GrowingType)
        type_ = step.type
    return False


# --- what is never looked into --------------------------------------------------------------------


def _sealed(program: core.Program) -> frozenset[Type]:
    """Types of lists whose elements and lengths only summaries read."""
    types = {type_ for node in nodes(program) if (type_ := _list_type(node)) is not None}
    duties = tuple(external.requires for external in program.externals)
    looked = {t for node in nodes((replace(program, externals=()), duties)) for t in opened(node)}
    return frozenset(types - looked)


def _list_type(node: object) -> Type | None:
    type_ = getattr(node, "type", None) if isinstance(node, core.Node | core.Variable) else None
    while isinstance(type_, ArrayType):
        type_ = type_.element
    return type_ if isinstance(type_, ListType) else None


def opened(node: object) -> Iterator[Type]:
    """The types of lists whose elements or length a node reads."""
    match node:
        case core.Place(variable=variable, steps=steps):
            yield from (variable.type, *(step.type for step in steps[:-1])) if steps else ()
        case core.Select(base=base):
            yield base.type
        case core.Builtin(arguments=(first, *_)):
            yield first.type
        case core.ForEach(sequence=sequence) | core.Elements(sequence=sequence):
            yield sequence.type
        case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
            yield place.type
        case core.Declaration(variable=variable, length=int()):
            yield variable.type
        case _:
            return
