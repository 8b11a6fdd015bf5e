"""From set-points to messages of ROS: velocities, steering, and positions."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NoReturn

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.frames import in_body, to_xyzw, turned, yaw_of
from koord.runtime.drivers.ros.graph import Fields, Sender
from koord.runtime.drivers.ros.poses import Fix
from koord.runtime.drivers.setpoints import (
    Arm,
    Disarm,
    Drive,
    Hold,
    Land,
    Position,
    Setpoint,
    Takeoff,
    Track,
    Velocity,
)
from koord.runtime.motion.bodies import Body, Car
from koord.runtime.motion.world import Point

#: The frame of commands to what drives.
BASE = "base_link"

#: Aircraft that are told velocities rise and sink at these speeds, and go to places in proportion
#: to how far these are, per s, at no more than so much of their cruising speed.
_RISING_MPS, SINKING_MPS, _APPROACH, _FASTEST = 0.5, 0.4, 1.0, 1.5

#: Whoever is not higher above the ground is on it, in m.
_LANDED_M = 0.1

#: A way-point that stays as it is is said again after so long, for nodes that start late, in s.
_AGAIN_S = 1.0

_NOWHERE: Point = (0.0, 0.0, 0.0)


class Commander(ABC):
    """What tells a vehicle its set-points, on one topic."""

    WISHES: ClassVar[tuple[type[Any], ...]]

    def __init__(self, sender: Sender, body: Body, ground_m: float) -> None:
        self.sender, self.body, self.ground_m = sender, body, ground_m

    @abstractmethod
    def command(self, setpoint: Setpoint, fix: Fix, now_s: float) -> None:
        """Tell a set-point. Raises DriverError for one that this vehicle does not understand."""

    def stop(self) -> None:
        """The last words: come to a stop."""
        return

    @property
    def aim(self) -> Point | None:
        """Where the vehicle was sent last, if it is told positions."""
        return None

    def refuse(self, setpoint: Setpoint) -> NoReturn:
        """Say that a set-point is none of this vehicle's, after it has been stopped."""
        self.stop()
        raise DriverError(
            f"a vehicle that hears `{self.sender.wire.told}` is told {type(setpoint).__name__}",
            f"it understands {', '.join(wish.__name__ for wish in self.WISHES)} and Hold",
        )


class Wheels(Commander):
    """Commands to what drives: Twist, TwistStamped or AckermannDriveStamped, in its own frame.

    Whatever is no wish to move is a velocity of zero, said anew each time. (P-ROS-STOP)
    """

    WISHES = (Drive, Velocity)

    def __init__(self, sender: Sender, body: Body, ground_m: float) -> None:
        super().__init__(sender, body, ground_m)
        self._steering_rad = 0.0

    def command(self, setpoint: Setpoint, fix: Fix, now_s: float) -> None:
        match setpoint:
            case Drive(speed_mps=speed, yaw_rate_radps=rate, steering_rad=steering):
                self._say(speed, rate, steering)
            case Velocity(velocity_mps=velocity, yaw_rate_radps=rate):
                self._say(in_body(fix.attitude, velocity)[0], rate, None)
            case Hold() | Land() | Arm() | Disarm():
                self.stop()
            case _:
                self.refuse(setpoint)

    def stop(self) -> None:
        self._say(0.0, 0.0, self._steering_rad)

    def _say(self, speed: float, rate: float, steering: float | None) -> None:
        twist = {"linear": {"x": speed}, "angular": {"z": rate}}
        match self.sender.wire.type_name:
            case "Twist":
                self.sender.send(twist)
            case "TwistStamped":
                self.sender.send({"header": header(BASE), "twist": twist})
            case _:
                if steering is not None:
                    self._steering_rad = steering
                elif speed and isinstance(self.body, Car):
                    self._steering_rad = math.atan(rate * self.body.wheelbase_m / speed)
                drive = {"steering_angle": self._steering_rad, "speed": speed}
                self.sender.send({"header": header(BASE), "drive": drive})


class Wings(Commander):
    """Velocities of what flies: TwistStamped in that of poses, or Twist in its own. (P-ROS-AIR)"""

    WISHES = (Velocity, Position, Track, Takeoff)

    def command(self, setpoint: Setpoint, fix: Fix, now_s: float) -> None:
        height_m = fix.position_m[2] - self.ground_m
        rate = 0.0
        match setpoint:
            case Velocity(velocity_mps=velocity, yaw_rate_radps=rate):
                pass
            case Track(position_m=position, velocity_mps=ahead, heading_rad=heading):
                velocity = self._towards(position, fix, ahead)
                rate = _turn(heading, fix)
            case Position(position_m=position, speed_mps=speed, heading_rad=heading):
                velocity = _limited(self._towards(position, fix), speed)
                rate = _turn(heading, fix)
            case Takeoff(height_m=to_m):
                rising = max(-SINKING_MPS, min(_RISING_MPS, _APPROACH * (to_m - height_m)))
                velocity = (0.0, 0.0, rising)
            case Land():
                velocity = (0.0, 0.0, -SINKING_MPS)
            case Disarm() if height_m > _LANDED_M:
                velocity = (0.0, 0.0, -SINKING_MPS)
            case _:
                velocity = _NOWHERE
        self._say(velocity, rate, fix)

    def stop(self) -> None:
        self._say(_NOWHERE, 0.0, None)

    def _towards(self, position: Point, fix: Fix, ahead: Point = _NOWHERE) -> Point:
        x, y, z = (
            v + _APPROACH * (to - at)
            for v, to, at in zip(ahead, position, fix.position_m, strict=True)
        )
        return _limited((x, y, z), _FASTEST * self.body.pace.cruise_mps)

    def _say(self, velocity: Point, rate: float, fix: Fix | None) -> None:
        turn = {"z": rate}
        if self.sender.wire.type_name == "TwistStamped":
            top = header(BASE if fix is None else fix.frame)
            twist = {"linear": _xyz(velocity), "angular": turn}
            self.sender.send({"header": top, "twist": twist})
        else:
            own = velocity if fix is None else in_body(fix.attitude, velocity)
            self.sender.send({"linear": _xyz(own), "angular": turn})


class Targets(Commander):
    """Positions that the vehicle's own controller goes to: a stream of them, or way-points.

    A way-point is said when it changes, and again now and then. Nothing is said before the first
    wish. What flies cannot be disarmed in this way: it is told to be on the ground. (P-ROS-AIR)
    """

    WISHES = (Position, Track, Takeoff)

    def __init__(
        self,
        sender: Sender,
        body: Body,
        ground_m: float,
        *,
        streams: bool,
        frame: str | None = None,
    ) -> None:
        """Positions are in ``frame``; None: in that of poses."""
        super().__init__(sender, body, ground_m)
        self._streams, self._frame = streams, frame
        self._aim: Point | None = None
        self._yaw_rad = 0.0
        self._last: Setpoint | None = None
        self._said_at_s = -math.inf

    def command(self, setpoint: Setpoint, fix: Fix, now_s: float) -> None:
        if isinstance(setpoint, Drive | Velocity):
            self._stay(Hold(), fix)
            self._say(fix, now_s)
            self.refuse(setpoint)
        if self._aim is None and isinstance(setpoint, Hold | Land | Arm | Disarm):
            return
        before = self._aim
        match setpoint:
            case (
                Position(position_m=aim, heading_rad=heading)
                | Track(position_m=aim, heading_rad=heading)
            ):
                self._aim = aim
                if heading is not None:
                    self._yaw_rad = heading
                elif type(setpoint) is not type(self._last):
                    self._yaw_rad = yaw_of(fix.attitude)
            case _:
                self._stay(setpoint, fix)
        self._last = setpoint
        if self._streams or self._aim != before or now_s - self._said_at_s >= _AGAIN_S:
            self._say(fix, now_s)

    def _stay(self, setpoint: Setpoint, fix: Fix) -> None:
        """Aim at where it was when it was first told so, or at what lies above or below."""
        x, y, z = fix.position_m
        if self._aim is not None and type(setpoint) is type(self._last):
            x, y, z = self._aim
        elif self._aim is None or not isinstance(self._last, Hold | Land | Takeoff | Arm | Disarm):
            self._yaw_rad = yaw_of(fix.attitude)
        match setpoint:
            case Takeoff(height_m=height):
                z = self.ground_m + height
            case Land() | Disarm() if not self.body.ON_GROUND:
                z = self.ground_m
            case _:
                pass
        self._aim = x, y, z

    def _say(self, fix: Fix, now_s: float) -> None:
        assert self._aim is not None
        turn = dict(zip("xyzw", to_xyzw(turned(self._yaw_rad)), strict=True))
        pose = {"position": _xyz(self._aim), "orientation": turn}
        frame = fix.frame if self._frame is None else self._frame
        self.sender.send({"header": header(frame), "pose": pose})
        self._said_at_s = now_s

    @property
    def aim(self) -> Point | None:
        return self._aim


def header(frame: str) -> Fields:
    """The header of a message of now, by the clock of the wall as all nodes have it."""
    now_ns = time.time_ns()
    stamp = {"sec": now_ns // 10**9, "nanosec": now_ns % 10**9}
    return {"stamp": stamp, "frame_id": frame}


def _xyz(vector: Point) -> Fields:
    return dict(zip("xyz", map(float, vector), strict=True))


def _limited(velocity: Point, speed_mps: float) -> Point:
    size = math.hypot(*velocity)
    if size <= speed_mps:
        return velocity
    x, y, z = (v * speed_mps / size for v in velocity)
    return x, y, z


def _turn(heading_rad: float | None, fix: Fix) -> float:
    """The yaw rate that turns to a heading, if one is wished for."""
    if heading_rad is None:
        return 0.0
    return _APPROACH * math.remainder(heading_rad - yaw_of(fix.attitude), math.tau)
