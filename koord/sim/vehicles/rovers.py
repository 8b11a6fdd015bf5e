"""Robots with a differential drive: two wheels side by side, alone, in contact, or in MuJoCo.

For the middle of the axle: ẋ = v cos θ, ẏ = v sin θ, θ̇ = (r − l) / b with v = (l + r) / 2, for
wheels of the speeds l and r at the distance b (LaValle, Planning Algorithms, 13.1.2.2). Speeds of
wheels follow what is commanded with limited acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from koord.runtime.motion.angles import Numbers, greater, lesser
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import DifferentialDrive
from koord.runtime.motion.world import Point
from koord.sim.vehicles import mjcf
from koord.sim.vehicles.wheels import Rolling

#: In front of the axle and behind it stands a ball that rolls any way, so large, so far from it.
_BALL_M, _BALL_AT = 0.03, 0.7


class Differentials(Rolling):
    """The kinematic model of differential drives, without contact."""

    NAME: ClassVar[str] = "rover"
    MOTORS: ClassVar[tuple[str, ...]] = ("left", "right")

    def __init__(self, body: DifferentialDrive, start: Floats, heading_rad: Floats) -> None:
        """``start`` has shape ``(n, 3)``."""
        super().__init__(start, heading_rad)
        self.body = body
        self.wheels: Floats = np.zeros((len(start), 2))  #: speeds, left ones first

    def take(self, speed: Floats, turn: Floats) -> None:
        self.wheels = np.column_stack(wheels(self.body, speed, turn))
        self.speed = speed

    def actuate(self, command: Floats, dt_s: float) -> None:
        self.wheels = np.column_stack(
            actuated(self.body, dt_s, list(command.T), list(self.wheels.T))
        )
        self.speed, _ = speed_and_turn(self.body, list(self.wheels.T))

    def turning(self) -> Floats:
        rate: Floats = speed_and_turn(self.body, list(self.wheels.T))[1]
        return rate

    def described(self, name: str, at: Point, heading_rad: float) -> mjcf.Described:
        """The MJCF of a robot. Its frame lies on the ground below the middle of its axle."""
        body = self.body
        mass_kg = body.mass_kg - 2 * mjcf.WHEEL_KG
        parts = [*mjcf.chassis(name, at, heading_rad, mass_kg, body.outline_m, is_disc=True)]
        motors = []
        for side, sign in (("left", 1), ("right", -1)):
            parts += mjcf.wheel(f"{name} {side}", 0.0, sign * body.track_m / 2)
            on = f'joint="{name} {side}"'
            motors.append(
                mjcf.engine(f"{name} {side}", on, body.mass_kg / 2, body.wheel_accel_mps2)
            )
        parts += (mjcf.ball(sign * _BALL_AT * body.radius_m, _BALL_M) for sign in (1, -1))
        return mjcf.Described([*parts, "</body>"], [], motors)

    def controls(self) -> Floats:
        """The rates at which the wheels turn."""
        rates: Floats = self.wheels / mjcf.WHEEL_M
        return rates


# Of arrays, or of lanes of machine code, the same to the last bit; left wheels come first.


def wheels(body: DifferentialDrive, speed: Numbers, turn: Numbers) -> list[Numbers]:
    """The speeds of wheels at a speed of the middle of the axle, and a rate of turning."""
    aside = turn * body.track_m / 2
    return [speed - aside, speed + aside]


def actuated(
    body: DifferentialDrive, dt_s: Numbers, command: Sequence[Numbers], now: Sequence[Numbers]
) -> list[Numbers]:
    """The speeds of wheels after a step, as near to commands as their acceleration allows."""
    most = body.wheel_accel_mps2 * dt_s
    found = []
    for told, speed in zip(command, now, strict=True):
        wanted = lesser(greater(told, -body.wheel_mps), body.wheel_mps)
        found.append(speed + lesser(greater(wanted - speed, -most), most))
    return found


def speed_and_turn(body: DifferentialDrive, now: Sequence[Numbers]) -> tuple[Numbers, Numbers]:
    """The speed of the middle of the axle, and the rate of turning in rad/s."""
    left, right = now
    return (left + right) / 2, (right - left) / body.track_m
