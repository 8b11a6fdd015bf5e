"""Robots with a differential drive: two wheels side by side, alone, in contact, or in MuJoCo.

For the middle of the axle: ẋ = v cos θ, ẏ = v sin θ, θ̇ = (r − l) / b with v = (l + r) / 2, for
wheels of the speeds l and r at the distance b (LaValle, Planning Algorithms, 13.1.2.2). Speeds of
wheels follow what is commanded with limited acceleration.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from koord.runtime.motion.arrays import Floats, bounded
from koord.runtime.motion.bodies import DifferentialDrive
from koord.runtime.motion.driving import Turning
from koord.runtime.motion.world import Point
from koord.sim.squads import SquadSetup, VehicleSetup, Wheeled, WheeledSquad, tracker, wheeled
from koord.sim.vehicles import mjcf
from koord.sim.vehicles.wheels import Hull, Rolling

#: In front of the axle and behind it stands a ball that rolls any way, so large, so far from it.
_BALL_M, _BALL_AT = 0.03, 0.7


def squad(setup: SquadSetup) -> WheeledSquad:
    """Make a squad of differential drives at rest."""
    law = tracker(setup, lambda: Turning(setup.group))
    return WheeledSquad(setup, vehicles(setup), law)


def vehicles(setup: VehicleSetup) -> Wheeled:
    """Make differential drives at rest; commands are the speeds of wheels, left ones first."""
    body = setup.model.body
    assert isinstance(body, DifferentialDrive)
    hull = Hull(body.mass_kg, *body.outline_m, is_disc=True)
    return wheeled(setup, Differentials(body, setup.start, setup.heading_rad), hull)


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
        aside = turn * self.body.track_m / 2
        self.wheels = np.column_stack([speed - aside, speed + aside])
        self.speed = speed

    def actuate(self, command: Floats, dt_s: float) -> None:
        body, most = self.body, self.body.wheel_accel_mps2 * dt_s
        wanted = bounded(command, -body.wheel_mps, body.wheel_mps)
        self.wheels = self.wheels + bounded(wanted - self.wheels, -most, most)
        self.speed = (self.wheels[:, 0] + self.wheels[:, 1]) / 2

    def turning(self) -> Floats:
        rate: Floats = (self.wheels[:, 1] - self.wheels[:, 0]) / self.body.track_m
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
