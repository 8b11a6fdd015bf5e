"""The interface of drivers: what moves a robot, and tells where it is.

A driver is found by its name among the entry points ``koord.drivers`` (:mod:`.registry`). It never
blocks: it is asked at each tick, and answers with the latest that it knows. (P-DRIVER)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, runtime_checkable

from msgspec import Struct

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.setpoints import Capabilities, Sensed, Setpoint
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.world import Point, World


class DriverError(Exception):
    """Raised where a driver cannot do what it is asked for, with a cure."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class NoOptions(Struct, frozen=True, forbid_unknown_fields=True):
    """The options of a driver that has none."""


class Device(Struct, frozen=True):
    """What a driver is told of its vehicle."""

    pid: int
    vehicle: Vehicle  #: as the configuration describes it
    world: World
    position_m: Point  #: where it begins, if the configuration says so, or the run's seed
    heading_rad: float = 0.0
    seed: int = 0
    options: Any = NoOptions()  #: the driver's own

    @property
    def body(self) -> Body:
        return self.vehicle.body


class DriverType(Protocol):
    """What makes the drivers of one name: a class of drivers, or a function with these facts."""

    #: The form of options in configurations: a struct that refuses unknown fields.
    OPTIONS: ClassVar[type[Struct]]

    def __call__(self, device: Device) -> Driver:
        """Make the driver of a device; nothing is opened yet. Raises DriverError."""
        ...


@runtime_checkable
class Addressed(Protocol):
    """A driver type that knows by what its vehicles are reached, before anything is opened."""

    def address(self, device: Device) -> tuple[str, bool]:
        """What tells a vehicle to move: no other robot may have the same. Raises DriverError.

        False beside it: on another computer it may be another vehicle's.
        """
        ...


class Driver(Protocol):
    """The driver of one vehicle. Who inherits from it may leave out what has an answer here."""

    capabilities: Capabilities

    def open(self, now_s: float) -> None:
        """Connect to the vehicle and wait until it tells where it is; nothing moves.

        Nothing else waits. Raises DriverError.
        """

    def sense(self, now_s: float) -> Sensed | None:
        """The latest of what is known; None: nothing was heard yet."""

    def command(self, setpoint: Setpoint, now_s: float) -> None:
        """Pass a set-point on, without waiting for anything."""

    def ports(self) -> Mapping[str, Any]:
        """The latest readings of sensors of the program's own modules, by the ports' names."""
        return {}

    def act(self, port: str, value: Any) -> None:
        """Pass the value of an actuator of the program's own modules on."""
        return

    @property
    def remarks(self) -> tuple[str, ...]:
        """What people should know by now: why the vehicle does not do what it is told."""
        return ()

    def close(self) -> None:
        """Let go of the vehicle, which was told to hold, land or disarm before."""
