"""What motion captures have in common: bodies by name, and axes that are not the world's."""

from __future__ import annotations

import math
from enum import Enum

from koord.runtime.configuration.forms import Positive
from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.frames import (
    Quaternion,
    attitude_from_y_up,
    product,
    rotated,
    turned,
    y_up_to_enu,
)
from koord.runtime.drivers.localiser import LocaliserOptions
from koord.runtime.motion.world import Point


class Up(Enum):
    """The axis of a motion capture that points up."""

    Y = "y"
    Z = "z"


class CaptureOptions(LocaliserOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The options of motion captures. (P-LOCATE-CAPTURE)"""

    body: str | None = None  #: its name; without: the device's. `{pid}` is the robot's
    up: Up = Up.Z
    origin: Point = (0.0, 0.0, 0.0)  #: m, where in the world the capture's origin is
    turn: float = 0.0  #: rad, the heading of the capture's x axis in the world
    ahead: float = 0.0  #: rad, the heading of the vehicle in the body's own axes
    silent: Positive = 0.5  #: s without its pose until people are told why

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.origin, self.turn, self.ahead))):
            raise ValueError("`origin`, `turn` and `ahead` have to be numbers")

    def body_of(self, device: Device) -> str:
        """The name of a device's body."""
        name = device.vehicle.name if self.body is None else self.body
        return name.replace("{pid}", str(device.pid))

    def position(self, seen_m: Point) -> Point:
        """A position of the capture, in the world."""
        level = y_up_to_enu(seen_m) if self.up is Up.Y else seen_m
        x, y, z = (
            a + b for a, b in zip(rotated(turned(self.turn), level), self.origin, strict=True)
        )
        return x, y, z

    def attitude(self, seen: Quaternion) -> Quaternion:
        """The attitude of the vehicle in the world, from that of its body in the capture."""
        level = attitude_from_y_up(seen) if self.up is Up.Y else seen
        return product(product(turned(self.turn), level), turned(self.ahead))
