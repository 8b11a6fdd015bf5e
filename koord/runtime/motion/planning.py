"""Path planners by the names that configurations give them. (paper, III-D and VI-C)

A planner is made for a world and a body, and asked for paths. It answers with points, the first of
which is the start and the last the goal, or with None: no way was found. It never answers with a
path that its body must not take: for a car to a point above the plane, for a drone to one on the
ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Protocol, assert_never

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Body, Car, Drone, Ideal
from koord.runtime.motion.field import Field, field
from koord.runtime.motion.world import Disc, Point, World

#: A goal of a car this far above the plane is still on it.
_ON_PLANE_M = 0.05


class PlannerName(Enum):
    """What a configuration may say behind ``planner:``."""

    STRAIGHT = "STRAIGHT"
    RRT_CAR = "RRT_CAR"
    RRT_STAR_CAR = "RRT_STAR_CAR"
    RRT_DRONE = "RRT_DRONE"
    RRT_STAR_DRONE = "RRT_STAR_DRONE"

    @property
    def optimal(self) -> bool:
        return self in (PlannerName.RRT_STAR_CAR, PlannerName.RRT_STAR_DRONE)


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a robot is, and where it points (counter-clockwise from the x axis)."""

    position: Point
    heading_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Effort:
    """How long a planner may try: in steps, not in time, so that a seed repeats a run."""

    steps: int = 1000
    star_steps: int = 120  #: of planners that go on improving


class Planner(Protocol):
    """A path planner for one body in one world."""

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        """A path, shape ``(k, 3)`` with k ≥ 2, around obstacles and points to avoid."""
        ...


def planner(
    name: PlannerName,
    world: World,
    body: Body,
    effort: Effort = Effort(),
    avoid_m: float = 0.25,
) -> Planner:
    """The planner of that name. Raises KoordError if it needs a library that is not installed.

    ``avoid_m`` is the radius of what stands at a point to avoid.
    """
    match name:
        case PlannerName.STRAIGHT:
            return Straight(Ground(world, body, avoid_m))
        case PlannerName.RRT_CAR | PlannerName.RRT_STAR_CAR:
            from koord.runtime.motion.rrt import CurvePlanner

            car = body if isinstance(body, Car) else Car()
            return CurvePlanner(Ground(world, car, avoid_m), car, effort, name.optimal)
        case PlannerName.RRT_DRONE | PlannerName.RRT_STAR_DRONE:
            from koord.runtime.motion.rrt import SpacePlanner

            return SpacePlanner(Ground(world, body, avoid_m), effort, name.optimal)
        case _:
            assert_never(name)


def suits(body: Body, world: World, goal: Point) -> bool:
    """Whether robots of that kind may go to a point at all: inside, on the plane or above it."""
    inside = all(a <= c <= b for a, c, b in zip(world.low, goal, world.high, strict=True))
    match body:
        case Car():
            return inside and goal[2] <= world.ground + _ON_PLANE_M
        case Drone():
            return inside and goal[2] >= world.ground + body.above_ground_m
        case Ideal():
            return inside
        case _:
            assert_never(body)


@dataclass(frozen=True, slots=True)
class Ground:
    """What planners know: the world, the body, and the radius of what stands at points to avoid."""

    world: World
    body: Body
    avoid_m: float

    @property
    def flat(self) -> bool:
        return isinstance(self.body, Car)

    def field(self, avoid: Sequence[Point]) -> Field:
        """The free space, with cylinders around the points to avoid."""
        if not avoid:
            return field(self.world, flat=self.flat)
        extra = tuple(Disc((x, y), self.avoid_m) for x, y, _ in avoid)
        return field(replace(self.world, obstacles=self.world.obstacles + extra), flat=self.flat)


@dataclass(frozen=True, slots=True)
class Straight:
    """The straight line, where nothing is in the way."""

    ground: Ground

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        body = self.ground.body
        if not suits(body, self.ground.world, goal):
            return None
        path = np.array([start.position, goal])
        return path if self.ground.field(avoid).path_free(path, body.radius_m) else None
