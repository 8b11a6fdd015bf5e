"""Machine code of :class:`.Going`: how far robots have gone in a tick, and which two are nearest.

Each length is added up in the order in which :func:`.lengths` does it, so that what is measured is
equal to the last bit, and so is which pair is named where several are as near. Tests hold the two
together.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from koord.machine.code import BYTES, F64, I64, Code, Ir, new_module, word
from koord.machine.kept import kept
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes
from koord.runtime.motion.arrays import Floats, Ints
from koord.sim.separation import FEW, ROOM_M, Going, Listed, Nearest
from koord.sim.vehicles.compiled import address

#: Pairs are listed that are at most so much further apart than the nearest, if the last list had no
#: more than so many pairs for each robot.
_FURTHEST_M, _PAIRS_EACH = 4.0, 8


class CompiledGoing(Going):
    """The same by machine code, in one call a tick."""

    def __init__(self, start: Floats) -> None:
        super().__init__(np.ascontiguousarray(start))
        self._measure, self._enlist = measuring_code()
        self._found = (ctypes.c_double * 2)()  # squares: of the least distance, of the longest way
        self._found_at = ctypes.addressof(self._found)
        self._ways_at, self._last_at = address(self.ways_m), address(self.last)
        #: Who may be nearest, and where in memory: pairs, how many, where robots were then.
        self._listed: Listed | None = None
        self._listed_at = 0, 0, 0
        self._room = 4 * len(start)  #: for pairs
        self._further_m = ROOM_M / 2  #: so much further than to the nearest is looked

    def tick(self, here: Floats) -> Nearest | None:
        count = len(here)
        if count < 2:
            return super().tick(here)
        if count > FEW and self._listed is None:
            self._list(here, math.inf)
        here_at = address(here)
        which = self._measured(here_at, self._ways_at, count)
        self.last, self._last_at = here, here_at
        square, moved2 = self._found
        if self._listed is None:
            return Nearest(math.sqrt(square), *divmod(which, count))
        if not self._listed.is_sure(math.sqrt(square), math.sqrt(moved2)):
            self._list(here, math.sqrt(square))
            which = self._measured(here_at, 0, count)
            square = self._found[0]
        return Nearest(math.sqrt(square), *divmod(which, count))

    @property
    def code(self) -> Callable[..., int]:
        """The machine code of a tick."""
        return self._measure

    @property
    def is_listed(self) -> bool:
        return self._listed is not None

    @property
    def is_to_be_listed(self) -> bool:
        """Whether pairs are to be listed before anything is measured."""
        return self._listed is None and len(self.last) > FEW

    @property
    def listed(self) -> tuple[int, int, int]:
        """Where pairs are in memory, how many, and where robots were when they were listed."""
        return self._listed_at

    @property
    def reach_m(self) -> float:
        """How far from each other those were that are in no listed pair."""
        return math.inf if self._listed is None else self._listed.reach_m

    def moved_to(self, here: Floats) -> None:
        self.last, self._last_at = here, address(here)

    def _measured(self, here_at: int, ways_at: int, count: int) -> int:
        """The pair that is nearest, as ``n * one + other``. Without ways none are added to."""
        return self._measure(
            here_at, self._last_at, ways_at, count, *self._listed_at, self._found_at
        )

    def _list(self, here: Floats, least_m: float) -> None:
        """List the pairs that may be nearest, as :func:`.listed`. Two are ``least_m`` apart."""
        axis = int(np.ptp(here, axis=0).argmax())
        order = np.argsort(here[:, axis], kind="stable")
        along, count = here[order], self._room + 1
        # Who is in no pair is looked for again where all have moved by half of that, which takes a
        # sort; one more pair takes a few nanoseconds.
        if self._listed is None or len(self._listed.pairs[0]) <= _PAIRS_EACH * len(here):
            self._further_m = min(2 * self._further_m, _FURTHEST_M)
        while count > self._room:
            self._room = max(self._room, count)
            pairs: Ints = np.empty((self._room, 2), np.int64)
            reach = (ctypes.c_double * 2)(least_m, self._further_m)
            places = address(along), address(order), len(here), axis
            count = self._enlist(*places, address(pairs), self._room, ctypes.addressof(reach))
        self._listed = Listed(pairs[:count].T, here, reach[0] + self._further_m)
        self._listed_at = address(pairs), count, address(here)


# --- the machine code -----------------------------------------------------------------------------


@cache
def measuring_code() -> tuple[Callable[..., int], Callable[..., int]]:
    """Compile what is measured at the end of a tick, and what lists pairs."""
    code = kept("measuring", (), _module)
    return code.function("measure", 8), code.function("enlist", 7)


def _module() -> Ir:
    module = new_module("measuring")
    _measuring(module)
    _listing(module)
    return module


def _measuring(module: Ir) -> None:
    """Write what is measured.

    The function takes the addresses of positions now and of those at the last tick, shape
    ``(n, 3)``, of the ways that robots have gone, ``(n,)``, or 0; n; of pairs, ``(k, 2)``, or
    0; k; of positions when these were listed; and of two numbers that are found. It returns which
    pair is nearest, as ``n * one + other``; of several the least. Without pairs it looks at all.
    """
    arguments = [BYTES, BYTES, I64, I64, I64, I64, I64, BYTES]
    code = Code(module, "measure", arguments, I64)
    here, last, distance, count, pairs, pair_count, since, found = code.arguments
    b, nothing = code.b, word(0)
    lanes = Lanes(code, 1)
    now = _Places(lanes, here)
    with code.only_if(b.icmp_signed("!=", distance, nothing)):
        _add_ways(now, _Places(lanes, last), b.inttoptr(distance, BYTES), count)
    found_square, found_pair = code.slot(F64), code.slot(I64)
    least = lanes.constant(math.inf).ir, nothing

    def keep(square: Ir, pair: Ir) -> None:
        b.store(square, found_square)
        b.store(pair, found_pair)

    keep(*least)
    with code.only_if(b.icmp_signed("!=", pairs, nothing)):
        listed = b.inttoptr(pairs, BYTES)

        def among(values: list[Ir]) -> list[Ir]:
            square, first, number = values
            place = b.mul(number, word(2 * DOUBLE_BYTES))
            one, other = (code.get(code.at(listed, place), DOUBLE_BYTES * k, I64) for k in (0, 1))
            pair = b.add(b.mul(one, count), other)
            return [*_nearer(now.square(one, now, other), pair, square, first), _next(b, number)]

        square, first, _ = code.repeated(pair_count, [*least, nothing], among)
        keep(square, first)
        most = _furthest(now, _Places(lanes, b.inttoptr(since, BYTES)), count)
        code.put(found, DOUBLE_BYTES, most)
    with code.only_if(b.icmp_signed("==", pairs, nothing)), code.loop(nothing, count) as one:
        row = b.mul(one, count)

        def each(values: list[Ir]) -> list[Ir]:
            square, first, other = values
            pair = b.add(row, other)
            return [*_nearer(now.square(one, now, other), pair, square, first), _next(b, other)]

        after = _next(b, one)
        begun = [b.load(found_square), b.load(found_pair), after]
        square, first, _ = code.repeated(b.sub(count, after), begun, each)
        keep(square, first)
    code.put(found, 0, b.load(found_square))
    b.ret(b.load(found_pair))


def _listing(module: Ir) -> None:
    """Write what lists pairs.

    The function takes the addresses of positions in their order along an axis, shape ``(n, 3)``,
    and of the robots that these are of; n; the axis; the address of pairs, ``(k, 2)``, and k; and
    of two numbers: a distance that is not less than that of the two nearest, and how much further
    apart others may be. It writes the least distance in place of the first, and pairs with the
    lesser robot first. It returns how many there are; if that is more than k, not all are written.
    """
    arguments = [BYTES, BYTES, I64, I64, BYTES, I64, BYTES]
    code = Code(module, "enlist", arguments, I64)
    along, order, count, axis, pairs, most, reach = code.arguments
    b, lanes = code.b, Lanes(code, 1)
    now, further_m = _Places(lanes, along), lanes.get(reach, DOUBLE_BYTES)
    side = b.mul(axis, word(DOUBLE_BYTES))
    found, number = code.slot(I64), code.slot(I64)
    least2, bound, bound2 = (code.slot(F64) for _ in range(3))
    b.store(word(0), found)

    def look_within(square: Lane) -> None:
        far = square.sqrt() + further_m
        for slot, value in ((least2, square), (bound, far), (bound2, far * far)):
            b.store(value.ir, slot)

    look_within(lanes.get(reach, 0) * lanes.get(reach, 0))

    def ahead() -> Ir:
        """Whether the next along the axis may be near enough."""
        other = b.load(number)
        inside = b.icmp_signed("<", other, count)
        there = b.select(inside, other, b.sub(count, word(1)))  # beyond nobody is to be read
        way = now.along(there, side) - now.along(one, side)
        return b.and_(inside, b.not_(Lane(lanes, b.load(bound)).is_below(way)))

    with code.loop(word(0), count) as one:
        b.store(_next(b, one), number)
        with code.while_(ahead):
            other = b.load(number)
            square = now.square(one, now, other)
            with code.only_if(square.is_below(Lane(lanes, b.load(least2)))):
                look_within(square)
            with code.only_if(square.is_at_most(Lane(lanes, b.load(bound2)))):
                place = b.load(found)
                with code.only_if(b.icmp_signed("<", place, most)):
                    there = code.at(pairs, b.mul(place, word(2 * DOUBLE_BYTES)))
                    robots = (b.mul(robot, word(DOUBLE_BYTES)) for robot in (one, other))
                    _put_pair(code, there, [code.get(order, robot, I64) for robot in robots])
                b.store(_next(b, place), found)
            b.store(_next(b, other), number)
    lanes.put(reach, 0, Lane(lanes, b.load(least2)).sqrt())
    b.ret(b.load(found))


def _put_pair(code: Code, place: Ir, robots: list[Ir]) -> None:
    """Store a pair, the lesser first."""
    one, other = robots
    is_less = code.b.icmp_signed("<", one, other)
    code.put(place, 0, code.b.select(is_less, one, other))
    code.put(place, DOUBLE_BYTES, code.b.select(is_less, other, one))


class _Places:
    """Positions of robots, one after the other."""

    def __init__(self, lanes: Lanes, block: Ir) -> None:
        self.lanes, self._block = lanes, block

    def of(self, robot: Ir) -> list[Lane]:
        first = self.lanes.code.b.mul(robot, word(3 * DOUBLE_BYTES))
        there = self.lanes.code.at(self._block, first)
        return [self.lanes.get(there, DOUBLE_BYTES * k) for k in range(3)]

    def along(self, robot: Ir, side: Ir) -> Lane:
        """A coordinate of a robot's place, so many bytes from its first."""
        first = self.lanes.code.b.mul(robot, word(3 * DOUBLE_BYTES))
        return self.lanes.get(self._block, self.lanes.code.b.add(first, side))

    def square(self, robot: Ir, others: _Places, other: Ir) -> Lane:
        """The square of the distance from a robot's place to another's."""
        x, y, z = (a - b for a, b in zip(self.of(robot), others.of(other), strict=True))
        return x * x + y * y + z * z


def _next(b: Any, number: Ir) -> Ir:
    return b.add(number, word(1))


def _nearer(square: Lane, pair: Ir, least: Ir, first: Ir) -> tuple[Ir, Ir]:
    """The nearer of a pair and one before, as ``np.argmin``: what is no number is the least.

    Of two that are equally near it is the lesser.
    """
    b = square.lanes.code.b
    is_less = b.fcmp_unordered("<", square.ir, least)
    is_less = b.and_(is_less, b.fcmp_ordered("ord", least, least))
    none = b.and_(
        b.fcmp_unordered("uno", square.ir, square.ir), b.fcmp_unordered("uno", least, least)
    )
    is_same = b.or_(b.fcmp_ordered("==", square.ir, least), none)
    is_less = b.or_(is_less, b.and_(is_same, b.icmp_signed("<", pair, first)))
    return b.select(is_less, square.ir, least), b.select(is_less, pair, first)


def _add_ways(now: _Places, last: _Places, ways: Ir, count: Ir) -> None:
    """Add to each robot's way what it has gone in this tick."""
    lanes = now.lanes
    with lanes.code.loop(word(0), count) as robot:
        place = lanes.code.b.mul(robot, word(DOUBLE_BYTES))
        gone = now.square(robot, last, robot).sqrt()
        lanes.put(ways, place, lanes.get(ways, place) + gone)


def _furthest(now: _Places, before: _Places, count: Ir) -> Ir:
    """The square of how far the robot has moved that has moved the most."""
    lanes = now.lanes

    def further(values: list[Ir]) -> list[Ir]:
        most, robot = Lane(lanes, values[0]), values[1]
        found = most.greater(now.square(robot, before, robot))
        return [found.ir, _next(lanes.code.b, robot)]

    most, _ = lanes.code.repeated(count, [lanes.constant(0.0).ir, word(0)], further)
    return most
