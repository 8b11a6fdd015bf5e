"""Static facts for the compiler: variables that are surely set, code that asks the host."""

from __future__ import annotations

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.core import Home, Start
from koord.syntax.types import ArrayType, RecordType, Robots, Type
from koord.syntax.walk import nodes, reached, statements, written


class Knowledge(Struct):
    """Facts of a program that spare its compiled form checks and arguments."""

    program: core.Program
    #: Functions in whose bodies something is asked, themselves or below.
    asking: set[str] = field(default_factory=set)
    #: Functions that need the robot: its number, the others', the store, the host.
    methods: set[str] = field(default_factory=set)
    #: Functions and external functions that robots call; those of properties alone are left out.
    used: set[str] = field(default_factory=set)
    #: Functions that may be called while INIT is not over.
    in_init: set[str] = field(default_factory=set)
    #: Shared variables that are set once INIT is over, by home and slot.
    shared: set[tuple[Home, int]] = field(default_factory=set)
    #: The same of each kind's own variables.
    own: list[set[tuple[Home, int]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for function in self.program.functions:
            if self.asks(function.body):
                self.asking.add(function.name)
            if self._needs_robot(function.body):
                self.methods.add(function.name)
        self._find_sure()
        self._find_used()

    def asks(self, part: object) -> bool:
        """Return whether any node below asks an external function, or for a choice."""
        return any(
            isinstance(node, core.ExternalCall | core.Choose)
            or (isinstance(node, core.Call) and node.function in self.asking)
            for node in nodes(part)
        )

    def _needs_robot(self, part: object) -> bool:
        return any(
            isinstance(
                node,
                core.Pid
                | core.NumAgents
                | core.Delta
                | core.ExternalCall
                | core.Choose
                | core.RobotRange,
            )
            or (isinstance(node, core.Call) and node.function in self.methods)
            or (isinstance(node, core.Variable) and _is_of_fleet(node))
            for node in nodes(part)
        )

    def _find_used(self) -> None:
        program = self.program
        entries = [*program.allread, *program.allwrite]
        for agent in program.agents:
            entries += [*agent.locals, *(port.declaration for port in agent.ports)]
        starting: tuple[object, ...] = (
            *(entry.initial for entry in entries if not isinstance(entry.initial, Start)),
            *(agent.init for agent in program.agents),
        )
        models = (m.environment or () for agent in program.agents for m in agent.modules)
        self.in_init = self.called(starting)
        self.used = self.called((starting, *(a.events for a in program.agents), *models))

    def called(self, part: object) -> set[str]:
        """The functions that a part of the program calls, directly or through others."""
        return {
            node.function
            for node in reached(self.program, part, duties=True)
            if isinstance(node, core.Call | core.ExternalCall)
        }

    def _find_sure(self) -> None:
        """Find variables that start set, or that every robot's INIT surely sets. [ATOM]"""
        program = self.program
        by_all: set[tuple[Home, int]] | None = None
        for agent in program.agents:
            written = {
                (s.place.variable.home, s.place.variable.slot)
                for s in agent.init
                if isinstance(s, core.Assign) and _is_all_of_it(s.place)
            }
            entries = (*agent.locals, *(port.declaration for port in agent.ports))
            self.own.append(
                {_key(entry) for entry in entries if entry.initial is not Start.UNSET}
                | {key for key in written if key[0] in (Home.LOCAL, Home.PORT)}
            )
            by_all = written if by_all is None else by_all & written
        shared = (*program.allread, *program.allwrite)
        self.shared = {_key(entry) for entry in shared if entry.initial is not Start.UNSET}
        self.shared |= {key for key in by_all or () if key[0] in (Home.ALLREAD, Home.ALLWRITE)}


def _is_of_fleet(variable: core.Variable) -> bool:
    return variable.home is not Home.BOUND or _is_per_robot(variable.type)


def _is_per_robot(type_: Type) -> bool:
    """Return whether the shape of a type's values depends on the number of robots."""
    match type_:
        case ArrayType(element=element, size=size):
            return size is Robots.ALL or _is_per_robot(element)
        case RecordType(fields=fields):
            return any(_is_per_robot(field) for _, field in fields)
        case _:
            return False


def _key(entry: core.Declaration) -> tuple[Home, int]:
    return entry.variable.home, entry.variable.slot


def _is_all_of_it(place: core.Place) -> bool:
    """Return whether a write sets the whole variable, or this robot's entry of it."""
    if place.variable.home is Home.ALLREAD:
        return len(place.steps) == 1
    return not place.steps


def assigned_slots(block: core.Block) -> set[int]:
    """The bound slots that statements of a block write."""
    places = (place for statement in statements(block) for place in written(statement))
    return {place.variable.slot for place in places if place.variable.home is Home.BOUND}
