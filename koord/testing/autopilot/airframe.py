"""The body of a simulated aircraft: a point with limited acceleration, which tilts as it must.

All of it is north, east, down, as an autopilot has it: nothing here knows koord's frames.
"""

from __future__ import annotations

import math

from msgspec import Struct

Vector = tuple[float, float, float]

GRAVITY_MPS2 = 9.81

_STILL: Vector = (0.0, 0.0, 0.0)


class Target(Struct, frozen=True):
    """What the position controller is to reach."""

    position_m: Vector | None
    velocity_mps: Vector = _STILL
    acceleration_mps2: Vector = _STILL
    yaw_rad: float | None = None
    yaw_rate_radps: float = 0.0


class Handling(Struct, frozen=True):
    """How the aircraft flies."""

    position_gain: float = 1.5  #: per s
    velocity_gain: float = 4.0  #: per s
    lag_s: float = 0.08  #: until it has the tilt that it needs
    speed_mps: float = 3.0
    acceleration_mps2: float = 5.0
    yaw_rate_radps: float = 1.5


class Airframe:
    """An aircraft in the air or on level ground."""

    def __init__(self, position_m: Vector, yaw_rad: float, handling: Handling) -> None:
        """Stand on the ground at a position, which is NED of the local origin."""
        self.position_m, self.velocity_mps, self.yaw_rad = position_m, _STILL, yaw_rad
        self.handling = handling
        self.ground_m = position_m[2]  #: down
        self._acceleration: Vector = _STILL

    @property
    def height_m(self) -> float:
        """Above the ground."""
        return self.ground_m - self.position_m[2]

    def step(self, target: Target | None, dt_s: float) -> None:
        """Fly for a moment; without a target its motors are off."""
        if target is None:
            self._acceleration = (0.0, 0.0, GRAVITY_MPS2) if self.height_m > 0 else _STILL
        else:
            share = min(1.0, dt_s / self.handling.lag_s)
            wanted = self._wanted(target)
            self._acceleration = _plus(
                _scaled(self._acceleration, 1 - share), _scaled(wanted, share)
            )
            self._turn(target, dt_s)
        self.velocity_mps = _plus(self.velocity_mps, _scaled(self._acceleration, dt_s))
        self.position_m = _plus(self.position_m, _scaled(self.velocity_mps, dt_s))
        x, y, z = self.position_m
        if z >= self.ground_m:
            rises = min(self.velocity_mps[2], 0.0)
            self.position_m = (x, y, self.ground_m)
            self.velocity_mps = (0.0, 0.0, rises)
            self._acceleration = (0.0, 0.0, min(self._acceleration[2], 0.0))

    def _wanted(self, target: Target) -> Vector:
        """The acceleration that the controllers ask for."""
        handling = self.handling
        velocity = target.velocity_mps
        if target.position_m is not None:
            gap = _minus(target.position_m, self.position_m)
            velocity = _plus(velocity, _scaled(gap, handling.position_gain))
        gap = _minus(_limited(velocity, handling.speed_mps), self.velocity_mps)
        wanted = _plus(target.acceleration_mps2, _scaled(gap, handling.velocity_gain))
        return _limited(wanted, handling.acceleration_mps2)

    def _turn(self, target: Target, dt_s: float) -> None:
        most = self.handling.yaw_rate_radps * dt_s
        turn = target.yaw_rate_radps * dt_s
        if target.yaw_rad is not None:
            turn = math.remainder(target.yaw_rad - self.yaw_rad, math.tau)
        self.yaw_rad = math.remainder(self.yaw_rad + max(-most, min(most, turn)), math.tau)

    @property
    def attitude(self) -> tuple[float, float, float, float]:
        """The quaternion wxyz from FRD to NED: the thrust goes along the body's axis."""
        x, y, z = _minus(self._acceleration, (0.0, 0.0, GRAVITY_MPS2))
        size = math.sqrt(x * x + y * y + z * z)
        if size < 1e-6:
            x, y, z, size = 0.0, 0.0, -1.0, 1.0
        # Yaw about down first, and then the tilt that turns down into the thrust's opposite.
        down = (-x / size, -y / size, -z / size)
        w = math.sqrt(max(0.0, (1 + down[2]) / 2)) or 1e-9
        tilt = (w, -down[1] / (2 * w), down[0] / (2 * w), 0.0)
        half = self.yaw_rad / 2
        return product(tilt, (math.cos(half), 0.0, 0.0, math.sin(half)))


def product(
    p: tuple[float, float, float, float], q: tuple[float, float, float, float]
) -> tuple[float, float, float, float]:
    """The quaternion wxyz that turns by ``q`` first and by ``p`` then."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _scaled(vector: Vector, factor: float) -> Vector:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def _limited(vector: Vector, most: float) -> Vector:
    size = math.hypot(*vector)
    return vector if size <= most else _scaled(vector, most / size)
