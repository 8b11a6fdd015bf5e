"""The base of wheeled vehicles: motion without contact, and hulls."""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import hypot
from typing import ClassVar

import numpy as np
from msgspec import Struct

from koord.runtime.motion.angles import sine_cosine
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.geometry import wrapped
from koord.runtime.motion.planning import Touched
from koord.runtime.motion.world import Point
from koord.sim.vehicles import mjcf


class Rolling(ABC):
    """The kinematic model of wheeled vehicles that go where they point, without contact.

    All arrays have a row for each. Engines of contact ask them which velocity they strive for.
    """

    NAME: ClassVar[str]
    MOTORS: ClassVar[tuple[str, ...]]  #: as MuJoCo is told of them

    def __init__(self, start: Floats, heading_rad: Floats) -> None:
        """``start`` has shape ``(n, 3)``."""
        self.position: Floats = start.copy()
        self.heading: Floats = heading_rad.copy()
        self.speed: Floats = np.zeros(len(start))  #: along the heading

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Advance some steps under commands, shape ``(n, 2)``."""
        for _ in range(steps):
            self.actuate(command, dt_s)
            turn = self.turning()
            course = self.heading + turn * (dt_s / 2)
            sine, cosine = sine_cosine(course)
            self.position[:, 0] += dt_s * self.speed * cosine
            self.position[:, 1] += dt_s * self.speed * sine
            self.heading += dt_s * turn
        self.heading = wrapped(self.heading)

    def touched(self, number: int) -> tuple[Touched, ...]:
        """The contacts of a vehicle: none at this level."""
        return ()

    @abstractmethod
    def take(self, speed: Floats, turn: Floats) -> None:
        """Continue from the speeds and yaw rates that contact has left."""

    @abstractmethod
    def actuate(self, command: Floats, dt_s: float) -> None:
        """Update the speeds by a step, within the limits."""

    @abstractmethod
    def turning(self) -> Floats:
        """The yaw rates in rad/s."""

    @abstractmethod
    def described(self, name: str, at: Point, heading_rad: float) -> mjcf.Described:
        """The MJCF of a vehicle; its motors are named after it."""

    @abstractmethod
    def controls(self) -> Floats:
        """The commands of the motors, shape ``(n, motors)``."""


class Hull(Struct, frozen=True):
    """The body of a vehicle in the plane: a rectangle, or a disc of that length."""

    mass_kg: float
    length_m: float
    width_m: float
    middle_m: float = 0.0  #: from the position forward to its middle
    is_disc: bool = False

    @property
    def radius_m(self) -> float:
        """The radius of the circle about its middle that it stays within, however it turns."""
        return (self.length_m if self.is_disc else hypot(self.length_m, self.width_m)) / 2

    @property
    def inertia_kgm2(self) -> float:
        """The moment of inertia about the vertical, for uniform density."""
        if self.is_disc:
            return self.mass_kg * self.length_m**2 / 8
        return self.mass_kg * (self.length_m**2 + self.width_m**2) / 12
