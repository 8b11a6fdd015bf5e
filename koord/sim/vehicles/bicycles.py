"""Cars: kinematic bicycles with limits, alone, in contact, or on wheels of MuJoCo.

For the middle of the rear axle: ẋ = v cos θ, ẏ = v sin θ, θ̇ = v tan φ / L (LaValle, Planning
Algorithms, 13.1.2.1). Speed and steering angle follow what is commanded at their limited rates.
Wheels of level ``mujoco`` are those of the F1TENTH vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from koord.runtime.motion.angles import Numbers, greater, lesser, tangent
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car
from koord.runtime.motion.world import Point
from koord.sim.vehicles import mjcf
from koord.sim.vehicles.wheels import Rolling

#: The servos that turn the front wheels, N m per rad.
_SERVO_NM = 5.0


class Bicycles(Rolling):
    """The kinematic model of cars, without contact."""

    NAME: ClassVar[str] = "car"
    MOTORS: ClassVar[tuple[str, ...]] = ("engine", "left", "right")

    def __init__(self, car: Car, start: Floats, heading_rad: Floats) -> None:
        """``start`` has shape ``(n, 3)``."""
        super().__init__(start, heading_rad)
        self.car = car
        self.steering: Floats = np.zeros(len(start))

    def take(self, speed: Floats, turn: Floats) -> None:
        self.speed = speed

    def turning(self) -> Floats:
        rate: Floats = bends(self.car, self.speed, self.steering)
        return rate

    def actuate(self, command: Floats, dt_s: float) -> None:
        self.speed, self.steering = actuated(
            self.car, dt_s, list(command.T), self.speed, self.steering
        )

    def described(self, name: str, at: Point, heading_rad: float) -> mjcf.Described:
        """The MJCF of a car. Its frame lies on the ground below the middle of its rear axle."""
        car = self.car
        mass_kg = car.mass_kg - 4 * mjcf.WHEEL_KG
        body = [*mjcf.chassis(name, at, heading_rad, mass_kg, car.outline_m)]
        for axle, x in (("rear", 0.0), ("front", car.wheelbase_m)):
            for side, sign in (("left", 1), ("right", -1)):
                y = sign * track_m(car) / 2
                body += mjcf.wheel(f"{name} {axle} {side}", x, y, steers=axle == "front")
        body.append("</body>")
        # The rear wheels are behind a differential: the engine turns both, in the mean.
        halves = (f'<joint joint="{name} rear {side}" coef="0.5"/>' for side in ("left", "right"))
        tendon = f'<fixed name="{name} axle">{"".join(halves)}</fixed>'
        engine = mjcf.engine(f"{name} engine", f'tendon="{name} axle"', car.mass_kg, car.accel_mps2)
        servos = [
            f'<position name="{name} {side}" joint="{name} front {side} steering" '
            f'kp="{_SERVO_NM}" dampratio="1"/>'
            for side in ("left", "right")
        ]
        return mjcf.Described(body, [tendon], [engine, *servos])

    def controls(self) -> Floats:
        """The speed of the engine, and the angles of the left and the right front wheel."""
        car, bend = self.car, np.tan(self.steering) / self.car.wheelbase_m
        # Both front wheels point along circles about one point (Ackermann).
        angles = [
            np.arctan2(car.wheelbase_m * bend, 1.0 - aside * track_m(car) * bend)
            for aside in (0.5, -0.5)
        ]
        return np.column_stack([self.speed / mjcf.WHEEL_M, *angles])


# Of arrays, or of lanes of machine code, the same to the last bit.


def actuated(
    car: Car, dt_s: Numbers, command: Sequence[Numbers], speed: Numbers, steering: Numbers
) -> tuple[Numbers, Numbers]:
    """The speeds and steering angles after a step, as near to commands as the rates allow."""
    wanted = _within(command[0], car.speed_mps)
    turned = _within(command[1], car.steering_rad)
    return (
        speed + _within(wanted - speed, car.accel_mps2 * dt_s),
        steering + _within(turned - steering, car.steering_rate_radps * dt_s),
    )


def bends(car: Car, speed: Numbers, steering: Numbers) -> Numbers:
    """The yaw rates in rad/s."""
    return speed * tangent(steering) / car.wheelbase_m


def _within(values: Numbers, most: Numbers) -> Numbers:
    return lesser(greater(values, -most), most)


def track_m(car: Car) -> float:
    """The track in metres: the distance between the middles of the wheels of an axle."""
    return car.width_m - mjcf.TYRE_M
