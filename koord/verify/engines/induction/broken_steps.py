"""Counterexamples to induction: a step from where all claims hold to where one does not.

Such a step is no run: nobody knows whether its first configuration can be reached. It shows what an
invariant leaves open, and never passes for a violation.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store
from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage, Tree
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.types import INT, ArrayType, RecordType, Type
from koord.verify.claims import ClaimPhase
from koord.verify.encoding.terms import Term
from koord.verify.verdicts import BrokenStep
from koord.verify.witness import ModelReader


def broken_step(
    reader: ModelReader,
    before: Sequence[Configuration[Term]],
    last: Configuration[Term],
    phase: ClaimPhase,
) -> BrokenStep:
    """The step that a model describes: from the ends of rounds ``before`` to ``last``."""
    read = tuple(_configuration(reader, c) for c in (*before, last))
    events = tuple(tuple(_event(robot.ran) for robot in c.robots) for c in read[1:])
    return BrokenStep(read, events, phase)


def _event(ran: Constant) -> int:
    assert isinstance(ran, int)
    return ran if ran >= 0 else NO_EVENT


def _configuration(reader: ModelReader, c: Configuration[Term]) -> Configuration[Constant]:
    system = reader.system
    program = system.program
    store = _store(reader, c.store)
    robots = tuple(_robot(reader, system, n, robot, store) for n, robot in enumerate(c.robots))
    assert len(program.allwrite) == len(store.allwrite)
    return Configuration(robots, store, c.round, c.turn)


def _store(reader: ModelReader, store: Store[Term]) -> Store[Constant]:
    program = reader.system.program
    return Store(
        _all(reader, store.allread, program.allread),
        _all(reader, store.allwrite, program.allwrite),
    )


def _robot(
    reader: ModelReader, system: System, number: int, robot: Robot[Term], store: Store[Constant]
) -> Robot[Constant]:
    agent = system.agent(number)
    ports = tuple(port.declaration for port in agent.ports)
    read: Robot[Constant] = replace(
        robot,
        locals=_all(reader, robot.locals, agent.locals),
        ports=_all(reader, robot.ports, ports),
        copy=store,
        status=reader.model.scalar(robot.status, INT),
        ran=reader.model.scalar(robot.ran, INT),
    )
    return read


def _all(
    reader: ModelReader, storages: Sequence[Storage[Term]], declared: Sequence[core.Declaration]
) -> tuple[Storage[Constant], ...]:
    pairs = zip(storages, declared, strict=True)
    return tuple(_storage(reader, storage, d.variable.type) for storage, d in pairs)


def _storage(reader: ModelReader, storage: Storage[Term], type_: Type) -> Storage[Constant]:
    if isinstance(storage, Tree):
        if isinstance(type_, RecordType):
            parts = zip(storage.parts, (field for _, field in type_.fields), strict=True)
            return Tree(tuple(_storage(reader, part, field) for part, field in parts))
        assert isinstance(type_, ArrayType)
        return Tree(tuple(_storage(reader, part, type_.element) for part in storage.parts))
    assert isinstance(storage, Cell)
    return Cell(reader.truth(storage.is_set), reader.value(storage.value, type_))
