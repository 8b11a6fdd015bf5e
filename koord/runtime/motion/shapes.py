"""Footprints of obstacles, by shapely: the one file that imports it."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias, assert_never

import numpy as np

from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.motion.libraries import missing, require
from koord.runtime.motion.world import Box, Disc, Obstacle, Polygon

if TYPE_CHECKING:
    import shapely

require(("shapely",), "sim")

#: What stands on the ground, and how far it reaches around that: a disc is a point that reaches.
Footprint: TypeAlias = "tuple[shapely.Geometry, float]"


@cache
def _shapely() -> Any:
    """The library, imported when it is first used: where there are obstacles. Raises KoordError."""
    try:
        import shapely
    except ImportError as error:
        raise missing("shapely", "sim") from error
    return shapely


def footprint(obstacle: Obstacle) -> Footprint:
    """The exact footprint of an obstacle on the ground."""
    match obstacle:
        case Box() | Polygon():
            shape = _shapely().Polygon(obstacle.corners)
            _shapely().prepare(shape)
            return shape, 0.0
        case Disc():
            return _shapely().Point(obstacle.centre), obstacle.radius_m
        case _:
            assert_never(obstacle)


def fault(polygon: Polygon) -> str | None:
    """The problem with a polygon's corners, such as crossing edges; None if there is none."""
    if len(set(polygon.corners)) < 3:
        return "a polygon needs three corners"
    shape = _shapely().Polygon(polygon.corners)
    return None if shape.is_valid and shape.area > 0 else _shapely().is_valid_reason(shape)


def touched(starts: Floats, ends: Floats, where: Footprint, reach_m: float) -> Bools:
    """A mask of the flat segments, shape ``(n, 2)``, that come within reach of a footprint."""
    shape, around = where
    lines = _shapely().linestrings(_rounded(np.stack([starts, ends], axis=1)))
    found: Bools = _shapely().dwithin(lines, shape, reach_m + around)
    return found


def flat_paths_within(one: Floats, other: Floats, reach_m: float) -> bool:
    """Return whether two flat paths, shape ``(k, 2)``, come within reach of each other."""
    return bool(_shapely().dwithin(_line(one), _line(other), reach_m))


def _line(path: Floats) -> shapely.Geometry:
    path = _rounded(path)
    return _shapely().Point(path[0]) if len(path) == 1 else _shapely().LineString(path)


def _rounded(points: Floats) -> Floats:
    """Round away components so small that their squares vanish: GEOS divides by such."""
    return np.round(points, 12)


def overlaps(where: Footprint, centre: tuple[float, float], side_m: float) -> bool:
    """Return whether a footprint covers part of a square, and not only its edge."""
    shape, around = where
    half = side_m / 2 - 1e-9
    (x, y) = centre
    square = _shapely().box(x - half, y - half, x + half, y + half)
    return bool(_shapely().distance(square, shape) <= around) and (
        around > 0 or bool(_shapely().intersection(square, shape).area > 0)
    )
