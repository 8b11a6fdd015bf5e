"""Geometric checks of a world and of the robots' starts in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from enum import Enum
from itertools import combinations

from msgspec import Struct

from koord.runtime.motion import shapes
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.field import field
from koord.runtime.motion.planning import suits
from koord.runtime.motion.world import Box, Disc, Point, Polygon, World

#: Up to so many robots all pairs are looked at.
_FEW = 64

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
    from scipy.spatial import cKDTree

    reach = max(apart_m, 2 * max(body.inner_radius_m for body, _ in robots))
    tree = cKDTree([start for _, start in robots])
    yield from sorted(tree.query_pairs(reach * (1 + 1e-9)))


def _shown(point: Point) -> str:
    return f"({', '.join(f'{c:g}' for c in point)})"
