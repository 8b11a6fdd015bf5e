"""Free space of a world for a body with a radius: clearance of points and segments.

A body is an upright cylinder that reaches as far up and down as it does sideways. So a position is
blocked by an obstacle if it is nearer than the radius sideways, and vertically as well; for robots
that stay on the ground only sideways, and only by what is as low as they are high.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import assert_never

import numpy as np
from msgspec import Struct

from koord.runtime.motion import shapes
from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.motion.world import Box, Disc, Flat, Obstacle, Polygon, World

#: What is higher above the ground than this does not concern a robot on the ground.
GROUND_ROBOT_M = 0.35


class Field(Struct, frozen=True):
    """The free space of a body. ``flat``: the body stays on the ground."""

    world: World
    flat: bool
    obstacles: tuple[Obstacle, ...]
    distances: tuple[Callable[[float, float], float], ...]
    footprints: tuple[shapes.Footprint, ...]

    def clearance(self, x: float, y: float, z: float) -> float:
        """The distance in metres of a position from the nearest obstacle or wall; negative inside.

        The ground is no wall: robots stand on it.
        """
        return min([self.from_edge(x, y, z), *self.apart(x, y, z)])

    def from_edge(self, x: float, y: float, z: float) -> float:
        """The distance in metres of a position from the nearest wall of the world."""
        low, high = self.world.low, self.world.high
        nearest = min(x - low[0], high[0] - x, y - low[1], high[1] - y)
        if not self.flat:
            nearest = min(nearest, high[2] - z, math.inf if z >= low[2] else z - low[2])
        return nearest

    def apart(self, x: float, y: float, z: float) -> Iterator[float]:
        """Yield the distance in metres of a position from each obstacle."""
        for obstacle, sideways in zip(self.obstacles, self.distances, strict=True):
            apart = sideways(x, y)
            if not self.flat:
                apart = max(apart, obstacle.low_z - z, z - obstacle.high_z)
            yield apart

    def segments_free(self, starts: Floats, ends: Floats, reach_m: float) -> Bools:
        """A mask of the segments, shape ``(n, 3)``, along which a body can move, exactly."""
        free = self._inside(starts, reach_m) & self._inside(ends, reach_m)
        for obstacle, where in zip(self.obstacles, self.footprints, strict=True):
            free &= ~self._blocked(starts, ends, obstacle, where, reach_m)
        return free

    def path_free(self, path: Floats, reach_m: float) -> bool:
        """Return whether a body of that radius can move along a path of at least one point."""
        starts, ends = (path, path) if len(path) == 1 else (path[:-1], path[1:])
        return bool(self.segments_free(starts, ends, reach_m).all())

    def _inside(self, points: Floats, reach_m: float) -> Bools:
        low, high = np.array(self.world.low), np.array(self.world.high)
        inside: Bools = np.all(
            (points[:, :2] >= low[:2] + reach_m) & (points[:, :2] <= high[:2] - reach_m), axis=1
        )
        if not self.flat:
            inside &= (points[:, 2] >= low[2]) & (points[:, 2] <= high[2] - reach_m)
        return inside

    def _blocked(
        self,
        starts: Floats,
        ends: Floats,
        obstacle: Obstacle,
        where: shapes.Footprint,
        reach_m: float,
    ) -> Bools:
        first, last = np.zeros(len(starts)), np.ones(len(starts))
        if not self.flat:
            # The share of each segment that is as high as the obstacle; none if first > last.
            rise = ends[:, 2] - starts[:, 2]
            level = np.abs(rise) < 1e-12
            safe = np.where(level, 1.0, rise)
            bottom = (obstacle.low_z - reach_m - starts[:, 2]) / safe
            top = np.minimum((obstacle.high_z + reach_m - starts[:, 2]) / safe, 1e9)
            beside = (starts[:, 2] > obstacle.low_z - reach_m) & (
                starts[:, 2] < obstacle.high_z + reach_m
            )
            first = np.where(level, np.where(beside, 0.0, 2.0), np.minimum(bottom, top))
            last = np.where(level, 1.0, np.maximum(bottom, top))
            first, last = np.maximum(first, 0.0), np.minimum(last, 1.0)
        way = ends - starts
        from_ = (starts + first[:, None] * way)[:, :2]
        to = (starts + np.maximum(first, last)[:, None] * way)[:, :2]
        found: Bools = (first <= last) & shapes.touched(from_, to, where, reach_m)
        return found


def field(world: World, *, flat: bool) -> Field:
    """The field of a world for robots that fly, or that stay on the ground (``flat``)."""
    seen = tuple(
        obstacle
        for obstacle in world.obstacles
        if not flat
        or (obstacle.low_z < world.ground + GROUND_ROBOT_M and obstacle.high_z > world.ground)
    )
    return Field(
        world,
        flat,
        seen,
        tuple(_sideways(obstacle) for obstacle in seen),
        tuple(shapes.footprint(obstacle) for obstacle in seen),
    )


def _sideways(obstacle: Obstacle) -> Callable[[float, float], float]:
    """The distance function of a footprint: 0 or less inside. Planners call it often."""
    match obstacle:
        case Disc(centre=(cx, cy), radius_m=radius):
            return lambda x, y: math.hypot(x - cx, y - cy) - radius
        case Box(low=(x0, y0, _), high=(x1, y1, _)):
            return lambda x, y: math.hypot(max(x0 - x, 0.0, x - x1), max(y0 - y, 0.0, y - y1))
        case Polygon(corners=corners):
            edges = tuple(_edges(corners))
            return lambda x, y: _polygon_distance(edges, x, y)
        case _:
            assert_never(obstacle)


def _edges(corners: tuple[Flat, ...]) -> Iterator[tuple[float, float, float, float]]:
    for (x0, y0), (x1, y1) in pairwise((*corners, corners[0])):
        yield x0, y0, x1, y1


def _polygon_distance(
    edges: tuple[tuple[float, float, float, float], ...], x: float, y: float
) -> float:
    inside, nearest = False, math.inf
    for x0, y0, x1, y1 in edges:
        dx, dy = x1 - x0, y1 - y0
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * dx / dy:
            inside = not inside
        length = dx * dx + dy * dy
        share = ((x - x0) * dx + (y - y0) * dy) / length if length else 0.0
        share = min(max(share, 0.0), 1.0)
        nearest = min(nearest, math.hypot(x - x0 - share * dx, y - y0 - share * dy))
    return 0.0 if inside else nearest
