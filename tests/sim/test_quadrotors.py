"""Drones: bounded attitudes and energy, rest, wind; and kernels that agree."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Drone
from koord.runtime.motion.flying import GRAVITY, Reference, axis_and_thrust
from koord.sim.vehicles.compiled import CompiledQuadrotors
from koord.sim.vehicles.quadrotors import PointDrones, Quadrotors

DRONE = Drone()
CALM = np.zeros((1, 3))
KINDS = [Quadrotors, PointDrones, CompiledQuadrotors]


def stand(at: Floats) -> Reference:
    return Reference(at, np.zeros_like(at), np.zeros_like(at))


def tilt(drones: Quadrotors) -> Floats:
    _, x, y, _ = drones.state.attitude
    angle: Floats = np.arccos(np.clip(1 - 2 * (x * x + y * y), -1.0, 1.0))
    return angle


@pytest.mark.parametrize("kind", KINDS)
def test_a_drone_comes_to_rest_where_it_is_sent(kind: type[Quadrotors]) -> None:
    drones = kind(DRONE, np.array([[0.0, 0, 1]]))
    goal = np.array([[1.0, -2.0, 2.0]])
    drones.advance(stand(goal), CALM, 0.01, 1500)
    assert drones.state.position[:, 0] == pytest.approx(goal[0], abs=0.01)
    assert np.abs(drones.state.velocity).max() < 0.01
    assert np.abs(drones.state.rates).max() < 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_at_rest_it_stays_at_rest(kind: type[Quadrotors]) -> None:
    drones = kind(DRONE, np.array([[0.0, 0, 1]]))
    drones.advance(stand(np.array([[0.0, 0, 1]])), CALM, 0.01, 500)
    assert np.abs(drones.state.position[:, 0] - [0, 0, 1]).max() < 1e-9


@given(st.tuples(st.floats(-40, 40), st.floats(-40, 40), st.floats(0, 40)), st.floats(0, 8))
def test_attitude_and_energy_are_bounded_wherever_it_is_sent(
    goal: tuple[float, float, float], wind: float
) -> None:
    drones = Quadrotors(DRONE, np.array([[0.0, 0, 5]]))
    for _ in range(25):
        drones.advance(stand(np.array([goal])), np.array([[wind, -wind, 0]]), 0.01, 5)
        s = drones.state
        assert np.linalg.norm(s.attitude[:, 0]) == pytest.approx(1.0, abs=1e-9)
        assert tilt(drones)[0] < DRONE.tilt_rad * 1.3
        assert s.thrust[0] <= DRONE.thrust_ratio * GRAVITY + 1e-9
        assert np.abs(s.rates).max() < 12.0
        # Drag bounds the speed: at most what the thrust can hold against it.
        assert np.linalg.norm(s.velocity) < 2.0 * GRAVITY * 2.0 + 2 * wind
    assert drones.state.position[2, 0] >= 0.0


@given(st.lists(st.floats(-30, 30), min_size=3, max_size=3))
def test_the_thrust_asked_for_is_within_limits(wanted: list[float]) -> None:
    axis, thrust = axis_and_thrust(np.array(wanted)[:, None], DRONE)
    assert np.linalg.norm(axis) == pytest.approx(1.0)
    assert math.acos(min(float(axis[2, 0]), 1.0)) <= DRONE.tilt_rad + 1e-9
    assert 0 < thrust[0] <= DRONE.thrust_ratio * GRAVITY


@pytest.mark.parametrize("kind", KINDS)
def test_wind_pushes_and_is_held_against(kind: type[Quadrotors]) -> None:
    drones = kind(DRONE, np.array([[0.0, 0, 2]]))
    wind = np.array([[3.0, 0, 0]])
    here = np.array([[0.0, 0, 2]])
    drones.advance(stand(here), wind, 0.01, 60)
    pushed = drones.state.position[0, 0]
    assert 0.02 < pushed < 0.3
    drones.advance(stand(here), wind, 0.01, 3000)
    assert abs(drones.state.position[0, 0]) < 0.02
    if kind is not PointDrones:
        # In balance the thrust leans against the drag: tan(tilt) = c w / (m g).
        lean = math.atan(DRONE.drag_kgps * 3.0 / (DRONE.mass_kg * GRAVITY))
        assert tilt(drones)[0] == pytest.approx(lean, rel=0.05)


def test_free_fall_is_that_of_gravity() -> None:
    """With the motors off: v = g t, but for the drag, which is small at first."""
    heavy = Drone(mass_kg=1e6, thrust_ratio=1e-9, rotor_lag_s=1e-6)
    drones = Quadrotors(heavy, np.array([[0.0, 0, 100]]))
    drones.advance(stand(np.array([[0.0, 0, 0]])), CALM, 0.001, 1000)
    assert drones.state.velocity[2, 0] == pytest.approx(-GRAVITY, rel=0.01)
    assert drones.state.position[2, 0] == pytest.approx(100 - GRAVITY / 2, abs=0.1)


def test_the_ground_holds() -> None:
    drones = Quadrotors(DRONE, np.array([[0.0, 0, 0.3]]))
    drones.advance(stand(np.array([[0.5, 0, -3.0]])), np.array([[4.0, 0, 0]]), 0.01, 500)
    assert drones.state.position[2, 0] == 0.0
    assert np.array_equal(drones.state.velocity[:, 0], np.zeros(3))


def test_the_compiled_kernel_computes_what_the_reference_computes() -> None:
    draw = np.random.default_rng(3)
    start = draw.uniform(-2, 2, (7, 3)) + np.array([0, 0, 3])
    one, other = Quadrotors(DRONE, start), CompiledQuadrotors(DRONE, start)
    for _ in range(60):
        reference = Reference(*(draw.uniform(-2, 2, (7, 3)) for _ in range(3)))
        wind = draw.normal(size=(7, 3))
        one.advance(reference, wind, 0.01, 5)
        other.advance(reference, wind, 0.01, 5)
    for name in ("position", "velocity", "attitude", "rates", "thrust", "steady"):
        assert getattr(one.state, name) == pytest.approx(getattr(other.state, name), abs=1e-9), name


def test_one_drone_flies_as_among_many() -> None:
    start = np.array([[0.0, 0, 1], [1, 1, 1], [2, 0, 2]])
    goals = start + np.array([[1, 0, 0], [0, 2, 1], [-1, 0, -1]])
    many, alone = Quadrotors(DRONE, start), Quadrotors(DRONE, start[1:2])
    for _ in range(40):
        many.advance(stand(goals), np.zeros((3, 3)), 0.01, 5)
        alone.advance(stand(goals[1:2]), CALM, 0.01, 5)
    assert np.array_equal(many.state.position[:, 1], alone.state.position[:, 0])
