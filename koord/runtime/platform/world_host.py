"""The world as the host of compiled programs: sensors, actuators and library.

An actuator counts as an order when its value changes; the last that changed counts. What the
sensors are read of, and who carries orders out, subclasses say: a simulated fleet, or the driver of
a vehicle.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from random import Random
from typing import Any

from koord.runtime.drivers.frames import turned
from koord.runtime.drivers.setpoints import Sensed
from koord.runtime.lazily import Lazily
from koord.runtime.motion.library import Library, occupied
from koord.runtime.motion.world import Point, World
from koord.runtime.plain_functions import FUNCTIONS
from koord.runtime.platform.sensors import MotionSensors
from koord.runtime.plugins.calls import PlugInError
from koord.runtime.plugins.modules import ServedModules
from koord.runtime.ports import (
    DONE,
    GOALS,
    PLACES,
    TAKEOFF,
    YAW,
    is_place,
    is_set,
    is_task,
    placed,
    plain_name,
    point_of,
    port_name,
    shape_of,
    task_at,
)
from koord.runtime.robot import Key, Robot, Turn
from koord.runtime.shapes import (
    FLOAT,
    Array,
    Enumeration,
    Shape,
    default,
)
from koord.runtime.shapes import Sequence as ListOf

#: What programs ask for ways.
WAYS = frozenset({"findPath", "getPathFromTask"})

#: The functions that the simulated world answers.
ANSWERED = frozenset(
    {
        *WAYS,
        *FUNCTIONS,
        *("pathsClear", "onPath", "apart", "willCollide"),
        *("scanToMap", "pickFrontierPos", "findObs", "world"),
    }
)

#: What cells of a map are called where nothing is known of them, and where nothing stands.
_UNKNOWN, _FREE = "unknown", "free"


class WorldHost(ABC):
    """The host of robots with bodies in a world. All numbers are metres, radians and seconds."""

    def __init__(
        self,
        classes: Sequence[type[Robot]],
        kinds: Sequence[int],
        world: World,
        library: Library,
        seed: int = 0,
    ) -> None:
        """Make a host of robots whose programs are ``classes[kinds[pid]]``."""
        self.kinds = tuple(kinds)
        self.modules: dict[int, ServedModules] = {}  #: of robots, that plug-ins serve (P-OWN)
        self.ignoring_height: frozenset[int] = frozenset()  #: they go below goals (P-PUBLISHED-CAR)
        self.library = library
        self._world = world
        self._reseed(seed)
        self.take_on(classes)
        self._sent: list[dict[str, Any]] = [{} for _ in kinds]
        self._walls = occupied(world) if world.obstacles else frozenset()

    def take_on(self, classes: Sequence[type[Robot]]) -> None:
        """Be the host of other programs for the same robots. [RELOAD]"""
        self.classes = tuple(classes)
        self.watches: tuple[type[Robot], ...] = ()  #: others that may ask the library
        self._goals = [list(_goals(one)) for one in self.classes]
        self._sensors = [
            [(name, one.PORTS[name], port_name(name)) for name in one.SENSORS]
            for one in self.classes
        ]

    def also_answer(self, program: type[Robot]) -> None:
        """Answer the functions of another program, in the shapes that it declares."""
        self.watches = (*self.watches, program)

    def reseed(self, seed: int) -> None:
        """Let all chance to come hang on another seed; what was drawn stays."""
        self._reseed(seed)
        self.library.reseed(seed)

    def _reseed(self, seed: int) -> None:
        self._draw = Lazily(len(self.kinds), lambda robot: Random(f"{seed} {robot}"))

    # --- what is sensed, and who moves ----------------------------------------------------------

    @abstractmethod
    def sensors(self, robot: int) -> MotionSensors:
        """What a robot knows of itself now."""

    @abstractmethod
    def scan(self, robot: int) -> tuple[Point, ...]:
        """What a robot's scanner sees now; nothing if it has none."""

    @abstractmethod
    def follow(self, robot: int, path: Sequence[Point]) -> None:
        """Let a robot follow a path; an empty one leaves it where it is."""

    @abstractmethod
    def take_off(self, robot: int, up: bool) -> None:
        """Let a robot that flies take off, or land; nothing to others. (P-TAKEOFF)"""

    @abstractmethod
    def go_to(self, robot: int, target: Point) -> None:
        """Let a robot find a path to a target and follow it."""

    def whereabouts(self, robot: int) -> tuple[Sensed, float]:
        """Where a robot is, for the modules that it has, and the time in s."""
        sensed = self.sensors(robot)
        return Sensed(sensed.psn, turned(sensed.heading_rad), (0.0, 0.0, 0.0), 0.0), 0.0

    def modules_fail(self, robot: int, troubles: Mapping[str, PlugInError]) -> None:
        """Take note of modules that fail now; none if all is well. Raises the first."""
        for error in troubles.values():
            raise error.of(robot)

    def served(self, robot: int) -> dict[str, Any]:
        """The readings of a robot's sensors that plug-ins serve, by the sensors' names."""
        modules = self.modules.get(robot)
        if modules is None:
            return {}
        sensed, now_s = self.whereabouts(robot)
        program = self.classes[self.kinds[robot]]
        readings = modules.read(program, len(self.kinds), sensed, now_s)
        self.modules_fail(robot, modules.troubles)
        return readings

    def order(self, robot: Robot) -> None:
        """Carry out what a robot's actuators say that they did not say before."""
        held, pid = vars(robot), robot.pid
        for name, is_way, is_takeoff in self._goals[robot.KIND]:
            value, before = held[name], self._sent[pid].get(name)
            if not self._is_new(pid, name, value):
                continue
            if is_takeoff:
                if value or before:  # nobody has to land who was never told to take off
                    self.take_off(pid, bool(value))
            elif is_way:
                self.follow(pid, [self._goal(pid, p) for p in value if is_set(p)])
            elif is_set(value):
                self.go_to(pid, self._goal(pid, value))
        modules = self.modules.get(robot.pid)
        if modules is not None:
            modules.act(robot, self.whereabouts(robot.pid)[1])
            self.modules_fail(robot.pid, modules.troubles)

    def _is_new(self, robot: int, name: str, value: Any) -> bool:
        """Note what an actuator says; return whether it did not say so before."""
        sent = self._sent[robot]
        before = sent.get(name)
        if value is None or value is before or value == before:
            return False
        sent[name] = value
        return True

    def _goal(self, robot: int, place: Any) -> Point:
        """The point that a robot is sent to by a place."""
        x, y, z = point_of(place)
        return x, y, self._world.ground if robot in self.ignoring_height else z

    # --- the host of compiled robots ------------------------------------------------------------

    def start(self, robot: int | None, name: str) -> Any:
        """The start of a variable: the robot's position, the world's tasks, or a default. [INIT]"""
        program = self.classes[0 if robot is None else self.kinds[robot]]
        shape, robots = shape_of(program, name, shared=robot is None), len(self.kinds)
        if robot is not None and is_place(name):
            return placed(shape, self.sensors(robot).psn)
        if robot is not None and port_name(name) == YAW and shape == FLOAT:
            return self.sensors(robot).heading_rad
        if isinstance(shape, Array) and is_task(shape.element):
            tasks = (*self._world.tasks, *[None] * shape.size)
            return tuple(task_at(shape.element, tasks[k], robots) for k in range(shape.size))
        if robot is not None and robot in self.modules and name in self.modules[robot]:
            return self.served(robot).get(name, default(shape, robots))
        return default(shape, robots)

    def read(self, robot: Robot) -> Mapping[str, Any]:
        """The readings of a robot's sensors now. [ENV-FREE]"""
        sensed = self.sensors(robot.pid)
        readings: dict[str, Any] = {}
        for name, shape, port in self._sensors[self.kinds[robot.pid]]:
            match port:
                case _ if port in PLACES:
                    readings[name] = placed(shape, sensed.psn)
                case _ if port in DONE:
                    readings[name] = sensed.reached
                case _ if port == YAW and shape == FLOAT:
                    readings[name] = sensed.heading_rad
                case "planner":
                    readings[name] = sensed.planner.value
                case "pscan":
                    readings[name] = self.scan(robot.pid)
                case _ if getattr(robot, name) is None:
                    readings[name] = default(shape, robot.numAgents)
                case _:
                    pass
        return readings | self.served(robot.pid)

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        """Answer a call of the library, with real geometry. [EXTERNAL]"""
        library, clearance = self.library, self.library.clearance
        match plain_name(function), arguments:
            case name, _ if name in FUNCTIONS:
                return FUNCTIONS[name](*arguments)
            case "findPath", (start, goal):
                return library.find_path(robot, tuple(start), tuple(goal))
            case "findPath", (start, goal, obstacles):
                points = [point_of(p) for p in obstacles]
                return library.find_path_around(robot, tuple(start), tuple(goal), points)
            case "getPathFromTask", (task,):
                return library.path_from_task(robot, tuple(task[0]))
            case "getPathFromTask", (start, task):
                return library.find_path(robot, tuple(start), tuple(task[0]))
            case "pathsClear", (one, other):
                return clearance.paths_clear(one, other)
            case "onPath", (p, path):
                return clearance.on_path(p, path, clearance.resting_m)
            case "apart", (p, q):
                return clearance.apart(p, q)
            case "willCollide", (task,):
                return library.will_collide(robot, tuple(task[0]))
            case "scanToMap", (scan,):
                return _drawn(self._result(robot, function), library.scan_to_map(scan))
            case "pickFrontierPos", (known, near):
                return library.pick_frontier(robot, _known(known), point_of(near))
            case "findObs", (known,):
                return library.find_obstacles(_known(known))
            case "world", (int(cell),):
                return _cell(self._result(robot, function), cell in self._walls)
            case _:
                raise LookupError(function)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        """Choose a value between the bounds, by the robot's own generator. [CHOOSE]"""
        draw = self._draw[robot]
        return draw.uniform(low, high) if isinstance(low, float) else draw.randint(low, high)

    # --- inside ---------------------------------------------------------------------------------

    def _result(self, robot: int, function: str) -> Shape:
        """The shape of an answer; properties may call functions that robots do not."""
        for program in (self.classes[self.kinds[robot]], *self.watches):
            if function in program.EXTERNALS:
                return program.EXTERNALS[function]
        raise LookupError(function)


def asks_to_fly(program: type[Robot]) -> bool:
    """Return whether a program says when its robot is to take off."""
    return any(port_name(name) == TAKEOFF for name in program.PORTS if name not in program.SENSORS)


def _goals(one: type[Robot]) -> Iterator[tuple[str, bool, bool]]:
    """The actuators of a robot that move it; whether each has ways, and whether it takes off."""
    for name, shape in one.PORTS.items():
        if port_name(name) in (*GOALS, TAKEOFF) and name not in one.SENSORS:
            yield name, isinstance(shape, ListOf | Array), port_name(name) == TAKEOFF


def _drawn(shape: Shape, seen: Mapping[int, bool]) -> Any:
    """Convert a map to the program's form: cell to occupied, or the state of each cell."""
    if not isinstance(shape, Array):
        return dict(seen)
    cells = (seen.get(cell) for cell in range(shape.size))
    return tuple(_cell(shape.element, there) for there in cells)


def _cell(shape: Shape, there: bool | None) -> Any:
    """The state of a cell (None: unknown) as a Boolean, or as a member of an enumeration."""
    if not isinstance(shape, Enumeration):
        return bool(there)
    names = shape.members
    if there is None:
        return names.index(_UNKNOWN)
    if not there:
        return names.index(_FREE)
    return next(k for k, name in enumerate(names) if name not in (_UNKNOWN, _FREE))


def _known(cells: Any) -> dict[int, bool]:
    """The known cells of a program's map; of an enumeration, member 0 is unknown, 1 free."""
    if isinstance(cells, Mapping):
        return dict(cells)
    return {cell: state > 1 for cell, state in enumerate(cells) if state}
