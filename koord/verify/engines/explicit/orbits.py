"""Symmetry reduction: one representative of all states that differ by names. [SYMMETRY] [ELEMENTS]

A renaming of robots moves each robot's own state to its new number, and renames robots in all
values (see ``symmetry``). To find the representative, robots are put in order of how they *look*:
their own state and where others name them, told without any number. Where looks leave several
orders, all are tried if they are few; otherwise one is taken as it comes, and some states
that differ by names alone stay apart, which costs time and nothing else. Elements of arrays are put
in order behind each order of robots, by how they look when robots are known by their numbers.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from itertools import groupby, islice, permutations, product
from typing import Any

from msgspec import Struct

from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax.analysis.sorts import Entries, Fields, Items, Scalar, Shape
from koord.syntax.analysis.symmetry import Names, Symmetry
from koord.verify.engines.explicit.cells import CACHE_LIMIT, Cells, Interner
from koord.verify.engines.explicit.cost import Cost
from koord.verify.engines.explicit.states import RobotState, State, StateStore

#: The new place of each name: of robots, then of elements.
Renaming = tuple[int, ...]

Held = Any  #: a storage or a value


class _View(Struct, frozen=True):
    """How a content is told: with one name as itself, and others of its sort as others.

    Where that is a robot elements are told as nothing but that; else robots by their numbers.
    """

    symmetry: Symmetry
    me: int

    def mine(self, names: Names) -> int | None:
        """The number of the name itself among some; None if it is not one of them."""
        number = self.me - names.first
        return number if 0 <= number < names.count else None

    def is_exact(self, names: Names) -> bool:
        return names.sort is None and self.mine(names) is None

    def told(self, names: Names, value: int) -> Hashable:
        """A value that may be one of some names."""
        if not 0 <= value < names.count or self.is_exact(names):
            return value
        return "me" if value == self.mine(names) else "other"


class Naming:
    """The occurrences of names in the contents of one variable.

    Mostly they stand at fixed positions of a form. An array over names is moved about as well, and
    then contents are renamed as a whole.
    """

    def __init__(self, cells: Cells, shape: Shape, symmetry: Symmetry) -> None:
        self._cells = cells
        self._shape = shape
        self._symmetry = symmetry
        self._robots = symmetry.names[0].count
        self._moves = _is_moved(shape, symmetry)
        self._positions: dict[int, tuple[tuple[int, Names], ...]] = {}
        self._renamed: dict[tuple[int, Renaming], int] = {}
        self._looks: dict[tuple[int, int], Hashable] = {}
        self._places: dict[int, tuple[tuple[int, ...], ...]] = {}

    def renamed(self, number: int, renaming: Renaming) -> int:
        """The number of a content with all names renamed."""
        known = self._renamed.get((number, renaming))
        if known is None:
            if len(self._renamed) > CACHE_LIMIT:
                self._renamed.clear()
            known = self._renamed[number, renaming] = self._found(number, renaming)
        return known

    def _found(self, number: int, renaming: Renaming) -> int:
        cells = self._cells
        if self._moves:
            held = _renamed(cells.storage(number), self._shape, self._symmetry, renaming)
            return cells.number(held)
        codes = list(cells.codes[number])
        for position, names in self._named(cells.forms[number]):
            if 0 <= codes[position] < names.count:
                codes[position] = renaming[names.first + codes[position]] - names.first
        return cells.numbered(cells.forms[number], tuple(codes))

    def names_any(self, number: int) -> bool:
        """Return whether a content names anything, or has an element for each name."""
        codes = self._cells.codes[number]
        named = self._named(self._cells.forms[number])
        return self._moves or any(0 <= codes[place] < names.count for place, names in named)

    def look(self, number: int, name: int) -> Hashable:
        """The look of a content from a name: where it is named, without numbers of its sort."""
        if not self._moves and name < self._robots and not self._symmetry.elements:
            return self._named_at(number)[name]
        known = self._looks.get((number, name))
        if known is None:
            view = _View(self._symmetry, name)
            known = _described(self._cells.storage(number), self._shape, self._symmetry, view)
            self._looks[number, name] = known
        return known

    def told(self, number: int, robot: int) -> Hashable:
        """A content described with that robot as itself and all others as others."""
        cells = self._cells
        if self._moves:
            return self.look(number, robot)
        codes: list[object] = list(cells.codes[number])
        view = _View(self._symmetry, robot)
        for position, names in self._named(cells.forms[number]):
            code = codes[position]
            assert isinstance(code, int)
            codes[position] = view.told(names, code)
        return cells.forms[number], tuple(codes)

    def _named_at(self, number: int) -> tuple[tuple[int, ...], ...]:
        """For each robot, the positions at which it is named."""
        known = self._places.get(number)
        if known is None:
            found: list[list[int]] = [[] for _ in range(self._robots)]
            codes = self._cells.codes[number]
            for position, names in self._named(self._cells.forms[number]):
                if names.sort is None and 0 <= codes[position] < self._robots:
                    found[codes[position]].append(position)
            known = self._places[number] = tuple(map(tuple, found))
        return known

    def _named(self, form: int) -> tuple[tuple[int, Names], ...]:
        """The positions of names in contents of a form."""
        known = self._positions.get(form)
        if known is None:
            positions = range(len(self._cells.types(form)))
            found: list[tuple[int, Names]] = []
            _find(self._cells.built(form, positions), self._shape, self._symmetry, found)
            known = self._positions[form] = tuple(found)
        return known


# --- values ---------------------------------------------------------------------------------------


def _renamed(held: Storage[Any], of: Shape, symmetry: Symmetry, renaming: Renaming) -> Storage[Any]:
    """Rename names in the storage of a variable."""
    if isinstance(held, Cell):
        if not held.is_set:
            return held
        return Cell(True, _renamed_value(held.value, of, symmetry, renaming))
    if isinstance(of, Fields):
        pairs = zip(held.parts, of.parts, strict=True)
        return Tree(tuple(_renamed(part, shape, symmetry, renaming) for part, shape in pairs))
    assert isinstance(of, Items)
    parts = [_renamed(part, of.element, symmetry, renaming) for part in held.parts]
    return Tree(tuple(_moved(parts, symmetry.of(of.index), renaming)))


def _renamed_value(
    value: Value[Any], of: Shape, symmetry: Symmetry, renaming: Renaming
) -> Value[Any]:
    match value, of:
        case Rec(fields=fields), Fields(parts=shapes):
            pairs = zip(fields, shapes, strict=True)
            return Rec(tuple(_renamed_value(p, shape, symmetry, renaming) for p, shape in pairs))
        case Seq(length=length, items=items), Items(element=element):
            renamed = [_renamed_value(item, element, symmetry, renaming) for item in items]
            return Seq(length, tuple(_moved(renamed, symmetry.of(of.index), renaming)))
        case Table(length=length, entries=entries), Entries(key=key, value=held):
            return Table(
                length,
                tuple(
                    (
                        _renamed_value(k, key, symmetry, renaming),
                        _renamed_value(v, held, symmetry, renaming),
                    )
                    for k, v in entries
                ),
            )
        case int(), Scalar(sort=sort):
            names = symmetry.of(sort)
            if names is None or not 0 <= value < names.count:
                return value
            return renaming[names.first + value] - names.first
        case _:
            return value


def _moved(items: list[Any], names: Names | None, renaming: Renaming) -> Sequence[Any]:
    """The elements of an array over names, each moved to the new position of its name."""
    if names is None:
        return items
    moved = items.copy()
    for number in range(names.count):
        moved[renaming[names.first + number] - names.first] = items[number]
    return moved


def _described(held: Held, of: Shape, symmetry: Symmetry, view: _View) -> Hashable:
    """Describe storage or a value as a name sees it."""
    match held, of:
        case Cell(is_set=is_set, value=value), _:
            return _described(value, of, symmetry, view) if is_set else "unset"
        case ((Tree(parts=parts) | Rec(fields=parts)), Fields(parts=shapes)):
            pairs = zip(parts, shapes, strict=True)
            return tuple(_described(part, shape, symmetry, view) for part, shape in pairs)
        case ((Tree(parts=parts) | Seq(items=parts)), Items(element=element)):
            told = [_described(part, element, symmetry, view) for part in parts]
            names = symmetry.of(of.index)
            if names is None or view.is_exact(names):
                return tuple(told)
            # Mine first; the others' in an order that does not depend on their numbers.
            mine = view.mine(names)
            first = () if mine is None else (told.pop(mine),)
            return (*first, *sorted(told, key=repr))
        case Table(entries=entries), Entries(key=key, value=value):
            return tuple(
                (_described(k, key, symmetry, view), _described(v, value, symmetry, view))
                for k, v in entries
            )
        case int(), Scalar(sort=sort):
            known = symmetry.of(sort)
            return held if known is None else view.told(known, held)
        case _:
            return held  # type: ignore[no-any-return]


def _find(held: Held, of: Shape, symmetry: Symmetry, found: list[tuple[int, Names]]) -> None:
    """Note all places in storage or a value, whose scalars are positions, that may hold names."""
    match held, of:
        case Cell(is_set=is_set, value=value), _:
            if is_set:
                _find(value, of, symmetry, found)
        case ((Tree(parts=parts) | Rec(fields=parts)), Fields(parts=shapes)):
            for part, shape in zip(parts, shapes, strict=True):
                _find(part, shape, symmetry, found)
        case ((Tree(parts=parts) | Seq(items=parts)), Items(element=element)):
            for part in parts:
                _find(part, element, symmetry, found)
        case Table(entries=entries), Entries(key=key, value=value):
            for k, v in entries:
                _find(k, key, symmetry, found)
                _find(v, value, symmetry, found)
        case int(), Scalar(sort=sort):
            names = symmetry.of(sort)
            if names is not None:
                found.append((held, names))


def _is_moved(of: Shape, symmetry: Symmetry) -> bool:
    """Return whether there is an array over names in a value of that shape."""
    match of:
        case Items(index=index, element=element):
            return symmetry.of(index) is not None or _is_moved(element, symmetry)
        case Fields(parts=parts):
            return any(_is_moved(part, symmetry) for part in parts)
        case Entries(key=key, value=value):
            return _is_moved(key, symmetry) or _is_moved(value, symmetry)
        case _:
            return False


#: How many orders of robots that look alike are tried.
ORDERS_TRIED = 24

#: What each of them costs, in steps of evaluation.
_PER_ORDER = 2


class Orbits:
    """Representatives of the states of one search."""

    def __init__(self, vault: StateStore, symmetry: Symmetry, cost: Cost | None = None) -> None:
        self._vault = vault
        self._robots = vault.system.robots
        self._symmetry = symmetry
        self._groups = symmetry.groups
        self._same = tuple(range(symmetry.count))
        self._is_plain = symmetry.is_plain
        self._is_one_group = symmetry.groups == (tuple(range(self._robots)),)
        self._locals = [
            self._namings(*each) for each in zip(vault.locals, symmetry.locals, strict=True)
        ]
        self._ports = [
            self._namings(*each) for each in zip(vault.ports, symmetry.ports, strict=True)
        ]
        self._entries = self._namings(vault.entries, symmetry.entries)
        shared = self._namings(vault.allwrite, symmetry.allwrite)
        self._shared = [(slot, n) for slot, n in enumerate(shared) if n is not None]
        self._looks: Interner[Hashable] = Interner()
        self._own_looks: dict[tuple[int, int], int] = {}
        self._own_element_looks: dict[tuple[int, int], int] = {}
        self._shared_looks: dict[tuple[int, int, int], int] = {}
        self._renamed_robots: dict[tuple[int, Renaming], int] = {}
        self._mentions: dict[int, bool] = {}
        self._known: dict[State, State] = {}
        self._cost = cost if cost is not None else Cost()
        self._budget = vault.system.budget
        elements = sum(len(group) for n in symmetry.elements for group in n.groups)
        self._per_order = (1 + elements) * (self._robots + len(self._shared))

    def _namings(
        self, cells: Sequence[Cells], shapes: Sequence[Shape | None]
    ) -> list[Naming | None]:
        pairs = zip(cells, shapes, strict=True)
        return [Naming(c, of, self._symmetry) if of is not None else None for c, of in pairs]

    def representative(self, robots: tuple[int, ...], shared: tuple[int, ...]) -> State:
        """The representative of a state and of all that differ from it by names alone."""
        if self._is_plain:
            return (*self._in_order(robots), *shared)
        state = (*robots, *shared)
        known = self._known.get(state)
        if known is None:
            if len(self._known) > CACHE_LIMIT:
                self._known.clear()
            known = self._known[state] = self._found(state)
        return known

    def _in_order(self, robots: tuple[int, ...]) -> Sequence[int]:
        """Sort robots by the number of their state, which suffices where nothing names them."""
        if self._is_one_group:
            return sorted(robots)
        ordered = list(robots)
        for group in self._groups:
            for place, number in zip(group, sorted(robots[i] for i in group), strict=True):
                ordered[place] = number
        return ordered

    def _found(self, state: State) -> State:
        orders = list(islice(self._orders(state), ORDERS_TRIED))
        self._cost.looked_at += len(orders) * self._per_order
        # The budget of a search counts what its cost has besides: these are counted above.
        (self._budget.whole or self._budget).spend(_PER_ORDER * len(orders))
        return min(self._in_place(self.renamed(state, renaming)) for renaming in orders)

    # --- elements -------------------------------------------------------------------------------

    def _in_place(self, state: State) -> State:
        """The state with its elements in order of their looks, its robots as they are."""
        if not self._symmetry.elements:
            return state
        renaming = list(self._same)
        for names in self._symmetry.elements:
            for group in names.groups:
                looks = {name: self._element_look(state, name) for name in group}
                ordered = sorted(group, key=looks.__getitem__)
                for place, name in zip(group, ordered, strict=True):
                    renaming[name] = place
        return self.renamed(state, tuple(renaming))

    def _element_look(self, state: State, name: int) -> tuple[int, ...]:
        """The look of an element: where it is named, and what stands at it, in all variables."""
        count = self._robots
        told = [self._own_element_look(robot, name) for robot in state[:count]]
        told += [self._shared_look(slot, n, state[count + slot], name) for slot, n in self._shared]
        return tuple(told)

    def _own_element_look(self, number: int, name: int) -> int:
        """The look of an element in a robot's own state."""
        known = self._own_element_looks.get((number, name))
        if known is None:
            if len(self._own_element_looks) > CACHE_LIMIT:
                self._own_element_looks.clear()
            parts = self._parts(self._vault.robots.values[number])
            told = tuple(naming.look(held, name) for held, naming in parts if naming is not None)
            known = self._own_element_looks[number, name] = self._looks.number(("at", *told))
        return known

    def _shared_look(self, slot: int, naming: Naming, held: int, name: int) -> int:
        """The look of a name in what an allwrite variable holds."""
        known = self._shared_looks.get((slot, held, name))
        if known is None:
            if len(self._shared_looks) > CACHE_LIMIT:
                self._shared_looks.clear()
            known = self._looks.number(naming.look(held, name))
            self._shared_looks[slot, held, name] = known
        return known

    def _orders(self, state: State) -> Iterator[Renaming]:
        """Yield renamings that put robots in order of their looks."""
        looks = self._all_looks(state)
        ordered = [sorted(group, key=looks.__getitem__) for group in self._groups]
        choices: list[list[tuple[int, ...]]] = []
        mentioned: bool | None = None
        for group in ordered:
            for _, alike in groupby(group, key=looks.__getitem__):
                same = tuple(alike)
                if len(same) > 1 and mentioned is None:
                    # Robots that look alike and that nobody names may come as they are.
                    mentioned = any(self._names_robots(number) for number in state[: self._robots])
                tried = len(same) in (2, 3, 4) and mentioned
                choices.append(list(permutations(same)) if tried else [same])
        places = [i for group in self._groups for i in group]
        for parts in product(*choices):
            renaming = list(self._same)
            for place, robot in zip(places, (i for part in parts for i in part), strict=True):
                renaming[robot] = place
            yield tuple(renaming)

    # --- looks ----------------------------------------------------------------------------------

    def _all_looks(self, state: State) -> list[tuple[int, ...]]:
        """The look of each robot: its own state, and the positions where the store names it."""
        count = self._robots
        looks = [[self._own_look(i, state[i])] for i in range(count)]
        for slot, naming in self._shared:
            held = state[count + slot]
            for i in range(count):
                looks[i].append(self._shared_look(slot, naming, held, i))
        return [tuple(look) for look in looks]

    def _own_look(self, robot: int, number: int) -> int:
        known = self._own_looks.get((number, robot))
        if known is None:
            own = self._vault.robots.values[number]
            told: list[Hashable] = [own.kind, own.status, own.ran]
            for held, naming in self._parts(own):
                told.append(held if naming is None else naming.told(held, robot))
            known = self._own_looks[number, robot] = self._looks.number(("own", *told))
        return known

    def _parts(self, own: RobotState) -> Iterator[tuple[int, Naming | None]]:
        """Yield a robot's contents, each with the robots that it may name."""
        yield from zip(own.locals, self._locals[own.kind], strict=True)
        yield from zip(own.ports, self._ports[own.kind], strict=True)
        yield from zip(own.entries, self._entries, strict=True)

    def _names_robots(self, number: int) -> bool:
        """Return whether a robot's own state names robots, which might tell others apart."""
        known = self._mentions.get(number)
        if known is None:
            parts = self._parts(self._vault.robots.values[number])
            known = any(naming is not None and naming.names_any(held) for held, naming in parts)
            self._mentions[number] = known
        return known

    # --- renaming -------------------------------------------------------------------------------

    def renamed(self, state: State, renaming: Renaming) -> State:
        count = self._robots
        renamed = list(state)
        for robot, place in enumerate(renaming[:count]):
            renamed[place] = self._renamed_robot(state[robot], renaming)
        for slot, naming in self._shared:
            renamed[count + slot] = naming.renamed(state[count + slot], renaming)
        return tuple(renamed)

    def _renamed_robot(self, number: int, renaming: Renaming) -> int:
        known = self._renamed_robots.get((number, renaming))
        if known is None:
            own = self._vault.robots.values[number]
            numbers = [
                held if naming is None else naming.renamed(held, renaming)
                for held, naming in self._parts(own)
            ]
            first, second = len(own.locals), len(own.locals) + len(own.ports)
            renamed = own._replace(
                locals=tuple(numbers[:first]),
                ports=tuple(numbers[first:second]),
                entries=tuple(numbers[second:]),
            )
            known = self._renamed_robots[number, renaming] = self._vault.robots.number(renamed)
        return known
