"""Ticks of squads of cars and rovers by machine code: to the last bit what NumPy computes."""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.bodies import Body, Car, DifferentialDrive, PlannerName, Steering
from koord.runtime.motion.driving import Driving, Turning
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.planning import PlanningEffort
from koord.runtime.motion.world import World
from koord.sim.disturbances import Disturbances, Positioning
from koord.sim.squads import DeviceModel, Engines, WheeledSquad, squad

legs = pytest.importorskip("koord.sim.vehicles.compiled_legs")

WORLD = World((-30, -30, 0), (30, 30, 3))
MOST = 9

PLACES = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.just(0.0))
ORDERS = st.one_of(
    st.tuples(st.just("follow"), st.lists(PLACES, max_size=5)),
    st.tuples(st.just("curve"), st.tuples(st.floats(0.2, 3), st.sampled_from([-1.0, 1.0]))),
    st.tuples(st.just("go_to"), PLACES),
    st.tuples(st.sampled_from(["hold", "release", "release", "stop"]), st.none()),
)
TICKS = st.tuples(
    st.lists(st.tuples(st.integers(0, MOST - 1), ORDERS), max_size=3), st.integers(1, 30)
)


#: Bodies with a law of motion; of differential drives there is one.
Law = tuple[Body, PlannerName, Steering]
LAW = [
    (Car(), PlannerName.RRT_CAR, Steering.PREDICTIVE),
    (Car(), PlannerName.RRT_CAR, Steering.PURSUIT),
    (DifferentialDrive(), PlannerName.RRT_DIFF, Steering.PURSUIT),
]
LAWS = pytest.mark.parametrize("law", LAW, ids=["predictive", "pursuit", "differential"])


def made(count: int, seed: int, noise_m: float, law: Law, *, compiled: bool) -> WheeledSquad:
    """Robots that stand in a row, and some of them the other way round."""
    body, planner, steering = law
    model = DeviceModel(
        body,
        planner,
        steering=steering,
        disturbances=Disturbances(Positioning(noise_m, noise_m / 5)),
        effort=PlanningEffort(),
    )
    start = np.zeros((count, 3))
    start[:, 1] = 2.5 * np.arange(count) - 10
    heading = np.random.default_rng(seed).uniform(-3, 3, count)
    seeds = np.random.SeedSequence(seed).spawn(count)
    of = "cars" if isinstance(body, Car) else "differential"
    with patch(f"koord.sim.vehicles.{of}.is_installed", lambda: compiled):
        found = squad(model, start, heading, seeds, Engines(WORLD))
    assert isinstance(found, WheeledSquad)
    assert isinstance(found, legs.DrivenSquad) == compiled
    return found


def order(of: WheeledSquad, robot: int, what: str, where: Any) -> None:
    group, (position, heading) = of.group, of.truth()
    here = position[robot]
    match what, where:
        case "follow", [*places]:
            path = np.array(places, dtype=np.float64).reshape(-1, 3)
            group.follow(robot, path + here * (len(places) > 0), heading[robot], here)
        case "curve", (radius_m, way):
            angles = np.linspace(0, 2.5, 60)
            bend = radius_m * np.column_stack([np.sin(angles), 1 - np.cos(angles), 0 * angles])
            cosine, sine = way * np.cos(heading[robot]), way * np.sin(heading[robot])
            turned = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
            group.follow(robot, bend @ turned + here, heading[robot], here)
        case "go_to", (x, y, z):
            group.go_to(robot, (float(x + here[0]), float(y + here[1]), z))
        case _:
            getattr(group, what)(robot)


def seen(of: WheeledSquad) -> dict[str, NDArray[Any]]:
    group, law = of.group, of.tracker
    if isinstance(law, Turning):
        kept = {"pace": law.speed, "turn": law.turn, "turns": law.turns}
    else:
        assert isinstance(law, Driving)
        kept = {"inputs": law.inputs}
        if law.controller is not None:
            kept["kept"] = law.controller.kept
    automata, (position, heading) = group.automata, of.truth()
    return {
        "position": position,
        "heading": heading,
        "speed": of.vehicles.speed,
        "s": group.s,
        "wanted": group.speed,
        "way": law.legs.way,
        "waited": law.legs.waited,
        "command": of._command,
        **kept,
        "state": automata.state,
        "since_s": automata.since_s,
        "reached": automata.reached,
        "has_route": automata.has_route,
        "resumes": automata.resumes,
    }


def agree(one: WheeledSquad, other: WheeledSquad, now_s: float) -> None:
    """Both make a tick, and are left in the same state; zeros may differ by their signs."""
    one.tick(now_s)
    other.tick(now_s)
    mine, its = seen(one), seen(other)
    for name, value in mine.items():
        assert value.dtype == its[name].dtype, name
        assert np.array_equal(value, its[name], equal_nan=value.dtype == np.float64), name
    assert one.group.targets == other.group.targets


@pytest.mark.slow
@settings(max_examples=15)
@given(
    st.integers(1, MOST),
    st.lists(TICKS, min_size=1, max_size=6),
    st.integers(0, 99),
    st.sampled_from([0.0, 0.01, 0.1]),
    st.sampled_from(LAW),
)
def test_whatever_is_ordered_both_drive_the_same(
    count: int,
    ticks: list[tuple[list[tuple[int, tuple[str, Any]]], int]],
    seed: int,
    noise: float,
    law: Law,
) -> None:
    one, other = (made(count, seed, noise, law, compiled=on) for on in (False, True))
    tick = 0
    for orders, times in ticks:
        for robot, (what, where) in orders:
            for of in (one, other):
                order(of, robot % count, what, where)
        for _ in range(times):
            agree(one, other, tick * TICK_S)
            tick += 1


@LAWS
def test_routes_are_driven_to_their_ends(law: Law) -> None:
    """There and back, with wheels or robots that are turned first, a hold, and a pause."""
    one, other = (made(3, 5, 0.0, law, compiled=compiled) for compiled in (False, True))
    for of in (one, other):
        order(of, 0, "go_to", (1.5, 1.0, 0.0))
        order(of, 1, "curve", (1.0, 1.0))
        position, heading = of.truth()
        cosine, sine = np.cos(heading[2]), np.sin(heading[2])
        way = np.array([[1.0, 0, 0], [0.2, 0.3, 0]]) @ [
            [cosine, sine, 0],
            [-sine, cosine, 0],
            [0, 0, 1],
        ]
        of.group.follow(2, np.vstack([position[2:3], position[2] + way]), heading[2], position[2])
    states: list[MotionState] = []
    turned_at_rest, ways = False, set()
    for tick in range(400):
        if tick in (30, 50):
            for of in (one, other):
                order(of, 1, "hold" if tick == 30 else "release", None)
        before = other.truth()[0].copy()
        agree(one, other, tick * TICK_S)
        own = other.tracker
        ways |= set(own.legs.way.tolist())
        rests = np.abs(other.truth()[0] - before).max(1) < 1e-9
        if isinstance(own, Turning):
            turned_at_rest |= bool((rests & own.turns & (np.abs(own.turn) > 0.1)).any())
        else:
            assert isinstance(own, Driving)
            turned_at_rest |= bool((rests & (np.abs(own.inputs[:, 1]) > 0.1)).any())
        state = other.group.state(1)
        if not states or states[-1] is not state:
            states.append(state)
    assert states[:4] == [
        *(MotionState.MOVING, MotionState.HOLDING, MotionState.MOVING, MotionState.IDLE),
    ]
    assert ways == ({-1.0, 1.0} if isinstance(law[0], Car) else {1.0})
    assert turned_at_rest
    assert other.group.automata.reached.all()


@LAWS
def test_who_stands_at_the_end_and_is_not_there_finds_another_way(law: Law) -> None:
    one, other = (made(1, 5, 0.0, law, compiled=compiled) for compiled in (False, True))
    for of in (one, other):
        order(of, 0, "follow", [(0.0, 0.0, 0.0), (0.02, 0.0, 0.0)])
    asked = 0
    for tick in range(80):
        for of in (one, other):
            of.group.automata.reached[:] = False
            of.group.automata.since_s[:] = np.nan
            of.group.visit = type(of.group.visit)(1e-4, 0.5)
        agree(one, other, tick * TICK_S)
        asked += bool(other.group.targets)
    assert asked > 0


@pytest.mark.parametrize("odd", [np.nan, np.inf, 1e200])
@LAWS
def test_odd_measurements_are_no_difference(odd: float, law: Law) -> None:
    one, other = (made(3, 5, 0.0, law, compiled=compiled) for compiled in (False, True))
    for of in (one, other):
        for robot in range(3):
            order(of, robot, "curve", (1.0, 1.0))
    for tick in range(12):
        for of in (one, other):
            position, heading = (part.copy() for part in of.truth())
            if tick in (4, 5):
                position[1, 0] = odd
            with np.errstate(all="ignore"):
                of._track(position, heading, tick * TICK_S, acts=tick % 2 == 0)
        mine, its = seen(one), seen(other)
        for name, value in mine.items():
            assert np.array_equal(value, its[name], equal_nan=value.dtype == np.float64), name
