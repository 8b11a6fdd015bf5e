"""Machine code of automata and references: to the last bit what NumPy computes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.automaton import Automata, MotionState, Visit
from koord.runtime.motion.bodies import Drone, PlannerName
from koord.runtime.motion.flying import Flying
from koord.runtime.motion.group import TICK_S, Group
from koord.runtime.motion.planners import planner
from koord.runtime.motion.world import World
from koord.sim.vehicles.compiled_flying import CompiledFlying

WORLD = World((-50, -50, 0), (50, 50, 20))
MOST = 5

#: Places on a coarse grid, so that robots are told to go where they are, and stay near.
COORDINATES = st.sampled_from([-0.0, 0.0, 0.1, 0.2, 0.7, 2.0, 5.0])
PLACES = st.tuples(COORDINATES, COORDINATES, COORDINATES)
ORDERS = st.one_of(
    st.tuples(st.just("follow"), st.lists(PLACES, max_size=6)),
    st.tuples(st.just("go_to"), PLACES),
    st.tuples(st.sampled_from(["hold", "release", "release", "stop"]), st.none()),
)

#: In a tick: orders with the robots that are given them; how far measured positions are off, and
#: whether drones are where they are to be.
TICKS = st.tuples(
    st.lists(st.tuples(st.integers(0, MOST - 1), ORDERS), max_size=2),
    st.sampled_from([0.0, 0.02, 0.3, 3.0]),
    st.integers(1, 12),
)


class Flown:
    """A group, and who moves its references."""

    def __init__(self, kind: Callable[[Group, Floats], Flying], start: Floats) -> None:
        body, visit = Drone(), Visit(0.2, 0.3)
        made = planner(PlannerName.STRAIGHT, WORLD, body)
        self.group = Group(len(start), body, WORLD, made, visit)
        self.flying = kind(self.group, start)

    def order(self, robot: int, what: str, where: Any, position: Floats) -> None:
        match what, where:
            case "follow", [*places]:
                path = np.array(places, dtype=np.float64).reshape(-1, 3)
                self.group.follow(robot, path, 0.0, position[robot])
            case "go_to", (x, y, z):
                self.group.go_to(robot, (float(x), float(y), float(z)))
            case _:
                getattr(self.group, what)(robot)

    def tick(self, position: Floats, now_s: float) -> Floats:
        self.group.plan(self.flying.origin(position), np.zeros(len(position)))
        return self.flying.step(position, now_s, TICK_S)


def seen(flown: Flown) -> dict[str, NDArray[Any]]:
    group, automata = flown.group, flown.group.automata
    return {
        "s": group.s,
        "speed": group.speed,
        "rest": flown.flying.rest,
        "state": automata.state,
        "since_s": automata.since_s,
        "reached": automata.reached,
        "has_route": automata.has_route,
        "resumes": automata.resumes,
    }


def agree(one: Flown, other: Flown, position: Floats, now_s: float) -> Floats:
    """Both send the same, and are left in the same state; zeros may differ by their signs."""
    sent, also = one.tick(position, now_s), other.tick(position, now_s)
    assert np.array_equal(sent, also, equal_nan=True)
    mine, its = seen(one), seen(other)
    for name, value in mine.items():
        assert value.dtype == its[name].dtype, name
        assert np.array_equal(value, its[name], equal_nan=value.dtype == np.float64), name
    return sent


@given(st.integers(1, MOST), st.lists(TICKS, min_size=1, max_size=8), st.integers(0, 99))
def test_whatever_is_ordered_both_send_the_same(
    count: int, ticks: list[tuple[list[tuple[int, tuple[str, Any]]], float, int]], seed: int
) -> None:
    draw = np.random.default_rng(seed)
    position = np.round(draw.uniform(0, 2, (count, 3)), 1)
    one, other = Flown(Flying, position), Flown(CompiledFlying, position)
    now_s = 0.0
    for orders, off_m, times in ticks:
        for robot, (what, where) in orders:
            for flown in (one, other):
                flown.order(robot % count, what, where, position)
        for _ in range(times):
            sent = agree(one, other, position, now_s)
            position = sent[:, :3] + draw.normal(0.0, off_m, (count, 3))
            now_s += TICK_S


def test_a_route_is_flown_from_its_start_to_its_end() -> None:
    """Over bends, with arrival, a hold in between, and a push away from the end."""
    start = np.array([[0.0, 0, 1], [3, 3, 1]])
    one, other = Flown(Flying, start), Flown(CompiledFlying, start)
    angles = np.linspace(0, 3, 40)
    bend = np.column_stack([np.sin(angles), 1 - np.cos(angles), 1 + 0 * angles])
    for flown in (one, other):
        flown.group.follow(0, bend, 0.0, start[0])
    position = start
    states: list[MotionState] = []
    for k in range(220):
        if k in (20, 30):
            for flown in (one, other):
                (flown.group.hold if k == 20 else flown.group.release)(0)
        sent = agree(one, other, position, k * TICK_S)
        position = sent[:, :3] + (np.array([1.0, 0, 0]) if k == 200 else 0.0)
        state = other.group.state(0)
        if not states or states[-1] is not state:
            states.append(state)
    assert states == [
        *(MotionState.MOVING, MotionState.HOLDING, MotionState.MOVING),
        *(MotionState.IDLE, MotionState.MOVING, MotionState.IDLE),
    ]
    assert position[1].tolist() == [3, 3, 1]


@pytest.mark.parametrize("odd", [np.nan, np.inf, 1e200])
def test_odd_measurements_are_no_difference(odd: float) -> None:
    start = np.array([[0.0, 0, 1], [3, 3, 1], [0, 3, 1]])
    one, other = Flown(Flying, start), Flown(CompiledFlying, start)
    for flown in (one, other):
        for robot in range(3):
            flown.group.follow(robot, start[robot] + [[0, 0, 0], [1, 0, 0]])
    for k in range(12):
        position = start.copy()
        position[1, 0] = odd if k == 5 else 3.0
        with np.errstate(all="ignore"):
            agree(one, other, position, k * TICK_S)


def test_any_orders_come_to_the_same_in_any_state() -> None:
    """Also those that a group refuses, or gives nobody."""
    draw, count = np.random.default_rng(0), 4000
    start = draw.uniform(0, 3, (count, 3))
    one, other = Flown(Flying, start), Flown(CompiledFlying, start)
    states = draw.integers(0, len(MotionState), (2, count))
    since = np.where(draw.random(count) < 0.5, np.nan, draw.choice([0.0, 0.7, 0.9, 1.0], count))
    masks = draw.random((2, count)) < 0.5
    orders = draw.random((6, count)) < draw.choice([0.0, 0.3, 1.0], (6, count))
    position = np.where(draw.random((count, 1)) < 0.5, 0.0, draw.uniform(-0.3, 0.3, (count, 3)))
    for flown in (one, other):
        flown.group.automata = Automata(states[0], since, masks[0], masks[1], states[1])
        flown.group.orders[:] = orders
        flown.flying.step(position, 1.0, TICK_S)
        assert not flown.group.orders.any()
    mine, its = seen(one), seen(other)
    for name, value in mine.items():
        assert np.array_equal(value, its[name], equal_nan=value.dtype == np.float64), name
