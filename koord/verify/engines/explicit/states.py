"""Configurations at the start of a round as short tuples of numbers.

What each variable holds has a number (:mod:`cells`); a robot is a tuple of such numbers, and has a
number too. Copies equal the store at the start of a round, and the round's number is of no
consequence, so neither is part of a state.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store
from koord.semantics.domain import Constant
from koord.semantics.storage import Storage, Tree
from koord.syntax.system import System
from koord.syntax.types import ArrayType, Type
from koord.verify.engines.explicit.cells import Cells, Interner, Scalars

#: The robots' numbers, then those of what the allwrite variables hold.
State = tuple[int, ...]


class Own(NamedTuple):
    """What one robot is: numbers of what its variables hold. ``entries`` are its allread ones."""

    kind: int
    locals: tuple[int, ...]
    ports: tuple[int, ...]
    entries: tuple[int, ...]
    status: int
    ran: int


class Vault:
    """The numbers of one search. ``tracks_ran`` says whether a property asks who ran what."""

    def __init__(self, system: System, *, tracks_ran: bool) -> None:
        program = system.program
        self.system = system
        self.tracks_ran = tracks_ran
        self.scalars = Scalars()
        self.locals = [
            [self._cells(x.variable.type) for x in agent.locals] for agent in program.agents
        ]
        self.ports = [
            [self._cells(p.declaration.variable.type) for p in agent.ports]
            for agent in program.agents
        ]
        self.entries = [self._cells(_element(x.variable.type)) for x in program.allread]
        self.allwrite = [self._cells(x.variable.type) for x in program.allwrite]
        self.robots: Interner[Own] = Interner()

    def _cells(self, type_: Type) -> Cells:
        return Cells(type_, self.system.robots, self.scalars)

    # --- to numbers -----------------------------------------------------------------------------

    def robot(self, robot: int, state: Robot[Constant]) -> int:
        """The number of what a robot is; its entries are taken from its own copy."""
        assert isinstance(state.status, int)
        assert isinstance(state.ran, int)
        entries = [_part(storage, robot) for storage in state.copy.allread]
        own = Own(
            state.kind,
            _numbers(self.locals[state.kind], state.locals),
            _numbers(self.ports[state.kind], state.ports),
            _numbers(self.entries, entries),
            int(state.status),
            state.ran if self.tracks_ran else NO_EVENT,
        )
        return self.robots.number(own)

    def shared(self, store: Store[Constant]) -> tuple[int, ...]:
        """The numbers of what the allwrite variables hold."""
        return _numbers(self.allwrite, store.allwrite)

    # --- from numbers ---------------------------------------------------------------------------

    def store(self, state: State) -> Store[Constant]:
        """The shared store of a state."""
        count = self.system.robots
        owns = [self.robots.values[number] for number in state[:count]]
        allread = tuple(
            Tree(tuple(cells.storage(own.entries[slot]) for own in owns))
            for slot, cells in enumerate(self.entries)
        )
        return Store(allread, _storages(self.allwrite, state[count:]))

    def state_of(self, number: int, store: Store[Constant]) -> Robot[Constant]:
        """One robot, with a copy of the store."""
        own = self.robots.values[number]
        return Robot(
            own.kind,
            _storages(self.locals[own.kind], own.locals),
            _storages(self.ports[own.kind], own.ports),
            store,
            own.status,
            own.ran,
        )

    def configuration(self, state: State) -> Configuration[Constant]:
        """A configuration of that state, at the start of a round."""
        store = self.store(state)
        robots = (self.state_of(number, store) for number in state[: self.system.robots])
        return Configuration(tuple(robots), store, 0)


def _numbers(cells: Sequence[Cells], held: Sequence[Storage[Constant]]) -> tuple[int, ...]:
    return tuple(c.number(storage) for c, storage in zip(cells, held, strict=True))


def _storages(cells: Sequence[Cells], numbers: Sequence[int]) -> tuple[Storage[Constant], ...]:
    return tuple(c.storage(number) for c, number in zip(cells, numbers, strict=True))


def _element(type_: Type) -> Type:
    assert isinstance(type_, ArrayType)
    return type_.element


def _part(storage: Storage[Constant], robot: int) -> Storage[Constant]:
    assert isinstance(storage, Tree)
    return storage.parts[robot]
