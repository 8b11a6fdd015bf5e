"""Machine code of whole ticks of drones: to the last bit what their squads do on NumPy."""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.api.fitting import FitRequest, fit
from koord.api.sim_setup import simulation
from koord.runtime.configuration.checking import load
from koord.runtime.motion.arrays import Floats, lengths
from koord.runtime.motion.automaton import Visit
from koord.runtime.motion.bodies import Drone, PlannerName
from koord.runtime.motion.flying import Flying
from koord.runtime.motion.group import TICK_S, Group
from koord.runtime.motion.planners import planner
from koord.runtime.motion.world import World
from koord.sim.disturbances import Disturbances, Wind, spawned
from koord.sim.fleet import Fleet, Placed
from koord.sim.measuring import Figures
from koord.sim.run_log import tilts_of
from koord.sim.running import Simulation, run
from koord.sim.squad_kernel import FusedDrones
from koord.sim.squads import DeviceModel, Engines, SquadSetup
from koord.sim.vehicles.drones import DroneSquad
from koord.sim.vehicles.quadrotors import Quadrotors
from koord.syntax.source import Source

WORLD = World((-50, -50, 0), (50, 50, 20))
COORDINATES = st.sampled_from([0.0, 0.1, 0.5, 2.0, 5.0])
PLACES = st.tuples(COORDINATES, COORDINATES, COORDINATES)
ORDERS = st.one_of(
    st.tuples(st.just("go_to"), PLACES),
    st.tuples(st.sampled_from(["hold", "release", "release", "stop"]), st.none()),
)
#: Orders with the drones that are given them, and how many ticks are made then.
SPELLS = st.tuples(st.lists(st.tuples(st.integers(0, 19), ORDERS), max_size=7), st.integers(1, 7))


def setup(start: Floats, air: tuple[float, float, float], takes_s: float) -> SquadSetup:
    drone, visit = Drone(), Visit(0.2, 0.3)
    disturbances = Disturbances(wind=Wind(air))
    model = DeviceModel(drone, PlannerName.STRAIGHT, visit=visit, disturbances=disturbances)
    seeds = [spawned(np.random.SeedSequence(0), k) for k in range(len(start))]
    made = planner(PlannerName.STRAIGHT, WORLD, drone)
    group = Group(len(start), drone, WORLD, made, visit, [0] * len(start), takes_s=takes_s)
    return SquadSetup(model, start, np.zeros(len(start)), Engines(WORLD), group, seeds, seeds)


def both(
    start: Floats, air: tuple[float, float, float] = (0.0, 0.0, 0.0), takes_s: float = 0.0
) -> tuple[DroneSquad, FusedDrones]:
    """A squad on NumPy, and one of machine code."""
    plain = setup(start, air, takes_s)
    vehicles = Quadrotors(Drone(), start, WORLD.ground)
    slow = DroneSquad(plain, vehicles, Flying(plain.group, start))
    return slow, FusedDrones(setup(start, air, takes_s))


def agree(slow: DroneSquad, quick: FusedDrones, now_s: float, ticks: int) -> None:
    times_s, places = [now_s + k * TICK_S for k in range(ticks)], []
    for time_s in times_s:
        slow.tick(time_s)
        places.append(slow.truth()[0].copy())
    found = quick.ticks(times_s)
    assert np.array_equal(places, found, equal_nan=True)
    one, other = seen(slow), seen(quick)
    for name, value in one.items():
        assert np.array_equal(value, other[name], equal_nan=value.dtype == np.float64), name
    assert slow.group.targets == quick.group.targets
    assert np.array_equal(tilts_of(slow.attitude()), quick.tilts(), equal_nan=True)
    assert np.array_equal(short_of(slow), quick.short_m(), equal_nan=True)


def short_of(squad: DroneSquad) -> Floats:
    left = lengths(squad.fixes(0.0)[0] - squad.group.routes.end) - squad.group.visit.epsilon_m
    return np.maximum(left, 0.0)


def seen(squad: DroneSquad | FusedDrones) -> dict[str, Any]:
    group = squad.group
    state = {name: getattr(squad.vehicles.state, name) for name in ("velocity", "rates", "steady")}
    automata = {
        name: getattr(group.automata, name) for name in type(group.automata).__struct_fields__
    }
    return {
        **state,
        **automata,
        "thrust": squad.vehicles.state.thrust,
        "truth": squad.truth()[0],
        "fixes": squad.fixes(0.0)[0],
        "attitude": squad.attitude(),
        "rest": squad.flying.rest,
        "s": group.s,
        "speed": group.speed,
    }


@given(
    st.integers(1, 20),
    st.lists(SPELLS, min_size=1, max_size=6),
    st.sampled_from([(0.0, 0.0, 0.0), (-0.0, 1.5, 0.0)]),
    st.integers(0, 99),
)
def test_whatever_is_ordered_both_do_the_same(
    count: int,
    spells: list[tuple[list[tuple[int, tuple[str, Any]]], int]],
    air: tuple[float, float, float],
    seed: int,
) -> None:
    start = np.round(np.random.default_rng(seed).uniform(0, 3, (count, 3)), 1)
    slow, quick = both(start, air)
    now_s = 0.0
    for orders, ticks in spells:
        for robot, (what, where) in orders:
            for squad in (slow, quick):
                given = () if where is None else (where,)
                getattr(squad.group, what)(robot % count, *given)
        agree(slow, quick, now_s, ticks)
        now_s += ticks * TICK_S


@pytest.mark.parametrize("ticks", [1, 2, 7])
def test_who_arrives_has_been_there_for_as_long(ticks: int) -> None:
    """However many ticks are made in one call, each is at its own time."""
    slow, quick = both(np.array([[0.0, 0, 1], [0, 3, 1]]))
    for k in range(0, 84, ticks):
        if k in (0, 42):
            for squad in (slow, quick):
                squad.group.go_to(0, (0.5 + k, 0.0, 1.0))
                squad.group.go_to(1, (0.0, 3.1, 1.0))
        agree(slow, quick, k * TICK_S, ticks)
    assert quick.group.automata.reached.tolist() == [False, True]


def test_who_waits_for_a_plan_gets_it_when_its_time_has_passed() -> None:
    """However many ticks are made in one call."""
    start = np.array([[2.0 * k, 0, 1] for k in range(3)])
    slow, quick = both(start, takes_s=3 * TICK_S)
    for squad in (slow, quick):
        for k, (x, y, z) in enumerate(start.tolist()):
            # Beyond the world: no way is straight, and the planner finds none.
            squad.group.go_to(k, (x, y + 1000.0 * (k > 0), z))
    agree(slow, quick, 0.0, 2)
    assert len(quick.group.plights) == 0
    agree(slow, quick, 2 * TICK_S, 5)
    assert len(quick.group.plights) == 2


@pytest.mark.parametrize("odd", [math.nan, math.inf, 1e200])
def test_states_that_somebody_has_set_are_flown_from(odd: float) -> None:
    start = np.array([[0.0, 0, 1], [3, 3, 1], [0, 3, 1]])
    slow, quick = both(start)
    agree(slow, quick, 0.0, 3)
    for squad in (slow, quick):
        other = Quadrotors(Drone(), start + 1.0, WORLD.ground).state
        other.position[0, 1] = odd
        squad.vehicles.state = other
    assert np.array_equal(tilts_of(slow.attitude()), quick.tilts())
    with np.errstate(all="ignore"):
        for k in range(2):
            agree(slow, quick, (3 + 3 * k) * TICK_S, 3)


def test_what_was_seen_stays_as_it_was() -> None:
    _, quick = both(np.array([[0.0, 0, 1], [3, 3, 1]]), (1.0, 0.0, 0.0))
    quick.group.go_to(0, (4.0, 4.0, 4.0))
    quick.tick(0.0)
    before = quick.truth()[0], quick.fixes(0.0)[0], quick.attitude()
    kept = [array.copy() for array in before]
    quick.ticks([TICK_S, 2 * TICK_S, 3 * TICK_S])
    assert all(map(np.array_equal, before, kept))
    short_m = quick.short_m().copy()
    quick.group.follow(1, np.array([[3.0, 3, 1], [9, 9, 9]]))  # further than it had to go
    assert (quick.short_m() > short_m).tolist() == [False, True]
    assert not np.array_equal(quick.truth()[0], kept[0])


class Passer:
    """Somebody who looks at one tick in three, and is told of the others."""

    def __init__(self) -> None:
        self.seen: list[tuple[float, bytes]] = []

    def is_looked_at(self, time_s: float) -> bool:
        return round(time_s / TICK_S) % 3 == 0

    def passed(self, time_s: float, positions: Floats) -> None:
        self.seen.append((time_s, positions.tobytes()))

    def watch(self, fleet: Fleet) -> None:
        self.seen.append((fleet.now_s, fleet.positions().tobytes()))


@pytest.mark.parametrize("kinds", [1, 2])
def test_fleets_make_ticks_at_once_and_each_by_itself(
    kinds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    models = [DeviceModel(Drone(cruise_mps=1.0 + k), PlannerName.STRAIGHT) for k in range(kinds)]
    places = [(2.0 * k, 0.0, 0.5 * (k % 3)) for k in range(5)]

    def ways(*, at_once: bool) -> tuple[type, list[Any]]:
        fleet = Fleet(WORLD, [Placed(models[k % kinds], at) for k, at in enumerate(places)], 7)
        passer = Passer()
        for k, (x, y, z) in enumerate(places):
            fleet.go_to(k, (x + 0.5, y + 1.0, z + 0.5))
        for until_s in (0.1, 0.5, 1.7):
            fleet.advance_to(until_s, passer.watch, passer if at_once else None)
            fleet.follow(0, [(until_s, 1.0, 1.0)])
        (squad, _), *_ = fleet._squads
        sensed = fleet.sensed()
        more = fleet.attitudes(), sensed.position, sensed.short_m, sensed.state, sensed.reached
        return type(squad), [*passer.seen, *(array.tobytes() for array in more)]

    kind, fused = ways(at_once=True)
    assert kind is FusedDrones
    assert ways(at_once=False) == (kind, fused)
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    assert ways(at_once=True) == (DroneSquad, fused)


#: Drones that fly to and fro, two of them towards each other.
LINES = """\
using Motion:
    sensors:
        pos psn
        bool reached
    actuators:
        pos target
{contract}local:
    int k = 0
    pos home
init:
    home = Motion.psn
Go:
    pre: Motion.reached and k < 3
    eff:
        k = k + 1
        Motion.target = home + pos(0.7 * k, 0.0 - pid * 1.9, 0.0)
invariant Counted: k <= 3
"""
CONTRACT = "    contract Low:\n        ensures: psn'.x <= 1.0\n"
DRONES = """\
num_robots: 3
delta: {delta}
positions: {{0: [0, 0, 1], 1: [0, 2, 1], 2: [0, 7, 1]}}
device: {{bot_type: QUAD, planner: STRAIGHT}}
world: {{bounds: {{low: [-4, -4, 0], high: [9, 9, 3]}}}}
"""


@pytest.mark.parametrize("contract", ["", CONTRACT])
@pytest.mark.parametrize("delta", ["0.1", "0.15", "0.2", "0.25"])
def test_runs_are_recorded_and_watched_the_same_without_llvmlite(
    contract: str, delta: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether poses are due within rounds, or at their ends, and whether or not claims are."""

    def made() -> tuple[Figures, list[Any], Counter[str], int]:
        texts = LINES.format(contract=contract), DRONES.format(delta=delta)
        sources = Source("one.krd", texts[0]), load(Source("fleet.yaml", texts[1]))
        one = simulation(fit(FitRequest(*sources, (), {})), Simulation, keep_going=True)
        calls: Counter[str] = Counter()
        for name in ("tick", "passed"):
            monkeypatch.setattr(one, name, counted(getattr(one, name), calls, name))
        one.begin()
        for _ in run(one, 4.0):
            pass
        log = one.recording
        poses = [pose.tobytes() for pose in log.poses]
        paths = [(path.time_s, path.robot, path.points.tobytes()) for path in log.paths]
        told = list(log.times_s), poses, log.separations_m.tobytes(), log.violations, paths
        return one.figures(), [*told, one.broken], calls, round(one.time_s / TICK_S)

    figures, told, calls, ticks = made()
    assert {broken.claim for broken in told[-1]} == {
        "separation",
        *(["contract Low"] if contract else []),
    }
    assert calls["tick"] + calls["passed"] == ticks
    # The first tick of two; those at 0.1 and 0.2 s are recorded.
    few = {"0.1": 1 / 2, "0.15": 1 / 3, "0.2": 1 / 2, "0.25": 2 / 5}
    assert calls["passed"] == pytest.approx(0 if contract else few[delta] * ticks, abs=4)
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    plain, also, calls, _ = made()
    assert (plain, also) == (figures, told)
    assert calls["passed"] == 0


def counted(function: Callable[..., Any], calls: Counter[str], name: str) -> Callable[..., Any]:
    def called(*arguments: Any) -> Any:
        calls[name] += 1
        return function(*arguments)

    return called
