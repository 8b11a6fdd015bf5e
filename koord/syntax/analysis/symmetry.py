"""Symmetry: groups of interchangeable robots of a system. [SYMMETRY]

**Decision.** A renaming σ of robots permutes robots of one kind. It acts on a configuration by
moving each robot's state to its new number, and by renaming, in every value, the integers of a sort
of robots (:mod:`koord.syntax.analysis.sorts`), and the order of arrays that such integers index.
If no sort is both one of robots and one of numbers, then for all σ that leave the numbers in the
text in place: c → c′ is a step if and only if σ(c) → σ(c′) is one, and a property holds in c if and
only if it does in σ(c).

**Why.** By induction over the evaluation of expressions and statements, e on σ(μ) gives σ of what e
gives on μ, faults included:

- ``pid`` of robot σ(i) is σ(i). A constant of a sort of robots is left in place by σ, or is no
  robot, and σ changes only robots. Any other scalar, and every integer of a sort of numbers, is
  unchanged, and so is all that is computed from such.
- A sort of robots is only stored, compared for equality, used as a key, searched for, or used as an
  index into an array that has an element for each robot and is itself reordered by σ: each of these
  commutes with an injective renaming.
- Values flow between places of one sort only, since flows unify. A list whose indices are robots
  is an array over robots, or in a bound variable and made from one: it is never written out,
  appended to, or shortened, so it always has one element per robot.
- A loop over all robots runs in another order on σ(μ). So its body may only do what does not depend
  on the order: :mod:`~koord.syntax.analysis.sort_inference`. The same holds of quantifiers, for a
  fault ends their evaluation early.
- Answers that are left open are tried all, and what is assumed of them is among the text that has
  been looked at.

The same holds of *elements*, the indices of arrays of one fixed size that nobody tells apart
[ELEMENTS]: σ permutes them, leaves alone those that the text names, and reorders these arrays.
They may be held against numbers that all of them are on one side of, and a loop over all of them
may also be :mod:`~koord.syntax.analysis.first_come`: what it *may* end with hangs on no order.

The rules of rounds treat robots of one kind alike. So the states that can be reached are closed
under renaming, if the initial ones are, and these are by the same argument: INIT and assumptions
are part of the text.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import Struct

from koord.syntax import core
from koord.syntax.analysis.definedness import size_of
from koord.syntax.analysis.sort_inference import Sorting
from koord.syntax.analysis.sorts import Entries, Fields, Items, Scalar, Shape, Sort
from koord.syntax.system import System
from koord.syntax.types import ArrayType, RecordType
from koord.syntax.walk import statements

#: More elements are left as they are: to put them in order would cost more than it saves.
_MOST_ELEMENTS = 32


class Names(Struct, frozen=True):
    """Names that integers of one sort may be: robots (``sort`` is None), or elements.

    Among all names of a system they are ``count`` from ``first`` on, and ``groups`` of them may
    change places, by their places among all names.
    """

    first: int
    count: int
    groups: tuple[tuple[int, ...], ...]
    sort: Sort | None = None

    def holds(self, sort: Sort | None) -> bool:
        """Return whether integers of a sort are such names; robots are if some change places."""
        if sort is None:
            return False
        root = sort.root()
        return root is self.sort if self.sort is not None else root.is_robot and bool(self.groups)


class Symmetry(Struct, frozen=True):
    """A symmetry: ``groups`` of robots that may change places, by number.

    The shapes tell what is renamed in what a variable holds; None where nothing is. Locals and
    ports are by kind and slot, entries (of allread variables) and allwrite variables by slot.
    ``names`` are those of robots, then those of each sort of elements that may change places.
    """

    groups: tuple[tuple[int, ...], ...]
    locals: tuple[tuple[Shape | None, ...], ...]
    ports: tuple[tuple[Shape | None, ...], ...]
    entries: tuple[Shape | None, ...]
    allwrite: tuple[Shape | None, ...]
    names: tuple[Names, ...]

    @property
    def count(self) -> int:
        """The number of all names."""
        return sum(names.count for names in self.names)

    def of(self, sort: Sort | None) -> Names | None:
        """The names that integers of a sort are; None if they are numbers."""
        return next((names for names in self.names if names.holds(sort)), None)

    @property
    def elements(self) -> tuple[Names, ...]:
        """The names of elements."""
        return self.names[1:]

    def is_renaming(self, renaming: Sequence[int]) -> bool:
        """Return whether a renaming of all names lets none but those change places that may."""
        expected = list(range(self.count))
        for names in self.names:
            for group in names.groups:
                if sorted(renaming[i] for i in group) != sorted(group):
                    return False
                for i in group:
                    expected[i] = renaming[i]
        return list(renaming) == expected

    @property
    def is_plain(self) -> bool:
        """True if no value is renamed anywhere: then robots are simply put in order."""
        nested = (*self.locals, *self.ports, self.entries, self.allwrite)
        return all(part is None for parts in nested for part in parts)


class Asymmetry(Struct, frozen=True):
    """The reason why robots may not change places."""

    reason: str


def symmetry_of(system: System, properties: tuple[core.Property, ...]) -> Symmetry | Asymmetry:
    """The symmetry of a system's robots that preserves some properties."""
    sorting = Sorting(system, properties)
    reason = sorting.run()
    if reason:
        return Asymmetry(reason)
    groups = _robots(sorting)
    if not groups:
        return Asymmetry("no two robots are of one kind and without a role of their own")
    return _symmetry(sorting, groups, [])


def reachable_symmetry(
    system: System, properties: tuple[core.Property, ...]
) -> Symmetry | Asymmetry:
    """The symmetry of robots and of elements among the configurations that can be reached.

    It preserves some properties. Of configurations that cannot be reached it says nothing.
    """
    sorting = Sorting(system, properties, _initialized(system))
    reason = sorting.run()
    elements = [each for each in sorting.book.elements() if each[1] <= _MOST_ELEMENTS]
    groups = () if reason else _robots(sorting)
    if not groups and not elements:
        return Asymmetry(reason or "no two robots and no two elements are alike")
    return _symmetry(sorting, groups, elements)


def _robots(sorting: Sorting) -> tuple[tuple[int, ...], ...]:
    fixed = sorting.book.fixed()
    groups: dict[int, list[int]] = {}
    for robot, kind in enumerate(sorting.book.system.kinds):
        if robot not in fixed:
            groups.setdefault(kind, []).append(robot)
    return tuple(tuple(group) for group in groups.values() if len(group) > 1)


def _symmetry(
    sorting: Sorting,
    groups: tuple[tuple[int, ...], ...],
    elements: list[tuple[Sort, int, tuple[int, ...]]],
) -> Symmetry:
    book = sorting.book
    robots = book.system.robots
    names = [Names(0, robots, groups)]
    for sort, count, group in elements:
        first = names[-1].first + names[-1].count
        names.append(Names(first, count, (tuple(first + k for k in group),), sort))
    made = Symmetry(groups, (), (), (), (), tuple(names))

    def renamed(shapes: list[Shape]) -> tuple[Shape | None, ...]:
        return tuple(of if has_names(of, made) else None for of in shapes)

    return Symmetry(
        groups,
        tuple(renamed(shapes) for shapes in book.locals),
        tuple(renamed(shapes) for shapes in book.ports),
        renamed([_element(of) for of in book.allread]),
        renamed(book.allwrite),
        tuple(names),
    )


def has_names(of: Shape, symmetry: Symmetry) -> bool:
    """Return whether a value of that shape may change when names change places."""
    match of:
        case Scalar(sort=sort):
            return symmetry.of(sort) is not None
        case Fields(parts=parts):
            return any(has_names(part, symmetry) for part in parts)
        case Items(index=index, element=element):
            return symmetry.of(index) is not None or has_names(element, symmetry)
        case Entries(key=key, value=value):
            return has_names(key, symmetry) or has_names(value, symmetry)


def _initialized(system: System) -> frozenset[int]:
    """The allwrite arrays, by slot, all elements of which every kind of robot sets in INIT."""
    found = []
    for kind in sorted(set(system.kinds)):
        block = system.program.agents[kind].init
        found.append(frozenset(slot for s in block for slot in _filled(s)))
    return frozenset.intersection(*found) if found else frozenset()


def _filled(s: core.Stmt) -> Iterator[int]:
    """Yield the allwrite arrays that a loop sets as a whole."""
    if not isinstance(s, core.ForRange) or any(_leaves(inner) for inner in statements(s.body)):
        return
    for inner in s.body:
        match inner:
            case core.Assign(
                place=core.Place(
                    variable=core.Variable(
                        home=core.Home.ALLWRITE, slot=slot, type=ArrayType(element=element, size=n)
                    ),
                    steps=(core.IndexStep(index=core.Read(place=index)),),
                )
            ) if index == core.Place(s.variable) and n == size_of(s.low, s.high):
                if not isinstance(element, ArrayType | RecordType):
                    yield slot


def _leaves(s: core.Stmt) -> bool:
    return isinstance(s, core.Break | core.Return)


def _element(of: Shape) -> Shape:
    assert isinstance(of, Items)
    return of.element
