"""Controllers of a lab's own: how vehicles on the ground follow their ways."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from msgspec import Struct

from koord.runtime.drivers.setpoints import Drive
from koord.runtime.motion import automaton
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Body, Car, DifferentialDrive
from koord.runtime.motion.driving import Legs, Measured
from koord.runtime.motion.group import Group
from koord.runtime.motion.routes import Routes
from koord.runtime.motion.world import Point
from koord.runtime.plugins.calls import Guarded, PlugInError

#: How long it may take for a step.
_LIMIT_S = 0.2


class ControllerSite(Struct, frozen=True):
    """What a controller controls."""

    body: Body
    options: Any  #: its own


class Steered(Struct, frozen=True):
    """A vehicle on its way, as its controller sees it at a step."""

    position_m: Point
    heading_rad: float
    speed_mps: float  #: negative: backwards
    limit_mps: float  #: the greatest speed here, by bends and by what is left of the leg
    left_m: float  #: of the leg, at whose end it is to stand
    backwards: bool  #: the leg is driven backwards
    dt_s: float  #: until the next step
    _routes: Routes
    _row: int
    _s: float

    def ahead(self, far_m: float) -> Point:
        """The point of the way that lies so far ahead; the end of the leg, if that is nearer."""
        s = min(self._s + far_m, self._s + self.left_m - 1e-9)
        spot = self._routes.at(np.array([self._row]), np.array([s]))
        x, y, z = spot.position[0].tolist()
        return x, y, z


class OwnController(Protocol):
    """The controller of one vehicle."""

    def step(self, vehicle: Steered) -> Drive:
        """The speed (negative: backwards) and the yaw rate until the next step."""
        ...


class OwnControllerType(Protocol):
    """What makes the controllers of one name: a class, or a function with its options' form."""

    OPTIONS: ClassVar[type[Struct]]

    def __call__(self, site: ControllerSite) -> OwnController: ...


class FleetLaw(Protocol):
    """A motion law that leads all vehicles of a group together."""

    legs: Legs

    def command(self, measured: Measured, dt_s: float) -> Floats:
        """What motors are told for the next step, shape ``(n, 2)``."""
        ...


class FleetControllerType(Protocol):
    """What makes laws for all vehicles of a group; its ``OF_FLEETS`` is True."""

    OPTIONS: ClassVar[type[Struct]]

    def __call__(self, group: Group, options: Any) -> FleetLaw: ...


class OwnDriving:
    """The motion law of a group of vehicles on the ground, each with a controller."""

    def __init__(self, name: str, controllers: Sequence[OwnController], group: Group) -> None:
        body = group.body
        assert isinstance(body, Car | DifferentialDrive)
        accel = body.accel_mps2 if isinstance(body, Car) else body.wheel_accel_mps2
        self.group, self.body, self.legs = group, body, Legs(group, accel)
        self.what = f"the controller {name}"
        self._controllers = controllers
        self._calls = Guarded(self.what, _LIMIT_S)
        self._steering: Floats = np.zeros(group.count)

    def command(self, measured: Measured, dt_s: float) -> Floats:
        """What motors are told, shape ``(n, 2)``: speed and steering, or the speeds of wheels."""
        drives = self.drives(measured, dt_s)
        speed, rate = drives[:, 0], drives[:, 1]
        if isinstance(self.body, DifferentialDrive):
            half = rate * self.body.track_m / 2
            return np.column_stack([speed - half, speed + half])
        moves = np.abs(speed) > 1e-3
        angle = np.arctan(rate * self.body.wheelbase_m / np.where(moves, speed, 1.0))
        most = self.body.steering_rad
        self._steering = np.where(moves, np.clip(angle, -most, most), self._steering)
        return np.column_stack([speed, self._steering])

    def drives(self, measured: Measured, dt_s: float) -> Floats:
        """Speeds and yaw rates, shape ``(n, 2)``. Raises PlugInError."""
        group = self.group
        wanted = automaton.moves(group.automata)
        going = np.zeros(group.count, np.bool_)
        made = np.zeros((group.count, 2))
        robots = np.flatnonzero(wanted & (group.routes.size > 0))
        if len(robots):
            robots, k, left = self.legs.advance(robots, measured)
            going[robots] = True
            spots = group.routes.at(robots, group.s[robots], k)
            pace = np.minimum(spots.speed_mps, self.legs.pace(robots, spots.speed_mps, left, dt_s))
            for j, row in enumerate(robots.tolist()):
                seen = self._seen(row, measured, float(left[j]), float(pace[j]), dt_s)
                made[row] = self._step(row, seen)
        self.legs.watch(wanted, going, dt_s)
        speeds = self.legs.speeds(going, np.abs(made[:, 0]), measured, dt_s)
        made[:, 0] = np.where(going, made[:, 0], speeds * np.sign(measured.speed_mps))
        return made

    def _seen(
        self, row: int, measured: Measured, left_m: float, limit_mps: float, dt_s: float
    ) -> Steered:
        x, y, z = measured.position[row].tolist()
        return Steered(
            (x, y, z),
            float(measured.heading_rad[row]),
            float(measured.speed_mps[row]),
            limit_mps,
            left_m,
            bool(self.legs.way[row] < 0),
            dt_s,
            self.group.routes,
            row,
            float(self.group.s[row]),
        )

    def _step(self, row: int, seen: Steered) -> tuple[float, float]:
        """What a controller says, within what the vehicle can do. Raises PlugInError."""
        try:
            told: Any = self._calls.call(lambda: self._controllers[row].step(seen))
        except PlugInError as error:
            error.row = row
            raise
        numbers = (told.speed_mps, told.yaw_rate_radps) if isinstance(told, Drive) else ()
        sane = [one for one in numbers if _is_number(one)]
        if len(sane) != 2:
            cure = "answer Drive(speed_mps, yaw_rate_radps), in numbers"
            raise PlugInError(self.what, f"answered {told!r:.60}", cure, row)
        most = 1.5 * self.body.pace.cruise_mps
        return max(-most, min(most, float(sane[0]))), max(-4.0, min(4.0, float(sane[1])))


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and math.isfinite(value)
