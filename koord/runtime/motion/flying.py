"""Path following of drones and ideal robots; cascaded control of quadrotors.

The position controller asks for an acceleration; the thrust has its size along the body's axis and
the attitude turns that axis towards it (Mellinger, Kumar 2011). The attitude controller asks for
rates in proportion to the vector part of the error quaternion (Brescianini et al. 2013), and the
rate controller for torques. Shapes are ``(3, n)`` and ``(4, n)``, quaternions have w first.

A drone's position controller is sent the reference (or its autopilot's); an ideal
robot is at it.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from koord.runtime.motion import automaton
from koord.runtime.motion.arrays import Floats, bounded, lengths, products
from koord.runtime.motion.bodies import Drone
from koord.runtime.motion.group import Group

GRAVITY = 9.81

#: conj(q) ∘ q_wanted, the error as the body sees it, of w, y and −x of what is wanted; z is 0.
_ERROR = products(
    ((1, 0, 0), (-1, 1, 2), (1, 2, 1)),
    ((-1, 0, 2), (-1, 1, 0), (1, 3, 1)),
    ((1, 0, 1), (-1, 2, 0), (1, 3, 2)),
    ((-1, 2, 2), (-1, 1, 1), (-1, 3, 0)),
)

#: Of the gain, around each axis: the nose may turn more slowly.
_SHARES: Floats = np.array([[1.0], [1.0], [0.4]])


class Gains(Struct, frozen=True):
    """Gains of the control loops, from outer to inner; each is several times faster."""

    position: float = 6.25  #: per s²
    velocity: float = 4.5  #: per s
    attitude: float = 10.0  #: rate per angle, per s
    rate: float = 25.0  #: angular acceleration per rate, per s
    integral: float = 1.5  #: per s³, against steady wind
    windup_mps2: float = 2.0  #: the most that the integral may ask for


def acceleration(
    gains: Gains, gap: Floats, speed_gap: Floats, ahead: Floats, drone: Drone
) -> Floats:
    """The acceleration that the position controller demands, limited; without gravity. In m/s².

    ``gap`` and ``speed_gap`` are reference minus measured, ``ahead`` what is asked for apart from
    them: the acceleration of the reference, and the integral part.
    """
    wanted = gains.position * gap + gains.velocity * speed_gap + ahead
    size = _sizes(wanted)
    wanted *= np.minimum(1.0, drone.accel_mps2 / np.maximum(size, 1e-9))
    return wanted


def axis_and_thrust(wanted: Floats, drone: Drone) -> tuple[Floats, Floats]:
    """The direction that the body's axis should have, and the specific thrust along it, m/s²."""
    up = np.maximum(wanted[2] + GRAVITY, 1.0)
    flat = np.sqrt(wanted[0] * wanted[0] + wanted[1] * wanted[1])
    # The tilt is limited: what is asked for sideways gives way.
    share = np.minimum(1.0, up * math.tan(drone.tilt_rad) / np.maximum(flat, 1e-9))
    force = np.empty_like(wanted)
    np.multiply(wanted[:2], share, out=force[:2])
    force[2] = up
    size = _sizes(force)
    return force / size, np.minimum(size, drone.thrust_ratio * GRAVITY)


def body_rates(gains: Gains, axis: Floats, quaternion: Floats) -> Floats:
    """The body rates that turn the body's axis towards ``axis`` and its nose to +x, in rad/s.

    The tilt is the shortest turn from the vertical to the axis; it has no yaw.
    """
    wanted = np.empty((3, axis.shape[1]))
    c = np.sqrt(0.5 * (1.0 + axis[2]))  # half-angle; the axis is never far from the vertical
    wanted[0] = c
    np.divide(axis[:2], 2 * c, out=wanted[1:])
    error = _ERROR.of(quaternion, wanted)
    rates: Floats = np.copysign(2.0 * gains.attitude, error[0]) * _SHARES * error[1:]
    return rates


def _sizes(vectors: Floats) -> Floats:
    """The lengths of vectors ``(3, n)``, added up in the same order for one drone as for many."""
    square = vectors * vectors
    sizes: Floats = np.sqrt(square[0] + square[1] + square[2])
    return sizes


#: The end of a route is approached in proportion to what is left of it, over this time: robots that
#: aim at each other's positions would swing about them if they came as fast as brakes allow.
APPROACH_S = 0.5

#: So slowly a reference need not go.
CREEP_MPS = 0.05

#: A reference waits for a drone that is this far behind it.
LAG_M = 0.5


class Reference(Struct, frozen=True):
    """Reference states: position, velocity and acceleration, shape ``(n, 3)`` each."""

    position: Floats
    velocity: Floats
    acceleration: Floats


class Flying:
    """The motion law of a group of robots that can move in every direction."""

    def __init__(self, group: Group, start: Floats, *, waits: bool = True) -> None:
        self.group = group
        self.waits = waits
        #: where robots without a route stay; they start there
        self.rest: Floats = start.copy()
        self._all = np.arange(group.count)

    def origin(self, position: Floats) -> Floats:
        """The start of new paths to targets: the reference, which a drone is about to reach.

        A robot that has been pushed away starts where it is measured to be.
        """
        near = lengths(self.rest - position) < LAG_M
        return np.where(near[:, None], self.rest, position)

    def step(self, position: Floats, now_s: float, dt_s: float) -> Floats:
        """Step the automata, and then the references; in one array of shape ``(n, 9)``."""
        self.group.update(position, now_s)
        reference = self.command(position, dt_s)
        return np.concatenate(
            [reference.position, reference.velocity, reference.acceleration], axis=1
        )

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
            speed = speed * bounded(2.0 - 2.0 * lag / LAG_M, 0.0, 1.0)
            speed = np.minimum(speed, CREEP_MPS + (routes.length - group.s) / APPROACH_S)
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
