"""Fleets: mixed robots, equal runs for equal seeds, the dwell rule on the clock of ticks."""

from __future__ import annotations

import hashlib
import math
from itertools import combinations

import numpy as np
import pytest
from msgspec.structs import replace

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.automaton import MotionState, Visit
from koord.runtime.motion.bodies import (
    Body,
    Car,
    DifferentialDrive,
    Drone,
    IdealBody,
    Level,
    PlannerName,
    Steering,
)
from koord.runtime.motion.clearance import clearance_of
from koord.runtime.motion.geometry import point_path
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.world import Point, World
from koord.sim.disturbances import Disturbances, Positioning, Wind
from koord.sim.fleet import Fleet, Placed
from koord.sim.sensing import FleetSensors
from koord.sim.separation import nearest
from koord.sim.squads import DeviceModel
from tests.runtime.motion.worlds import CLUTTERED
from tests.sampling import first

CAR = DeviceModel(Car(), PlannerName.RRT_CAR)
PURSUING = DeviceModel(Car(), PlannerName.RRT_CAR, steering=Steering.PURSUIT)
DRONE = DeviceModel(Drone(), PlannerName.RRT_DRONE)
ROVER = DeviceModel(DifferentialDrive(), PlannerName.RRT_DIFF)
POINT = DeviceModel(IdealBody(), PlannerName.STRAIGHT)
ROUGH = Disturbances(Positioning(0.01, 0.01, 20.0), 0.1, Wind((0.5, 0, 0), 0.5))

MIXED = [
    Placed(CAR, (-2.5, -2.5, 0.0), 0.5),
    Placed(DRONE, (2.5, -2.5, 0.0)),
    Placed(PURSUING, (-2.5, 3.0, 0.0), -1.0),
    Placed(DRONE, (2.5, 3.0, 0.0)),
    Placed(POINT, (0.0, -3.0, 0.5)),
    Placed(ROVER, (-3.0, 0.0, 0.0), 3.0),
]
GOALS: list[Point] = [
    (2.3, -1.5, 0),
    (-2, -1.5, 1),
    (-0.5, -1.5, 0),
    (-2, 3, 1.5),
    (2, -3, 1),
    (3, 0, 0),
]


def digest(robots: list[Placed], seed: int, seconds: float) -> str:
    """A digest of all that happens: positions and attitudes at every tick."""
    fleet = Fleet(CLUTTERED, robots, seed)
    found = hashlib.sha256()

    def watch(fleet: Fleet) -> None:
        found.update(fleet.positions().tobytes() + fleet.attitudes().tobytes())
        found.update(bytes(sensed.reached for sensed in fleet.sensed()))

    for k, goal in enumerate(GOALS[: len(robots)]):
        fleet.go_to(k, goal)
    fleet.advance_to(seconds, watch)
    return found.hexdigest()


def roughly(disturbances: Disturbances) -> list[Placed]:
    return [
        Placed(replace(p.model, disturbances=disturbances), p.start, p.heading_rad) for p in MIXED
    ]


@pytest.mark.parametrize("disturbances", first(1, [ROUGH, Disturbances()]))
def test_everybody_arrives(disturbances: Disturbances) -> None:
    fleet = Fleet(CLUTTERED, roughly(disturbances), 1)
    for k, goal in enumerate(GOALS):
        fleet.go_to(k, goal)
    fleet.advance_to(0.1)
    while not all(sensed.reached for sensed in fleet.sensed()):
        fleet.advance_to(fleet.now_s + 0.1)
        assert fleet.now_s < 60
    fleet.advance_to(fleet.now_s + 3)
    assert np.linalg.norm(fleet.positions() - np.array(GOALS), axis=1).max() < 0.15
    assert [sensed.planner for sensed in fleet.sensed()][:2] == [
        PlannerName.RRT_CAR,
        PlannerName.RRT_DRONE,
    ]


@pytest.mark.parametrize("level", first(2, [Level.SIMPLE, Level.FULL, Level.FAST]))
def test_who_meets_nobody_moves_as_if_it_were_alone(level: Level) -> None:
    """To the last bit: each process of a run simulates its own robot."""
    robots = [
        Placed(replace(p.model, level=level), (x, p.start[1], p.start[2]))
        for p in roughly(ROUGH)
        for x in (-6.0, -2.0, 2.0)
    ]

    def ways(only: int | None) -> list[bytes]:
        fleet = Fleet(World((-9, -9, 0), (9, 9, 3)), robots, 3, only)
        for k, robot in enumerate(robots):
            if only in (None, k):
                fleet.go_to(k, (robot.start[0] + 0.7, robot.start[1] + 0.3, robot.start[2]))
        found: list[list[bytes]] = [[] for _ in robots]

        def watch(fleet: Fleet) -> None:
            everything = np.hstack([fleet.positions(), fleet.attitudes()])
            for k, row in enumerate(everything):
                found[k].append(row.tobytes())

        fleet.advance_to(1.5, watch)
        return [b"".join(rows) for rows in found]

    together = ways(None)
    for k in range(len(robots)):
        assert ways(k)[k] == together[k], robots[k]


@pytest.mark.parametrize("level", [Level.FULL, Level.MUJOCO])
def test_cars_of_different_devices_do_not_pass_through_one_another(level: Level) -> None:
    if level is Level.MUJOCO:
        pytest.importorskip("mujoco")
    one = DeviceModel(Car(), PlannerName.STRAIGHT, level)
    other = DeviceModel(replace(Car(), cruise_mps=0.6), PlannerName.STRAIGHT, level)
    fleet = Fleet(World(), [Placed(one, (-1.5, 0, 0)), Placed(other, (1.5, 0, 0), math.pi)])
    fleet.go_to(0, (2.5, 0, 0))
    fleet.go_to(1, (-2.5, 0, 0))
    apart: list[float] = []
    fleet.advance_to(4.0, lambda f: apart.append(math.dist(*f.positions())))
    # Nose to nose their positions are as far apart as their fronts are from them, twice.
    assert min(apart) == pytest.approx(2 * (Car().middle_m + Car().length_m / 2), abs=0.03)


def test_equal_seeds_make_equal_runs() -> None:
    rough = roughly(ROUGH)
    one, again, other = (digest(rough, seed, 3.0) for seed in (1, 1, 2))
    assert one == again
    assert one != other


@pytest.mark.slow
def test_levels_change_what_happens_and_not_what_is_reached() -> None:
    ends = []
    for level in Level:
        one, other = (replace(model, level=level) for model in (CAR, DRONE))
        robots = [Placed(one, (-2.5, -2.5, 0.0), 0.5), Placed(other, (2.5, -2.5, 0.0))]
        fleet = Fleet(CLUTTERED, robots, 1)
        for k in (0, 1):
            fleet.go_to(k, GOALS[k])
        fleet.advance_to(30.0)
        ends.append(fleet.positions())
        assert all(sensed.reached for sensed in fleet.sensed())
    assert np.linalg.norm(ends[0] - ends[1], axis=1).max() < 0.1
    assert not np.array_equal(ends[0], ends[1])


@pytest.mark.parametrize("kind", [CAR, ROVER, DRONE, POINT])
def test_reached_comes_after_the_dwell_time_by_the_clock(kind: DeviceModel) -> None:
    visit = Visit(0.2, 0.75)
    timed = DeviceModel(kind.body, PlannerName.STRAIGHT, visit=visit)
    fleet = Fleet(World(), [Placed(timed, (0, 0, 0))])
    end = (1.5, 0.0, 0.0) if kind.body.ON_GROUND else (1.5, 0.0, 1.0)
    fleet.follow(0, [(0, 0, 0), end])
    since, reached = [], []

    def watch(fleet: Fleet) -> None:
        # The automaton sees positions at the beginnings of ticks.
        since.append(math.dist(fleet.sensed()[0].psn, end) <= visit.epsilon_m)
        reached.append(fleet.sensed()[0].reached)

    fleet.advance_to(6.0, watch)
    entered, told = since.index(True), reached.index(True)
    assert all(since[entered:])
    assert (told - 1 - entered) * TICK_S == pytest.approx(visit.dwell_s)


def test_an_ideal_robot_is_exactly_where_its_speed_takes_it() -> None:
    fleet = Fleet(World(), [Placed(POINT, (0, 0, 1))])
    fleet.follow(0, [(0, 0, 1), (3, 0, 1)])
    fleet.advance_to(2.0)
    assert fleet.positions()[0] == pytest.approx([2.0 * IdealBody().cruise_mps, 0, 1])
    fleet.advance_to(5.0)
    assert fleet.positions()[0].tolist() == [3, 0, 1]


@pytest.mark.parametrize("kind", [DRONE, POINT])
def test_nobody_jumps_to_a_path_that_begins_elsewhere(kind: DeviceModel) -> None:
    fleet = Fleet(World(), [Placed(kind, (-2, 0, 1))])
    fleet.follow(0, [(0, 1, 1), (2, 1, 1)])
    last = fleet.positions()
    steps = []

    def watch(fleet: Fleet) -> None:
        nonlocal last
        steps.append(float(np.linalg.norm(fleet.positions() - last)))
        last = fleet.positions()

    fleet.advance_to(9.0, watch)
    assert max(steps) < 1.3 * TICK_S
    assert fleet.positions()[0] == pytest.approx([2, 1, 1], abs=0.02)


def test_time_passes_in_whole_ticks() -> None:
    fleet = Fleet(World(), [Placed(POINT, (0, 0, 1))])
    for k in range(1, 31):
        fleet.advance_to(0.1 * k)
        assert fleet.ticks == 2 * k
    fleet.advance_to(3.03)
    assert fleet.ticks == 60
    fleet.advance_to(3.12)
    assert fleet.ticks == 62


def test_nobody_gets_closer_than_clear_paths_say() -> None:
    """Paths that are found clear are followed at once, and the robots stay apart all the time."""
    bodies: list[Body] = [Car(), Drone(), Drone()]
    clear = clearance_of(bodies, tracking_m=0.15)
    robots = [
        Placed(CAR, (-2.5, -3.0, 0.0), 0.0),
        Placed(DRONE, (-2.5, 0.0, 1.2)),
        Placed(DRONE, (2.5, 3.2, 1.2)),
    ]
    goals: list[Point] = [(2.5, -3.0, 0.0), (2.5, 0.0, 1.4), (-2.5, 3.2, 2.0)]
    fleet = Fleet(World(), robots, 3)
    paths = []
    for k, goal in enumerate(goals):
        fleet.go_to(k, goal)
    fleet.advance_to(0.1)
    for k in range(3):
        paths.append(tuple((x, y, z) for x, y, z in fleet.path(k).tolist()))
    assert all(clear.paths_clear(a, b) for a, b in combinations(paths, 2))
    least = [math.inf]
    off = [0.0]

    def watch(fleet: Fleet) -> None:
        pair = nearest(fleet.positions())
        assert pair is not None
        least.append(pair.distance_m)
        off.extend(point_path(p, np.array(paths[k])) for k, p in enumerate(fleet.positions()))

    fleet.advance_to(12.0, watch)
    assert max(off) < clear.tracking_m
    assert min(least) > clear.safety_m


def test_orders_of_all_kinds() -> None:
    fleet = Fleet(World(), [Placed(DRONE, (0, 0, 1)), Placed(POINT, (2, 0, 1))])
    for robot in (0, 1):
        fleet.follow(robot, [(0, 0, 1), (0, 3, 1)] if robot == 0 else [(2, 0, 1), (2, 3, 1)])
    fleet.advance_to(1.0)
    fleet.hold(0)
    fleet.stop(1)
    fleet.advance_to(3.0)
    states = [sensed.state for sensed in fleet.sensed()]
    assert states == [MotionState.HOLDING, MotionState.STOPPED]
    stopped = fleet.positions()[1].copy()
    fleet.release(0)
    fleet.follow(1, [(2, 0, 1), (2, 3, 1)])
    fleet.go_to(1, (2, 3, 1))
    held = fleet.positions()[0].copy()
    fleet.follow(0, [])
    fleet.advance_to(9.0)
    assert not fleet.sensed()[0].reached  # no path leads nowhere
    assert np.allclose(fleet.positions()[0], held, atol=0.1)
    assert np.array_equal(fleet.positions()[1], stopped)


def test_a_drone_follows_a_target_that_moves_every_round() -> None:
    """As LineForm has it: a new target ten times a second, no stop in between."""
    fleet = Fleet(World(), [Placed(DRONE, (-2, 0, 1))])
    speeds = []
    for k in range(1, 60):
        before = fleet.positions()[0]
        fleet.go_to(0, (min(-2 + 0.05 * k + 0.3, 1.0), 0.0, 1.0))
        fleet.advance_to(0.1 * k)
        speeds.append(float(np.linalg.norm(fleet.positions()[0] - before)) / 0.1)
    assert min(speeds[15:50]) > 0.25
    assert np.abs(fleet.positions()[0][1:] - [0, 1]).max() < 0.02


def test_robots_do_not_hang_on_each_other() -> None:
    """A drone far away changes nothing for another: noise and wind are each robot's own."""
    rough = DeviceModel(Drone(), PlannerName.STRAIGHT, disturbances=ROUGH)
    alone = Fleet(World(), [Placed(rough, (0, 0, 1))], 5)
    two = Fleet(World(), [Placed(rough, (0, 0, 1)), Placed(rough, (3, 3, 1))], 5)
    for fleet in (alone, two):
        fleet.go_to(0, (2, 2, 1))
        fleet.advance_to(4.0)
    assert alone.positions()[0] == pytest.approx(two.positions()[0], abs=1e-9)


def test_what_was_sensed_stays_as_it_was() -> None:
    """Columns say of each robot what it sensed then, whatever it is told and does since."""
    straight = DeviceModel(Car(), PlannerName.STRAIGHT)
    starts: list[Point] = [(-2, 0, 0), (-2, 2, 0)]
    fleet = Fleet(World(), [Placed(straight, start) for start in starts])
    fleet.go_to(1, (1e6, 0.0, 0.0))
    fleet.advance_to(0.1)
    seen = fleet.sensed()
    before = list(seen)
    assert before[1].plight is not None
    assert list(FleetSensors.of(before)) == before
    assert seen.on_the_way.tolist() == [False, False]
    fleet.go_to(0, (0.0, 0.0, 0.0))
    fleet.go_to(1, (0.0, 2.0, 0.0))
    fleet.advance_to(0.5)
    assert list(seen) == before
    now = fleet.sensed()
    assert now.on_the_way.tolist() == [True, True]
    assert now[1].plight is None
    assert now[0].psn != before[0].psn


class Passing:
    """Notes where robots were at ticks that nobody looks at."""

    def __init__(self) -> None:
        self.places: list[bytes] = []

    def is_looked_at(self, time_s: float) -> bool:
        return False

    def passed(self, time_s: float, positions: Floats) -> None:
        self.places.append(positions.tobytes())


@pytest.mark.parametrize(
    ("models", "at_once"),
    [
        ((CAR, DRONE), True),
        ((ROVER,), True),
        ((PURSUING, replace(DRONE, disturbances=ROUGH)), False),
        ((replace(CAR, disturbances=ROUGH), DRONE), True),
        ((CAR, DRONE, ROVER), False),
        ((replace(CAR, level=Level.MUJOCO), replace(DRONE, level=Level.MUJOCO)), False),
    ],
)
def test_ticks_that_nobody_looks_at_are_those_that_are_looked_at(
    models: tuple[DeviceModel, ...], at_once: bool
) -> None:
    """Squads make several of them, if none has to wait for another."""
    robots = [
        Placed(models[k % len(models)], (1.5 * k - 3, -2.0, models[k % len(models)] is DRONE))
        for k in range(4)
    ]
    one, other = (Fleet(World((-9, -9, 0), (9, 9, 3)), robots, 7) for _ in range(2))
    passing, seen, last = Passing(), [], []
    for fleet in (one, other):
        for robot in range(len(robots)):
            fleet.go_to(
                robot, (1.5 * robot - 2.5, 1.0, 0.0 if robots[robot].model.body.ON_GROUND else 1.0)
            )
    for k in range(1, 21):
        one.advance_to(0.2 * k, lambda fleet: seen.append(fleet.positions().tobytes()))
        other.advance_to(0.2 * k, lambda fleet: last.append(fleet.positions().tobytes()), passing)
        assert one.attitudes().tobytes() == other.attitudes().tobytes()
        tilting = np.arange(len(robots))
        assert np.array_equal(one.tilts(tilting), other.tilts(tilting))
    if at_once:
        assert len(passing.places) == 60
        assert seen[3::4] == last
        assert [place for k, place in enumerate(seen) if k % 4 < 3] == passing.places
    else:
        assert passing.places == []
        assert seen == last
