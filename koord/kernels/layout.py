"""Packed states: a configuration at the start of a round as cells of one width. [CONFIG]

Robot by robot come locals, ports, the own entries of ``allread`` variables, and, where they can
differ, status and ``ran``; then the ``allwrite`` variables. An atom has one cell, and another for
whether it is set where it may be unset; what is set once stays so. Copies equal the store then, and
the round's number is of no consequence, so neither is packed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from msgspec import Struct

from koord.kernels.terms import NoKernelError
from koord.semantics.configurations import NO_EVENT, Configuration, Robot, Store
from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage, Tree
from koord.syntax import core
from koord.syntax.analysis.footprint import statuses
from koord.syntax.analysis.sorts import Fields, Items, Scalar, Shape, Sort
from koord.syntax.analysis.symmetry import Names, Symmetry
from koord.syntax.system import Status, System
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    BoolType,
    EnumType,
    IntType,
    RecordType,
    Robots,
    Type,
)

V = TypeVar("V")

#: A state has so many cells at most.
_MOST_CELLS = 2_000


class PackedCell(Struct, frozen=True):
    """A cell of a packed state.

    ``index`` are the names that it stands at, by their places among all names: the robot whose it
    is, and the robots and elements that index arrays above it. Two cells of one ``base`` are of one
    variable and differ in ``index`` alone. ``names`` are those of which the value is a number,
    if it is one. [SYMMETRY] [ELEMENTS]
    """

    type: Type
    base: int
    index: tuple[int, ...] = ()
    names: Names | None = None

    @property
    def is_bool(self) -> bool:
        """Return whether the cell holds a Boolean."""
        return isinstance(self.type, BoolType)


class _Atom(Struct, frozen=True):
    """An atom of a variable: its cell, and that which says whether it is set, if there is one."""

    value: int
    is_set: int | None


#: A variable's atoms in the form of its storage.
_Atoms = Any


class _RobotCells(Struct, frozen=True):
    first: int
    end: int
    locals: tuple[_Atoms, ...]
    ports: tuple[_Atoms, ...]
    entries: tuple[_Atoms, ...]
    status: int | None
    ran: int | None


class Layout:
    """The cells of a system's states. ``symmetry`` says which values name robots.

    ``may_be_unset`` are the variables, by home, kind and slot, with atoms that may be unset.
    Raises NoKernelError where a variable has no fixed number of finite atoms.
    """

    def __init__(
        self,
        system: System,
        symmetry: Symmetry | None,
        may_be_unset: frozenset[tuple[core.Home, int, int]],
        *,
        tracks_ran: bool,
    ) -> None:
        self.system = system
        self.symmetry = symmetry
        self.cells: list[PackedCell] = []
        self._unset = may_be_unset
        self._bases: dict[object, int] = {}
        self._stands: dict[tuple[int, tuple[int, ...]], int] = {}
        self._statuses = statuses(system.program)
        self._tracks_ran = tracks_ran
        self.robots = [self._robot(i, kind) for i, kind in enumerate(system.kinds)]
        self.shared_first = len(self.cells)
        shapes = symmetry.allwrite if symmetry is not None else None
        self.allwrite = tuple(
            self._variable(x, 0, None, shapes[x.variable.slot] if shapes else None)
            for x in system.program.allwrite
        )

    # --- making ---------------------------------------------------------------------------------

    def _robot(self, robot: int, kind: int) -> _RobotCells:
        program, agent, s = self.system.program, self.system.agent(robot), self.symmetry
        first = len(self.cells)
        locals_ = tuple(
            self._variable(x, kind, robot, s.locals[kind][k] if s else None)
            for k, x in enumerate(agent.locals)
        )
        ports = tuple(
            self._variable(p.declaration, kind, robot, s.ports[kind][k] if s else None)
            for k, p in enumerate(agent.ports)
        )
        entries = tuple(
            self._variable(x, 0, robot, s.entries[k] if s else None)
            for k, x in enumerate(program.allread)
        )
        status = ran = None
        if self._statuses[kind] != {Status.RUNNING}:
            status = self._cell(PackedCell(INT, self._base("status", kind), (robot,)))
        if self._tracks_ran:
            ran = self._cell(PackedCell(INT, self._base("ran", kind), (robot,)))
        return _RobotCells(first, len(self.cells), locals_, ports, entries, status, ran)

    def _variable(
        self, declaration: core.Declaration, kind: int, robot: int | None, shape: Shape | None
    ) -> _Atoms:
        variable = declaration.variable
        where = (variable.home, kind, variable.slot)
        index = () if robot is None else (robot,)
        return self._atoms(where, variable.own_type, shape, index, (), where in self._unset)

    def _atoms(
        self,
        where: object,
        type_: Type,
        shape: Shape | None,
        index: tuple[int, ...],
        path: tuple[int, ...],
        may_be_unset: bool,
    ) -> _Atoms:
        match type_:
            case RecordType(fields=fields):
                shapes = shape.parts if isinstance(shape, Fields) else (None,) * len(fields)
                pairs = enumerate(zip(fields, shapes, strict=True))
                return tuple(
                    self._atoms(where, t, part, index, (*path, k), may_be_unset)
                    for k, ((_, t), part) in pairs
                )
            case ArrayType(element=element, size=size):
                count = self.system.robots if size is Robots.ALL else size
                assert isinstance(count, int)
                inner = shape.element if isinstance(shape, Items) else None
                over = self._names(shape.index) if isinstance(shape, Items) else None
                if over is not None and count != over.count:
                    raise NoKernelError("an array over robots is not as long as there are robots")
                return tuple(
                    self._atoms(
                        where,
                        element,
                        inner,
                        index if over is None else (*index, over.first + k),
                        (*path, k if over is None else -1),
                        may_be_unset,
                    )
                    for k in range(count)
                )
            case IntType() | BoolType() | EnumType():
                names = self._names(shape.sort) if isinstance(shape, Scalar) else None
                base = self._base(where, path)
                value = self._cell(PackedCell(type_, base, index, names))
                if not may_be_unset:
                    return _Atom(value, None)
                flag = PackedCell(BoolType(), self._base(where, path, "set"), index)
                return _Atom(value, self._cell(flag))
            case _:
                raise NoKernelError("a variable is neither a number, nor made of a fixed count")

    def _names(self, sort: Sort | None) -> Names | None:
        return self.symmetry.of(sort) if self.symmetry is not None else None

    @property
    def names(self) -> int:
        """The number of all names that may change places: of robots and of elements."""
        return self.symmetry.count if self.symmetry is not None else self.system.robots

    def _base(self, *what: object) -> int:
        return self._bases.setdefault(what, len(self._bases))

    def _cell(self, cell: PackedCell) -> int:
        if len(self.cells) >= _MOST_CELLS:
            raise NoKernelError(f"a state has more than {_MOST_CELLS} cells")
        self._stands[cell.base, cell.index] = len(self.cells)
        self.cells.append(cell)
        return len(self.cells) - 1

    def beside(self, count: int) -> list[int]:
        """So many cells of Booleans that are of no variable: rounds leave them as they are."""
        return [self._cell(PackedCell(BOOL, self._base("beside", k))) for k in range(count)]

    # --- states in any domain -------------------------------------------------------------------

    def configuration(self, read: Callable[[int], V], always: V, constant: Any) -> Configuration[V]:
        """The configuration whose cells hold what ``read`` gives; ``always`` is the truth.

        ``constant`` makes a scalar of an int, for what has no cell.
        """
        allread = tuple(
            Tree(tuple(_storage(r.entries[slot], read, always) for r in self.robots))
            for slot in range(len(self.system.program.allread))
        )
        store = Store(allread, tuple(_storage(a, read, always) for a in self.allwrite))
        robots = tuple(
            Robot(
                self.system.kinds[i],
                tuple(_storage(a, read, always) for a in r.locals),
                tuple(_storage(a, read, always) for a in r.ports),
                store,
                read(r.status) if r.status is not None else constant(int(Status.RUNNING)),
                read(r.ran) if r.ran is not None else constant(NO_EVENT),
            )
            for i, r in enumerate(self.robots)
        )
        return Configuration(robots, store, 0)

    def of_robot(self, robot: int, after: Robot[V]) -> Iterator[tuple[int, V]]:
        """Yield a robot's cells, each with what it holds; entries are those of its own copy."""
        cells = self.robots[robot]
        for atoms, storage in zip(cells.locals, after.locals, strict=True):
            yield from _scalars(atoms, storage)
        yield from self.of_ports(robot, after.ports)
        for atoms, whole in zip(cells.entries, after.copy.allread, strict=True):
            assert isinstance(whole, Tree)
            yield from _scalars(atoms, whole.parts[robot])
        if cells.status is not None:
            yield cells.status, after.status
        if cells.ran is not None:
            yield cells.ran, after.ran

    def of_ports(self, robot: int, ports: Sequence[Storage[V]]) -> Iterator[tuple[int, V]]:
        """Yield the cells of a robot's ports, each with what it holds."""
        for atoms, storage in zip(self.robots[robot].ports, ports, strict=True):
            yield from _scalars(atoms, storage)

    def of_shared(self, slot: int, storage: Storage[V]) -> Iterator[tuple[int, V]]:
        """Yield the cells of an allwrite variable, each with what it holds."""
        yield from _scalars(self.allwrite[slot], storage)

    def written(self, slot: int, storage: Storage[V], mask: Any) -> Iterator[tuple[int, list[V]]]:
        """Yield the cells of an allwrite variable with conditions, of which one holds if it was
        written. [LOCATION]
        """
        yield from _masked(self.allwrite[slot], storage, mask, [])

    # --- states as numbers ----------------------------------------------------------------------

    def numbers(self, configuration: Configuration[Constant]) -> list[int]:
        """What the cells hold in a configuration; Booleans are 0 and 1."""
        found: list[int] = []
        for i, robot in enumerate(configuration.robots):
            found += self.robot_numbers(i, robot, configuration.store)
        return found + self.shared_numbers(configuration.store)

    def robot_numbers(
        self, robot: int, state: Robot[Constant], store: Store[Constant]
    ) -> list[int]:
        """What a robot's cells hold, if its entries are those of a store."""
        own = Robot(state.kind, state.locals, state.ports, store, state.status, state.ran)
        cells = self.robots[robot]
        found = [0] * (cells.end - cells.first)
        for cell, value in self.of_robot(robot, own):
            found[cell - cells.first] = _number(value)
        return found

    def shared_numbers(self, store: Store[Constant]) -> list[int]:
        """What the cells of the allwrite variables hold."""
        found = [0] * (len(self.cells) - self.shared_first)
        for slot, storage in enumerate(store.allwrite):
            for cell, value in self.of_shared(slot, storage):
                found[cell - self.shared_first] = _number(value)
        return found

    def from_numbers(self, numbers: Sequence[int]) -> Configuration[Constant]:
        """The configuration whose cells hold some numbers."""

        def read(cell: int) -> Constant:
            return bool(numbers[cell]) if self.cells[cell].is_bool else numbers[cell]

        return self.configuration(read, True, int)

    def renamed(self, numbers: Sequence[int], names: Sequence[int]) -> list[int]:
        """The numbers of a state in which all names have new places, ``names``. [SYMMETRY]"""
        made = list(numbers)
        for number, cell in enumerate(self.cells):
            held = numbers[number]
            if cell.names is not None and 0 <= held < cell.names.count:
                held = names[cell.names.first + held] - cell.names.first
            made[self._stands[cell.base, tuple(names[i] for i in cell.index)]] = held
        return made


def _number(value: Constant) -> int:
    assert isinstance(value, int)
    return int(value)


def _storage(atoms: _Atoms, read: Callable[[int], V], always: V) -> Storage[V]:
    if isinstance(atoms, _Atom):
        return Cell(always if atoms.is_set is None else read(atoms.is_set), read(atoms.value))
    return Tree(tuple(_storage(part, read, always) for part in atoms))


def _scalars(atoms: _Atoms, storage: Storage[V]) -> Iterator[tuple[int, Any]]:
    if isinstance(atoms, _Atom):
        assert isinstance(storage, Cell)
        yield atoms.value, storage.value
        if atoms.is_set is not None:
            yield atoms.is_set, storage.is_set
        return
    assert isinstance(storage, Tree)
    for part, below in zip(atoms, storage.parts, strict=True):
        yield from _scalars(part, below)


def _masked(
    atoms: _Atoms, storage: Storage[V], mask: Any, above: list[V]
) -> Iterator[tuple[int, list[V]]]:
    conditions = above if mask is None else [*above, mask.whole]
    if isinstance(atoms, _Atom):
        if conditions:
            yield atoms.value, conditions
            if atoms.is_set is not None:
                yield atoms.is_set, conditions
        return
    assert isinstance(storage, Tree)
    parts = mask.parts if mask is not None and mask.parts else (None,) * len(atoms)
    for part, below, its in zip(atoms, storage.parts, parts, strict=True):
        yield from _masked(part, below, its, conditions)


def unset_somewhere(
    system: System, starts: Sequence[Configuration[Constant]]
) -> frozenset[tuple[core.Home, int, int]]:
    """The variables that are not set as a whole in some start: what is set stays so. [ATOM]"""
    found: set[tuple[core.Home, int, int]] = set()
    for start in starts:
        for robot in start.robots:
            for slot, storage in enumerate(robot.locals):
                if not _is_set(storage):
                    found.add((core.Home.LOCAL, robot.kind, slot))
            for slot, storage in enumerate(robot.ports):
                if not _is_set(storage):
                    found.add((core.Home.PORT, robot.kind, slot))
        homes = (core.Home.ALLREAD, core.Home.ALLWRITE)
        for home, storages in zip(homes, (start.store.allread, start.store.allwrite), strict=True):
            found |= {(home, 0, slot) for slot, s in enumerate(storages) if not _is_set(s)}
    return frozenset(found)


def _is_set(storage: Storage[Constant]) -> bool:
    if isinstance(storage, Cell):
        return storage.is_set is True
    return all(_is_set(part) for part in storage.parts)
