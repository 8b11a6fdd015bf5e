"""Ideal robots without a platform: points that move to their targets at a given speed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from random import Random
from types import MappingProxyType
from typing import Any

from koord.runtime.deploy.member import Untimed
from koord.runtime.motion.world import Point, World
from koord.runtime.plain_functions import FUNCTIONS
from koord.runtime.ports import (
    DONE,
    GOALS,
    PLACES,
    YAW,
    is_place,
    is_set,
    is_task,
    placed,
    plain_name,
    point_of,
    shape_of,
    task_at,
)
from koord.runtime.robot import Key, Robot, Turn
from koord.runtime.shapes import FLOAT, Array, Shape, default
from koord.runtime.shapes import Sequence as ListOf

#: Robots that begin nowhere in particular stand in a row, so far apart.
APART_M = 1.0

DEFAULT_SPEED_MPS = 1.0

#: So much of a step is left out, so that rounding makes nobody faster than it may be.
_SLACK = 1e-9


def unanswered(functions: Mapping[str, Shape]) -> tuple[str, ...]:
    """The external functions that :class:`IdealHost` cannot answer."""
    known = _LIBRARY.keys() | FUNCTIONS.keys()
    return tuple(name for name in functions if plain_name(name) not in known)


class IdealHost(Untimed):
    """The host of one ideal robot: its sensors, its library, its random choices."""

    def __init__(
        self,
        program: type[Robot],
        pid: int,
        robots: int,
        delta_s: float,
        seed: int,
        position: Point | None = None,
        speed_mps: float | None = None,
        world: World | None = None,
        starts: Mapping[tuple[int | None, str], Any] = MappingProxyType({}),
    ) -> None:
        """Make a host; ``starts`` are those of variables that begin as the program assumes."""
        self.program = program
        self.pid = pid
        self.robots = robots
        self.starts = starts
        self.world = world if world is not None else World()
        self.position: Point = position if position is not None else self._place(pid)
        self.yaw_rad = 0.0  #: where it went last
        self.holding = False
        speed = speed_mps if speed_mps is not None else DEFAULT_SPEED_MPS
        self._step_m = delta_s * speed * (1 - _SLACK)
        self._random = Random(f"{seed} {pid}")
        self._done = 0  #: way-points of the path that lie behind
        self.path: tuple[Point, ...] = ()

    def _place(self, pid: int) -> Point:
        """Start positions for robots, in rows from the low corner of the world."""
        low, high = self.world.low, self.world.high
        columns = max(1, int((high[0] - low[0] - APART_M) / APART_M))
        row, column = divmod(pid, columns)
        return (low[0] + (column + 1) * APART_M, low[1] + (row + 1) * APART_M, low[2])

    # --- the host of a compiled robot -----------------------------------------------------------

    def start(self, robot: int | None, name: str) -> Any:
        """The start of a variable: the robot's position, the tasks, or a default. [INIT]"""
        if (robot, name) in self.starts:
            return self.starts[robot, name]
        shape = shape_of(self.program, name, shared=robot is None)
        robots = self.robots
        if is_place(name):
            return placed(shape, self.position)
        if isinstance(shape, Array) and is_task(shape.element):
            spots = map(self._spot, range(shape.size))
            return tuple(task_at(shape.element, spot, robots) for spot in spots)
        return default(shape, robots)

    def _spot(self, number: int) -> Point:
        """The place of a task: the world's, or else somewhere in it, the same for all robots."""
        if number < len(self.world.tasks):
            return self.world.tasks[number]
        low, high = self.world.low, self.world.high
        draw = Random(f"task {number}")
        x, y = (draw.uniform(a + 0.5, b - 0.5) for a, b in zip(low[:2], high[:2], strict=True))
        return (x, y, low[2])

    def read(self, robot: Robot) -> Mapping[str, Any]:
        """The sensors' readings δ later: the point has moved on, unless it holds. [ENV-FREE]"""
        readings: dict[str, Any] = {}
        for name in robot.SENSORS:
            module, _, port = name.rpartition("_")
            shape = robot.PORTS[name]
            if port in PLACES:
                before = self.position
                self._move(self._goals(robot, module))
                if self.position[:2] != before[:2]:
                    (x, y, _), (was_x, was_y, _) = self.position, before
                    self.yaw_rad = math.atan2(y - was_y, x - was_x)
                readings[name] = placed(shape, self.position)
        for name in robot.SENSORS:
            module, _, port = name.rpartition("_")
            if port in DONE:
                readings[name] = self._done >= len(self.path)
            elif port == YAW and robot.PORTS[name] == FLOAT:
                readings[name] = self.yaw_rad
            elif name not in readings and getattr(robot, name) is None:
                readings[name] = default(robot.PORTS[name], robot.numAgents)
        return readings

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        name = plain_name(function)
        if name in FUNCTIONS:
            return FUNCTIONS[name](*arguments)
        return _LIBRARY[name](self, *arguments)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        if isinstance(low, float):
            return self._random.uniform(low, high)
        return self._random.randint(low, high)

    # --- motion ---------------------------------------------------------------------------------

    def _goals(self, robot: Robot, module: str) -> tuple[Point, ...]:
        """The goals that the program has set for the robot, or none."""
        for port in GOALS:
            sent = getattr(robot, f"{module}_{port}", None)
            shape = robot.PORTS.get(f"{module}_{port}")
            if sent is None or shape is None:
                continue
            if isinstance(shape, ListOf | Array):
                return tuple(point_of(one) for one in sent if is_set(one))
            if not is_set(sent):
                continue
            return (point_of(sent),)
        return ()

    def _move(self, path: tuple[Point, ...]) -> None:
        if path != self.path:
            self.path, self._done = path, 0
        left = 0.0 if self.holding else self._step_m
        while self._done < len(path):
            goal = path[self._done]
            far = math.dist(self.position, goal)
            if far > left:
                if far > 0 and left > 0:
                    self.position = _towards(self.position, goal, left / far)
                return
            self.position, left = goal, left - far
            self._done += 1


def _towards(start: Point, goal: Point, part: float) -> Point:
    x, y, z = (a + (b - a) * part for a, b in zip(start, goal, strict=True))
    return (x, y, z)


# --- the library, where there is nothing in the way ---------------------------------------------


def _find_path(host: IdealHost, start: Any, goal: Any, obstacles: Any = ()) -> Any:
    return (tuple(start), tuple(goal))


def _path_from_task(host: IdealHost, first: Any, task: Any = None) -> Any:
    """Answer ``getPathFromTask(task)`` or ``getPathFromTask(start, task)``."""
    start, of = (host.position, first) if task is None else (first, task)
    return (tuple(start), tuple(of[0]))


def _paths_clear(host: IdealHost, one: Any, other: Any) -> bool:
    """Return whether two paths keep apart, sampled at half that distance."""
    ours, theirs = _samples(one), _samples(other)
    return all(math.dist(a, b) > APART_M / 2 for a in ours for b in theirs)


def _samples(path: Sequence[Any]) -> list[Point]:
    points = [point_of(one) for one in path]
    samples = points[:1]
    for a, b in pairwise(points):
        pieces = max(1, math.ceil(math.dist(a, b) / (APART_M / 4)))
        samples += [_towards(a, b, k / pieces) for k in range(1, pieces + 1)]
    return samples


_LIBRARY: dict[str, Any] = {
    "findPath": _find_path,
    "getPathFromTask": _path_from_task,
    "pathsClear": _paths_clear,
    "willCollide": lambda host, task: False,
}
