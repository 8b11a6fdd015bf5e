"""One representative for all states that differ by who is who. [SYMMETRY]

A renaming of robots moves each robot's own state to its new number, and renames robots in all
values (:mod:`koord.semantics.symmetry`). To find the representative, robots are put in order of how
they *look*: their own state and what others hold about them, told without any number. Where looks
leave several orders, all are tried if they are few; otherwise one is taken as it comes, and some
states that differ by names alone stay apart, which costs time and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from itertools import groupby, islice, permutations, product
from typing import TypeAlias

from koord.semantics.canonical import Cells, Interner, Own, State, Vault
from koord.semantics.domain import Constant
from koord.semantics.sorts import Entries, Fields, Items, Scalar, Shape
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.symmetry import Symmetry
from koord.semantics.values import Rec, Seq, Table, Value

#: How many orders of robots that look alike are tried.
ORDERS_TRIED = 24

#: Entries of the cache of representatives, beyond which it is emptied.
CACHE_LIMIT = 400_000

Renaming = tuple[int, ...]


class Orbits:
    """Representatives of the states of one search."""

    def __init__(self, vault: Vault, symmetry: Symmetry) -> None:
        self._vault = vault
        self._symmetry = symmetry
        self._robots = vault.system.robots
        self._groups = symmetry.groups
        self._is_one_group = symmetry.groups == (tuple(range(self._robots)),)
        self._looks: Interner[Hashable] = Interner()
        self._own_looks: dict[tuple[int, int], int] = {}
        self._shared_looks: dict[tuple[int, int, int], int] = {}
        self._renamed_robots: dict[tuple[int, Renaming], int] = {}
        self._renamed_cells: dict[tuple[int, int, Renaming], int] = {}
        self._mentions: dict[int, bool] = {}
        self._named = [k for k, of in enumerate(symmetry.allwrite) if of is not None]
        self._known: dict[State, State] = {}

    def representative(self, robots: tuple[int, ...], shared: tuple[int, ...]) -> State:
        """The state that stands for this one and all that differ from it by names alone."""
        if self._symmetry.is_plain:
            return (*self._in_order(robots), *shared)
        state = (*robots, *shared)
        known = self._known.get(state)
        if known is None:
            if len(self._known) > CACHE_LIMIT:
                self._known.clear()
            known = self._known[state] = self._found(state)
        return known

    def _in_order(self, robots: tuple[int, ...]) -> Sequence[int]:
        """Robots by number of their state: all that matters where nothing names them."""
        if self._is_one_group:
            return sorted(robots)
        ordered = list(robots)
        for group in self._groups:
            for place, number in zip(group, sorted(robots[i] for i in group), strict=True):
                ordered[place] = number
        return ordered

    def _found(self, state: State) -> State:
        orders = islice(self._orders(state), ORDERS_TRIED)
        return min(self._renamed(state, renaming) for renaming in orders)

    def _orders(self, state: State) -> Iterator[Renaming]:
        """Renamings that put robots in order of their looks."""
        looks = [self._look(i, state) for i in range(self._robots)]
        choices: list[list[tuple[int, ...]]] = []
        for group in self._groups:
            ordered = sorted(group, key=looks.__getitem__)
            for _, alike in groupby(ordered, key=looks.__getitem__):
                same = tuple(alike)
                # Robots that look alike and are not told apart by others may come as they are.
                tied = len(same) > 1 and any(self._is_mentioned(i, state) for i in same)
                choices.append(list(permutations(same)) if tied and len(same) < 5 else [same])
        places = [i for group in self._groups for i in group]
        for parts in product(*choices):
            renaming = list(range(self._robots))
            for place, robot in zip(places, (i for part in parts for i in part), strict=True):
                renaming[robot] = place
            yield tuple(renaming)

    # --- looks ----------------------------------------------------------------------------------

    def _look(self, robot: int, state: State) -> tuple[int, ...]:
        """How a robot looks: its own state, and where the store names it."""
        looks = [self._own_look(robot, state[robot])]
        looks += [
            self._shared_look(slot, state[self._robots + slot], robot) for slot in self._named
        ]
        return tuple(looks)

    def _own_look(self, robot: int, number: int) -> int:
        known = self._own_looks.get((number, robot))
        if known is None:
            told = self._told_own(self._vault.robots.values[number], robot)
            known = self._own_looks[number, robot] = self._looks.number(("own", told))
        return known

    def _shared_look(self, slot: int, number: int, robot: int) -> int:
        known = self._shared_looks.get((slot, number, robot))
        if known is None:
            of = self._symmetry.allwrite[slot]
            assert of is not None
            told = _told(self._vault.allwrite[slot].values[number], of, robot, self._robots)
            known = self._shared_looks[slot, number, robot] = self._looks.number((slot, told))
        return known

    def _told_own(self, own: Own, robot: int) -> Hashable:
        """A robot's state, told with itself as *me* and everybody else as *other*."""
        told: list[Hashable] = [own.kind, own.status, own.ran]
        for number, cells, of in self._parts(own):
            told.append(
                number if of is None else _told(cells.values[number], of, robot, self._robots)
            )
        return tuple(told)

    def _parts(self, own: Own) -> Iterator[tuple[int, Cells, Shape | None]]:
        """What a robot's variables hold, each with its cells and the shape of what is renamed."""
        vault, symmetry, kind = self._vault, self._symmetry, own.kind
        yield from zip(own.locals, vault.locals[kind], symmetry.locals[kind], strict=True)
        yield from zip(own.ports, vault.ports[kind], symmetry.ports[kind], strict=True)
        yield from zip(own.entries, vault.entries, symmetry.entries, strict=True)

    def _is_mentioned(self, robot: int, state: State) -> bool:
        """Whether anything could tell a robot from those that look like it."""
        return any(self._names_others(i, state[i]) for i in range(self._robots))

    def _names_others(self, robot: int, number: int) -> bool:
        known = self._mentions.get(number)
        if known is None:
            own = self._vault.robots.values[number]
            known = self._mentions[number] = any(
                of is not None and _names(cells.values[number], of, self._robots)
                for number, cells, of in self._parts(own)
            )
        return known

    # --- renaming -------------------------------------------------------------------------------

    def _renamed(self, state: State, renaming: Renaming) -> State:
        count = self._robots
        renamed = [0] * count
        for robot, place in enumerate(renaming):
            renamed[place] = self._renamed_robot(state[robot], renaming)
        shared = list(state[count:])
        for slot in self._named:
            shared[slot] = self._renamed_cell(slot, shared[slot], renaming)
        return (*renamed, *shared)

    def _renamed_robot(self, number: int, renaming: Renaming) -> int:
        known = self._renamed_robots.get((number, renaming))
        if known is None:
            own = self._vault.robots.values[number]
            numbers = [
                n if of is None else cells.number(_renamed(cells.values[n], of, renaming))
                for n, cells, of in self._parts(own)
            ]
            first, second = len(own.locals), len(own.locals) + len(own.ports)
            known = self._vault.robots.number(
                own._replace(
                    locals=tuple(numbers[:first]),
                    ports=tuple(numbers[first:second]),
                    entries=tuple(numbers[second:]),
                )
            )
            self._renamed_robots[number, renaming] = known
        return known

    def _renamed_cell(self, slot: int, number: int, renaming: Renaming) -> int:
        known = self._renamed_cells.get((slot, number, renaming))
        if known is None:
            of = self._symmetry.allwrite[slot]
            assert of is not None
            cells = self._vault.allwrite[slot]
            known = cells.number(_renamed(cells.values[number], of, renaming))
            self._renamed_cells[slot, number, renaming] = known
        return known


# --- values ---------------------------------------------------------------------------------------

Held: TypeAlias = "Storage[Constant] | Value[Constant]"
Robot = Callable[[int], Hashable]


def _renamed(held: Storage[Constant], of: Shape, renaming: Renaming) -> Storage[Constant]:
    """What a variable holds, with robots renamed."""
    if isinstance(held, Cell):
        if not held.is_set:
            return held
        return Cell(True, _renamed_value(held.value, of, renaming))
    if isinstance(of, Fields):
        pairs = zip(held.parts, of.parts, strict=True)
        return Tree(tuple(_renamed(part, shape, renaming) for part, shape in pairs))
    assert isinstance(of, Items)
    parts = [_renamed(part, of.element, renaming) for part in held.parts]
    return Tree(tuple(_moved(parts, of, renaming)))


def _renamed_value(value: Value[Constant], of: Shape, renaming: Renaming) -> Value[Constant]:
    if isinstance(value, Rec):
        assert isinstance(of, Fields)
        pairs = zip(value.fields, of.parts, strict=True)
        return Rec(tuple(_renamed_value(part, shape, renaming) for part, shape in pairs))
    if isinstance(value, Seq):
        assert isinstance(of, Items)
        items = [_renamed_value(item, of.element, renaming) for item in value.items]
        return Seq(value.length, tuple(_moved(items, of, renaming)))
    if isinstance(value, Table):
        assert isinstance(of, Entries)
        entries = tuple(
            (_renamed_value(k, of.key, renaming), _renamed_value(v, of.value, renaming))
            for k, v in value.entries
        )
        return Table(value.length, entries)
    assert isinstance(of, Scalar)
    is_robot = of.sort is not None and of.sort.root().is_robot
    if is_robot and isinstance(value, int) and 0 <= value < len(renaming):
        return renaming[value]
    return value


def _moved(items: list, of: Items, renaming: Renaming) -> list:  # type: ignore[type-arg]
    """The elements of an array over robots, each at its robot's new place."""
    if not of.index.root().is_robot:
        return items
    moved = items.copy()
    for robot, place in enumerate(renaming):
        moved[place] = items[robot]
    return moved


def _told(held: Held, of: Shape, me: int, robots: int) -> Hashable:
    """What something holds, told with one robot as *me* and all others as *other*."""

    def name(robot: int) -> Hashable:
        if 0 <= robot < robots:
            return "me" if robot == me else "other"
        return robot

    return _described(held, of, name, me)


def _described(held: Held, of: Shape, name: Robot, me: int) -> Hashable:
    match held, of:
        case Cell(is_set=is_set, value=value), _:
            return _described(value, of, name, me) if is_set else "unset"
        case Tree(parts=parts), Fields(parts=shapes):
            return tuple(
                _described(part, s, name, me) for part, s in zip(parts, shapes, strict=True)
            )
        case Tree(parts=items) | Seq(items=items), Items():
            told = [_described(item, of.element, name, me) for item in items]
            if of.index.root().is_robot:
                # Mine first; the others' in an order that does not depend on their numbers.
                return (told.pop(me), *sorted(told, key=repr))
            return tuple(told)
        case Rec(fields=fields), Fields(parts=shapes):
            return tuple(
                _described(part, s, name, me) for part, s in zip(fields, shapes, strict=True)
            )
        case Table(entries=entries), Entries(key=key, value=value):
            return tuple(
                (_described(k, key, name, me), _described(v, value, name, me)) for k, v in entries
            )
        case int(), Scalar(sort=sort) if sort is not None and sort.root().is_robot:
            return name(held)
        case _:
            assert not isinstance(held, Cell | Tree)
            return held


def _names(held: Held, of: Shape, robots: int) -> bool:
    """Whether something names a robot."""
    found: list[int] = []

    def name(robot: int) -> Hashable:
        if 0 <= robot < robots:
            found.append(robot)
        return robot

    _described(held, of, name, 0)
    return bool(found) or _is_over_robots(of)


def _is_over_robots(of: Shape) -> bool:
    match of:
        case Items(index=index, element=element):
            return index.root().is_robot or _is_over_robots(element)
        case Fields(parts=parts):
            return any(_is_over_robots(part) for part in parts)
        case _:
            return False
