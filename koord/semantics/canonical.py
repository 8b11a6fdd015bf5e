"""Configurations at the start of a round as short tuples of numbers.

Whatever a variable may hold has a number, per variable; whatever a robot may be is a tuple of such
numbers, and has a number too. Copies equal the store at the start of a round, and the round's
number is of no consequence, so neither is part of a state.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Generic, NamedTuple, TypeAlias, TypeVar

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store, System
from koord.semantics.domain import Constant
from koord.semantics.storage import Storage, Tree

H = TypeVar("H", bound=Hashable)

#: The robots' numbers, then those of what the allwrite variables hold.
State = tuple[int, ...]


class Interner(Generic[H]):
    """Numbers for values, in the order of their coming. Equal values have one number."""

    __slots__ = ("numbers", "values")

    def __init__(self) -> None:
        self.numbers: dict[H, int] = {}
        self.values: list[H] = []

    def number(self, value: H) -> int:
        """The number of a value."""
        known = self.numbers.get(value)
        if known is None:
            known = self.numbers[value] = len(self.values)
            self.values.append(value)
        return known

    def __len__(self) -> int:
        return len(self.values)


class Own(NamedTuple):
    """What one robot is: numbers of what its variables hold. ``entries`` are its allread ones."""

    kind: int
    locals: tuple[int, ...]
    ports: tuple[int, ...]
    entries: tuple[int, ...]
    status: int
    ran: int


Cells: TypeAlias = "Interner[Storage[Constant]]"


class Vault:
    """The numbers of one search. ``tracks_ran`` says whether a property asks who ran what."""

    def __init__(self, system: System, *, tracks_ran: bool) -> None:
        program = system.program
        self.system = system
        self.tracks_ran = tracks_ran
        self.locals: list[list[Cells]] = [[Interner() for _ in a.locals] for a in program.agents]
        self.ports: list[list[Cells]] = [[Interner() for _ in a.ports] for a in program.agents]
        self.entries: list[Cells] = [Interner() for _ in program.allread]
        self.allwrite: list[Cells] = [Interner() for _ in program.allwrite]
        self.robots: Interner[Own] = Interner()

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

    def state(self, configuration: Configuration[Constant]) -> State:
        """The state of a configuration at the start of a round."""
        robots = (self.robot(i, robot) for i, robot in enumerate(configuration.robots))
        return (*robots, *self.shared(configuration.store))

    # --- from numbers ---------------------------------------------------------------------------

    def store(self, state: State) -> Store[Constant]:
        """The shared store of a state."""
        count = self.system.robots
        owns = [self.robots.values[number] for number in state[:count]]
        allread = tuple(
            Tree(tuple(cells.values[own.entries[slot]] for own in owns))
            for slot, cells in enumerate(self.entries)
        )
        return Store(allread, _values(self.allwrite, state[count:]))

    def state_of(self, number: int, store: Store[Constant]) -> Robot[Constant]:
        """One robot, with a copy of the store."""
        own = self.robots.values[number]
        return Robot(
            own.kind,
            _values(self.locals[own.kind], own.locals),
            _values(self.ports[own.kind], own.ports),
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


def _values(cells: Sequence[Cells], numbers: Sequence[int]) -> tuple[Storage[Constant], ...]:
    return tuple(c.values[number] for c, number in zip(cells, numbers, strict=True))


def _part(storage: Storage[Constant], robot: int) -> Storage[Constant]:
    assert isinstance(storage, Tree)
    return storage.parts[robot]
