"""How a simulated Crazyflie is set up, and the states that it can be in."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from koord.testing.autopilot.airframe import Handling, Vector


class State(Enum):
    """The states of the supervisor."""

    CHECKS_FAIL = "pre-flight checks not passed"
    CHECKS_PASS = "pre-flight checks passed"
    READY = "ready to fly"
    FLYING = "flying"
    LANDED = "landed"
    LEVEL_OUT = "warning, level out"
    LOCKED = "locked"


class Settings(Struct, frozen=True):
    """A simulated Crazyflie, as it is set up."""

    start_m: Vector = (
        0.0,
        0.0,
        0.0,
    )  #: east, north, up of its frame; it stands on the ground there
    yaw_rad: float = 0.0  #: counter-clockwise from east
    arms_itself: bool = True  #: as a Crazyflie 2.1 does; others wait for a request
    tumbled: bool = False  #: it does not lie as it should: it refuses to arm
    wants_poses: bool = False  #: it has no positioning of its own
    forgets: tuple[str, ...] = ()  #: log variables that an old firmware has not got
    battery: float = 1.0
    drain_per_s: float = 0.0
    handling: Handling = Handling(speed_mps=2.0)
