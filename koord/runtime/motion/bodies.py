"""Bodies as data: how large a robot is and what it can do. Sources: specs/decisions/0015."""

from __future__ import annotations

import math
from typing import TypeAlias

from msgspec import Struct


class Car(Struct, frozen=True):
    """A car of the size of the F1/10 and RACECAR platforms (paper, VI-A).

    Its position is the middle of its rear axle, as in those platforms: that point goes where the
    car points, so a path of positions says where the car points as well.
    """

    length_m: float = 0.58
    width_m: float = 0.31
    wheelbase_m: float = 0.33
    mass_kg: float = 3.5
    steering_rad: float = 0.4189  #: the furthest that the wheels turn, to either side
    steering_rate_radps: float = 3.2
    speed_mps: float = 2.0  #: the fastest it can go, either way
    accel_mps2: float = 2.5
    cruise_mps: float = 0.8
    cruise_accel_mps2: float = 1.2

    @property
    def middle_m(self) -> float:
        """From the position forward to the middle of the car."""
        return self.wheelbase_m / 2

    @property
    def turning_m(self) -> float:
        """The radius of the tightest circle that the position can describe."""
        return self.wheelbase_m / math.tan(self.steering_rad)

    @property
    def radius_m(self) -> float:
        """Of the disc about the position that covers the car."""
        return math.hypot(self.length_m / 2 + self.middle_m, self.width_m / 2)


class Drone(Struct, frozen=True):
    """A quadrotor with a footprint of 40 × 40 cm (paper, VI-A)."""

    radius_m: float = 0.29
    mass_kg: float = 1.2
    inertia_kgm2: tuple[float, float, float] = (0.012, 0.012, 0.022)
    thrust_ratio: float = 2.0  #: the greatest thrust, as a multiple of its weight
    tilt_rad: float = 0.5  #: the furthest that its controller tilts it
    torque_nm: tuple[float, float, float] = (0.6, 0.6, 0.15)
    drag_kgps: float = 0.25  #: force per speed against the air
    rotor_lag_s: float = 0.04
    speed_mps: float = 3.0
    accel_mps2: float = 4.0
    cruise_mps: float = 1.0
    cruise_accel_mps2: float = 1.2
    above_ground_m: float = 0.1  #: goals lower than this are on the ground


class Ideal(Struct, frozen=True):
    """A point that goes exactly where it is told, at one speed."""

    radius_m: float = 0.2
    cruise_mps: float = 1.0


Body: TypeAlias = Car | Drone | Ideal
