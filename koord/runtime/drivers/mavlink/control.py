"""From set-points to those of autopilots: SET_POSITION_TARGET_LOCAL_NED."""

from __future__ import annotations

import math
from typing import assert_never

from koord.runtime.drivers.frames import heading_to_ned, ned_to_enu
from koord.runtime.drivers.mavlink.library import Message, mavlink
from koord.runtime.drivers.mavlink.options import MavlinkOptions
from koord.runtime.drivers.setpoints import Hold, Land, Position, Takeoff, Track, Velocity
from koord.runtime.motion.world import Point

#: It is told to stay where it comes to a stop with this.
_BRAKING_MPS2 = 2.0

#: What is led along goes ahead of the vehicle by no more.
_LEAD_M = 0.5

#: Who was told nothing for longer is not led on by more.
_MOST_S = 0.2

_STILL: Point = (0.0, 0.0, 0.0)

_NO_POSITION = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)
_NO_ACCELERATION = (
    mavlink.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AZ_IGNORE
)
_NO_YAW = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
_NO_YAW_RATE = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE


#: What aircraft may be told to do in the air.
Flight = Hold | Velocity | Position | Track | Takeoff | Land


class Control:
    """What an autopilot is told at a tick, to do what is wished."""

    def __init__(self, options: MavlinkOptions, origin_m: Point, ground_m: float) -> None:
        self._options, self._origin_m, self._ground_m = options, origin_m, ground_m
        self._flight: Flight = Land()
        self._aim: Point | None = None  #: where it is to be; None: its position is not known
        self._now_s = -math.inf

    def target(
        self,
        flight: Flight,
        here: Point | None,
        velocity_mps: Point,
        now_s: float,
        *,
        on_ground: bool,
    ) -> Message:
        """What to tell a vehicle that is here and moves like this."""
        lasts_s = min(max(now_s - self._now_s, 0.0), _MOST_S)
        if self._aim is None or type(flight) is not type(self._flight):
            self._aim = here
            if here is not None and isinstance(flight, Hold):
                self._aim = _stopping(here, velocity_mps)
        self._flight, self._now_s = flight, now_s
        match flight:
            case Track(position_m=position, velocity_mps=velocity, acceleration_mps2=acceleration):
                self._aim = position
                return self._message(velocity, acceleration, heading_rad=flight.heading_rad)
            case Velocity(velocity_mps=velocity, yaw_rate_radps=rate):
                self._aim = None
                return self._message(velocity, None, yaw_rate_radps=rate)
            case Position(position_m=position, heading_rad=heading, speed_mps=speed):
                velocity = self._lead(position, speed, lasts_s, here)
                return self._message(velocity, None, heading_rad=heading)
            case Takeoff(height_m=height):
                return self._message(self._rise(height, lasts_s, here), None)
            case Hold() | Land():
                if on_ground:
                    self._aim = here
                return self._message(_STILL, None)
            case _:
                assert_never(flight)

    def above_start_m(self, wish: Takeoff, here: Point | None) -> float:
        """The height of a take-off, from where it stands."""
        stands_m = self._ground_m if here is None else here[2]
        return self._ground_m + wish.height_m - stands_m

    def _rise(self, height_m: float, lasts_s: float, here: Point | None) -> Point:
        if self._aim is None:
            return _STILL
        x, y, _ = self._aim
        goal = (x, y, self._ground_m + height_m)
        return self._lead(goal, self._options.climb, lasts_s, here)

    def _lead(self, goal: Point, speed_mps: float, lasts_s: float, here: Point | None) -> Point:
        """Let the aim go on towards a goal; return at which velocity it does."""
        if self._aim is None or here is None:
            return _STILL
        far_m = math.dist(self._aim, goal)
        step_m = speed_mps * lasts_s
        if far_m <= step_m:
            self._aim = goal
            return _STILL
        direction = _scaled(_between(self._aim, goal), 1 / far_m)
        ahead = _plus(self._aim, _scaled(direction, step_m))
        if math.dist(ahead, here) <= max(_LEAD_M, math.dist(self._aim, here)):
            self._aim = ahead
        return _scaled(direction, speed_mps)

    def _message(
        self,
        velocity_mps: Point,
        acceleration_mps2: Point | None,
        *,
        heading_rad: float | None = None,
        yaw_rate_radps: float | None = None,
    ) -> Message:
        mask = 0
        mask |= _NO_POSITION if self._aim is None else 0
        mask |= _NO_ACCELERATION if acceleration_mps2 is None else 0
        mask |= _NO_YAW if heading_rad is None else 0
        mask |= _NO_YAW_RATE if yaw_rate_radps is None else 0
        position = _STILL if self._aim is None else _between(self._origin_m, self._aim)
        return mavlink.MAVLink_set_position_target_local_ned_message(
            int(self._now_s * 1000) % 2**32,
            self._options.system,
            mavlink.MAV_COMP_ID_AUTOPILOT1,
            mavlink.MAV_FRAME_LOCAL_NED,
            mask,
            *ned_to_enu(position),
            *ned_to_enu(velocity_mps),
            *ned_to_enu(acceleration_mps2 or _STILL),
            0.0 if heading_rad is None else heading_to_ned(heading_rad),
            0.0 if yaw_rate_radps is None else -yaw_rate_radps,
        )


def _stopping(here: Point, velocity_mps: Point) -> Point:
    """Where a vehicle stands that brakes."""
    speed_mps = math.hypot(*velocity_mps)
    return _plus(here, _scaled(velocity_mps, speed_mps / (2 * _BRAKING_MPS2)))


def _between(start: Point, end: Point) -> Point:
    return end[0] - start[0], end[1] - start[1], end[2] - start[2]


def _plus(a: Point, b: Point) -> Point:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(vector: Point, factor: float) -> Point:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor
