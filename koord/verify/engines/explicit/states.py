"""States: configurations as short tuples of numbers, and the part of one that is read.

What each variable holds has a number (:mod:`cells`); a robot is a tuple of such numbers, and has a
number too. Copies equal the store at the start of a round, and the round's number is of no
consequence, so neither is part of a state.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store
from koord.semantics.domain import Constant
from koord.semantics.storage import Storage, Tree
from koord.syntax.analysis.footprint import Reads
from koord.syntax.system import Status, System
from koord.syntax.types import ArrayType, Type
from koord.verify.engines.explicit.cells import Cells, Codes, Interner, Scalars
from koord.verify.engines.explicit.lazy import Lazy, PlaceOf

#: The robots' numbers, then those of what the allwrite variables hold.
State = tuple[int, ...]


class RobotState(NamedTuple):
    """The state of a robot: numbers of its variables' contents. ``entries`` are allread ones."""

    kind: int
    locals: tuple[int, ...]
    ports: tuple[int, ...]
    entries: tuple[int, ...]
    status: int
    ran: int


class StateStore:
    """The tables of numbers of one search. ``tracks_ran``: a property reads which events ran."""

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
        self.robots: Interner[RobotState] = Interner()

    def _cells(self, type_: Type) -> Cells:
        return Cells(type_, self.system.robots, self.scalars)

    # --- to numbers -----------------------------------------------------------------------------

    def robot(self, robot: int, state: Robot[Constant]) -> int:
        """The number of a robot's state; its entries are taken from its own copy."""
        assert isinstance(state.status, int)
        assert isinstance(state.ran, int)
        entries = [_part(storage, robot) for storage in state.copy.allread]
        own = RobotState(
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
        """A robot with a number of its state, and a copy of the store."""
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
        """A configuration of a state, at the start of a round."""
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


class Snapshot(NamedTuple):
    """The codes of some variables, and a root that tells apart what is not in them."""

    root: tuple[int, ...]
    codes: list[Codes]


class ReadWindow:
    """The variables that an event of one kind of robot reads, in a fixed order.

    First come the robot's own locals, ports and entries, then allwrite variables, then the entries
    of all robots of those allread variables that are read elsewhere than at the robot's own.
    """

    def __init__(self, vault: StateStore, kind: int, reads: Reads) -> None:
        self._vault = vault
        self._reads = reads
        self._kind = kind
        self._robots = vault.system.robots
        self._own_cells = [
            *(vault.locals[kind][slot] for slot in reads.locals),
            *(vault.ports[kind][slot] for slot in reads.ports),
            *(vault.entries[slot] for slot in reads.entries),
        ]
        self._shared = [(self._robots + slot, vault.allwrite[slot]) for slot in reads.allwrite]
        self._arrays = [(slot, vault.entries[slot]) for slot in reads.arrays]
        self._own: dict[int, tuple[tuple[int, ...], tuple[Codes, ...]]] = {}
        self._templates: dict[tuple[int, ...], Robot[Lazy]] = {}

    def snapshot(self, robot: int, state: State) -> Snapshot:
        """The values that a robot reads in a state."""
        number = state[robot]
        own = self._own.get(number)
        if own is None:
            own = self._own[number] = self._looked_at(self._vault.robots.values[number])
        root, codes = list(own[0]), list(own[1])
        for place, cells in self._shared:
            held = state[place]
            root.append(cells.forms[held])
            codes.append(cells.codes[held])
        if self._arrays:
            owns = self._vault.robots.values
            for slot, cells in self._arrays:
                for each in state[: self._robots]:
                    held = owns[each].entries[slot]
                    root.append(cells.forms[held])
                    codes.append(cells.codes[held])
        if self._reads.is_placed:
            root.append(robot)
        return Snapshot(tuple(root), codes)

    def _looked_at(self, own: RobotState) -> tuple[tuple[int, ...], tuple[Codes, ...]]:
        numbers = [
            *(own.locals[slot] for slot in self._reads.locals),
            *(own.ports[slot] for slot in self._reads.ports),
            *(own.entries[slot] for slot in self._reads.entries),
        ]
        pairs = list(zip(self._own_cells, numbers, strict=True))
        return tuple(c.forms[n] for c, n in pairs), tuple(c.codes[n] for c, n in pairs)

    # --- robots to evaluate on ------------------------------------------------------------------

    def robot(self, robot: int, root: tuple[int, ...]) -> Robot[Lazy]:
        """The robot with places in its variables; those that are not read are unset."""
        key = (*root, robot)
        known = self._templates.get(key)
        if known is None:
            known = self._templates[key] = self._built(robot, root)
        return known

    def _built(self, robot: int, root: tuple[int, ...]) -> Robot[Lazy]:
        vault, reads, kind, count = self._vault, self._reads, self._kind, self._robots
        cells = [*self._own_cells, *(c for _, c in self._shared)]
        cells += [c for _, c in self._arrays for _ in range(count)]
        made = iter(
            [template(c, form, k) for k, (c, form) in enumerate(zip(cells, root, strict=False))]
        )
        locals_ = filled(vault.locals[kind], reads.locals, made)
        ports = filled(vault.ports[kind], reads.ports, made)
        own = dict(zip(reads.entries, made, strict=False))
        allwrite = filled(vault.allwrite, reads.allwrite, made)
        arrays = {slot: [next(made) for _ in range(count)] for slot in reads.arrays}
        allread = []
        for slot, entry in enumerate(vault.entries):
            parts = arrays.get(slot, [nothing(entry)] * count).copy()
            if slot in own and slot not in arrays:
                parts[robot] = own[slot]
            allread.append(Tree(tuple(parts)))
        store: Store[Lazy] = Store(tuple(allread), allwrite)
        status = int(Status.RUNNING)
        return Robot(kind, locals_, ports, store, status, NO_EVENT)


def template(cells: Cells, form: int, variable: int) -> Storage[Lazy]:
    """Storage of a form with a place for each scalar."""
    places = [PlaceOf(variable, k, type_) for k, type_ in enumerate(cells.types(form))]
    return cells.built(form, places)


def nothing(cells: Cells) -> Storage[Lazy]:
    """Unset storage, for variables that are not read."""
    empty: Storage[Constant] = cells.nothing()
    return empty  # type: ignore[return-value]  # constants are among the scalars of either domain


def filled(
    cells: Sequence[Cells], slots: Sequence[int], made: Iterator[Storage[Lazy]]
) -> tuple[Storage[Lazy], ...]:
    """Storages of some variables: the next ones for those in some slots, else nothing."""
    storages = [nothing(c) for c in cells]
    for slot in slots:
        storages[slot] = next(made)
    return tuple(storages)
