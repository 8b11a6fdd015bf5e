"""Pilots: the motion of one robot, from what it is told to what its driver is asked for.

A pilot has the motion automaton, the planner and the law of motion that a simulated squad has, for
one robot, and the same steps. (P-PILOT)
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import Struct, field

from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.setpoints import (
    Drive,
    Hold,
    Land,
    Position,
    Sensed,
    Takeoff,
    Track,
    Wish,
)
from koord.runtime.motion import automaton
from koord.runtime.motion.arrays import Floats, lengths
from koord.runtime.motion.automaton import Visit
from koord.runtime.motion.bodies import Body, Car, DifferentialDrive, PlannerName, Steering
from koord.runtime.motion.driving import PREDICTIVE_TICKS, Driving, Measured, Turning
from koord.runtime.motion.field import field as field_of
from koord.runtime.motion.flying import Flying
from koord.runtime.motion.geometry import as_path
from koord.runtime.motion.group import TAKEOFF_M, TICK_S, Group
from koord.runtime.motion.planners import planner
from koord.runtime.motion.planning import CLOSE, PlanningEffort, Room
from koord.runtime.motion.pursuit import Horizon
from koord.runtime.motion.world import Point, World
from koord.runtime.platform.asking import AskedPlanner
from koord.runtime.platform.rising import RISEN
from koord.runtime.platform.sensors import MotionSensors
from koord.runtime.plugins.calls import PlugIn, PlugInError
from koord.runtime.plugins.loading import own_driving
from koord.runtime.plugins.planning import CheckedPlanner

#: Who is lower than that has landed, if it does not say so itself.
_LANDED_M = 0.15

#: Who rises does not drift further.
_RISES_WITHIN_M = 0.5


class PilotSettings(Struct, frozen=True):
    """How a robot moves, as its configuration says."""

    body: Body
    planner: PlannerName | PlugIn
    steering: Steering = Steering.PREDICTIVE
    visit: Visit = field(default_factory=Visit)
    effort: PlanningEffort = field(default_factory=PlanningEffort)
    controller: PlugIn | None = None
    room: Room = CLOSE  #: what its ways keep from walls and obstacles (P-WAY)


class Pilot(ABC):
    """The pilot of a robot."""

    def __init__(self, settings: PilotSettings, world: World, seed: int = 0) -> None:
        """Make a pilot that has no orders. Raises KoordError for libraries that are missing."""
        self.settings = settings
        #: aircraft rise to this above the ground before they follow a way; None: they need not
        self.takeoff_height_m: float | None = None
        body = settings.body
        made = planner(settings.planner, world, body, settings.effort, room=settings.room)
        self.planner = made
        if isinstance(made, CheckedPlanner):
            made.forgives = True
        #: what a program asks for ways; while it thinks, ways to targets have to wait (P-PLAN)
        self.asked = AskedPlanner(made)
        #: plug-ins that fail, by what they are for; while there are some, the robot stays
        self.troubles: dict[str, str] = {}
        self.group = Group(1, body, world, made, settings.visit, [seed], settings.room)

    def wish(self, sensed: Sensed, now_s: float) -> Wish:
        """What the vehicle should do until the next tick, from where it is."""
        position = np.array([sensed.position_m])
        heading = np.array([yaw_of(sensed.attitude)])
        if not self.asked.is_busy:
            self.group.plan(self._origin(position), heading)
        self.group.update(position, now_s)
        return self._law(position, heading, sensed)

    def follow(self, path: Sequence[Point], sensed: Sensed) -> None:
        """Follow a path; an empty one leaves the robot where it is."""
        position = np.array(sensed.position_m)
        self.group.follow(0, as_path(path), yaw_of(sensed.attitude), position)

    def go_to(self, target: Point) -> None:
        """Find a path to a target and follow it."""
        self.group.go_to(0, target)

    def hold(self) -> None:
        """Stay until released."""
        self.group.hold(0)

    def release(self) -> None:
        """Go on with what holding interrupted."""
        self.group.release(0)

    def sensors(self, sensed: Sensed) -> MotionSensors:
        """What the robot's program reads."""
        group = self.group
        gap = lengths(np.array([sensed.position_m]) - group.routes.end)[0] - group.visit.epsilon_m
        return MotionSensors(
            sensed.position_m,
            yaw_of(sensed.attitude),
            bool(group.automata.reached[0]),
            self.settings.planner,
            group.state(0),
            group.plights.get(0),
            max(float(gap), 0.0),
        )

    def wait_for_takeoff(self) -> None:  # noqa: B027
        """Stay on the ground until told to take off; what drives does that anyway."""

    def take_off(self, up: bool) -> None:  # noqa: B027
        """Take off, or land; what drives does nothing."""

    @property
    def path(self) -> tuple[Point, ...]:
        """The path that the robot follows."""
        return tuple(map(_point, self.group.path(0)))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What people should know: which plug-ins fail."""
        failed = self.planner.trouble if isinstance(self.planner, CheckedPlanner) else None
        return (*((failed,) if failed is not None else ()), *self.troubles.values())

    @property
    def is_under_way(self) -> bool:
        """True if the robot has somewhere to go."""
        return bool(automaton.moves(self.group.automata)[0])

    def _origin(self, position: Floats) -> Floats:
        """Where new paths begin, shape ``(1, 3)``."""
        return position

    @abstractmethod
    def _law(self, position: Floats, heading: Floats, sensed: Sensed) -> Wish:
        """Apply the law of motion."""


class CarPilot(Pilot):
    """The pilot of a car, with pursuit or model-predictive control."""

    def __init__(self, settings: PilotSettings, world: World, seed: int = 0) -> None:
        super().__init__(settings, world, seed)
        self._every = PREDICTIVE_TICKS if settings.steering is Steering.PREDICTIVE else 1
        self._driving = Driving(self.group, settings.steering, Horizon(step_s=self._every * TICK_S))
        self._ticks = 0
        self._wish: Wish = Hold()

    def _law(self, position: Floats, heading: Floats, sensed: Sensed) -> Wish:
        if self._ticks % self._every == 0:
            measured = Measured(position, heading, _speed(heading, sensed))
            speed, steering = self._driving.command(measured, self._every * TICK_S)[0].tolist()
            car = self._driving.car
            self._wish = Drive(speed, speed * np.tan(steering) / car.wheelbase_m, steering)
            self.group.replan(np.flatnonzero(self._driving.legs.missed).tolist())
        self._ticks += 1
        return self._wish


class OwnPilot(Pilot):
    """The pilot of what drives, with a controller of a lab's own. (P-OWN)"""

    def __init__(
        self, settings: PilotSettings, controller: PlugIn, world: World, seed: int = 0
    ) -> None:
        super().__init__(settings, world, seed)
        self._driving = own_driving(controller, self.group)

    def _law(self, position: Floats, heading: Floats, sensed: Sensed) -> Wish:
        measured = Measured(position, heading, _speed(heading, sensed))
        try:
            speed, rate = self._driving.drives(measured, TICK_S)[0].tolist()
        except PlugInError as error:
            self.troubles["controller"] = error.told
            return Hold()
        self.troubles.pop("controller", None)
        self.group.replan(np.flatnonzero(self._driving.legs.missed).tolist())
        body = self.group.body
        if not isinstance(body, Car):
            return Drive(speed, rate)
        steering = math.atan(rate * body.wheelbase_m / speed) if abs(speed) > 1e-3 else None
        return Drive(speed, rate, steering)


class TurningPilot(Pilot):
    """The pilot of a robot with a differential drive."""

    def __init__(self, settings: PilotSettings, world: World, seed: int = 0) -> None:
        super().__init__(settings, world, seed)
        self._turning = Turning(self.group)

    def _law(self, position: Floats, heading: Floats, sensed: Sensed) -> Wish:
        measured = Measured(position, heading, _speed(heading, sensed))
        left, right = self._turning.command(measured, TICK_S)[0].tolist()
        self.group.replan(np.flatnonzero(self._turning.legs.missed).tolist())
        return Drive((left + right) / 2, (right - left) / self._turning.body.track_m)


class SendingPilot(Pilot):
    """The pilot of a vehicle that goes to places by itself: it is sent along its way.

    It is sent to the next point of it that is not near. How it goes there is its own matter, so
    ways of cars are followed as well as its controller does. (P-ROS-STOP)
    """

    def __init__(self, settings: PilotSettings, world: World, seed: int = 0) -> None:
        super().__init__(settings, world, seed)
        self._given = 0  #: which of the paths that it was given it follows
        self._next = 0

    def _law(self, position: Floats, heading: Floats, sensed: Sensed) -> Wish:
        if not self.is_under_way:
            return Hold()
        given, path = int(self.group.routes.given[0]), self.group.path(0)
        if given != self._given:
            self._given, self._next = given, 0
        near_m, last = self.group.visit.epsilon_m, len(path) - 1
        while self._next < last and lengths(path[self._next] - position)[0] <= near_m:
            self._next += 1
        return Position(_point(path[self._next]), None, self.group.body.pace.cruise_mps)


class FlyingPilot(Pilot):
    """The pilot of a robot that can move in every direction. (P-TAKEOFF)"""

    def __init__(self, settings: PilotSettings, world: World, seed: int = 0) -> None:
        super().__init__(settings, world, seed)
        self._flying: Flying | None = None  #: once it is known where the robot is
        self._field = field_of(world, flat=False)
        self._has_risen = False
        self._after_takeoff: Sequence[Point] | None = None  #: the path that it was told to follow
        self._may_fly = True
        self._has_a_way = False  #: it was sent somewhere, or asked to fly

    def wait_for_takeoff(self) -> None:
        self._may_fly = False
        if self.takeoff_height_m is None:
            self.takeoff_height_m = TAKEOFF_M

    def take_off(self, up: bool) -> None:
        self._may_fly = self._has_a_way = up

    def wish(self, sensed: Sensed, now_s: float) -> Wish:
        if not self._may_fly:
            return self._on_ground(sensed)
        if self.takeoff_height_m is not None:
            self._watch_height(sensed, self.takeoff_height_m)
            if not self._has_risen:
                self.settle(sensed)
                self.group.update(np.array([sensed.position_m]), now_s)  # ways are found up there
                return Takeoff(self.takeoff_height_m) if self._has_a_way else Hold()
        return super().wish(sensed, now_s)

    def follow(self, path: Sequence[Point], sensed: Sensed) -> None:
        far_m = math.dist(path[-1], sensed.position_m) if path else 0.0
        self._has_a_way = len(path) > 1 or far_m > self.group.visit.epsilon_m
        rises_first = self.takeoff_height_m is not None and not self._has_risen
        self._after_takeoff = path if rises_first else None
        super().follow(path, sensed)

    def go_to(self, target: Point) -> None:
        self._has_a_way = True
        self._after_takeoff = None
        super().go_to(target)

    def _on_ground(self, sensed: Sensed) -> Wish:
        """Stay on the ground, or come down."""
        self._has_risen = False
        self.settle(sensed)
        return Hold() if self._is_down(sensed) else Land()

    def _above_ground_m(self, sensed: Sensed) -> float:
        return sensed.position_m[2] - self._field.world.ground

    def _is_down(self, sensed: Sensed) -> bool:
        if sensed.airborne is None:
            return self._above_ground_m(sensed) < _LANDED_M
        return not sensed.airborne

    def _watch_height(self, sensed: Sensed, height_m: float) -> None:
        """Notice that it has risen, and that it is on the ground again."""
        if not self._has_risen:
            is_high = self._above_ground_m(sensed) >= RISEN * height_m
            self._has_risen = sensed.airborne is not False and is_high
            if self._has_risen and self._after_takeoff is not None:
                self._join(self._after_takeoff, sensed)
        elif self._is_down(sensed):
            self._has_risen = False

    def _join(self, path: Sequence[Point], sensed: Sensed) -> None:
        """Follow a path that was made for where the robot stood, from above there."""
        x, y, _ = here = sensed.position_m
        if len(path) > 1 and math.dist(path[0][:2], (x, y)) < _RISES_WITHIN_M:
            path = path[1:]
        reach_m = max(self.group.body.radius_m, self.settings.room.least_m)
        if path and not self._field.path_free(as_path([here, *path]), reach_m):
            self.go_to(path[-1])
        else:
            self.follow(path, sensed)

    def _law(self, position: Floats, heading: Floats, sensed: Sensed) -> Wish:
        if self._flying is None:
            self._flying = Flying(self.group, position, waits=not self.group.body.IS_EXACT)
        to = self._flying.command(position, TICK_S)
        x, y, z = _point(to.position[0])
        # Its way begins where it is measured to be, which on the ground may be a little below it.
        place = x, y, max(z, self._field.world.ground)
        return Track(place, _point(to.velocity[0]), _point(to.acceleration[0]))

    def _origin(self, position: Floats) -> Floats:
        return position if self._flying is None else self._flying.origin(position)

    def settle(self, sensed: Sensed) -> None:
        """Take where the robot is for where it is to be: it was moved by other means."""
        self._flying = None


def pilot(
    settings: PilotSettings,
    world: World,
    seed: int = 0,
    wishes: tuple[type[Any], ...] = (Drive, Track),
) -> Pilot:
    """The pilot of a body, whose driver understands such wishes.

    Raises KoordError for libraries that are missing.
    """
    if settings.body.ON_GROUND and Drive not in wishes:
        return SendingPilot(settings, world, seed)
    if settings.controller is not None:
        return OwnPilot(settings, settings.controller, world, seed)
    match settings.body:
        case Car():
            return CarPilot(settings, world, seed)
        case DifferentialDrive():
            return TurningPilot(settings, world, seed)
        case _:
            return FlyingPilot(settings, world, seed)


def _speed(heading: Floats, sensed: Sensed) -> Floats:
    """The speed along the heading, shape ``(1,)``."""
    x, y, _ = sensed.velocity_mps
    speed: Floats = x * np.cos(heading) + y * np.sin(heading)
    return speed


def _point(row: Floats) -> Point:
    x, y, z = row.tolist()
    return x, y, z
