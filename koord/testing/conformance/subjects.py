"""What the suite is run on: a driver, its options and its vehicle."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import msgspec
from msgspec import Struct

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, Driver, DriverType
from koord.runtime.drivers.registry import DRIVERS, Registry, options_of
from koord.runtime.guardian.limits import SafetyLimits, usual
from koord.runtime.motion.bodies import VEHICLES, Body
from koord.runtime.motion.world import Point, World

#: The fastest that a vehicle is led.
_TEST_MPS = 0.4


class Subject(Struct, frozen=True, dict=True):
    """A driver that is to be tested, as a configuration would name it."""

    target: str  #: what makes it, as ``module:object``
    options: bytes = b"{}"  #: of the driver, as JSON
    vehicle: str = "DIFF"  #: its type, as configurations name it
    at_m: Point = (0.0, 0.0, 0.0)  #: where it stands
    heading_rad: float = 0.0
    knows_start: bool = False  #: it does stand there, and has to say so
    room_m: float = 4.0  #: so far around it, and up, it may go
    arms: bool = False  #: people have said that it may move
    is_virtual: bool = False  #: the vehicle is in this process, and moves by the times it is told
    opens_within_s: float = 30.0
    pid: int = 0
    name: str = ""  #: of the driver, if configurations can name it

    @cached_property
    def made(self) -> DriverType:
        """What makes the driver. Raises DriverError."""
        return Registry(DRIVERS, {}, "").load(self.target)

    def driver(self, more: dict[str, Any] | None = None) -> Driver:
        """Make the driver, with some more options. Raises DriverError."""
        given = self.options
        if more:
            given = msgspec.json.encode({**msgspec.json.decode(given), **more})
        device = Device(
            self.pid,
            Vehicle("kit", self.vehicle),
            self.world,
            self.at_m,
            self.heading_rad,
            options=options_of(self.made, given),
        )
        return self.made(device)

    @property
    def world(self) -> World:
        """The room about the vehicle. It stands on the ground."""
        (x, y, z), r = self.at_m, self.room_m
        return World((x - r, y - r, z), (x + r, y + r, z + max(r, 3.0)))

    @property
    def body(self) -> Body:
        return VEHICLES[self.vehicle].body

    @property
    def limits(self) -> SafetyLimits:
        return usual(self.body)

    @property
    def flies(self) -> bool:
        return not self.body.ON_GROUND and not self.body.IS_EXACT

    @property
    def speed_mps(self) -> float:
        """At which it is led."""
        return min(_TEST_MPS, self.body.pace.cruise_mps)

    @property
    def turn_m(self) -> float:
        """The radius of the turns that it is led."""
        return max(0.4, 1.3 * self.body.turning_m)

    @property
    def stops_within_s(self) -> float:
        """How long it takes to stop at most, from the set-point on."""
        limits = self.limits
        return limits.reaction_s + self.speed_mps / limits.braking_mps2

    @property
    def stops_within_m(self) -> float:
        """How far it goes until it stops, from the set-point on."""
        limits, v = self.limits, self.speed_mps
        return v * limits.reaction_s + v * v / (2 * limits.braking_mps2)


def flat(point: Point) -> Point:
    """A vector without its height."""
    return point[0], point[1], 0.0


def minus(a: Point, b: Point) -> Point:
    """From the one to the other."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def angle(a: Point, b: Point) -> float:
    """The angle between two directions in the plane, in degrees."""
    turned = math.atan2(a[1], a[0]) - math.atan2(b[1], b[0])
    return abs(math.degrees(math.remainder(turned, math.tau)))
