"""Cars with bodies: alone they are bicycles, and nobody passes through anything."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pytest
import shapely

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car
from koord.runtime.motion.planning import Hindrance, Touched
from koord.runtime.motion.world import Box, Disc, Obstacle, Polygon, World
from koord.sim.vehicles.bicycles import Bicycles
from koord.sim.vehicles.contact import Colliding, Floor
from koord.sim.vehicles.wheels import Hull

CAR = Car()
WIDE = World((-20, -20, 0), (20, 20, 3))
TOWARDS = np.array([[0.8, 0.0]])


def colliding(start: Floats, heading: Floats, floor: Floor) -> Colliding:
    return Colliding(Bicycles(CAR, start, heading), Hull(CAR.mass_kg, *CAR.outline_m), floor)


def outline(position: Floats, heading: float) -> shapely.Polygon:
    """The ground that a car covers."""
    front, back = CAR.middle_m + CAR.length_m / 2, CAR.middle_m - CAR.length_m / 2
    half = CAR.width_m / 2
    cos, sin = math.cos(heading), math.sin(heading)
    corners = [(front, half), (back, half), (back, -half), (front, -half)]
    x, y = position[0], position[1]
    return shapely.Polygon([(x + a * cos - b * sin, y + a * sin + b * cos) for a, b in corners])


def test_alone_a_car_with_a_body_moves_like_a_bicycle() -> None:
    start, heading = np.array([[0.0, 0, 0]]), np.array([0.4])
    one = colliding(start, heading, Floor(WIDE))
    other = Bicycles(CAR, start, heading)
    for k in range(120):
        command = np.array([[0.9 * math.cos(k / 20), 0.4 * math.sin(k / 7)]])
        one.advance(command, 0.01, 5)
        other.advance(command, 0.01, 5)
    assert one.position == pytest.approx(other.position, abs=0.05)
    assert one.heading == pytest.approx(other.heading, abs=0.05)
    assert one.speed == pytest.approx(other.speed, abs=0.05)
    assert np.abs(one.speed).max() <= CAR.speed_mps


@pytest.mark.parametrize("aside", [0.0, 0.1, 0.25])
def test_cars_do_not_pass_through_one_another(aside: float) -> None:
    start, floor = np.array([[-1.0, 0, 0], [1.0, aside, 0]]), Floor(WIDE)
    cars = colliding(start, np.array([0.0, math.pi]), floor)
    touched = False
    for _ in range(100):
        cars.advance(np.repeat(TOWARDS, 2, axis=0), 0.01, 5)
        shapes = [outline(cars.position[k], cars.heading[k]) for k in (0, 1)]
        assert shapely.intersection(*shapes).area < 0.004
        touched = touched or [one.what for one in cars.touched(0)] == [Hindrance.ROBOT]
    assert touched


@pytest.mark.parametrize(
    "obstacle",
    [
        Disc((2.0, 0.0), 0.5),
        Box((1.5, -1.0, 0.0), (2.5, 1.0, 1.0)),
        Polygon(((1.5, -1.0), (2.5, -1.0), (2.5, 1.0), (1.5, 1.0))),
        Polygon(((1.5, 1.0), (2.5, 1.0), (2.5, -1.0), (1.5, -1.0))),
    ],
)
def test_cars_do_not_pass_through_obstacles(obstacle: Obstacle) -> None:
    world = World(WIDE.low, WIDE.high, (obstacle,))
    floor = Floor(world)
    cars = colliding(np.zeros((1, 3)), np.zeros(1), floor)
    cars.advance(TOWARDS, 0.01, 600)
    assert cars.position[0, 0] + CAR.middle_m + CAR.length_m / 2 < 1.55
    assert cars.touched(0) == (Touched(Hindrance.OBSTACLE, 0),)
    assert abs(cars.speed[0]) < 0.1


def test_what_hangs_high_is_no_obstacle() -> None:
    world = World(WIDE.low, WIDE.high, (Disc((1.0, 0.0), 0.5, 1.0, 2.0),))
    cars = colliding(np.zeros((1, 3)), np.zeros(1), Floor(world))
    cars.advance(TOWARDS, 0.01, 400)
    assert cars.position[0, 0] > 2.0


def test_nobody_leaves_the_world() -> None:
    world = World((-2, -2, 0), (2, 2, 1))
    cars = colliding(np.zeros((1, 3)), np.array([0.3]), Floor(world))
    for _ in range(200):
        cars.advance(TOWARDS * 2, 0.01, 5)
        assert np.abs(cars.position[0, :2]).max() < 2.0


def test_contacts_come_out_the_same_every_time() -> None:
    def run() -> str:
        draw = np.random.default_rng(4)
        start = np.column_stack([np.arange(12) % 4 * 0.9, np.arange(12) // 4 * 0.9, np.zeros(12)])
        floor = Floor(World((-1, -1, 0), (4, 4, 1)))
        cars = colliding(start, draw.uniform(-3, 3, 12), floor)
        digest = hashlib.sha256()
        met = 0
        for _ in range(80):
            command = np.column_stack([draw.uniform(-1, 1, 12), draw.uniform(-0.4, 0.4, 12)])
            cars.advance(command, 0.01, 5)
            digest.update(cars.position.tobytes() + cars.heading.tobytes())
            met += sum(len(cars.touched(k)) for k in range(12))
        assert met > 0
        return digest.hexdigest()

    assert run() == run()
