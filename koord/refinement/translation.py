"""Translation between values of the runtime and of the semantics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from koord.runtime import proposals
from koord.runtime.buffers import Written as Output
from koord.runtime.compile.naming import PythonNames
from koord.runtime.engine import RoundEngine
from koord.runtime.robot import Robot as Running
from koord.runtime.robot import Turn
from koord.semantics.configurations import NO_EVENT, Configuration, Fault, Robot, Store, Written
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.oracle import Phase
from koord.semantics.recordings import Concrete, Reading, Start
from koord.semantics.storage import Cell, Storage, Tree, unset
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.source import NOWHERE
from koord.syntax.system import System
from koord.syntax.types import ArrayType, MapType, RecordType, SequenceType, Type

#: When a host is asked, as recordings have it.
PHASES = {Turn.INIT: Phase.INIT, Turn.PROG: Phase.PROG, Turn.ENV: Phase.ENV}


def to_value(value: Any, type_: Type) -> Concrete:
    """Convert a value of the runtime, or of a host, to one of the semantics."""
    match type_:
        case RecordType(fields=fields):
            pairs = zip(value, fields, strict=True)
            return Rec(tuple(to_value(part, t) for part, (_, t) in pairs))
        case SequenceType(element=element):
            items = tuple(to_value(item, element) for item in value)
            return Seq(len(items), items)
        case MapType(key=key, value=held):
            of_map = value.items() if isinstance(value, dict) else value
            entries = tuple((to_value(k, key), to_value(v, held)) for k, v in of_map)
            return Table(len(entries), entries)
        case _:
            found: Constant = value
            return found


def to_plain(value: Concrete) -> Any:
    """Convert a value of the semantics to a host's, for a compiled program."""
    match value:
        case Rec(fields=parts):
            return tuple(map(to_plain, parts))
        case Seq(items=items):
            return tuple(map(to_plain, items))
        case Table(entries=entries):
            return tuple((to_plain(k), to_plain(v)) for k, v in entries)
        case _:
            return value


def to_written(written: Output, statement: core.Output) -> Written[Constant]:
    """Convert the output of a statement, with the types of its values."""
    types = tuple(value.type for value in statement.values)
    return Written(written.stream, tuple(map(to_value, written.values, types)), types)


def to_storage(value: Any, type_: Type, robots: int) -> Storage[Constant]:
    """Convert an attribute's value to storage: atoms that are set or unset. [ATOM]"""
    match type_:
        case RecordType(fields=fields):
            pairs = zip(value, fields, strict=True)
            return Tree(tuple(to_storage(part, t, robots) for part, (_, t) in pairs))
        case ArrayType(element=element):
            return Tree(tuple(to_storage(part, element, robots) for part in value))
        case _:
            if value is None:
                return unset(DOUBLES, type_, robots)
            return Cell(True, to_value(value, type_))


def to_fault(found: proposals.EventFault, robot: int | None) -> Fault:
    """Convert a fault; its place is known by the runtime's name only."""
    return Fault(found.kind, robot, NOWHERE, found.detail)


class Translation:
    """Translation of attributes, queries and states of a system's robots. [CONFIG]"""

    def __init__(self, system: System, names: PythonNames) -> None:
        self.system = system
        self.names = names
        self._declared = dict(_declared(system.program, names))

    # --- what hosts are asked -------------------------------------------------------------------

    def declaration(self, robot: int | None, name: str) -> core.Declaration:
        """The declaration of an attribute; ``robot`` is None for allwrite variables."""
        return self._declared[None if robot is None else self.system.kinds[robot], name]

    def start(self, robot: int | None, name: str, value: Any) -> Start:
        """The recorded start of an attribute."""
        variable = self.declaration(robot, name).variable
        return Start(variable.home, variable.slot, robot, to_value(value, variable.own_type))

    def attribute(self, start: Start) -> str:
        """The attribute of a recorded start."""
        kind = None if start.robot is None else self.system.kinds[start.robot]
        return next(
            name
            for (of, name), entry in self._declared.items()
            if (of, entry.variable.home, entry.variable.slot) == (kind, start.home, start.slot)
        )

    def ports(self, robot: int) -> dict[str, core.Port]:
        """A robot's ports by attribute."""
        kind = self.system.kinds[robot]
        ports = self.system.program.agents[kind].ports
        return {self.names.attribute(port.declaration.variable, kind): port for port in ports}

    def reading(self, robot: int, name: str, value: Any) -> Reading:
        """The recorded reading of the sensor of an attribute."""
        variable = self.declaration(robot, name).variable
        return Reading(robot, variable.slot, to_value(value, variable.type))

    def question(
        self, function: str, arguments: Iterable[Any]
    ) -> tuple[core.External, tuple[Concrete, ...]]:
        """The external function of a query, and its arguments."""
        external = self.system.program.external(function)
        pairs = zip(arguments, external.parameters, strict=True)
        return external, tuple(to_value(value, parameter.type) for value, parameter in pairs)

    # --- what robots hold -----------------------------------------------------------------------

    def configuration(self, fleet: RoundEngine) -> Configuration[Constant]:
        """The configuration between two rounds, or between the turns of one."""
        store = self._store(fleet.store.values)
        robots = tuple(map(self.robot, fleet.robots))
        return Configuration(robots, store, fleet.round)

    def robot(self, robot: Running) -> Robot[Constant]:
        """The state of one robot, with its copy of the shared variables."""
        agent = self.system.agent(robot.pid)
        kind = self.system.kinds[robot.pid]
        held = vars(robot)
        return Robot(
            kind,
            self._storages(held, agent.locals, kind),
            self.held_ports(robot),
            self._store(held),
            robot.status.value,
            NO_EVENT if robot.ran is None else robot.ran,
        )

    def held_ports(self, robot: Running) -> tuple[Storage[Constant], ...]:
        """What a robot's ports hold."""
        kind = self.system.kinds[robot.pid]
        ports = (port.declaration for port in self.system.agent(robot.pid).ports)
        return self._storages(vars(robot), ports, kind)

    def _store(self, held: Mapping[str, Any]) -> Store[Constant]:
        program = self.system.program
        return Store(
            self._storages(held, program.allread, None),
            self._storages(held, program.allwrite, None),
        )

    def _storages(
        self, held: Mapping[str, Any], entries: Iterable[core.Declaration], kind: int | None
    ) -> tuple[Storage[Constant], ...]:
        return tuple(
            to_storage(
                held[self.names.attribute(entry.variable, kind)],
                entry.variable.type,
                self.system.robots,
            )
            for entry in entries
        )


def _declared(
    program: core.Program, names: PythonNames
) -> Iterator[tuple[tuple[int | None, str], core.Declaration]]:
    """The variables that may start arbitrarily, by kind and attribute."""
    for entry in program.allwrite:
        yield (None, names.attribute(entry.variable, None)), entry
    for kind, agent in enumerate(program.agents):
        ports = (port.declaration for port in agent.ports)
        for entry in (*agent.locals, *ports, *program.allread):
            yield (kind, names.attribute(entry.variable, kind)), entry
