"""Cars without contact: they are bicycles within their limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.bodies import Car
from koord.sim.vehicles.bicycles import Bicycles

CAR = Car()
COMMANDS = st.lists(st.tuples(st.floats(-9, 9), st.floats(-2, 2)), min_size=1, max_size=20)


@given(COMMANDS)
def test_limits_are_kept_whatever_is_commanded(commands: list[tuple[float, float]]) -> None:
    cars = Bicycles(CAR, np.zeros((1, 3)), np.zeros(1))
    for command in commands:
        speed, steering = cars.speed.copy(), cars.steering.copy()
        place, heading = cars.position.copy(), cars.heading.copy()
        cars.advance(np.array([command]), 0.01, 5)
        assert abs(cars.speed[0]) <= CAR.speed_mps + 1e-12
        assert abs(cars.steering[0]) <= CAR.steering_rad + 1e-12
        assert abs(cars.speed - speed)[0] <= CAR.accel_mps2 * 0.05 + 1e-9
        assert abs(cars.steering - steering)[0] <= CAR.steering_rate_radps * 0.05 + 1e-9
        moved = float(np.linalg.norm(cars.position - place))
        assert moved <= CAR.speed_mps * 0.05 + 1e-9
        turned = abs(math.remainder(float((cars.heading - heading)[0]), 2 * math.pi))
        assert turned <= max(abs(speed[0]), abs(cars.speed[0])) * 0.05 / CAR.turning_m + 1e-9


@pytest.mark.parametrize("speed", [0.6, -0.6])
def test_a_constant_steering_angle_makes_a_circle(speed: float) -> None:
    """Of radius L / tan φ about a point on the line of the rear axle."""
    cars = Bicycles(CAR, np.zeros((1, 3)), np.zeros(1))
    angle = 0.3
    cars.speed[:], cars.steering[:] = speed, angle
    radius = CAR.wheelbase_m / math.tan(angle)
    command = np.array([[speed, angle]])
    for _ in range(100):
        cars.advance(command, 0.01, 5)
        assert np.linalg.norm(cars.position[0, :2] - [0, radius]) == pytest.approx(radius, rel=1e-4)
    assert -math.pi <= cars.heading[0] < math.pi


def test_a_car_comes_to_rest() -> None:
    cars = Bicycles(CAR, np.zeros((1, 3)), np.zeros(1))
    cars.speed[:] = CAR.speed_mps
    cars.advance(np.zeros((1, 2)), 0.01, 100)
    assert cars.speed[0] == 0.0
    distance = CAR.speed_mps**2 / (2 * CAR.accel_mps2)
    assert cars.position[0, 0] == pytest.approx(distance, rel=0.02)
    there = cars.position.copy()
    cars.advance(np.zeros((1, 2)), 0.01, 100)
    assert np.array_equal(cars.position, there)
