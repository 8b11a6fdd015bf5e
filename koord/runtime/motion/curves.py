"""Single curves of cars, without a tree: where they are free, and the points that make a path.

A curve is arcs of one radius and straight pieces, forwards and backwards, of which it is only known
where it is at a share of its length (Reeds, Shepp 1990). Where the car turns about is found from
how far apart points on it are: a piece without a cusp is never shorter from end to end than an arc
of the radius (Schur).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Floats

#: x, y and heading.
State: TypeAlias = tuple[float, float, float]

#: The points of a car's path are this far apart at most.
SPACING_M = 0.15

#: States along a curve are checked at this distance.
CHECK_M = 0.05

#: Where a car turns about is known to half of this; so short a piece between two cusps is none.
CUSP_M = 1e-3

#: What rounding takes from a distance.
ROUNDING_M = 1e-7


class Curve(Struct, frozen=True):
    """A curve: its length in m, the radius of its arcs in m, and the state at a share of it."""

    length_m: float
    radius_m: float
    at: Callable[[float], State]


def is_free(curve: Curve, spare_m: Callable[[State], float]) -> bool:
    """Return whether a curve is free, as far as states at distances of ``CHECK_M`` say.

    ``spare_m`` says how far a car may move from a state for sure, in m: negative, where it must not
    be; 0 where that is not known.
    """
    along = 0.0
    while along < curve.length_m:
        spare = spare_m(curve.at(along / curve.length_m))
        if spare < 0:
            return False
        along += max(spare, CHECK_M)
    return spare_m(curve.at(1.0)) >= 0


def points(curve: Curve) -> Floats:
    """Points of a curve, shape ``(k, 2)``: evenly spaced between its cusps, which are kept."""
    legs = [0.0, *_cusps(curve), 1.0]
    found = [curve.at(0.0)[:2]]
    for first, last in pairwise(legs):
        count = max(1, math.ceil((last - first) * curve.length_m / SPACING_M - 1e-9))
        found += [curve.at(first + (last - first) * k / count)[:2] for k in range(1, count + 1)]
    return np.array(found)


def _cusps(curve: Curve) -> list[float]:
    """The shares of the length at which the car turns about."""
    count = max(1, math.ceil(curve.length_m / SPACING_M))
    shares = [k / count for k in range(count + 1)]
    states = [curve.at(share) for share in shares]
    found: list[float] = []
    way, until = 0, 0.0
    for k in range(count):
        for first, last, going in _pieces(
            curve, (shares[k], states[k]), (shares[k + 1], states[k + 1])
        ):
            if way and going != way:
                found.append((until + first) / 2)
            way, until = going, last
    return found


def _pieces(
    curve: Curve, first: tuple[float, State], last: tuple[float, State]
) -> Sequence[tuple[float, float, int]]:
    """What of a piece has no cusp, in order, with 1 where it is driven forwards, else -1."""
    (begin, (x, y, heading)), (end, (to_x, to_y, _)) = first, last
    length = (end - begin) * curve.length_m
    step_x, step_y = to_x - x, to_y - y
    radius = curve.radius_m
    arc_m = 2 * radius * math.sin(min(length / (2 * radius), math.pi / 2))
    if math.hypot(step_x, step_y) >= arc_m - ROUNDING_M:
        ahead = step_x * math.cos(heading) + step_y * math.sin(heading) > 0
        return ((begin, end, 1 if ahead else -1),)
    if length <= CUSP_M:
        return ()
    half = (begin + end) / 2
    middle = half, curve.at(half)
    return *_pieces(curve, first, middle), *_pieces(curve, middle, last)
