"""Barrier certificates: robots move as they want to, as far as that keeps all of them apart.

Two robots at p and q that are to be D apart have the barrier h = |p − q|² − D². Of all velocities
that satisfy, for each pair, ::

    2 (p − q) · (u − w) ≥ −γ h

those are taken that are nearest to what is wanted (Wang, Ames, Egerstedt 2017, "Safety barrier
certificates for collisions-free multirobot systems"). Nobody moving is always among them, if h ≥ 0.
A step of length t from there, at constant velocities, ends with ::

    h′ = h + 2 t (p − q) · (u − w) + t² |u − w|² ≥ (1 − γ t) h ≥ 0      if γ t ≤ 1

so points that move as they are told never come nearer than D. To be slower all together keeps that.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta, Struct
from scipy.optimize import nnls

from koord.runtime.motion import automaton
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.motion.bodies import DifferentialDrive
from koord.runtime.motion.driving import Legs, Measured
from koord.runtime.motion.group import TICK_S, Group

#: Velocities that differ by less are the same, in m/s; so are rates of barriers, in m²/s.
_SAME = 1e-9

#: Robots aim at the point of their way that lies so far ahead.
_AHEAD_M = 0.3

#: A point is approached at a speed that is so much per metre of what is left.
_NEAR_PER_S = 2.0


class BarrierOptions(Struct, frozen=True, forbid_unknown_fields=True):
    """The options of barrier certificates."""

    #: m, that the middles of two robots are to keep
    distance: Annotated[float, Meta(gt=0)] = 0.4
    #: γ, 1/s: how quickly they may come near to it
    gain: Annotated[float, Meta(gt=0, le=1 / TICK_S)] = 2.0
    #: m, from the middle of a robot forward to the point that is led
    ahead: Annotated[float, Meta(gt=0)] = 0.05
    #: rad, by which a robot that is kept back wants to go further to the right
    aside: Annotated[float, Meta(ge=0, le=1.5)] = 0.6


def certified(
    places: Floats, wanted: Floats, fixed: Bools, distance_m: float, gain_per_s: float
) -> Floats:
    """The velocities nearest to those wanted that keep points apart, all shape ``(n, 2)``.

    Those that are ``fixed`` stay where they are. The quadratic program is one of least distance,
    whose dual is a problem of non-negative least squares (Lawson and Hanson 1974, chapter 23).
    """
    velocity: Floats = np.where(fixed[:, None], 0.0, wanted)
    one, other = np.triu_indices(len(places), 1)
    moving = ~(fixed[one] & fixed[other])
    one, other = one[moving], other[moving]
    gap = places[one] - places[other]
    barrier = np.einsum("ij,ij->i", gap, gap) - distance_m**2
    # What is asked of each pair beyond what it does as it wants.
    least = -gain_per_s * barrier - 2 * np.einsum("ij,ij->i", gap, velocity[one] - velocity[other])
    held = np.zeros(len(one), np.bool_)
    change = np.zeros_like(velocity)
    while True:
        rate = 2 * np.einsum("ij,ij->i", gap, change[one] - change[other])
        broken = (rate < least - _SAME) & ~held
        if not broken.any():
            return velocity + change
        held |= broken
        pairs = np.column_stack([one, other])[held]
        found = _least_change(gap[held], pairs, least[held], np.flatnonzero(~fixed), len(places))
        if found is None:
            return np.zeros_like(velocity)
        change = found


def _least_change(gap: Floats, pairs: Ints, least: Floats, free: Ints, count: int) -> Floats | None:
    """The least change of velocities by which each pair has the rate that is asked of it.

    None if there is none, which is so only where some are too near to each other already.
    """
    of_robots = np.zeros((len(gap), count, 2))
    pair = np.arange(len(gap))
    of_robots[pair, pairs[:, 0]] = 2 * gap
    of_robots[pair, pairs[:, 1]] = -2 * gap
    rates: Floats = of_robots[:, free].reshape(len(gap), 2 * len(free))
    ends = np.zeros(rates.shape[1] + 1)
    ends[-1] = 1.0
    weights, _ = nnls(np.vstack([rates.T, least]), ends)
    rest = np.append(rates.T @ weights, least @ weights) - ends
    if rest[-1] > -_SAME:
        return None
    change = np.zeros((count, 2))
    change[free] = (-rest[:-1] / rest[-1]).reshape(-1, 2)
    return change


class BarrierCertificates:
    """The motion law of a group of differential drives that keep apart: wheel speeds.

    What is led is a point a little in front of each robot, which can go in any direction. Robots
    that are not on their way stay where they are, and the others keep away from them.
    """

    OPTIONS: ClassVar[type[Struct]] = BarrierOptions
    OF_FLEETS: ClassVar[bool] = True  #: it has to know where all robots are

    def __init__(self, group: Group, options: BarrierOptions) -> None:
        assert isinstance(group.body, DifferentialDrive)
        self.group, self.body, self.options = group, group.body, options
        self.legs = Legs(group, group.body.wheel_accel_mps2)
        self._speed: Floats = np.zeros(group.count)  #: that was commanded last

    def command(self, measured: Measured, dt_s: float) -> Floats:
        """The speeds of the wheels for the next step, in m/s, shape ``(n, 2)``, left ones first."""
        group, options = self.group, self.options
        ahead = np.column_stack([np.cos(measured.heading_rad), np.sin(measured.heading_rad)])
        points = measured.position[:, :2] + options.ahead * ahead
        wanted = automaton.moves(group.automata)
        going = np.zeros(group.count, np.bool_)
        wish = np.zeros((group.count, 2))
        robots = np.flatnonzero(wanted & (group.routes.size > 0))
        if len(robots):
            robots, _, left = self.legs.advance(robots, measured)
            going[robots] = True
            wish[robots] = self._wish(robots, measured.position[robots, :2], left, dt_s)
        wish = wish * self._share(wish, ahead)[:, None]
        # So far apart led points are that the middles are as far apart as they have to be.
        apart_m = options.distance + 2 * options.ahead
        found = certified(points, wish, ~going, apart_m, options.gain)
        kept = np.hypot(*(found - wish).T) > 0.1 * np.hypot(*wish.T)
        if kept.any() and options.aside:
            # Who meets somebody wants to pass on the right: else two that meet head on stay there.
            wish[kept] = wish[kept] @ _turned(-options.aside).T
            found = certified(points, wish, ~going, apart_m, options.gain)
        # All together as much slower as the one that is furthest beyond what its wheels can do.
        found = found * self._share(found, ahead).min(initial=1.0)
        forward = np.einsum("ij,ij->i", found, ahead)
        turn = (ahead[:, 0] * found[:, 1] - ahead[:, 1] * found[:, 0]) / options.ahead
        self.legs.watch(wanted, going, dt_s)
        self.legs.speeds(going, np.abs(forward), measured, dt_s)
        self._speed = np.hypot(*found.T)
        half = turn * self.body.track_m / 2
        return np.column_stack([forward - half, forward + half])

    def _wish(self, robots: Ints, places: Floats, left: Floats, dt_s: float) -> Floats:
        """The velocities that robots want where they are: along their ways, shape ``(k, 2)``."""
        s = self.group.s[robots]
        spots = self.group.routes.at(robots, np.minimum(s + _AHEAD_M, s + left - 1e-9))
        to = spots.position[:, :2] - places
        far = np.hypot(*to.T)
        pace = self.legs.pace(robots, self._speed[robots], left, dt_s)
        speed = np.minimum(pace, _NEAR_PER_S * far)
        found: Floats = to * (speed / np.maximum(far, 1e-9))[:, None]
        return found

    def _share(self, velocity: Floats, ahead: Floats) -> Floats:
        """For each robot the share of a velocity of its led point that its wheels can make."""
        forward = np.abs(np.einsum("ij,ij->i", velocity, ahead))
        aside = np.abs(ahead[:, 0] * velocity[:, 1] - ahead[:, 1] * velocity[:, 0])
        turn = aside / self.options.ahead
        wheels = self.body.wheel_mps / np.maximum(forward + turn * self.body.track_m / 2, 1e-9)
        turning = self.body.cruise_turn_radps / np.maximum(turn, 1e-9)
        found: Floats = np.minimum(np.minimum(wheels, turning), 1.0)
        return found


def _turned(angle_rad: float) -> Floats:
    """The matrix of a turn to the left."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])
