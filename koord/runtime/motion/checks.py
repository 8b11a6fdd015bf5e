"""Geometric checks of a world and of the robots' starts in it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from enum import Enum
from itertools import combinations, product

import numpy as np
from msgspec import Struct

from koord.runtime.motion import shapes
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.field import field
from koord.runtime.motion.planning import suits
from koord.runtime.motion.world import Box, Disc, Point, Polygon, World

#: Up to so many robots all pairs are looked at.
_FEW = 64

#: Of each two opposite cells around a cell one.
_HALF_AROUND = tuple(d for d in product((-1, 0, 1), repeat=3) if d > (0, 0, 0))

#: A world with obstacles has so many cells at most: of each it is worked out what stands in it.
MOST_CELLS = 1_000_000


class WorldPart(Enum):
    """The subjects of complaints about a world."""

    BOUNDS = "bounds"
    OBSTACLE = "obstacle"
    TASK = "task"
    ROBOT = "robot"


class WorldFlaw(Struct, frozen=True):
    """A problem with a world: of the ``index``-th obstacle, task or robot."""

    part: WorldPart
    index: int
    message: str


def world_complaints(world: World) -> Iterator[WorldFlaw]:
    """Yield the problems of a world by itself."""
    names = ("x", "y", "z")
    for name, low, high in zip(names, world.low, world.high, strict=True):
        if not low < high:
            yield WorldFlaw(WorldPart.BOUNDS, 0, f"the world has no extent along {name}")
    if world.obstacles and world.grid.cells > MOST_CELLS:
        yield WorldFlaw(
            WorldPart.BOUNDS,
            0,
            f"a world with obstacles has at most {MOST_CELLS} cells, and this one has "
            f"{world.grid.cells:.3g} of {world.cell_m:g} m: make it smaller, or its cells larger",
        )
    for k, obstacle in enumerate(world.obstacles):
        match obstacle:
            case Box() if any(a >= b for a, b in zip(obstacle.low, obstacle.high, strict=True)):
                yield WorldFlaw(
                    WorldPart.OBSTACLE, k, "the low corner of a box is below its high one"
                )
            case Disc(radius_m=radius) if radius <= 0:
                yield WorldFlaw(WorldPart.OBSTACLE, k, "the radius of a disc is greater than 0")
            case Polygon():
                fault = shapes.fault(obstacle)
                if fault is not None:
                    yield WorldFlaw(WorldPart.OBSTACLE, k, f"the corners make no polygon: {fault}")
            case _:
                pass
    for k, task in enumerate(world.tasks):
        inside = all(a <= c <= b for a, c, b in zip(world.low, task, world.high, strict=True))
        if not inside:
            yield WorldFlaw(
                WorldPart.TASK, k, f"the task at {_shown(task)} is outside of the world"
            )


def start_complaints(
    world: World, robots: Sequence[tuple[Body, Point]], apart_m: float = 0.0
) -> Iterator[WorldFlaw]:
    """Yield the problems of the robots' starts; they have to be more than ``apart_m`` apart."""
    fields = {flat: field(world, flat=flat) for flat in (False, True)}
    for k, (body, start) in enumerate(robots):
        inside = all(a <= c <= b for a, c, b in zip(world.low, start, world.high, strict=True))
        if not inside:
            yield WorldFlaw(
                WorldPart.ROBOT, k, f"the start at {_shown(start)} is outside of the world"
            )
            continue
        flat = body.ON_GROUND
        if flat and not suits(body, world, start):
            yield WorldFlaw(WorldPart.ROBOT, k, f"a {body.LOOK.name} starts on the ground")
        if fields[flat].clearance(*start) < (body.inner_radius_m if world.obstacles else 0.0):
            yield WorldFlaw(WorldPart.ROBOT, k, f"something stands at the start, {_shown(start)}")
    for i, k in _near_pairs(robots, apart_m):
        (one, here), (other, there) = robots[i], robots[k]
        least = max(apart_m, one.inner_radius_m + other.inner_radius_m)
        if math.dist(here, there) <= least:
            yield WorldFlaw(
                WorldPart.ROBOT, k, f"it starts {math.dist(here, there):.2f} m from robot {i}"
            )


def _near_pairs(robots: Sequence[tuple[Body, Point]], apart_m: float) -> Iterator[tuple[int, int]]:
    """Yield pairs of robots that may be too near to each other, in order."""
    if len(robots) <= _FEW:
        yield from combinations(range(len(robots)), 2)
        return
    reach_m = max(apart_m, 2 * max(body.inner_radius_m for body, _ in robots)) * (1 + 1e-9)
    starts = [start for _, start in robots]
    yield from sorted(near_pairs(starts, reach_m))


def near_pairs(points: Sequence[Point], reach_m: float) -> Iterator[tuple[int, int]]:
    """Yield the pairs ``(i, k)``, i < k, of points that are at most so far from each other.

    Each point is held against those of its own cell and of the cells around it, a little wider than
    the reach: not against all.
    """
    cell_m = max(1.01 * reach_m, 1e-3)
    cells: dict[tuple[float, float, float], list[int]] = {}
    corners = np.floor(np.array(points, dtype=np.float64) / cell_m).tolist()
    for k, (x, y, z) in enumerate(corners):
        cells.setdefault((x, y, z), []).append(k)
    for (x, y, z), members in cells.items():
        yield from _within(combinations(members, 2), points, reach_m)
        for dx, dy, dz in _HALF_AROUND:
            others = cells.get((x + dx, y + dy, z + dz))
            if others is not None and others is not members:
                yield from _within(product(members, others), points, reach_m)


def _within(
    pairs: Iterable[tuple[int, int]], points: Sequence[Point], reach_m: float
) -> Iterator[tuple[int, int]]:
    for one, other in pairs:
        if math.dist(points[one], points[other]) <= reach_m:
            yield (one, other) if one < other else (other, one)


def _shown(point: Point) -> str:
    return f"({', '.join(f'{c:g}' for c in point)})"
