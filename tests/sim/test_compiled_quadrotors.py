"""Machine code of drones: to the last bit what NumPy computes, at every width and for any state."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Drone, PlannerName
from koord.runtime.motion.flying import Gains, Reference
from koord.runtime.motion.world import World
from koord.sim.disturbances import Disturbances, Positioning, Wind
from koord.sim.fleet import Fleet, Placed
from koord.sim.squads import DeviceModel
from koord.sim.vehicles.compiled import CompiledQuadrotors, flight
from koord.sim.vehicles.quadrotors import FlightState, Quadrotors

WIDTHS = (1, 2, 4, 8)
PARTS = ("position", "velocity", "attitude", "rates", "thrust", "steady")

#: What arithmetic is odd at.
ODD = (math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, -1e-310, 1e-160, 1e155, -1e308, 1e308)

#: A row of the state or of what is told, a drone, and an odd number for it.
ODDITIES = st.lists(
    st.tuples(st.integers(0, 28), st.integers(0, 19), st.sampled_from(ODD)), max_size=6
)


def flying(width: int, drone: Drone, start: Floats, **more: Any) -> CompiledQuadrotors:
    made = CompiledQuadrotors(drone, start, **more)
    made._fly = flight(width)
    return made


def state(rows: Floats) -> FlightState:
    parts = np.split(rows, (3, 6, 10, 13, 14))
    position, velocity, attitude, rates, thrust, steady = parts
    return FlightState(position, velocity, attitude, rates, thrust[0], steady)


def same(one: Quadrotors, other: Quadrotors) -> None:
    """Each number has the same bits, or both are none."""
    for name in PARTS:
        left, right = getattr(one.state, name), getattr(other.state, name)
        assert left.shape == right.shape
        none = np.isnan(left)
        assert np.array_equal(none, np.isnan(right)), name
        left, right = np.where(none, 0.0, left), np.where(none, 0.0, right)
        assert np.array_equal(left.view(np.int64), right.view(np.int64)), name


@given(
    count=st.integers(1, 20),
    width=st.sampled_from(WIDTHS),
    seed=st.integers(0, 1 << 32),
    scale=st.sampled_from((1e-3, 1.0, 50.0)),
    odd=ODDITIES,
    steps=st.integers(0, 6),
    ground_m=st.sampled_from((-math.inf, 0.0, -0.0, 0.5)),
)
@example(3, 2, 0, 1.0, [(6, 2, math.nan)], 1, 0.0)
def test_any_state_becomes_what_it_does_in_numpy(
    count: int,
    width: int,
    seed: int,
    scale: float,
    odd: list[tuple[int, int, float]],
    steps: int,
    ground_m: float,
) -> None:
    draw = np.random.default_rng(seed)
    rows = draw.normal(0.0, scale, (29, count))
    for row, column, value in odd:
        rows[row, column % count] = value
    x, y, z = draw.uniform(0.01, 0.1, 3).tolist()
    drone = Drone(mass_kg=float(draw.uniform(0.5, 3.0)), inertia_kgm2=(x, y, z))
    gains = Gains(windup_mps2=float(draw.choice([0.01, 0.2, 2.0])))
    start = np.zeros((count, 3))
    one = Quadrotors(drone, start, ground_m, gains)
    other = flying(width, drone, start, ground_m=ground_m, gains=gains)
    one.state, other.state = state(rows[:17].copy()), state(rows[:17].copy())
    told = [part.T for part in np.split(rows[17:], 4)]
    with np.errstate(all="ignore"):
        one.advance(Reference(*told[:3]), told[3], 0.01, steps)
        other.advance(Reference(*told[:3]), told[3], 0.01, steps)
    same(one, other)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("count", [1, 7, 16, 100])
def test_flights_are_equal_to_the_last_bit(width: int, count: int) -> None:
    draw = np.random.default_rng(count)
    start = draw.uniform(-2, 2, (count, 3)) + np.array([0, 0, 1])
    one, other = Quadrotors(Drone(), start), flying(width, Drone(), start)
    for _ in range(60):
        reference = Reference(*(draw.uniform(-2, 2, (count, 3)) for _ in range(3)))
        wind = draw.normal(0, 2, (count, 3))
        one.advance(reference, wind, 0.01, 5)
        other.advance(reference, wind, 0.01, 5)
    same(one, other)
    assert count < 100 or (one.state.position[2] == 0.0).any()  # some have come down


def test_a_state_that_somebody_has_set_is_flown_from() -> None:
    start = np.array([[0.0, 0, 1], [1, 1, 1], [2, 0, 2]])
    one, other = Quadrotors(Drone(), start), CompiledQuadrotors(Drone(), start)
    here = Reference(start, 0 * start, 0 * start)
    for velocity in (0.5, -0.5):
        for drones in (one, other):
            drones.advance(here, 0 * start, 0.01, 5)
            drones.state.velocity = np.full((3, 3), velocity)
        same(one, other)
    one.advance(here, 0 * start, 0.02, 3)
    other.advance(here, 0 * start, 0.02, 3)
    same(one, other)


def test_what_stands_on_the_ground_has_one_zero() -> None:
    """Its speed upwards is the least of what there is, with a minus."""
    drone = Drone(rotor_lag_s=1e30)  # the thrust stays as it is: that of hovering
    start = np.zeros((1, 3))
    one, other = Quadrotors(drone, start), CompiledQuadrotors(drone, start)
    above = Reference(start + np.array([0, 0, 1]), start, start)
    for drones in (one, other):
        drones.state.velocity = np.full((3, 1), -0.0)
        drones.advance(above, start - np.array([0, 0, 1e-322]), 0.01, 1)
        assert drones.state.velocity.tolist() == [[0.0]] * 3
        assert not np.signbit(drones.state.velocity).any()
    same(one, other)


@pytest.mark.parametrize(
    "rough",
    [
        Disturbances(Positioning(0.01, 0.01, 20.0), 0.1, Wind((0.5, 0, 0), 0.5)),
        Disturbances(Positioning(0.01)),
        Disturbances(Positioning(rate_hz=7.0)),
        Disturbances(actuation_delay_s=0.1),
        Disturbances(wind=Wind((0.5, 0, 0), 0.5)),
    ],
)
def test_fleets_fly_the_same_without_llvmlite(
    rough: Disturbances, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = DeviceModel(Drone(), PlannerName.STRAIGHT, disturbances=rough)
    places = [(2.0 * k, 0.0, 0.5 * (k % 3)) for k in range(5)]

    def ways() -> tuple[type, list[bytes]]:
        fleet = Fleet(World((-9, -9, 0), (19, 9, 5)), [Placed(model, at) for at in places], 7)
        for k, (x, y, z) in enumerate(places):
            fleet.go_to(k, (x + 0.5, y + 1.0, z + 0.5))
        seen: list[bytes] = []
        fleet.advance_to(2.0, lambda f: seen.append(f.positions().tobytes()))
        (squad, _), *_ = fleet._squads
        return type(squad.vehicles), [*seen, fleet.attitudes().tobytes()]

    compiled, flown = ways()
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    plain, other = ways()
    assert (compiled, plain) == (CompiledQuadrotors, Quadrotors)
    assert flown == other


@pytest.mark.parametrize("kind", [Quadrotors, CompiledQuadrotors])
def test_what_was_seen_of_drones_stays_as_it_was(kind: type[Quadrotors]) -> None:
    """Nor does flying change what it is given, also where an array of one drone is its own turn."""
    start = np.array([[0.0, 0, 1]])
    goal, pace, wind = start + 1, start + 2, start + 3
    drones = kind(Drone(), start)
    drones.advance(Reference(goal, pace, 0 * pace), wind, 0.01, 5)
    seen = drones.state.position
    kept = seen.copy()
    drones.advance(Reference(goal, pace, 0 * pace), wind, 0.01, 5)
    assert np.array_equal(seen, kept)
    assert np.array_equal(start, [[0, 0, 1]])
    assert np.array_equal([goal, pace, wind], [start + 1, start + 2, start + 3])
