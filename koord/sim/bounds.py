"""Default bounds of a world: large enough for all places in program and configuration.

Nothing is made up: where it is not even said where robots begin, bounds are asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from msgspec.structs import replace

from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.configuration.reading import problem
from koord.runtime.motion.world import Disc, Obstacle, Point, World
from koord.runtime.platform.world_host import WAYS
from koord.runtime.ports import GOALS, plain_name
from koord.syntax import core
from koord.syntax.analysis.folding import constant
from koord.syntax.diagnostics import KoordError
from koord.syntax.elaboration.library import LIBRARY
from koord.syntax.types import POS
from koord.syntax.walk import nodes

#: Around all places there is so much room for robots to turn and to pass each other.
MARGIN_M = 2.0

#: The ground that a robot gets in a world without bounds, where nobody says where it begins.
_ROOM_M2 = 4.0

#: There is so much room above the ground, and above the highest place.
_ROOM_M, _ABOVE_M = 3.0, 1.0


def world_of(
    configuration: RunConfiguration,
    landmarks: Sequence[Point] | None,
    robots: int,
    *,
    located: bool = False,
) -> World:
    """The world of a configuration, with its bounds, or bounds with room for all places.

    ``landmarks`` are the places that a program names, None if it moves nobody. Robots that are
    ``located`` begin where their vehicles say, if drivers have them. Raises KoordError if bounds
    are to be asked for. (K931) (P-FENCE-UNSAID)
    """
    world = configuration.world if configuration.world is not None else World()
    if configuration.bounded:
        return world
    if landmarks is None:
        room = _with_room(world, robots)
        return widened(room, [*_outside(room, configuration)])
    lost = [
        robot.pid
        for robot in configuration.robots
        if robot.position is None and not (located and robot.vehicle.driver is not None)
    ]
    places = [*landmarks, *_places(configuration, world)]
    where = configuration.place("world") if configuration.world else configuration.place()
    hint = "write world: {bounds: {low: [-5, -5, 0], high: [5, 5, 3]}}"
    if lost and configuration.scatter.start is None:
        story = f"it is not said how large the world is, nor where robot {lost[0]} begins"
        raise KoordError((problem(where, story, f"{hint}, or a `position`"),))
    if not places:
        story = "it is not said how large the world is, and the program names no place in it"
        raise KoordError((problem(where, story, f"{hint}, here or in the file of a site"),))
    return around(world, places)


def _outside(world: World, configuration: RunConfiguration) -> Iterator[Point]:
    """The positions of robots that lie outside of a world."""
    for robot in configuration.robots:
        if (at := robot.position) is not None and not all(
            a <= c <= b for a, c, b in zip(world.low, at, world.high, strict=True)
        ):
            yield at


def _with_room(world: World, robots: int) -> World:
    """A world enlarged where needed, so that so many robots may stand in it anywhere."""
    (x0, y0, z0), (x1, y1, z1) = world.low, world.high
    scale = math.sqrt(robots * _ROOM_M2 / ((x1 - x0) * (y1 - y0)))
    if scale <= 1:
        return world
    low, high = (x0 * scale, y0 * scale, z0), (x1 * scale, y1 * scale, z1)
    return replace(world, low=low, high=high)


def widened(world: World, places: Sequence[Point]) -> World:
    """A world enlarged where needed, so that places have room."""
    if not places:
        return world
    room = around(world, places)
    (x0, y0, z0), (x1, y1, z1) = world.low, world.high
    (u0, v0, w0), (u1, v1, w1) = room.low, room.high
    low, high = (min(x0, u0), min(y0, v0), min(z0, w0)), (max(x1, u1), max(y1, v1), max(z1, w1))
    return replace(world, low=low, high=high)


def moves(program: core.Program) -> bool:
    """Return whether a program sends robots anywhere, or asks for paths."""
    ports = (port.declaration.variable.name for agent in program.agents for port in agent.ports)
    asked = (plain_name(external.name) for external in program.externals)
    return not set(GOALS).isdisjoint(ports) or not WAYS.isdisjoint(asked)


def around(world: World, places: Iterable[Point]) -> World:
    """A world with room around places."""
    xs, ys, zs = zip(*places, strict=True)
    low = (min(xs) - MARGIN_M, min(ys) - MARGIN_M, min(0.0, *zs))
    high = (max(xs) + MARGIN_M, max(ys) + MARGIN_M, max(low[2] + _ROOM_M, max(zs) + _ABOVE_M))
    return replace(world, low=low, high=high)


def places_of(program: core.Program) -> Iterator[Point]:
    """The places that a program names: positions with constant coordinates."""
    own = tuple(f for f in program.functions if f.span.file != LIBRARY)
    for node in nodes(replace(program, functions=own, externals=())):
        if isinstance(node, core.MakeRecord) and node.type == POS:
            x, y, z = map(_number, node.fields)
            if x is not None and y is not None and z is not None:
                yield x, y, z


def _number(e: core.Expr) -> float | None:
    value = constant(e)
    return None if value is None or isinstance(value, bool | str) else float(value)


def _places(configuration: RunConfiguration, world: World) -> Iterator[Point]:
    """The positions in a configuration."""
    for robot in configuration.robots:
        if robot.position is not None:
            yield robot.position
    yield from world.tasks
    yield from configuration.scatter.start or ()
    for obstacle in world.obstacles:
        yield from _corners(obstacle)


def _corners(obstacle: Obstacle) -> Iterator[Point]:
    flat: Iterable[tuple[float, float]]
    match obstacle:
        case Disc(centre=(x, y), radius_m=r):
            flat = ((x - r, y - r), (x + r, y + r))
        case _:
            flat = obstacle.corners
    high = obstacle.high_z if math.isfinite(obstacle.high_z) else obstacle.low_z
    for x, y in flat:
        yield x, y, obstacle.low_z
        yield x, y, high
