"""How near robots come to each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from koord.runtime.motion.arrays import Bools, Floats

#: Up to so many robots all pairs are looked at; a tree is quicker for more.
_FEW = 64


@dataclass(frozen=True, slots=True)
class Nearest:
    """The two robots that are nearest to each other."""

    distance_m: float
    one: int
    other: int


def nearest(positions: Floats) -> Nearest | None:
    """The nearest pair among positions ``(n, 3)``; None if there is no pair."""
    n = len(positions)
    if n < 2:
        return None
    if n <= _FEW:
        gap = positions[:, None] - positions[None]
        square = np.einsum("ijk,ijk->ij", gap, gap)
        square[np.diag_indices(n)] = np.inf
        one, other = divmod(int(square.argmin()), n)
        return Nearest(float(np.sqrt(square[one, other])), min(one, other), max(one, other))
    from scipy.spatial import cKDTree

    distances, neighbours = cKDTree(positions).query(positions, k=2)
    one = int(distances[:, 1].argmin())
    # Of two robots at one place the tree may name either first.
    other = next(int(k) for k in neighbours[one] if k != one)
    return Nearest(float(distances[one, 1]), min(one, other), max(one, other))


def outside(positions: Floats, low: Floats, high: Floats, slack_m: float = 0.0) -> Bools:
    """Which robots have left the world by more than a slack."""
    beyond: Bools = np.any((positions < low - slack_m) | (positions > high + slack_m), axis=1)
    return beyond
