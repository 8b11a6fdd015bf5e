"""What vehicles on wheels have in common: kinematics, hulls, and joints for MuJoCo."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.geometry import wrapped
from koord.runtime.motion.planning import Touched
from koord.runtime.motion.world import Point
from koord.sim.vehicles import mjcf

if TYPE_CHECKING:
    from koord.sim.vehicles.physics import Arena


class Rolling(ABC):
    """Vehicles on wheels that go where they point, with nothing in their way.

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
        """Go on for some steps with commands, shape ``(n, 2)``."""
        for _ in range(steps):
            self.actuate(command, dt_s)
            turn = self.turning()
            course = self.heading + turn * (dt_s / 2)
            self.position[:, 0] += dt_s * self.speed * np.cos(course)
            self.position[:, 1] += dt_s * self.speed * np.sin(course)
            self.heading += dt_s * turn
        self.heading = wrapped(self.heading)

    def touched(self, number: int) -> tuple[Touched, ...]:
        """What one of them touches: at this level nothing."""
        return ()

    @abstractmethod
    def take(self, speed: Floats, turn: Floats) -> None:
        """Go on from the speeds and the rates of turning that contact has left."""

    @abstractmethod
    def actuate(self, command: Floats, dt_s: float) -> None:
        """Speeds a step later, within the limits."""

    @abstractmethod
    def turning(self) -> Floats:
        """How fast they turn, rad/s."""

    @abstractmethod
    def described(self, name: str, at: Point, heading_rad: float) -> mjcf.Described:
        """One of them for MuJoCo; its motors are called by its name and theirs."""

    @abstractmethod
    def controls(self) -> Floats:
        """What their motors are told, shape ``(n, motors)``."""


class Hull(Struct, frozen=True):
    """The body of a vehicle in the plane: a rectangle, or a disc of that length."""

    mass_kg: float
    length_m: float
    width_m: float
    middle_m: float = 0.0  #: from the position forward to its middle
    is_disc: bool = False

    @property
    def inertia_kgm2(self) -> float:
        """About the vertical, of a body that is as dense everywhere."""
        if self.is_disc:
            return self.mass_kg * self.length_m**2 / 8
        return self.mass_kg * (self.length_m**2 + self.width_m**2) / 12


class PhysicalWheels:
    """Vehicles of one device whose wheels MuJoCo turns. Arrays have a row for each."""

    flies = False

    def __init__(self, told: Rolling, arena: Arena) -> None:
        """``told`` stand where the vehicles do, and are told what they are."""
        self.position: Floats = told.position.copy()
        self.heading: Floats = told.heading.copy()
        self.speed: Floats = np.zeros(len(told.heading))
        # What motors are told changes as fast as it does where nothing is in the way.
        self._told, self._arena = told, arena
        self._command: Floats = np.zeros((len(told.heading), 2))
        self.names = arena.join(self, told.NAME, len(told.heading))

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Go on for some steps with commands, shape ``(n, 2)``."""
        self._command = command
        self._arena.advance(self, dt_s, steps)

    def touched(self, number: int) -> tuple[Touched, ...]:
        """What one of them touches."""
        return self._arena.touched(self.names[number])

    def described(self) -> Iterator[mjcf.Described]:
        for name, at, heading_rad in zip(self.names, self.position, self.heading, strict=True):
            yield self._told.described(name, at.tolist(), float(heading_rad))

    def settle(self, model: Any, data: Any) -> None:
        self._qpos, self._qvel = mjcf.coordinates(model, self.names)
        self._motors = np.array(
            [
                [model.actuator(f"{name} {one}").id for one in self._told.MOTORS]
                for name in self.names
            ]
        )

    def act(self, data: Any, dt_s: float) -> None:
        self._told.actuate(self._command, dt_s)
        data.ctrl[self._motors] = self._told.controls()

    def look(self, data: Any) -> None:
        q = data.qpos[self._qpos[:, None] + np.arange(7)]
        v = data.qvel[self._qvel[:, None] + np.arange(2)]
        w, x, y, z = q[:, 3:].T
        self.heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        self.position = q[:, :3].copy()
        self.speed = np.cos(self.heading) * v[:, 0] + np.sin(self.heading) * v[:, 1]
