"""How far robots go, and which two of them are nearest to each other."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Floats, Ints, lengths

#: Up to so many robots all pairs are looked at; of more not.
FEW = 64

#: So much further than to the nearest pair is looked, to know who may be nearest soon.
ROOM_M = 0.5


class Nearest(Struct, frozen=True):
    """The two robots that are nearest to each other, and their distance in metres."""

    distance_m: float
    one: int
    other: int


class Listed(Struct, frozen=True):
    """The pairs that may be nearest for a while, shape ``(2, k)``.

    Others were at least ``reach_m`` from each other when robots were at ``since``.
    """

    pairs: Ints
    since: Floats
    reach_m: float

    def is_sure(self, distance_m: float, moved_m: float) -> bool:
        """True if none but these pairs can be so near, after nobody has moved further than that."""
        return distance_m < self.reach_m - 2 * moved_m - 1e-9


class Nearby:
    """An incremental search for the nearest pair, which skips most pairs of moving robots."""

    def __init__(self) -> None:
        self._listed: Listed | None = None

    def nearest(self, positions: Floats) -> Nearest | None:
        """The nearest pair, as :func:`nearest` finds it."""
        if len(positions) <= FEW:
            return nearest(positions)
        if self._listed is not None:
            found = _nearest_of(positions, self._listed.pairs)
            moved_m = float(lengths(positions - self._listed.since).max())
            if self._listed.is_sure(found.distance_m, moved_m):
                return found
        self._listed = listed(positions)
        return _nearest_of(positions, self._listed.pairs)


def nearest(positions: Floats) -> Nearest | None:
    """The nearest pair among positions ``(n, 3)``, of several the first; None if there is none."""
    n = len(positions)
    if n < 2:
        return None
    if n <= FEW:
        square = _squares(positions[:, None] - positions[None])
        square[np.diag_indices(n)] = np.inf
        one, other = divmod(int(square.argmin()), n)
        return Nearest(float(np.sqrt(square[one, other])), min(one, other), max(one, other))
    return _nearest_of(positions, listed(positions, 1e-9).pairs)


def listed(positions: Floats, room_m: float = ROOM_M) -> Listed:
    """Pairs that are at most a margin further apart than the nearest one.

    Each has its lesser robot first, and they are in the order of their robots.

    Each robot is held against the next, the one after that, and so on, along the axis on which
    they are spread the most.
    """
    axis = int(np.ptp(positions, axis=0).argmax())
    order = np.argsort(positions[:, axis], kind="stable")
    along, least_m, found = positions[order], np.inf, []
    for step in range(1, len(order)):
        gap = along[step:] - along[:-step]
        if gap[:, axis].min() > least_m + room_m:
            break
        apart = lengths(gap)
        least_m = min(least_m, float(apart.min()))
        near = np.flatnonzero(apart <= least_m + room_m)
        found.append(np.stack([order[near], order[near + step]]))
    pairs: Ints = np.sort(np.concatenate(found, axis=1), axis=0)
    in_order = np.ascontiguousarray(pairs.take(np.lexsort(pairs[::-1]), 1))
    return Listed(in_order, positions, least_m + room_m)


def _nearest_of(positions: Floats, pairs: Ints) -> Nearest:
    gap = positions.take(pairs[0], 0)
    gap -= positions.take(pairs[1], 0)
    square = _squares(gap)
    first = int(square.argmin())
    one, other = pairs[:, first].tolist()
    return Nearest(float(np.sqrt(square[first])), one, other)


def _squares(gaps: Floats) -> Floats:
    """The squares of lengths, shape ``(…, 3)``, added up in one order on every processor."""
    square = gaps * gaps
    found: Floats = square[..., 0] + square[..., 1] + square[..., 2]
    return found


class Going:
    """How far robots have gone, and which two are nearest to each other, tick by tick."""

    def __init__(self, start: Floats) -> None:
        self.last = start  #: where they were at the last tick, shape ``(n, 3)``
        self.ways_m: Floats = np.zeros(len(start))
        self._nearby = Nearby()

    def moved_to(self, here: Floats) -> None:
        """Note where robots are, by ways that were added already."""
        self.last = here

    def tick(self, here: Floats) -> Nearest | None:
        """Note where robots are now, and return the nearest pair. The array stays as it is."""
        self.ways_m += lengths(here - self.last)
        self.last = here
        return self._nearby.nearest(here)
