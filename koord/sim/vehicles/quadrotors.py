"""Quadrotors: rigid bodies under cascaded control, as arrays over drones.

Position p, velocity v, attitude q (a unit quaternion, w first, from the body's frame to the
world's), rates ω in the body's frame, and the thrust per mass T, which follows what is asked for
with the rotors' lag::

    m v̇ = m T R(q) e_z − m g e_z − c (v − wind)        J ω̇ = τ − ω × J ω        q̇ = ½ q ∘ (0, ω)

(Mahony, Kumar, Corke 2012; the drag is that of slow flight, linear in the speed against the air.)
The level ``simple`` leaves out attitude and rotors: the acceleration asked for is there at once,
and drones slide over the ground.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from koord.runtime.motion import flying
from koord.runtime.motion.arrays import Floats, products
from koord.runtime.motion.bodies import Drone
from koord.runtime.motion.flying import GRAVITY, Gains, Reference
from koord.runtime.motion.planning import Touched

#: a × b.
_CROSS = products(
    ((1, 1, 2), (-1, 2, 1)),
    ((1, 2, 0), (-1, 0, 2)),
    ((1, 0, 1), (-1, 1, 0)),
)

#: q ∘ (0, ω).
_TURNING = products(
    ((-1, 1, 0), (-1, 2, 1), (-1, 3, 2)),
    ((1, 0, 0), (1, 2, 2), (-1, 3, 1)),
    ((1, 0, 1), (1, 3, 0), (-1, 1, 2)),
    ((1, 0, 2), (1, 1, 1), (-1, 2, 0)),
)

#: R(q) e_z, but for the 1 of which the last one is subtracted; halved.
_AXIS = products(
    ((1, 1, 3), (1, 0, 2)),
    ((1, 2, 3), (-1, 0, 1)),
    ((1, 1, 1), (1, 2, 2)),
)


class FlightState(Struct):
    """The state of drones: ``(3, n)``, the quaternion ``(4, n)``, the thrust ``(n,)``."""

    position: Floats
    velocity: Floats
    attitude: Floats
    rates: Floats
    thrust: Floats
    steady: Floats  #: the integral part of the position controllers, m/s²


def at_rest(start: Floats) -> FlightState:
    """Drones that hover (or stand) at places, shape ``(n, 3)``."""
    n = len(start)
    upright = np.zeros((4, n))
    upright[0] = 1.0
    return FlightState(
        np.ascontiguousarray(start.T),
        np.zeros((3, n)),
        upright,
        np.zeros((3, n)),
        np.full(n, GRAVITY),
        np.zeros((3, n)),
    )


class Quadrotors:
    """Drones with attitude, on NumPy alone: the reference for every quicker kernel."""

    def __init__(
        self, drone: Drone, start: Floats, ground_m: float = 0.0, gains: Gains | None = None
    ) -> None:
        """``start`` has shape ``(n, 3)``."""
        self.drone, self.ground_m, self.gains = drone, ground_m, gains or Gains()
        self.state = at_rest(start)
        self._inertia = np.array(drone.inertia_kgm2)[:, None]
        self._torque = np.array(drone.torque_nm)[:, None]

    def touched(self, number: int) -> tuple[Touched, ...]:
        """The contacts of a drone: none at this level."""
        return ()

    def advance(self, reference: Reference, wind: Floats, dt_s: float, steps: int) -> None:
        """Fly for some steps. The reference moves on at its velocity; ``wind`` is ``(n, 3)``."""
        position = reference.position.T.copy()  # it moves
        velocity, air = np.ascontiguousarray(reference.velocity.T), np.ascontiguousarray(wind.T)
        gain = np.ascontiguousarray(reference.acceleration.T)
        # The reference is for the end of these steps.
        position -= velocity * (dt_s * steps)
        for _ in range(steps):
            position += velocity * dt_s
            self._step(position, velocity, gain, air, dt_s)

    def _step(self, goal: Floats, pace: Floats, gain: Floats, air: Floats, dt_s: float) -> None:
        s, drone = self.state, self.drone
        thrust, tau, couple = self.control(goal, pace, gain, dt_s)
        s.rates = s.rates + dt_s * (tau - couple) / self._inertia
        s.attitude = turned(s.attitude, s.rates, dt_s)
        s.thrust = s.thrust + (thrust - s.thrust) * (1.0 - math.exp(-dt_s / drone.rotor_lag_s))
        axis = 2.0 * _AXIS.of(s.attitude, s.attitude)
        axis[2] = 1.0 - axis[2]
        force = s.thrust * axis
        force[2] -= GRAVITY
        move(s, force, air, drone, self.ground_m, dt_s)

    def control(
        self, goal: Floats, pace: Floats, gain: Floats, dt_s: float
    ) -> tuple[Floats, Floats, Floats]:
        """The thrust per mass ``(n,)`` and the torques ``(3, n)`` demanded.

        The third result has the torques with which a spinning body turns itself.
        """
        s, drone, gains = self.state, self.drone, self.gains
        wanted = position_control(gains, s, goal, pace, gain, drone, dt_s)
        axis, thrust = flying.axis_and_thrust(wanted, drone)
        asked = flying.body_rates(gains, axis, s.attitude)
        inertia, torque = self._inertia, self._torque
        couple = _CROSS.of(s.rates, inertia * s.rates)
        tau = inertia * (gains.rate * (asked - s.rates)) + couple
        return thrust, np.minimum(np.maximum(tau, -torque), torque), couple


class PointDrones(Quadrotors):
    """Drones without attitude: the level ``simple``."""

    def _step(self, goal: Floats, pace: Floats, gain: Floats, air: Floats, dt_s: float) -> None:
        s = self.state
        wanted = position_control(self.gains, s, goal, pace, gain, self.drone, dt_s)
        move(s, wanted, air, self.drone, self.ground_m, dt_s, grips=False)


def position_control(
    gains: Gains,
    s: FlightState,
    goal: Floats,
    pace: Floats,
    gain: Floats,
    drone: Drone,
    dt_s: float,
) -> Floats:
    """The acceleration demanded, ``(3, n)``; the integral part advances by a step."""
    gap = goal - s.position
    steady = s.steady + (gains.integral * dt_s) * gap
    s.steady = np.minimum(np.maximum(steady, -gains.windup_mps2), gains.windup_mps2)
    return flying.acceleration(gains, gap, pace - s.velocity, s.steady + gain, drone)


def turned(attitude: Floats, rates: Floats, dt_s: float) -> Floats:
    """Attitudes after rotation at body rates for a step, normalised."""
    after = attitude + _TURNING.of(attitude, rates * (0.5 * dt_s))
    square = after * after
    unit: Floats = after / np.sqrt(square[0] + square[1] + square[2] + square[3])
    return unit


def move(
    s: FlightState,
    force: Floats,
    air: Floats,
    drone: Drone,
    ground_m: float,
    dt_s: float,
    *,
    grips: bool = True,
) -> None:
    """Integrate velocity, then position, by a step; the ground stops sinking drones.

    One that ``grips`` holds them where they touch it.
    """
    drag = drone.drag_kgps / drone.mass_kg
    s.velocity = s.velocity + dt_s * (force - drag * (s.velocity - air))
    s.position = s.position + dt_s * s.velocity
    below = s.position[2] <= ground_m
    if below.any():
        s.position[2, below] = ground_m
        if grips:
            s.velocity[:2, below] = 0.0
        s.velocity[2, below] = np.maximum(s.velocity[2, below], 0.0) + 0.0
