"""How drones and ideal robots follow their routes: a reference that moves along them.

A drone's position controller is sent the reference (its autopilot's, or :mod:`.cascade`); an ideal
robot is at it.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from koord.runtime.motion import automaton
from koord.runtime.motion.arrays import Floats, bounded, lengths
from koord.runtime.motion.group import Group

#: The end of a route is approached in proportion to what is left of it, over this time: robots that
#: aim at each other's positions would swing about them if they came as fast as brakes allow.
_APPROACH_S = 0.5

#: So slowly a reference need not go.
_CREEP_MPS = 0.05

#: A reference waits for a drone that is this far behind it.
_LAG_M = 0.5


class Reference(Struct, frozen=True):
    """Where robots are to be, how fast to move and to change that: shape ``(n, 3)`` each."""

    position: Floats
    velocity: Floats
    acceleration: Floats


class Flying:
    """The law of motion of a group of robots that can move in every direction."""

    def __init__(self, group: Group, start: Floats, *, waits: bool = True) -> None:
        self.group = group
        self.waits = waits
        #: where robots without a route stay; they start there
        self.rest: Floats = start.copy()
        self._all = np.arange(group.count)

    def origin(self, position: Floats) -> Floats:
        """Where new ways to targets begin: at the reference, which a drone is about to reach, and
        not where it is measured to be, unless it has been pushed away.
        """
        near = lengths(self.rest - position) < _LAG_M
        return np.where(near[:, None], self.rest, position)

    def command(self, position: Floats, dt_s: float) -> Reference:
        """The reference at the end of the next step, for robots measured at positions."""
        group, routes = self.group, self.group.routes
        on = automaton.moves(group.automata)
        routed = group.automata.has_route
        here = routes.at(self._all, group.s)
        accel = routes.pace.accel_mps2
        speed = np.minimum(group.speed + accel * dt_s, here.speed_mps)
        if self.waits:
            lag = lengths(here.position - position)
            speed = speed * bounded(2.0 - 2.0 * lag / _LAG_M, 0.0, 1.0)
            speed = np.minimum(speed, _CREEP_MPS + (routes.length - group.s) / _APPROACH_S)
        speed = np.where(on, speed, np.maximum(group.speed - accel * dt_s, 0.0))
        speed = np.where(routed & (group.s < routes.length), speed, 0.0)
        gain = (speed - group.speed) / dt_s
        group.speed = speed
        group.s = np.minimum(group.s + speed * dt_s, routes.length)
        spot = routes.at(self._all, group.s)
        at = np.where(routed[:, None], spot.position, self.rest)
        self.rest = at
        tangent = np.where(routed[:, None], spot.tangent, 0.0)
        return Reference(at, speed[:, None] * tangent, gain[:, None] * tangent)
