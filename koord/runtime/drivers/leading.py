"""Where an aircraft is led, tick by tick, whose autopilot follows positions and velocities."""

from __future__ import annotations

import math
from typing import assert_never

from msgspec import Struct

from koord.runtime.drivers.setpoints import Hold, Land, Position, Takeoff, Track, Velocity
from koord.runtime.motion.world import Point

#: It is told to stay where it comes to a stop with this.
_BRAKING_MPS2 = 2.0

#: What is led along goes ahead of the vehicle by no more.
_LEAD_M = 0.5

#: Who was told nothing for longer is not led on by more.
_MOST_S = 0.2

_STILL: Point = (0.0, 0.0, 0.0)

#: What aircraft may be told to do in the air.
Flight = Hold | Velocity | Position | Track | Takeoff | Land


class Target(Struct, frozen=True):
    """What an autopilot is to reach by now, in the world. None: what it likes."""

    position_m: Point | None
    velocity_mps: Point = _STILL
    acceleration_mps2: Point | None = None
    heading_rad: float | None = None
    yaw_rate_radps: float | None = None


class Leader:
    """Leads an aircraft through what is wished."""

    def __init__(self, ground_m: float, climb_mps: float) -> None:
        self._ground_m, self._climb_mps = ground_m, climb_mps
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
    ) -> Target:
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
                return Target(position, velocity, acceleration, flight.heading_rad)
            case Velocity(velocity_mps=velocity, yaw_rate_radps=rate):
                self._aim = None
                return Target(None, velocity, yaw_rate_radps=rate)
            case Position(position_m=position, heading_rad=heading, speed_mps=speed):
                velocity = self._lead(position, speed, lasts_s, here)
                return Target(self._aim, velocity, heading_rad=heading)
            case Takeoff(height_m=height):
                velocity = self._rise(height, lasts_s, here)
                return Target(self._aim, velocity)
            case Hold() | Land():
                if on_ground:
                    self._aim = here
                return Target(self._aim)
            case _:
                assert_never(flight)

    def _rise(self, height_m: float, lasts_s: float, here: Point | None) -> Point:
        if self._aim is None:
            return _STILL
        x, y, _ = self._aim
        return self._lead((x, y, self._ground_m + height_m), self._climb_mps, lasts_s, here)

    def _lead(self, goal: Point, speed_mps: float, lasts_s: float, here: Point | None) -> Point:
        """Let the aim go on towards a goal; return at which velocity it does."""
        if self._aim is None or here is None:
            return _STILL
        far_m = math.dist(self._aim, goal)
        step_m = speed_mps * lasts_s
        if far_m <= step_m:
            self._aim = goal
            return _STILL
        direction = _scaled(between(self._aim, goal), 1 / far_m)
        ahead = _plus(self._aim, _scaled(direction, step_m))
        if math.dist(ahead, here) <= max(_LEAD_M, math.dist(self._aim, here)):
            self._aim = ahead
        return _scaled(direction, speed_mps)


def between(start: Point, end: Point) -> Point:
    """The way from one point to another."""
    return end[0] - start[0], end[1] - start[1], end[2] - start[2]


def _stopping(here: Point, velocity_mps: Point) -> Point:
    """Where a vehicle stands that brakes."""
    speed_mps = math.hypot(*velocity_mps)
    return _plus(here, _scaled(velocity_mps, speed_mps / (2 * _BRAKING_MPS2)))


def _plus(a: Point, b: Point) -> Point:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(vector: Point, factor: float) -> Point:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor
