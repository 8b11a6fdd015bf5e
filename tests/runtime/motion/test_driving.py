"""Cars on their routes: how near both controllers keep to them, and that they arrive.

The vehicle here is the plain bicycle, stepped by the test, so that this is about control alone.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.automaton import MotionState, Visit
from koord.runtime.motion.bodies import Car, PlannerName, Steering
from koord.runtime.motion.driving import Driving, Measured
from koord.runtime.motion.field import field
from koord.runtime.motion.geometry import point_path
from koord.runtime.motion.group import Group
from koord.runtime.motion.planners import planner
from koord.runtime.motion.predictive import Predictive
from koord.runtime.motion.pursuit import Course, Horizon
from koord.sim.vehicles.bicycles import Bicycles
from tests.runtime.motion.worlds import CLUTTERED, EMPTY, places

CAR = Car()
CIRCLE = [(1.1 * math.sin(a), 1.1 - 1.1 * math.cos(a), 0.0) for a in np.linspace(0, 5, 40)]


class Ride:
    """Cars that are driven tick by tick."""

    def __init__(self, steering: Steering, starts: Floats, headings: Floats, seed: int) -> None:
        made = planner(PlannerName.RRT_CAR, CLUTTERED, CAR)
        self.group = Group(
            len(starts), CAR, CLUTTERED, made, Visit(), list(range(seed, seed + len(starts)))
        )
        self.tick_s = 0.1 if steering is Steering.PREDICTIVE else 0.05
        self.driving = Driving(self.group, steering, Horizon(step_s=self.tick_s))
        self.cars = Bicycles(CAR, starts, headings)
        self.now_s = 0.0
        self.command: Floats = np.zeros((len(starts), 2))

    def tick(self) -> None:
        cars = self.cars
        self.group.plan(cars.position, cars.heading)
        self.group.update(cars.position, self.now_s)
        measured = Measured(cars.position, cars.heading, cars.speed)
        self.command = self.driving.command(measured, self.tick_s)
        cars.advance(self.command, 0.01, round(self.tick_s / 0.01))
        self.now_s += self.tick_s


@pytest.mark.parametrize(
    ("steering", "most_m"), [(Steering.PREDICTIVE, 0.05), (Steering.PURSUIT, 0.12)]
)
def test_cars_keep_to_planned_paths_and_arrive(steering: Steering, most_m: float) -> None:
    free = field(CLUTTERED, flat=True)
    there = np.array(places(free, 12, seed=11, height_m=0.0, room_m=0.65))
    starts, goals = there[::2], there[1::2]
    ride = Ride(steering, starts, np.arange(6.0), seed=5)
    for k, goal in enumerate(goals.tolist()):
        ride.group.go_to(k, (goal[0], goal[1], 0.0))
    furthest = np.zeros(6)
    ride.tick()
    while not ride.group.automata.reached.all():
        ride.tick()
        off = [point_path(ride.cars.position[k], ride.group.path(k)) for k in range(6)]
        furthest = np.maximum(furthest, off)
        assert ride.now_s < 60
    assert (furthest < most_m).all()
    for _ in range(60):
        ride.tick()
    assert (np.linalg.norm(ride.cars.position - goals, axis=1) < 0.12).all()
    assert np.abs(ride.cars.speed).max() < 1e-9


@pytest.mark.parametrize("steering", Steering)
def test_commands_keep_the_limits(steering: Steering) -> None:
    ride = Ride(steering, np.zeros((1, 3)), np.zeros(1), 0)
    ride.group.follow(0, np.array(CIRCLE))
    for _ in range(200):
        before = ride.command
        ride.tick()
        speed, angle = ride.command[0]
        assert abs(speed) <= CAR.cruise_mps + 1e-9
        assert abs(angle) <= CAR.steering_rad + 1e-9
        assert abs(speed) - abs(before[0, 0]) <= CAR.accel_mps2 * ride.tick_s + 1e-9


@pytest.mark.parametrize("steering", Steering)
def test_holding_stops_and_releasing_goes_on(steering: Steering) -> None:
    ride = Ride(steering, np.zeros((1, 3)), np.zeros(1), 0)
    ride.group.follow(0, np.array(CIRCLE))
    for _ in range(30):
        ride.tick()
    assert ride.cars.speed[0] > 0.3
    ride.group.hold(0)
    for _ in range(20):
        ride.tick()
    held = ride.cars.position.copy()
    assert ride.group.state(0) is MotionState.HOLDING
    assert ride.cars.speed[0] == 0.0
    for _ in range(20):
        ride.tick()
    assert np.array_equal(ride.cars.position, held)
    ride.group.release(0)
    while not ride.group.automata.reached[0]:
        ride.tick()
        assert ride.now_s < 40


def test_stop_is_for_good() -> None:
    ride = Ride(Steering.PURSUIT, np.zeros((1, 3)), np.zeros(1), 0)
    ride.group.follow(0, np.array(CIRCLE))
    for _ in range(20):
        ride.tick()
    ride.group.stop(0)
    ride.group.follow(0, np.array(CIRCLE))
    for _ in range(40):
        ride.tick()
    assert ride.cars.speed[0] == 0.0
    assert ride.group.state(0) is MotionState.STOPPED


def test_a_car_that_missed_the_end_of_its_route_says_so() -> None:
    """A straight path across the way it points: it cannot come near enough to the end."""
    ride = Ride(Steering.PURSUIT, np.array([[2.0, -2.0, 0.0]]), np.array([0.0]), 0)
    ride.group.follow(0, np.array([[2.0, -2.0, 0.0], [2.0, -1.5, 0.0]]))
    missed = False
    for _ in range(200):
        ride.tick()
        if ride.driving.legs.missed[0]:
            missed = True
            ride.group.replan([0])
    assert missed
    assert ride.group.automata.reached[0]


def test_who_is_given_no_path_stays_and_never_reaches() -> None:
    ride = Ride(Steering.PURSUIT, np.zeros((1, 3)), np.zeros(1), 0)
    ride.group.follow(0, np.zeros((0, 3)))
    for _ in range(20):
        ride.tick()
    assert np.array_equal(ride.cars.position, np.zeros((1, 3)))
    assert ride.group.state(0) is MotionState.IDLE
    assert not ride.group.automata.reached[0]


def test_the_predictive_controller_is_optimal_without_limits() -> None:
    """Where no limit is met, its first input is that of the linear-quadratic problem itself."""
    n = 6
    made = Predictive(1, CAR, Horizon(n, 0.1))
    speed, bend = np.full((1, n), 0.5), np.full((1, n), 0.1)
    error, way = np.array([[0.0, 0.004, -0.003]]), np.ones(1)
    reference = np.array([[0.5, math.atan(CAR.wheelbase_m * 0.1)]])
    course = Course(speed, bend, 0.0)
    for _ in range(6):  # it improves on its last answer
        found = made.inputs(np.array([0]), error, course, way, reference)
    steering = _least_squares(n, error[0], 0.5, 0.1)
    # Speeds may not be exceeded, so only the steering is free.
    assert found[0, 1] - reference[0, 1] == pytest.approx(steering, abs=2e-3)


def _least_squares(n: int, error: Floats, w: float, bend: float) -> float:
    """The first steering angle of the same problem, by the normal equations; speeds as told."""
    dt, weights = 0.1, np.sqrt([0.05, 6.0, 1.0])
    swing = w / (CAR.wheelbase_m * math.cos(math.atan(CAR.wheelbase_m * bend)) ** 2)
    a = np.array([[1, dt * bend * w, 0], [-dt * bend * w, 1, dt * w], [0, 0, 1]])
    b = np.array([0, dt * w * dt * swing / 2, dt * swing])
    rows, right = [], []
    for k in range(1, n + 1):
        forced = np.zeros((3, n))
        for j in range(k):
            forced[:, j] = np.linalg.matrix_power(a, k - 1 - j) @ b
        rows.append(weights[:, None] * forced)
        right.append(-weights * (np.linalg.matrix_power(a, k) @ error))
    change = np.eye(n) - np.eye(n, k=-1)
    rows += [math.sqrt(0.05) * np.eye(n), math.sqrt(0.15) * change]
    right += [np.zeros(n), np.zeros(n)]
    found = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    return float(found[0])


def test_one_car_is_driven_as_among_many() -> None:
    starts = np.array([[0.0, 0, 0], [1.0, -2, 0], [2.0, 2, 0]])
    many = Ride(Steering.PREDICTIVE, starts, np.zeros(3), 0)
    alone = Ride(Steering.PREDICTIVE, starts[1:2], np.zeros(1), 1)
    for k, (x, y, _) in enumerate(starts.tolist()):
        many.group.follow(k, np.array(CIRCLE) + np.array([x, y, 0]))
    alone.group.follow(0, np.array(CIRCLE) + starts[1])
    for _ in range(40):
        many.tick()
        alone.tick()
    assert many.cars.position[1] == pytest.approx(alone.cars.position[0], abs=1e-6)
    assert EMPTY.obstacles == ()
