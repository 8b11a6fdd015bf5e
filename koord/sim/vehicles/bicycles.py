"""Cars as kinematic bicycles with limits; nothing is in their way. The level ``simple``.

For the middle of the rear axle: ẋ = v cos θ, ẏ = v sin θ, θ̇ = v tan φ / L (LaValle, Planning
Algorithms, 13.1.2.1). Speed and steering angle follow what is commanded at their limited rates.
"""

from __future__ import annotations

import numpy as np

from koord.runtime.motion.arrays import Floats, bounded
from koord.runtime.motion.bodies import Car
from koord.runtime.motion.geometry import wrapped
from koord.sim.vehicles.touching import Touched


class Bicycles:
    """Cars that do not meet anything. One entry for each car in every array."""

    def __init__(self, car: Car, start: Floats, heading_rad: Floats) -> None:
        """``start`` has shape ``(n, 3)``."""
        self.car = car
        self.position: Floats = start.copy()
        self.heading: Floats = heading_rad.copy()
        self.speed: Floats = np.zeros(len(start))
        self.steering: Floats = np.zeros(len(start))

    def touched(self, number: int) -> tuple[Touched, ...]:
        """What one of them touches: at this level nothing."""
        return ()

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Go on for some steps with commanded speeds and steering angles, shape ``(n, 2)``."""
        for _ in range(steps):
            self.actuate(command, dt_s)
            turn = self.turning()
            course = self.heading + turn * (dt_s / 2)
            self.position[:, 0] += dt_s * self.speed * np.cos(course)
            self.position[:, 1] += dt_s * self.speed * np.sin(course)
            self.heading += dt_s * turn
        self.heading = wrapped(self.heading)

    def turning(self) -> Floats:
        """How fast the cars turn, rad/s."""
        rate: Floats = self.speed * np.tan(self.steering) / self.car.wheelbase_m
        return rate

    def actuate(self, command: Floats, dt_s: float) -> None:
        """Speed and steering angle a step later, within the limits."""
        car = self.car
        wanted = bounded(command[:, 0], -car.speed_mps, car.speed_mps)
        most = car.accel_mps2 * dt_s
        self.speed = self.speed + bounded(wanted - self.speed, -most, most)
        turned = bounded(command[:, 1], -car.steering_rad, car.steering_rad)
        most = car.steering_rate_radps * dt_s
        self.steering = self.steering + bounded(turned - self.steering, -most, most)
