"""The options of MAVLink vehicles in configurations."""

from __future__ import annotations

import math
from enum import Enum
from typing import Annotated, Literal

from msgspec import Meta, Struct

Positive = Annotated[float, Meta(gt=0, le=1e6)]
SystemId = Annotated[int, Meta(ge=1, le=255)]


class AutopilotKind(Enum):
    """The autopilots that are known."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"


class Vision(Enum):
    """How an autopilot is told where a localiser says that it is."""

    NONE = "none"
    POSITION = "position"  #: VISION_POSITION_ESTIMATE
    ODOMETRY = "odometry"  #: ODOMETRY, with the velocity


#: Forms of connections, with what follows the first word.
_FORMS = {
    "udpin": "HOST:PORT",
    "udpout": "HOST:PORT",
    "serial": "DEVICE:BAUD",
}


class MavlinkOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How a vehicle is reached, and what its autopilot is like."""

    #: udpin:HOST:PORT (it sends there; a port for each vehicle), udpout:HOST:PORT (it listens
    #: there), or serial:DEVICE:BAUD
    connection: str
    autopilot: AutopilotKind = AutopilotKind.PX4
    system: SystemId = 1  #: the vehicle's
    ground_system: SystemId = 255  #: koord's; for ArduPilot's failsafe it has to be SYSID_MYGCS
    #: m, where in the world the autopilot's local frame has its origin; `start`: where the
    #: configuration places the robot
    origin: tuple[float, float, float] | Literal["start"] = (0.0, 0.0, 0.0)
    takeoff_height: Positive = 1.0  #: m above the ground of the world, before it follows ways
    climb: Positive = 0.5  #: m/s, at which it rises where koord leads it
    connect: Positive = 10.0  #: s, for which its pose is waited for at the start
    link: Positive = 3.0  #: s, greatest age of its heartbeat
    silence: Positive = 1.0  #: s, after which it acts by itself if koord falls silent
    vision: Vision = Vision.POSITION  #: with a localiser: what the autopilot is told of it
    agree: Positive = 0.5  #: m, by which its own estimate may differ from the localiser's
    telemetry: Annotated[float, Meta(ge=5, le=200)] = 30.0  #: poses a second that are asked for

    def __post_init__(self) -> None:
        word, _, rest = self.connection.partition(":")
        place, _, number = rest.rpartition(":")
        if word not in _FORMS or not place or not number.isdecimal():
            forms = ", ".join(f"{word}:{rest}" for word, rest in _FORMS.items())
            raise ValueError(f"`{self.connection}` is no connection: write one of {forms}")
        if word != "serial" and not int(number) <= 65535:
            raise ValueError(f"`{self.connection}`: there is no port {number}")
        if self.system == self.ground_system:
            raise ValueError("`system` and `ground_system` have to differ")
        if self.origin != "start" and not all(map(math.isfinite, self.origin)):
            raise ValueError("`origin` has to be three numbers, in metres")
