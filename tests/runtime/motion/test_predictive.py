"""Predictive controllers: their answers are those of OSQP, for each car whoever is beside it."""

from __future__ import annotations

import numpy as np
import pytest

from koord.runtime.motion.angles import arc_tangent, sine_cosine, tangent
from koord.runtime.motion.arrays import Floats, Ints
from koord.runtime.motion.bodies import Car
from koord.runtime.motion.predictive import Predictive
from koord.runtime.motion.pursuit import Course, Horizon
from tests.runtime.motion.by_osqp import ByOsqp

CAR = Car()
SLOWEST = 0.08
HORIZONS = [Horizon(), Horizon(3, 0.05)]


class Asked:
    """What many cars are asked, at random: near to their paths, and sometimes far from them."""

    def __init__(self, count: int, horizon: Horizon, seed: int) -> None:
        self.count, self.horizon, self._draw = count, horizon, np.random.default_rng(seed)

    def __call__(self) -> tuple[Floats, Course, Floats]:
        draw, shape = self._draw, (self.count, self.horizon.steps)
        error = draw.normal(0.0, [0.02, 0.05, 0.1], (self.count, 3))
        error *= draw.choice([0.1, 1.0, 4.0], (self.count, 1), p=[0.5, 0.4, 0.1])
        speed = np.cumsum(draw.normal(0.0, 0.06, shape), axis=1)
        speed += draw.uniform(0.05, 0.4, (self.count, 1))
        bend = draw.normal(0.0, 0.6, (self.count, 1)) + draw.normal(0.0, 0.2, shape)
        course = Course(np.clip(speed, 0.02, 0.8), np.clip(bend, -1.3, 1.3), SLOWEST)
        return error, course, draw.choice([-1.0, 1.0], self.count)


@pytest.mark.parametrize("horizon", HORIZONS)
def test_answers_are_those_of_osqp(horizon: Horizon) -> None:
    """To the last digits, with all that is kept for the next ones.

    Where it says that limits cannot be kept, as when a car is to brake for a path that is new to
    it, it has no answer, and ours keep to the limits of the car. Then both begin anew.
    """
    count = 24
    ours, its = Predictive(count, CAR, horizon), ByOsqp(count, CAR, horizon)
    asked, cars = Asked(count, horizon, 5), np.arange(count)
    last = np.zeros((count, 2))
    slow = compared = 0
    for _ in range(25):
        error, course, way = asked()
        found = ours.inputs(cars, error, course, way, last)
        wanted = its.inputs(cars, error, course, way, last)
        alike = np.array([what.startswith(("solved", "maximum")) for what in its.found])
        assert np.abs(found - wanted)[alike].max(initial=0.0) < 1e-9
        ours.kept[:, ~alike] = 0.0
        for car in np.flatnonzero(~alike).tolist():
            its.solvers[car] = None
        compared += int(alike.sum())
        assert (np.abs(found[:, 1]) <= CAR.steering_rad).all()
        assert (found[:, 0] <= np.maximum(course.speed_mps[:, 0], 0)).all()
        slow += int((course.speed_mps[alike] <= SLOWEST).sum())
        last = found
    assert compared > 300
    assert slow > 50  # speeds that leave no room


def test_a_car_is_alone_with_its_numbers() -> None:
    """To the last bit, whoever is solved beside it, and in whatever order."""
    horizon, count = Horizon(), 11
    asked = Asked(count, horizon, 2)
    many, alone = Predictive(count, CAR, horizon), Predictive(count, CAR, horizon)
    last = np.zeros((count, 2))
    for k in range(6):
        error, course, way = asked()
        cars = np.roll(np.arange(count), k)[: count - k]
        found = many.inputs(cars, *_part(cars, error, course, way), last[cars])
        for row, car in enumerate(cars.tolist()):
            one = np.array([car])
            single = alone.inputs(one, *_part(one, error, course, way), last[one])
            assert found[row].tobytes() == single[0].tobytes()
        last[cars] = found
    assert many.kept.tobytes() == alone.kept.tobytes()


def _part(cars: Ints, error: Floats, course: Course, way: Floats) -> tuple[Floats, Course, Floats]:
    part = Course(course.speed_mps[cars], course.curvature[cars], course.slowest_mps)
    return error[cars], part, way[cars]


def test_functions_of_angles_are_as_exact_as_they_can_be() -> None:
    draw = np.random.default_rng(1)
    for most in (0.5, 4.0, 1e6):
        angle = draw.uniform(-most, most, 20_000)
        sine, cosine = sine_cosine(angle)
        assert np.abs(sine - np.sin(angle)).max() < 5e-16
        assert np.abs(cosine - np.cos(angle)).max() < 5e-16
        assert np.abs(sine * sine + cosine * cosine - 1.0).max() < 1e-15
        assert np.abs(arc_tangent(angle) - np.arctan(angle)).max() < 1e-15
    angle = draw.uniform(-1.0, 1.0, 20_000)
    assert np.abs(tangent(angle) - np.tan(angle)).max() < 1e-15
    assert np.abs(arc_tangent(tangent(angle)) - angle).max() < 1e-15
    exact = sine_cosine(np.array([0.0, np.pi / 2, np.pi, -np.pi / 2]))
    assert exact[0][[0, 1, 3]].tolist() == [0.0, 1.0, -1.0]
    assert exact[1][[0, 2]].tolist() == [1.0, -1.0]
