"""Shared by all files of runs: colours, obstacles and robots as simple bodies, events that ran."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from koord.runtime.motion.world import Box, Disc, Obstacle, Point, Polygon
from koord.sim.run_log import Header, LoggedRobot, LoggedRound, TaskState

#: Red, green and blue, from 0 to 255.
Colour = tuple[int, int, int]

_HUES: tuple[Colour, ...] = (
    (47, 111, 222),
    (184, 66, 154),
    (14, 143, 158),
    (138, 100, 40),
    (108, 75, 216),
    (90, 113, 130),
    (47, 147, 216),
    (160, 60, 98),
)
TASKS: dict[TaskState, Colour] = {
    TaskState.OPEN: (212, 59, 52),
    TaskState.ASSIGNED: (224, 150, 30),
    TaskState.DONE: (29, 138, 78),
}
WALL: Colour = (150, 160, 175)


def hue(robot: int) -> Colour:
    """Return the colour of a robot."""
    return _HUES[robot % len(_HUES)]


def fractions(colour: Colour) -> tuple[float, float, float]:
    """Convert a colour to red, green and blue from 0 to 1."""
    red, green, blue = (round(part / 255, 3) for part in colour)
    return red, green, blue


class Solid(Struct, frozen=True):
    """A box along the axes or an upright cylinder, by its centre and size, in metres."""

    is_box: bool
    middle: Point
    size: Point


def heights(obstacle: Obstacle, roof: float) -> tuple[float, float]:
    """The lower and upper height of an obstacle, cut at a roof."""
    return obstacle.low_z, min(obstacle.high_z, roof)


def solid_of(obstacle: Box | Disc, roof: float) -> Solid:
    """The body of an obstacle, cut at a roof."""
    low, high = heights(obstacle, roof)
    if isinstance(obstacle, Disc):
        x, y = obstacle.centre
        wide = 2 * obstacle.radius_m
        return Solid(False, (x, y, (low + high) / 2), (wide, wide, high - low))
    (x0, y0, _), (x1, y1, _) = obstacle.low, obstacle.high
    middle = (x0 + x1) / 2, (y0 + y1) / 2, (low + high) / 2
    return Solid(True, middle, (x1 - x0, y1 - y0, high - low))


def rings(obstacle: Polygon, roof: float) -> list[list[Point]]:
    """The lower and upper edge of an obstacle, cut at a roof; both are closed."""
    ends = [*obstacle.corners, obstacle.corners[0]]
    return [[(x, y, z) for x, y in ends] for z in heights(obstacle, roof)]


def body_of(robot: LoggedRobot) -> Solid:
    """The body of a robot in its own frame."""
    if robot.look.is_box:
        return Solid(True, (robot.middle_m, 0.0, 0.08), (robot.length_m, robot.width_m, 0.16))
    return Solid(False, (0.0, 0.0, 0.0), (2 * robot.radius_m, 2 * robot.radius_m, 0.1))


def ran(header: Header, done: LoggedRound) -> Iterator[tuple[int, str]]:
    """The robots that ran an event in a round, and which."""
    for k, deed in enumerate(done.deeds.tolist()):
        if deed >= 0:
            yield k, header.agents[header.robots[k].agent].events[deed]
