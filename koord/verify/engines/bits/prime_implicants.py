"""Prime implicants: an invariant of bits as one of values, by prime cubes.

A cube of values says of some places which values they have. What the invariant leaves out is
covered by cubes that are prime: no place can be dropped from one, and no value added, without it
meeting a state of the invariant. Where robots may change places, cubes come in *orbits*, closed
under that: what is left out is the same if the invariant is closed, and else is less.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations, product
from math import perm, prod

from msgspec import Struct

from koord.syntax import core
from koord.syntax.types import INT
from koord.verify.effort import Deadline
from koord.verify.engines.bits import numbers
from koord.verify.engines.bits.clauses import QUICK, TRUE_SIDE, Clauses
from koord.verify.engines.bits.domain import BitDomain
from koord.verify.engines.bits.graph import FALSE, TRUE
from koord.verify.engines.bits.ic3 import Cube, SafetyQuery
from koord.verify.engines.bits.numbers import Number
from koord.verify.engines.bits.state_decoder import (
    OUTSIDE,
    Held,
    StateVariable,
)

#: Places by position, with the values that they have in a cube.
Values = tuple[tuple[int, frozenset[Held]], ...]

#: An orbit of more cubes than that is not followed.
MANY_IMAGES = 2_000


class Orbit(Struct, frozen=True):
    """An orbit of excluded states: those of a cube and of its images under renaming."""

    first: Values
    images: tuple[Values, ...]  #: the first is among them


class UnsaidError(Exception):
    """Raised with the reason why an invariant cannot be expressed in Koord."""


class PlaceTable:
    """The places of a state, and the symmetry of its robots."""

    def __init__(
        self, d: BitDomain, places: tuple[StateVariable, ...], groups: tuple[tuple[int, ...], ...]
    ) -> None:
        self.d = d
        self.places = places
        self.groups = groups
        self._literals: dict[tuple[int, frozenset[Held]], int] = {}
        self._numbers = {_key(place, place.robots): k for k, place in enumerate(self.places)}
        self._moves: dict[tuple[int, tuple[int, ...]], int] = {}  #: where robots lead from a place

    def is_in(self, values: Values) -> int:
        """The literal that a state is in a cube."""
        return self.d.graph.all_of(self._has(k, held) for k, held in values)

    def left_out(self, orbit: Orbit) -> int:
        """The literal that a state is in no cube of an orbit."""
        return self.d.graph.any_of(self.is_in(image) for image in orbit.images) ^ 1

    def _has(self, k: int, held: frozenset[Held]) -> int:
        key = (k, held)
        if key not in self._literals:
            place = self.places[k]
            is_value = (place.is_value(self.d, value) for value in held)
            self._literals[key] = self.d.graph.any_of(is_value)
        return self._literals[key]

    # --- robots that change places --------------------------------------------------------------

    def orbit(self, values: Values) -> Orbit:
        """The orbit of a cube. Raises UnsaidError if it is too large."""
        robots = self.robots_of(values)
        moving = [[r for r in robots if r in group] for group in self.groups]
        count = prod(perm(len(g), len(m)) for g, m in zip(self.groups, moving, strict=True))
        if count > MANY_IMAGES:
            raise UnsaidError(f"one of its clauses is about {len(robots)} robots at once")
        found: dict[Values, None] = {}
        choices = [permutations(g, len(m)) for g, m in zip(self.groups, moving, strict=True)]
        for others in product(*choices):
            to: dict[int, int] = {}
            for group, m, new in zip(self.groups, moving, others, strict=True):
                # All robots move, so that sets of others become sets of others.
                still = [r for r in group if r not in m], [r for r in group if r not in new]
                to |= dict(zip([*m, *still[0]], [*new, *still[1]], strict=True))
            found.setdefault(self._renamed(values, to))
        images = tuple(sorted(found, key=_order))
        return Orbit(images[0], images)

    def robots_of(self, values: Values) -> list[int]:
        """The robots that a cube is about, in order of occurrence."""
        found: dict[int, None] = {}
        for k, held in values:
            place = self.places[k]
            found |= dict.fromkeys(place.robots)
            if place.of_robots:
                few = _fewer(place, held)
                everyone = {r for group in self.groups for r in group}
                found |= dict.fromkeys(sorted(int(v) for v in few if v in everyone))
        return list(found)

    def _renamed(self, values: Values, to: Mapping[int, int]) -> Values:
        return tuple(sorted((self._moved(k, to), self._held(k, held, to)) for k, held in values))

    def _moved(self, k: int, to: Mapping[int, int]) -> int:
        place = self.places[k]
        robots = tuple(to.get(robot, robot) for robot in place.robots)
        if (k, robots) not in self._moves:
            found = self._numbers.get(_key(place, robots))
            if found is None:
                raise UnsaidError("nothing is known of what it says of other robots")
            self._moves[k, robots] = found
        return self._moves[k, robots]

    def _held(self, k: int, held: frozenset[Held], to: Mapping[int, int]) -> frozenset[Held]:
        if not self.places[k].of_robots:
            return held
        return frozenset(to.get(v, v) if isinstance(v, int) else v for v in held)


def _key(place: StateVariable, robots: Sequence[int]) -> object:
    """The expression of a place about such robots; sides of an equality may change places."""
    match place.of([core.Const(robot, INT) for robot in robots]):
        case core.Binary(left=left, right=right):
            return frozenset((left, right))
        case core.ExternalCall(function=function, arguments=arguments):
            return function, arguments
        case expr:
            return expr


def _fewer(place: StateVariable, held: frozenset[Held]) -> frozenset[Held]:
    """The values of a place, or the missing ones, whichever are fewer."""
    missing = frozenset(place.values) - held
    return held if len(held) <= len(missing) else missing


def complexity(orbit: Orbit) -> tuple[int, int, int]:
    """A measure of how hard an orbit is to read, to sort by."""
    return len(orbit.first), len(orbit.images), sum(len(held) for _, held in orbit.first)


def _order(values: Values) -> list[tuple[int, list[str]]]:
    return [(k, sorted(map(str, held))) for k, held in values]


class Primes:
    """A search for prime cubes outside of an invariant, and for the states they leave."""

    def __init__(
        self,
        table: PlaceTable,
        question: SafetyQuery,
        cubes: Sequence[Cube],
        deadline: Deadline,
    ) -> None:
        self.table = table
        self.question = question
        self.cubes = cubes
        self.deadline = deadline
        self.unsaid = ""  #: why some of its clauses are left out
        graph = table.d.graph
        self._of_latch: dict[int, list[int]] = {}
        for k, place in enumerate(table.places):
            for node in graph.cone([place.inside, *place.latches]):
                self._of_latch.setdefault(node, []).append(k)
        self._inside = Clauses(graph, QUICK, deadline)  #: states of the invariant
        #: states that no cube which was found leaves out
        self._outside = Clauses(graph, QUICK, deadline)

    def orbits(self) -> list[Orbit]:
        """Orbits that cover the cubes of an invariant. Raises UnsaidError if there are none."""
        graph, latches = self.table.d.graph, self.question.latches
        for required in facts(self.table):
            self._inside.require(required)
            self._outside.require(required)
        cubes = [[latches[abs(x) - 1].literal ^ (x < 0) for x in cube] for cube in self.cubes]
        for cube in cubes:
            self._inside.require(graph.all_of(cube) ^ 1)
        found = []
        for cube in sorted(cubes, key=len):
            if any(x >> 1 not in self._of_latch for x in cube):
                self.unsaid = "it speaks of more than the scalars of variables"
                continue
            while (point := self._uncovered(cube)) is not None:
                if self.deadline.passed():
                    raise UnsaidError("there was no time to say it in Koord")
                if not self._is_out(dict(point)):
                    # Where a value is not inside, its bits are: that says nothing of the program.
                    self._outside.require(self.table.is_in(point) ^ 1)
                    continue
                orbit = self.table.orbit(self._prime(point))
                self._outside.require(self.table.left_out(orbit))
                found.append(orbit)
        self._inside.close()
        self._outside.close()
        return self._independent(found)

    def _independent(self, orbits: Sequence[Orbit]) -> list[Orbit]:
        """An irredundant set of orbits; the simplest are kept."""
        table, clauses = self.table, Clauses(self.table.d.graph, QUICK, self.deadline)
        for fact in facts(table):
            clauses.require(fact)
        parts = {o: clauses.of(table.left_out(o), TRUE_SIDE) for o in orbits}
        for orbit in sorted(orbits, key=complexity, reverse=True):
            rest = [x for other, x in parts.items() if other != orbit]
            if not clauses.solve([*rest, clauses.of(table.is_in(orbit.first))]):
                del parts[orbit]
        clauses.close()
        return list(parts)

    def _uncovered(self, cube: Sequence[int]) -> Values | None:
        """Values that are in a cube of bits and in no cube found so far."""
        clauses = self._outside
        if not clauses.solve([clauses.of(x) for x in cube]):
            return None
        model = clauses.model()
        found: dict[int, frozenset[Held]] = {}
        for x in cube:
            for k in self._of_latch[x >> 1]:
                found[k] = frozenset([self._held(k, clauses, model)])
        return tuple(sorted(found.items()))

    def _held(self, k: int, clauses: Clauses, model: Sequence[int]) -> Held:
        place, d = self.table.places[k], self.table.d
        given = {}
        for node in d.graph.cone([place.inside, *place.latches]):
            number = clauses.known(node)
            given[node] = number is not None and (model[abs(number)] > 0) == (number > 0)
        for value in place.values:
            if d.graph.values([place.is_value(d, value)], given)[0]:
                return value
        raise UnsaidError("a variable may be beyond its values in it")

    def _prime(self, values: Values) -> Values:
        """A prime cube that contains a cube, with few places."""
        cube = dict(values)
        for k in list(cube):
            rest = {other: held for other, held in cube.items() if other != k}
            if self._is_out(rest):
                cube = rest
        for k in cube:
            for value in self._others(k, cube[k]):
                more = {**cube, k: cube[k] | {value}}
                if self._is_out(more):
                    cube = more
        return tuple(sorted(cube.items()))

    def _others(self, k: int, held: frozenset[Held]) -> Iterator[Held]:
        """Yield the other values that a place may hold; the hardest to express first."""
        place = self.table.places[k]
        values = [v for v in place.values if v not in held]
        yield from sorted(values, key=lambda v: v is not OUTSIDE)

    def _is_out(self, cube: Mapping[int, frozenset[Held]]) -> bool:
        """Return whether a cube contains no state of the invariant."""
        literals = [self.table.is_in((part,)) for part in cube.items()]
        return not self._inside.solve([self._inside.of(x) for x in literals])


def facts(table: PlaceTable) -> list[int]:
    """Facts of every state: numbers are in their ranges, and loose ones hold the least."""
    d, found = table.d, []
    for place in table.places:
        if isinstance(place.bits, Number):
            found += d.in_range(place.bits)
            if place.bits.loose > 1:
                least = numbers.lifted(place.bits.low)
                plain = place.bits._replace(loose=FALSE, scale=0)
                found.append(
                    d.graph.either(place.bits.loose ^ 1, numbers.equal(d.graph, plain, least))
                )
    return [fact for fact in found if fact != TRUE]
