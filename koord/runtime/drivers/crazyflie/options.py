"""The options of Crazyflies in configurations."""

from __future__ import annotations

import math
import re
from typing import Annotated, Literal

from msgspec import Meta, Struct

Positive = Annotated[float, Meta(gt=0, le=1e6)]

_URI = re.compile(
    r"radio://\w+/\d{1,3}/(250K|1M|2M)(/[0-9A-Fa-f]{1,10})?(\?rate_limit=\d+)?"
    r"|usb://\d+|(udp|tcp)://[^:/\s]+:\d{1,5}"
)


class CrazyflieOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How a Crazyflie is reached, and what it is like."""

    #: radio://DONGLE/CHANNEL/RATE/ADDRESS, usb://NUMBER, udp://HOST:PORT, tcp://HOST:PORT
    uri: str
    #: m, where in the world the origin of its own estimate is; `start`: where the configuration
    #: places the robot
    origin: tuple[float, float, float] | Literal["start"] = (0.0, 0.0, 0.0)
    takeoff_height: Positive = 0.5  #: m above the ground of the world, before it follows ways
    climb: Positive = 0.4  #: m/s, at which it rises
    sink: Positive = 0.3  #: m/s, at which it lands
    battery: tuple[float, float] = (3.0, 4.1)  #: V, of a battery that is empty, and of a full one
    spread: Positive = (
        0.2  #: m, standard deviation of its own estimate above which it does not count
    )
    reset: bool = True  #: begin with a new estimate, as after it was switched on
    connect: Positive = 20.0  #: s, for which it is waited for at the start
    link: Positive = 1.0  #: s, greatest age of what it tells
    telemetry: Annotated[float, Meta(ge=5, le=100)] = 50.0  #: poses a second
    cache: str | None = None  #: a folder for its tables of contents, so that it connects sooner

    def __post_init__(self) -> None:
        if not _URI.fullmatch(self.uri):
            raise ValueError(
                f"`{self.uri}` is no address of a Crazyflie: write one like"
                " radio://0/80/2M/E7E7E7E7E7, usb://0 or udp://127.0.0.1:19850"
            )
        if self.origin != "start" and not all(map(math.isfinite, self.origin)):
            raise ValueError("`origin` has to be three numbers, in metres")
        empty_v, full_v = self.battery
        if not 0 < empty_v < full_v < math.inf:
            raise ValueError("`battery` has to be two voltages, the lower one first")
