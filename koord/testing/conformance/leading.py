"""How vehicles are led along a line or a bend, by the set-points that their drivers understand."""

from __future__ import annotations

import math
from collections.abc import Callable

from msgspec import Struct

from koord.runtime.drivers.setpoints import (
    Capabilities,
    Drive,
    Position,
    Sensed,
    Setpoint,
    Takeoff,
    Track,
    Velocity,
)
from koord.runtime.motion.bodies import Body, Car
from koord.runtime.motion.world import Point
from koord.testing.conformance.findings import Skipped

Leading = Callable[[Sensed, float], Setpoint]

#: What leads a vehicle up or along a line.
_LEADS = "Drive, Track, Position or Velocity"


class Line(Struct, frozen=True):
    """A straight way: from a point, in a direction of the plane, so far and so fast."""

    start_m: Point
    direction: Point  #: a unit vector in the plane
    far_m: float
    speed_mps: float

    @property
    def end_m(self) -> Point:
        return self.at(self.far_m)

    @property
    def lasts_s(self) -> float:
        return self.far_m / self.speed_mps

    def at(self, far_m: float) -> Point:
        """The point on it that is so far from its start."""
        (x, y, z), (dx, dy, _) = self.start_m, self.direction
        return x + dx * far_m, y + dy * far_m, z


def steers(capabilities: Capabilities, body: Body) -> bool:
    """Return whether it is driven by speed and turn: it moves where it points."""
    return body.ON_GROUND and Drive in capabilities.wishes


def along(
    capabilities: Capabilities, body: Body, line: Line, begun_s: float, *, backwards: bool = False
) -> Leading:
    """Lead it along a line. What drives by speed and turn has to point along it."""
    wishes, speed = capabilities.wishes, line.speed_mps
    dx, dy, _ = line.direction
    if steers(capabilities, body):
        return lambda sensed, now_s: Drive(-speed if backwards else speed, 0.0, 0.0)
    if Track in wishes:

        def moved(sensed: Sensed, now_s: float) -> Setpoint:
            far_m = min(line.far_m, speed * (now_s - begun_s))
            moves = speed if far_m < line.far_m else 0.0
            return Track(line.at(far_m), (dx * moves, dy * moves, 0.0))

        return moved
    if Position in wishes:
        return lambda sensed, now_s: Position(line.end_m, None, speed)
    if Velocity in wishes:
        return lambda sensed, now_s: Velocity((dx * speed, dy * speed, 0.0))
    raise Skipped("it understands nothing that leads it", f"let it take {_LEADS}")


def turning(body: Body, speed_mps: float, radius_m: float) -> Drive:
    """Drive a bend to the left; backwards on the same circle if the speed is negative."""
    rate = speed_mps / radius_m
    steering = math.atan(body.wheelbase_m / radius_m) if isinstance(body, Car) else None
    return Drive(speed_mps, rate, steering)


def rising(capabilities: Capabilities, here: Point, height_m: float, ground_m: float) -> Leading:
    """Lead an aircraft up to a height above the ground."""
    (x, y, _), to_m = here, ground_m + height_m
    if Takeoff in capabilities.wishes:
        return lambda sensed, now_s: Takeoff(height_m)
    if Position in capabilities.wishes:
        return lambda sensed, now_s: Position((x, y, to_m), None, 0.5)
    if Track in capabilities.wishes:
        return lambda sensed, now_s: Track((x, y, to_m), (0.0, 0.0, 0.0))
    if Velocity in capabilities.wishes:
        return lambda sensed, now_s: Velocity((0.0, 0.0, 0.5 * (sensed.position_m[2] < to_m)))
    raise Skipped("it understands nothing that leads it up", f"let it take {_LEADS}")
