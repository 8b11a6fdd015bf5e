"""Routes: where robots are along them, legs, and speeds that can be kept to."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Pace
from koord.runtime.motion.geometry import length, point_path
from koord.runtime.motion.routes import Routes

PACE = Pace(cruise_mps=1.0, accel_mps2=1.0, lateral_mps2=2.0)
CAR_PACE = Pace(
    cruise_mps=1.0, accel_mps2=1.0, lateral_mps2=2.0, cusp_rad=math.radians(110), reverses=True
)
ONE = np.array([0])

POINT = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(0, 3))
PATH = st.lists(POINT, min_size=1, max_size=8).map(lambda points: np.array(points))


def routed(path: Floats, pace: Pace = PACE, heading_rad: float = 0.0) -> Routes:
    routes = Routes(1, pace)
    routes.put(0, path, heading_rad)
    return routes


@given(PATH, st.floats(0, 1))
def test_every_place_of_a_route_is_on_its_path(path: Floats, share: float) -> None:
    routes = routed(path)
    assert routes.length[0] == pytest.approx(length(path), abs=1e-6)
    s = routes.length * share
    spot = routes.at(ONE, s)
    assert point_path(spot.position[0], path) < 1e-6
    assert 0.0 <= spot.speed_mps[0] <= PACE.cruise_mps


@given(PATH)
def test_a_route_ends_exactly_where_its_path_does(path: Floats) -> None:
    routes = routed(path)
    assert np.allclose(routes.end[0], path[-1], atol=1e-9)
    assert np.array_equal(routes.at(ONE, routes.length).position[0], routes.end[0])


@given(PATH)
def test_speeds_can_be_braked_from_in_time(path: Floats) -> None:
    routes = routed(path)
    n = int(routes.size[0]) + 1
    s, square = routes.s[0, :n], routes.speed2[0, :n]
    assert square[-1] == 0.0 or n == 1
    # v² may not fall by more than 2 a Δs from a point to the next.
    assert (np.diff(square) >= -2 * PACE.accel_mps2 * np.diff(s) - 1e-9).all()
    assert (square <= PACE.cruise_mps**2 + 1e-12).all()


def test_between_two_points_nothing_is_beyond_them() -> None:
    """Rounding must not show: contracts say that a robot is between where it was and its target."""
    draw = np.random.default_rng(0)
    for _ in range(200):
        a, b = draw.normal(size=(2, 3))
        routes = routed(np.array([a, b]))
        at = np.array([routes.at(ONE, routes.length * t).position[0] for t in draw.random(20)])
        assert (at >= np.minimum(a, b)).all()
        assert (at <= np.maximum(a, b)).all()


def test_many_straight_routes_are_as_one_by_one() -> None:
    draw = np.random.default_rng(1)
    starts, goals = draw.normal(size=(2, 5, 3))
    goals[2] = starts[2]
    together, single = Routes(5, PACE), Routes(5, PACE)
    together.put_straight(np.arange(5), starts, goals)
    for k in range(5):
        single.put(k, np.array([starts[k], goals[k]]))
    robots = np.arange(5)
    for share in (0.0, 0.3, 1.0):
        one = together.at(robots, together.length * share)
        other = single.at(robots, single.length * share)
        assert np.allclose(one.position, other.position)
        assert np.allclose(one.speed_mps, other.speed_mps)
        assert np.allclose(one.tangent[together.size > 0], other.tangent[together.size > 0])


def test_a_car_turns_about_at_cusps() -> None:
    path = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0.2, 0], [0, 0.4, 0]])
    routes = routed(path, CAR_PACE)
    assert routes.way[0, :4].tolist() == [1, 1, -1, -1]
    assert routes.leg_end[0, :2].tolist() == [2.0, 2.0]
    assert routes.speed2[0, 2] == 0.0
    backwards = routed(path, CAR_PACE, heading_rad=np.pi)
    assert backwards.way[0, :4].tolist() == [-1, -1, 1, 1]
    assert routed(path, PACE).way[0, :4].tolist() == [1, 1, 1, 1]


def test_a_bend_has_its_curvature_and_course() -> None:
    angle = np.linspace(0, np.pi / 2, 12)
    path = np.column_stack([2 * np.sin(angle), 2 - 2 * np.cos(angle), 0 * angle])
    routes = routed(path, CAR_PACE)
    for share in (0.0, 0.35, 0.8, 1.0):
        spot = routes.at(ONE, routes.length * share)
        assert spot.curvature[0] == pytest.approx(0.5, rel=0.01)
        assert spot.course_rad[0] == pytest.approx(share * np.pi / 2, abs=0.02)


def test_a_corner_slows_a_drone_down() -> None:
    square = np.array([[0.0, 0, 1], [2, 0, 1], [2, 2, 1]])
    routes = routed(square)
    assert 0 < routes.speed2[0, 1] < 0.2**2
    slight = routed(np.array([[0.0, 0, 1], [2, 0, 1], [4, 0.05, 1]]))
    assert slight.speed2[0, 1] == pytest.approx(1.0)


def test_the_nearest_place_is_sought_on_the_leg_where_a_car_is() -> None:
    path = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0.01, 0], [0, 0.02, 0]])
    routes = routed(path, CAR_PACE)
    here = np.array([[1.2, 0.01, 0]])
    assert routes.nearest(ONE, np.array([0.5]), here)[0] == pytest.approx(1.2)
    assert routes.nearest(ONE, np.array([2.3]), here)[0] == pytest.approx(2.8, abs=0.01)


def test_routes_grow_without_forgetting_others() -> None:
    routes = Routes(2, PACE)
    routes.put(0, np.array([[0.0, 0, 0], [1, 0, 0]]))
    long = np.column_stack([np.arange(40.0), np.zeros(40), np.zeros(40)])
    routes.put(1, long)
    assert routes.at(np.array([0, 1]), np.array([0.5, 20.5])).position[:, 0].tolist() == [0.5, 20.5]
    assert routes.end[:, 0].tolist() == [1.0, 39.0]
    routes.put(1, long[:1])
    assert routes.length.tolist() == [1.0, 0.0]
