"""How robots with a differential drive follow their routes: they turn on the spot, then drive.

While a robot drives, its rate of turning is that of the path, and what brings it back to the path
(Kanayama et al. 1990, "A stable tracking control method for an autonomous mobile robot")::

    ω = v (κ + k_y e_y + k_θ sin e_θ)

with the path's curvature κ, how far the path is to the left e_y, and by how much its course is
further to the left than the robot points e_θ.
"""

from __future__ import annotations

import numpy as np

from koord.runtime.motion import automaton
from koord.runtime.motion.arrays import Bools, Floats, Ints, bounded
from koord.runtime.motion.bodies import DifferentialDrive
from koord.runtime.motion.driving import Legs, Measured, stands
from koord.runtime.motion.geometry import wrapped
from koord.runtime.motion.group import Group

#: The gains k_y (per m²) and k_θ (per m).
_ACROSS, _HEADING = 16.0, 8.0

#: Who points this far aside of its path turns on the spot, until it is no further aside than that.
_ASIDE_RAD, _ALONG_RAD = 0.5, 0.03


class Turning:
    """The law of motion of a group. Its answers are the speeds of left and right wheels."""

    def __init__(self, group: Group) -> None:
        assert isinstance(group.body, DifferentialDrive)
        self.group, self.body = group, group.body
        self.legs = Legs(group, group.body.wheel_accel_mps2)
        self._speed: Floats = np.zeros(group.count)  #: that was commanded last
        self._turn: Floats = np.zeros(group.count)
        self._turns: Bools = np.zeros(group.count, np.bool_)

    def command(self, measured: Measured, dt_s: float) -> Floats:
        """The speeds of the wheels for the next step, shape ``(n, 2)``, left ones first."""
        group = self.group
        wanted = automaton.moves(group.automata)
        speed, turn = np.zeros(group.count), np.zeros(group.count)
        turns, going = np.zeros(group.count, np.bool_), np.zeros(group.count, np.bool_)
        robots = np.flatnonzero(wanted & (group.routes.size > 0))
        if len(robots):
            robots, k, left = self.legs.advance(robots, measured)
            going[robots] = True
            aside = wrapped(
                group.routes.at(robots, group.s[robots], k).course_rad
                - measured.heading_rad[robots]
            )
            begins = stands(measured, robots) & (self._speed[robots] == 0)
            limit = np.where(self._turns[robots] | begins, _ALONG_RAD, _ASIDE_RAD)
            turns[robots] = np.abs(aside) > limit
            turn[robots] = self._on_the_spot(robots, aside, dt_s)
            drives = ~turns[robots]
            robots, k, left, aside = robots[drives], k[drives], left[drives], aside[drives]
            speed[robots] = self.legs.pace(robots, self._speed[robots], left, dt_s)
            turn[robots] = self._along(robots, k, aside, speed[robots], measured)
        self.legs.watch(wanted, going, dt_s)
        speed = self.legs.speeds(going & ~turns, speed, measured, dt_s)
        self._turns = turns
        half = self.body.track_m / 2
        # Where a wheel would have to be too quick both are slower: the bend stays what it is.
        share = self.body.wheel_mps / np.maximum(np.abs(speed) + half * np.abs(turn), 1e-9)
        share = np.minimum(share, 1.0)
        self._speed, self._turn = share * speed, share * turn
        return np.column_stack([self._speed - half * self._turn, self._speed + half * self._turn])

    def _on_the_spot(self, robots: Ints, aside: Floats, dt_s: float) -> Floats:
        """Rates at which to turn to the path, so that the wheels can stop there."""
        body = self.body
        accel = body.wheel_accel_mps2 / body.track_m  # half of what the wheels can do
        rate = np.minimum(np.sqrt(2 * accel * np.abs(aside)), np.abs(aside) / dt_s)
        rate = np.copysign(np.minimum(rate, body.cruise_turn_radps), aside)
        last = self._turn[robots]
        return last + bounded(rate - last, -2 * accel * dt_s, 2 * accel * dt_s)

    def _along(
        self, robots: Ints, k: Ints, aside: Floats, speed: Floats, measured: Measured
    ) -> Floats:
        """Rates of turning that keep to the path."""
        spot = self.group.routes.at(robots, self.group.s[robots], k)
        gap = spot.position[:, :2] - measured.position[robots, :2]
        across = np.cos(spot.course_rad) * gap[:, 1] - np.sin(spot.course_rad) * gap[:, 0]
        bend = spot.curvature + _ACROSS * across + _HEADING * np.sin(aside)
        return bounded(speed * bend, -self.body.cruise_turn_radps, self.body.cruise_turn_radps)
