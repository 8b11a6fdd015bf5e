"""Pure pursuit steering of cars, and the course that controllers follow. (Coulter 1992)

It steers along the circle to a point further on. All arrays have one entry for each car.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from koord.runtime.motion.angles import arc_tangent, sine_cosine
from koord.runtime.motion.arrays import Floats, bounded
from koord.runtime.motion.bodies import Car

#: How far ahead a car looks, in time, and at least.
AHEAD_S = 0.5
AHEAD_M = 0.35


def look_ahead(speed_mps: Floats) -> Floats:
    """The look-ahead distance along the route, in metres."""
    return np.maximum(AHEAD_M, AHEAD_S * speed_mps)


def curvature_towards(aim: Floats, position: Floats, course_rad: Floats) -> Floats:
    """The curvature of the circles that lead to the points ``aim``, shape ``(m, 2)``.

    ``course_rad`` is where the car is going, which is backwards if it drives backwards.
    """
    x, y = aim[:, 0] - position[:, 0], aim[:, 1] - position[:, 1]
    distance = np.maximum(np.sqrt(x * x + y * y), 1e-6)
    sine, cosine = sine_cosine(course_rad)
    ahead, aside = cosine * x + sine * y, cosine * y - sine * x
    # What lies behind is turned to as tightly as what lies abeam.
    share = np.where(ahead >= 0, aside / distance, np.where(aside < 0, -1.0, 1.0))
    bend: Floats = 2 * share / distance
    return bend


def steering(curvature: Floats, way: Floats, car: Car) -> Floats:
    """The steering angles for curvatures of the path, within the limits; ``way`` is ±1."""
    most = math.tan(car.steering_rad)
    angle = arc_tangent(bounded(way * car.wheelbase_m * curvature, -most, most))
    return bounded(angle, -car.steering_rad, car.steering_rad)


class Horizon(Struct, frozen=True):
    """The horizon of a controller: a number of steps and their length in seconds."""

    steps: int = 8
    step_s: float = 0.1


class Course(Struct, frozen=True):
    """The course that cars are to follow from now on: arrays ``(m, steps)``.

    They may go more slowly than told, to keep to the path, but not more slowly than ``slowest``.
    """

    speed_mps: Floats
    curvature: Floats
    slowest_mps: float
