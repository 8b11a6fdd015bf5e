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


def nearest(positions: Floats, before: Nearest | None = None) -> Nearest | None:
    """The nearest pair among positions ``(n, 3)``, of several the first; None if there is no pair.

    The pair that was nearest ``before`` says among many robots how far one need look.
    """
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

    tree = cKDTree(positions, balanced_tree=False, compact_nodes=False)
    if before is None:
        reach_m = float(tree.query(positions, k=2)[0][:, 1].min())
    else:
        reach_m = float(np.linalg.norm(positions[before.one] - positions[before.other]))
    pairs = tree.query_pairs(reach_m * (1 + 1e-9), output_type="ndarray")
    gap = positions[pairs[:, 0]] - positions[pairs[:, 1]]
    square = np.einsum("ij,ij->i", gap, gap)
    one, other = min(map(sorted, pairs[square == square.min()].tolist()))
    return Nearest(float(np.sqrt(square.min())), one, other)


def outside(positions: Floats, low: Floats, high: Floats, slack_m: float = 0.0) -> Bools:
    """Which robots have left the world by more than a slack."""
    beyond: Bools = np.any((positions < low - slack_m) | (positions > high + slack_m), axis=1)
    return beyond
