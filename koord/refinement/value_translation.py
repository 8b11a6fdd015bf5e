"""Values and configurations of the runtime as those of the semantics, and back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from koord.runtime.compile.naming import Names
from koord.runtime.engine.fleet import Fleet
from koord.runtime.robot import Robot as Running
from koord.runtime.robot import Written as Output
from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store, Written
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.recordings import Concrete
from koord.semantics.storage import Cell, Storage, Tree, unset
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.types import ArrayType, MapType, RecordType, SequenceType, Type


def to_value(value: Any, type_: Type) -> Concrete:
    """A value of the runtime, or one that a host gave, as one of the semantics."""
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
    """A value of the semantics as a host gives it to a compiled program."""
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
    """What a statement wrote to a stream, with the types of what it wrote."""
    types = tuple(value.type for value in statement.values)
    return Written(written.stream, tuple(map(to_value, written.values, types)), types)


def to_storage(value: Any, type_: Type, robots: int) -> Storage[Constant]:
    """What an attribute holds as what a variable holds: atoms that are set or unset. [ATOM]"""
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


class Observer:
    """Looks at a fleet, and sees a configuration of the semantics. [CONFIG]"""

    def __init__(self, system: System, names: Names) -> None:
        self.system = system
        self.names = names

    def configuration(self, fleet: Fleet) -> Configuration[Constant]:
        """The configuration between two rounds, or between the turns of one."""
        store = self._store(fleet.store.values)
        robots = tuple(map(self.robot, fleet.robots))
        return Configuration(robots, store, fleet.round)

    def robot(self, robot: Running) -> Robot[Constant]:
        """The state of one robot; its copy of the shared variables is what it holds of them."""
        agent = self.system.agent(robot.pid)
        kind = self.system.kinds[robot.pid]
        held = vars(robot)
        ports = (port.declaration for port in agent.ports)
        return Robot(
            kind,
            self._storages(held, agent.locals, kind),
            self._storages(held, ports, kind),
            self._store(held),
            robot.status.value,
            NO_EVENT if robot.ran is None else robot.ran,
        )

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
