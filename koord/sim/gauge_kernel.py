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

from koord.machine.code import BYTES, F64, I64, Code, Ir, Loaded, new_module, word
from koord.machine.lanes import DOUBLE_BYTES, Lane, Lanes
from koord.runtime.motion.arrays import Floats
from koord.sim.separation import FEW, Going, Listed, Nearest, listed
from koord.sim.vehicles.compiled import address


class CompiledGoing(Going):
    """The same by machine code, in one call a tick."""

    def __init__(self, start: Floats) -> None:
        super().__init__(np.ascontiguousarray(start))
        self._measure = measuring_code()
        self._found = (ctypes.c_double * 2)()  # squares: of the least distance, of the longest way
        self._found_at = ctypes.addressof(self._found)
        self._ways_at, self._last_at = address(self.ways_m), address(self.last)
        #: Who may be nearest, and where in memory: pairs, how many, where robots were then.
        self._listed: Listed | None = None
        self._listed_at = 0, 0, 0

    def tick(self, here: Floats) -> Nearest | None:
        count = len(here)
        if count < 2:
            return super().tick(here)
        if count > FEW and self._listed is None:
            self._list(here)
        here_at = address(here)
        which = self._measured(here_at, self._ways_at, count)
        self.last, self._last_at = here, here_at
        square, moved2 = self._found
        if self._listed is None:
            return Nearest(math.sqrt(square), *divmod(which, count))
        if not self._listed.is_sure(math.sqrt(square), math.sqrt(moved2)):
            self._list(here)
            which = self._measured(here_at, 0, count)
            square = self._found[0]
        one, other = self._listed.pairs[:, which].tolist()
        return Nearest(math.sqrt(square), one, other)

    def _measured(self, here_at: int, ways_at: int, count: int) -> int:
        """The pair that is nearest, by number. Without an address of ways none are added to."""
        return self._measure(
            here_at, self._last_at, ways_at, count, *self._listed_at, self._found_at
        )

    def _list(self, here: Floats) -> None:
        self._listed = one = listed(here)
        self._listed_at = address(one.pairs), one.pairs.shape[1], address(one.since)


# --- the machine code -----------------------------------------------------------------------------


@cache
def measuring_code() -> Callable[..., int]:
    """Compile what is measured at the end of a tick.

    The function takes the addresses of positions now and of those at the last tick, shape
    ``(n, 3)``, of the ways that robots have gone, ``(n,)``, or 0; n; of pairs, ``(2, k)``, or
    0; k; of positions when these were listed; and of two numbers that are found. It returns which
    pair is nearest. Without pairs it looks at all, and returns ``n * one + other``.
    """
    module = new_module("measuring")
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
        ones = b.inttoptr(pairs, BYTES)
        others = code.at(ones, b.mul(pair_count, word(DOUBLE_BYTES)))

        def listed(values: list[Ir]) -> list[Ir]:
            square, first, pair = values
            place = b.mul(pair, word(DOUBLE_BYTES))
            one, other = code.get(ones, place, I64), code.get(others, place, I64)
            return [*_nearer(now.square(one, now, other), pair, square, first), _next(b, pair)]

        square, first, _ = code.repeated(pair_count, [*least, nothing], listed)
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
    return Loaded(module).function("measure", len(arguments))


class _Places:
    """Positions of robots, one after the other."""

    def __init__(self, lanes: Lanes, block: Ir) -> None:
        self.lanes, self._block = lanes, block

    def of(self, robot: Ir) -> list[Lane]:
        first = self.lanes.code.b.mul(robot, word(3 * DOUBLE_BYTES))
        there = self.lanes.code.at(self._block, first)
        return [self.lanes.get(there, DOUBLE_BYTES * k) for k in range(3)]

    def square(self, robot: Ir, others: _Places, other: Ir) -> Lane:
        """The square of the distance from a robot's place to another's."""
        x, y, z = (a - b for a, b in zip(self.of(robot), others.of(other), strict=True))
        return x * x + y * y + z * z


def _next(b: Any, number: Ir) -> Ir:
    return b.add(number, word(1))


def _nearer(square: Lane, pair: Ir, least: Ir, first: Ir) -> tuple[Ir, Ir]:
    """The nearer of a pair and the one before, as ``np.argmin``: what is no number is the least."""
    b = square.lanes.code.b
    is_less = b.fcmp_unordered("<", square.ir, least)
    is_less = b.and_(is_less, b.fcmp_ordered("ord", least, least))
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
