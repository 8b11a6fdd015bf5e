"""What is said to the driver of a vehicle, and what it tells, as data.

SI units, ENU, z up, radians, quaternions wxyz, monotonic seconds: each driver converts from these
and to them.
"""

from __future__ import annotations

from msgspec import Struct

from koord.runtime.motion.world import Point


class Hold(Struct, frozen=True):
    """Come to a stop and stay there; what stands on the ground does not take off."""


class Velocity(Struct, frozen=True):
    """Move at a velocity until the next set-point."""

    velocity_mps: Point
    yaw_rate_radps: float = 0.0


class Position(Struct, frozen=True):
    """Go straight to a position and stay there. Without a heading any will do."""

    position_m: Point
    heading_rad: float | None
    speed_mps: float


class Drive(Struct, frozen=True):
    """Drive on the ground until the next set-point; backwards if the speed is negative."""

    speed_mps: float
    yaw_rate_radps: float = 0.0
    steering_rad: float | None = None  #: of the front wheels, for vehicles that have some


class Track(Struct, frozen=True):
    """Be at a position that moves on, at this velocity and acceleration."""

    position_m: Point
    velocity_mps: Point
    acceleration_mps2: Point = (0.0, 0.0, 0.0)
    heading_rad: float | None = None


class Takeoff(Struct, frozen=True):
    """Rise straight up to a height above the ground of the world."""

    height_m: float


class Land(Struct, frozen=True):
    """Come down where it is. Said again and again, also on the ground."""


class Disarm(Struct, frozen=True):
    """Take the power from motors or rotors; what is in the air falls."""


class Arm(Struct, frozen=True):
    """Give power to motors or rotors, and do not move yet."""


#: What motion may wish for. To arm and to disarm is for people and the guardian.
Wish = Hold | Velocity | Drive | Position | Track | Takeoff | Land

Setpoint = Wish | Arm | Disarm


class Sensed(Struct, frozen=True):
    """The latest that a driver knows of its vehicle. None: this vehicle does not tell."""

    position_m: Point
    attitude: tuple[float, float, float, float]  #: unit quaternion, wxyz
    velocity_mps: Point
    measured_at_s: float  #: when the pose was measured, monotonic
    battery: float | None = None  #: what is left, 0 to 1
    armed: bool | None = None
    airborne: bool | None = None
    link: bool = True  #: whether the vehicle answers and obeys


class Located(Struct, frozen=True):
    """The latest that a localiser knows of where a vehicle is."""

    position_m: Point
    attitude: tuple[float, float, float, float] | None  #: unit, wxyz; None: it does not tell
    measured_at_s: float  #: monotonic


class Stopper(Struct, frozen=True):
    """What a watchdog stops a vehicle with, in a process of its own. (P-WATCHDOG)

    ``target`` (``module:name``) makes, of ``arguments`` by name, an object with ``stop()``, which
    tells the vehicle once to stop and does not wait, and ``close()``. It is made before the vehicle
    moves, and connects then. It is asked to stop again and again, for ``for_s`` seconds after the
    robot has ended.
    """

    target: str
    arguments: bytes = b"{}"  #: as JSON
    for_s: float = 5.0


class Capabilities(Struct, frozen=True):
    """What a driver can do and tell, and what it asks of those who use it."""

    kinds: tuple[str, ...]  #: types of vehicle that it drives, as configurations name them
    wishes: tuple[type[Wish], ...]  #: set-points that it understands besides Hold, Arm and Disarm
    rate_hz: float  #: set-points a second that it needs
    pose_age_s: float  #: how old its poses usually are at most
    dead_man_s: float | None = None  #: the vehicle stops by itself after this long without any
    stopper: Stopper | None = None  #: else a watchdog does, if there is this
    tells_battery: bool = False
    tells_airborne: bool = False
    takeoff_height_m: float | None = None  #: it has to rise to this before it is led; None: never
