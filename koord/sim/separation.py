"""How near robots come to each other."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Floats, Ints, lengths

#: Up to so many robots all pairs are looked at; of more not.
_FEW = 64

#: So much further than to the nearest pair is looked, to know who may be nearest soon.
_ROOM_M = 0.5


class Nearest(Struct, frozen=True):
    """The two robots that are nearest to each other."""

    distance_m: float
    one: int
    other: int


class Nearby:
    """The nearest pair of robots that move: most need not be looked at again each time."""

    def __init__(self) -> None:
        #: Where robots were when it was last seen who is near to whom, and how far was looked then.
        self._seen: tuple[Floats, Ints, float] | None = None

    def nearest(self, positions: Floats) -> Nearest | None:
        """The same as :func:`nearest`."""
        if len(positions) <= _FEW:
            return nearest(positions)
        if self._seen is not None:
            before, pairs, reach_m = self._seen
            found = _nearest_of(positions, pairs)
            moved_m = float(lengths(positions - before).max())
            # Two that were further apart than was looked have come nearer by so much at most.
            if found.distance_m < reach_m - 2 * moved_m - 1e-9:
                return found
        pairs = _neighbours(positions, _ROOM_M)
        found = _nearest_of(positions, pairs)
        self._seen = positions, pairs, found.distance_m + _ROOM_M
        return found


def nearest(positions: Floats) -> Nearest | None:
    """The nearest pair among positions ``(n, 3)``, of several the first; None: there is none."""
    n = len(positions)
    if n < 2:
        return None
    if n <= _FEW:
        gap = positions[:, None] - positions[None]
        square = np.einsum("ijk,ijk->ij", gap, gap)
        square[np.diag_indices(n)] = np.inf
        one, other = divmod(int(square.argmin()), n)
        return Nearest(float(np.sqrt(square[one, other])), min(one, other), max(one, other))
    return _nearest_of(positions, _neighbours(positions, 1e-9))


def _neighbours(positions: Floats, room_m: float) -> Ints:
    """Pairs, shape ``(k, 2)``: all that are no further apart than the nearest and some room more.

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
        found.append(np.column_stack([order[near], order[near + step]]))
    return np.concatenate(found)


def _nearest_of(positions: Floats, pairs: Ints) -> Nearest:
    gap = positions[pairs[:, 0]] - positions[pairs[:, 1]]
    square = np.einsum("ij,ij->i", gap, gap)
    one, other = min(map(sorted, pairs[square == square.min()].tolist()))
    return Nearest(float(np.sqrt(square.min())), one, other)
