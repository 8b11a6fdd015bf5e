"""Looking at all literals of a language in many snapshots at once.

What a literal says depends on what it is about: one robot, two, nobody. It is looked at once for
each that is met, and kept; a row is put together from what is known of its robots. Truths of all
literals are the bits of one integer, the first literal's the lowest.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from itertools import permutations

from koord.syntax.core import BinaryOp
from koord.verify.engines.every_n.conditions import UNSET
from koord.verify.engines.every_n.language import Language
from koord.verify.engines.every_n.literals import (
    COUNT,
    OF_H,
    OF_I,
    OF_J,
    PLACES,
    AnyLiteral,
    Between,
    ConditionLiteral,
    Existence,
    Literal,
    Quantity,
    Row,
    Snapshot,
    twin_of,
)


class _Comparisons:
    """Literals about the same robots, whose quantities are looked at once."""

    def __init__(self) -> None:
        self._quantities: dict[tuple[object, ...], tuple[int, Quantity]] = {}
        self._atoms: dict[tuple[int, BinaryOp, int], list[int]] = {}

    def add(self, n: int, x: Literal) -> None:
        """Take in a literal, which is the n-th of its language."""
        a, b = (
            self._quantities.setdefault(twin_of(q), (len(self._quantities), q))[0]
            for q in (x.left, x.right)
        )
        self._atoms.setdefault((a, x.op, b), [0, 0])[x.positive] |= 1 << n

    def truths(self, here: Snapshot, row: Row) -> int:
        """Which of them hold of a row, as :func:`compared` says; here this is most of the work."""
        values = [q.look(here, row) for _, q in self._quantities.values()]
        held = 0
        for (a, op, b), (negative, positive) in self._atoms.items():
            left, right = values[a], values[b]
            if left is UNSET or right is UNSET:
                continue
            if left is None or right is None:
                held |= negative
            elif op is BinaryOp.EQ:
                held |= positive if left == right else negative
            else:
                held |= positive if left <= right else negative  # type: ignore[operator]
        return held


class Looking:
    """What is known of literals."""

    def __init__(self, language: Language) -> None:
        self.language = language
        self.simple: dict[int, _Comparisons] = {}
        self.conditions: dict[int, list[tuple[int, ConditionLiteral]]] = {}
        self.between: list[tuple[int, Between]] = []
        self.there: list[tuple[int, int]] = []
        places: dict[Literal, int] = {}
        for n, x in enumerate(language.literals):
            match x:
                case Literal():
                    places[x] = n
                    self.simple.setdefault(x.of, _Comparisons()).add(n, x)
                case ConditionLiteral():
                    self.conditions.setdefault(x.of, []).append((n, x))
                case Between():
                    self.between.append((n, x))
                case Existence(witness=witness):
                    self.there.append((n, places[witness]))
        #: Where in a row the robots stand that literals are about.
        self.places = {of: [PLACES[bit] for bit in PLACES if of & bit] for of in self.simple}
        self.known: dict[Hashable, int] = {}
        met = [q for x in places for q in (x.left, x.right) if q.value is None]
        self.counts = any(q.position == COUNT for q in met)
        self.numbers = any(q.of and q.position == -1 for q in met)
        self.indices = any(not q.of and q.position == -1 for q in met)

    def truths(self, here: Snapshot, rows: Iterable[Row]) -> Iterator[int]:
        """Which literals hold of rows of a snapshot."""
        looked = _Looked(self, here)
        several = [(of, places) for of, places in self.places.items() if len(places) > 1]
        alone: dict[tuple[int | None, ...], int] = {}
        for row in rows:
            i, j, h, k = row
            held = alone.get((i, k))
            if held is None:
                held = alone[i, k] = looked.alone((0, OF_I), row)
            if j is not None:
                of_j = alone.get((j, None, k))
                if of_j is None:
                    of_j = alone[j, None, k] = looked.alone((OF_J,), row)
                held |= of_j
            if h is not None:
                held |= looked.alone((OF_H,), row)
            for of, places in several:
                held |= looked.simple(of, places, row)
            if self.between:
                held |= _bits(self.between, here, row)
            yield held

    def view(self, here: Snapshot, robot: int | None, k: int) -> Hashable:
        """All that literals may say of a robot, or of what is shared (None), and of an index."""
        parts = self.language.shared if robot is None else self.language.own
        held = here.shared if robot is None else here.robots[robot]
        seen = tuple(
            value[k] if part.size is not None and isinstance(value, tuple) else value
            for value, part in zip(held, parts, strict=True)
        )
        if robot is not None:
            return (robot, *seen) if self.numbers else seen
        return here.count if self.counts else None, k if self.indices else None, *seen


class _Looked:
    """What is known of one snapshot."""

    def __init__(self, looking: Looking, here: Snapshot) -> None:
        self.looking = looking
        self.here = here
        self._views: dict[tuple[int | None, int], Hashable] = {}
        self._conditions: dict[tuple[int, int | None, int], int] = {}
        self._there: dict[int, int] = {}
        self._simple: dict[tuple[int | None, ...], int] = {}

    def _view(self, robot: int | None, k: int) -> Hashable:
        key = robot, k
        if key not in self._views:
            self._views[key] = self.looking.view(self.here, robot, k)
        return self._views[key]

    def alone(self, robots: Sequence[int], row: Row) -> int:
        """What is said of a robot alone, or of nobody: the same in all rows that have it there."""
        places, conditions = self.looking.places, self.looking.conditions
        held = self.somebody(row[-1]) if 0 in robots and self.looking.there else 0
        for of in robots:
            if of in places:
                held |= self.simple(of, places[of], row)
            if of in conditions:
                held |= self.condition(of, row)
        return held

    def simple(self, of: int, places: Sequence[int], row: Row) -> int:
        """The literals about robots at some places that are no more than comparisons."""
        k = row[-1]
        key: tuple[int | None, ...]
        match places:
            case ():
                key = of, k
            case (one,):
                key = of, k, row[one]
            case _:
                key = of, k, *(row[place] for place in places)
        found = self._simple.get(key)
        if found is None:
            robots = [robot for robot in key[2:] if robot is not None]
            found = self._compared(of, row, robots) if len(robots) == len(places) else 0
            self._simple[key] = found
        return found

    def _compared(self, of: int, row: Row, robots: Sequence[int]) -> int:
        """The same, as comparisons of what is seen of the robots."""
        here, k, known = self.here, row[-1], self.looking.known
        views = [self._view(robot, k) for robot in robots]
        mutual = [here.pairs[pair] for pair in permutations(robots, 2)] if here.pairs else ()
        key = of, self._view(None, k), *views, *mutual
        if key not in known:
            known[key] = self.looking.simple[of].truths(here, row)
        return known[key]

    def condition(self, of: int, row: Row) -> int:
        """The literals that are conditions of a robot, or of nobody."""
        key = of, row[PLACES[of]] if of else None, row[-1]
        if key not in self._conditions:
            self._conditions[key] = _bits(self.looking.conditions[of], self.here, row)
        return self._conditions[key]

    def somebody(self, k: int) -> int:
        """The literals that there is a robot of a sort."""
        if k not in self._there:
            held = 0
            for robot in self.here.robots:
                held |= self.simple(OF_I, (0,), (robot, None, None, k))
            there = (1 << n for n, witness in self.looking.there if held >> witness & 1)
            self._there[k] = sum(there)
        return self._there[k]


def _bits(literals: Iterable[tuple[int, AnyLiteral]], here: Snapshot, row: Row) -> int:
    return sum(1 << n for n, x in literals if x.look(here, row) is True)
