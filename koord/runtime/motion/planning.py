"""The interface of path planners, and the straight-line planner. (paper, III-D and VI-C)

A planner is made for a world and a body, and asked for paths. It answers with points, the first of
which is the start and the last the goal, or with None: no way was found. It never answers with a
path that its body must not take: for a car to a point above the plane, for a drone to one on the
ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.motion.arrays import Bools, Floats
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.field import Field, field
from koord.runtime.motion.world import Disc, Point, World

#: A goal this far above the plane is still on it.
_ON_PLANE_M = 0.05


class Pose(Struct, frozen=True):
    """The pose of a robot: position in metres, heading counter-clockwise from the x axis in rad."""

    position: Point
    heading_rad: float = 0.0


class PlanningEffort(Struct, frozen=True):
    """The effort of a planner in steps, not in time, so that a seed repeats a run."""

    steps: int = 1000
    star_steps: int = 120  #: of planners that go on improving


class Hindrance(Enum):
    """Reasons why a robot does not go to its goal."""

    OUTSIDE = "that is outside of the world's bounds"
    ABOVE_GROUND = "that is above the ground, which it never leaves"
    ON_GROUND = "that is so near to the ground that no drone flies there"
    NO_WAY = "its planner finds no way there"
    NO_POINTS = "the path that it was given has no points"
    NOT_CLEAR = "each path that it finds is in the way of another robot"
    ROBOT = "another robot stands in its way"
    OBSTACLE = "an obstacle stands in its way"
    EDGE = "the edge of the world is in its way"
    NO_HEADWAY = "it is on its way, and its vehicle makes no headway"


class Plight(Struct, frozen=True):
    """A robot that stays in place: the hindrance, and its goal, if one was set."""

    hindrance: Hindrance
    goal: Point | None = None
    by: str = ""  #: what its vehicle touches, where it makes no headway

    @property
    def words(self) -> str:
        if self.by:
            return f"{Hindrance.NO_HEADWAY.value}: it touches {self.by}"
        if self.goal is None:
            return self.hindrance.value
        place = ", ".join(f"{c:g}" for c in (round(c, 3) for c in self.goal))
        return f"it is to go to ({place}), and {self.hindrance.value}"


class Touched(NamedTuple):
    """A contact of a vehicle: with another vehicle, an obstacle, or the edge of the world."""

    what: Hindrance
    number: int = 0  #: of the obstacle, or of the vehicle among those that are ``others``
    others: object = None


class LateSeed(Struct, frozen=True):
    """The seed of a plan, worked out when a number is wanted: most plans hang on none.

    It is that of a robot's plan of a number, and ``seeds`` are those of robots.
    """

    seeds: Sequence[int]
    robot: int
    number: int

    def __index__(self) -> int:
        source = np.random.SeedSequence((self.seeds[self.robot], self.number))
        return int(source.generate_state(1)[0])


class Planner(Protocol):
    """A path planner for one body in one world."""

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        """A path, shape ``(k, 3)`` with k ≥ 2, around obstacles and points to avoid."""
        ...


def hindrance(body: Body, world: World, goal: Point) -> Hindrance | None:
    """The reason why robots of that kind may never go to a point; None if they may."""
    (x, y, z), (west, south, bottom), (east, north, top) = goal, world.low, world.high
    if not (west <= x <= east and south <= y <= north and bottom <= z <= top):
        return Hindrance.OUTSIDE
    lowest, highest = _heights(body, world)
    if z > highest:
        return Hindrance.ABOVE_GROUND
    return Hindrance.ON_GROUND if z < lowest else None


def _heights(body: Body, world: World) -> tuple[float, float]:
    """From where to where robots of that kind may be, whatever bounds the world has."""
    if body.ON_GROUND:
        return -math.inf, world.ground + _ON_PLANE_M
    return world.ground + body.above_ground_m, math.inf


def suits(body: Body, world: World, goal: Point) -> bool:
    """Return whether robots of that kind may go to a point: inside, on the plane or above it."""
    return hindrance(body, world, goal) is None


def all_suit(body: Body, world: World, goals: Floats) -> Bools:
    """A mask of the points, shape ``(n, 3)``, that suit, as :func:`suits` says of each."""
    lowest, highest = _heights(body, world)
    (west, south, bottom), (east, north, top) = world.low, world.high
    low = np.array([west, south, max(bottom, lowest)])
    high = np.array([east, north, min(top, highest)])
    found: Bools = np.logical_and.reduce((low <= goals) & (goals <= high), axis=1)
    return found


class Room(Struct, frozen=True):
    """How far positions on ways keep from walls and obstacles, however small the body is. (P-WAY)

    On no way they come nearer than ``least_m``, but to leave a start that is nearer already. Where
    there is such a way, they keep ``spare_m`` more, away from its start and its goal.
    """

    least_m: float = 0.0
    spare_m: float = 0.0

    @property
    def wide_m(self) -> float:
        """What is kept where that can be."""
        return self.least_m + self.spare_m


#: As close as bodies allow.
CLOSE = Room()


@lru_cache(maxsize=16)
def _field(world: World, *, flat: bool) -> Field:
    """The field of a world, which is made once for all plans in it."""
    return field(world, flat=flat)


class Ground(Struct, frozen=True):
    """The planning problem: world, body, and the radius in m of what stands at avoided points."""

    world: World
    body: Body
    avoid_m: float
    room: Room = CLOSE

    @property
    def flat(self) -> bool:
        return self.body.ON_GROUND

    def field(self, avoid: Sequence[Point]) -> Field:
        """The free space, with cylinders around the points to avoid."""
        if not avoid:
            return _field(self.world, flat=self.flat)
        extra = tuple(Disc((x, y), self.avoid_m) for x, y, _ in avoid)
        return field(replace(self.world, obstacles=self.world.obstacles + extra), flat=self.flat)

    def standing(self, start: Pose) -> Pose:
        """The start of a way: who stands on the ground may be measured a little below it."""
        x, y, z = start.position
        return (
            start if z >= self.world.ground else replace(start, position=(x, y, self.world.ground))
        )


class Straight(Struct, frozen=True):
    """The planner of straight lines, where nothing is in the way."""

    ground: Ground

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        body = self.ground.body
        if not suits(body, self.ground.world, goal):
            return None
        path = np.array([self.ground.standing(start).position, goal])
        reach_m = max(body.radius_m, self.ground.room.least_m)
        if not self.ground.field(avoid).path_free(path, reach_m):
            return None
        path[0] = start.position
        return path
