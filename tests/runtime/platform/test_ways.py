"""Ways of driven vehicles and their guardians, in wind and noise, in virtual time."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from koord.api.fitting import Fitted, fit, fit_request
from koord.api.platforms import pilot_settings
from koord.runtime.drivers.driver import Device
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Condition, Order
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import VEHICLES, PlannerName
from koord.runtime.motion.field import Field, field
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.planners import planner
from koord.runtime.motion.planning import PlanningEffort, Pose, Room
from koord.runtime.motion.world import Box, Point, World
from koord.runtime.platform.pilots import pilot
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.sim.driver import vehicle
from koord.sim.scene import TRACKING_M
from tests.sampling import first

EXAMPLES = Path(__file__).parents[3] / "specs" / "examples"

BOUNDS = (-4.0, -4.0, 0.0), (4.0, 4.0, 3.0)

FEW = PlanningEffort(steps=400, star_steps=30)


def mixed() -> Fitted:
    files = str(EXAMPLES / "task.krd"), str(EXAMPLES / "task_mixed.yaml")
    return fit(fit_request(*files, None, None, 0, None))


class Going:
    """A vehicle of a dry run, with its pilot and its guardian, that has been started."""

    def __init__(self, of: Fitted, pid: int, seed: int) -> None:
        self.now = 100.0
        self.world, placed = of.scene.world, of.scene.robots[pid]
        told, body = of.configuration.robots[pid].vehicle, placed.model.body
        x, y, _ = placed.start
        start, heading = (x, y, self.world.ground), placed.heading_rad
        device = Device(pid, told, self.world, start, heading, seed)
        guarded = Setup(told.safety, field(self.world, flat=body.ON_GROUND), 0.1)
        steersman = pilot(pilot_settings(of, pid), self.world, seed)
        self.driven = DrivenVehicle(vehicle(device), steersman, guarded, self.now)
        self.tick()
        self.driven.order(Order.ARM, self.now)
        self.tick(30)
        self.driven.order(Order.START, self.now)
        assert self.driven.mode is Mode.RUNNING

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            self.now += TICK_S
            self.driven.tick(self.now, 0.05)

    def way(self, goal: Point, seed: int) -> Floats:
        """The way that its program would get now."""
        sensors = self.driven.sensors
        found = self.driven.pilot.planner.plan(Pose(sensors.psn, sensors.heading_rad), goal, seed)
        assert found is not None, (sensors.psn, goal)
        return found

    def arrive(self, most_s: float = 60.0) -> None:
        self.tick()
        until_s = self.now + most_s
        while not self.driven.sensors.reached:
            assert self.now < until_s, self.driven.notes
            self.tick()

    @property
    def conditions(self) -> set[Condition]:
        """Why it was held so far, but for rounds that were missing at first."""
        told = {note.condition for note in self.driven.notes if note.condition is not None}
        return told - {Condition.ROUND}


def nearest(free: Field, path: Floats) -> float:
    """How near a path comes to walls and obstacles, in m."""
    shares = np.linspace(0.0, 1.0, 60)[:, None]
    legs = [a + shares * (b - a) for a, b in pairwise(path)]
    return min(free.clearance(x, y, z) for x, y, z in np.concatenate(legs).tolist())


@pytest.mark.parametrize("told", ["a path", "a target"])
@pytest.mark.parametrize("seed", first(1, range(3)))
def test_no_drone_in_wind_is_held_for_the_way_that_it_was_planned(seed: int, told: str) -> None:
    """(P-WAY) The straight line past the box is nearer to it than the guardian lets it be."""
    of = mixed()
    one = Going(of, 1, seed)
    for goal in of.scene.world.tasks[1], of.scene.world.tasks[5]:
        if told == "a path":
            one.driven.follow([(x, y, z) for x, y, z in one.way(goal, seed).tolist()])
        else:
            one.driven.go_to(goal)
        one.arrive()
    assert one.conditions == set()


def test_no_car_is_held_for_the_way_that_it_was_planned() -> None:
    """(P-WAY)"""
    of = mixed()
    for seed in range(2):
        one = Going(of, 0, seed)
        for goal in of.scene.world.tasks[4], of.scene.world.tasks[2]:
            one.driven.follow([(x, y, z) for x, y, z in one.way(goal, seed).tolist()])
            one.arrive()
        assert one.conditions == set()


@pytest.mark.parametrize("name", [name for name in PlannerName if "CAR" not in name.value])
def test_ways_keep_the_margin_and_more_where_there_is_room(name: PlannerName) -> None:
    """(P-WAY)"""
    kind = "DIFF" if "DIFF" in name.value else "QUAD"
    body = VEHICLES[kind].body
    height = 0.0 if body.ON_GROUND else 1.0
    wall, opposite = (
        Box((-0.3, -4.0, 0.0), (0.3, -0.53, 3.0)),
        Box((-0.3, 0.53, 0.0), (0.3, 4.0, 3.0)),
    )
    one_wall, a_gap = (World(*BOUNDS, walls) for walls in ((wall,), (wall, opposite)))
    room = Room(0.4, TRACKING_M)
    start, goal = (-2.0, -0.9, height), (2.0, -0.9, height)
    for world, keeps_m in (one_wall, room.wide_m), (a_gap, room.least_m):
        free = field(world, flat=body.ON_GROUND)
        made = planner(name, world, body, room=room)
        found = [made.plan(Pose(start), goal, seed) for seed in range(2)]
        if name is PlannerName.STRAIGHT:
            assert found == [None] * 2  # the wall is in the way
            continue
        for path in found:
            assert path is not None
            assert nearest(free, path) >= keeps_m - 0.02  # between the states that were checked


@pytest.mark.parametrize("name", list(PlannerName))
def test_there_is_no_way_to_where_the_guardian_lets_nobody_be(name: PlannerName) -> None:
    """(P-WAY)"""
    kind = next(kind for kind in ("CAR", "DIFF", "QUAD") if name in VEHICLES[kind].planners)
    body = VEHICLES[kind].body
    height = 0.0 if body.ON_GROUND else 1.0
    world = World(*BOUNDS)
    near, far = (3.3, 0.0, height), (3.1, 0.0, height)
    as_close_as_bodies = planner(name, world, body, FEW)
    assert as_close_as_bodies.plan(Pose((0.0, 0.0, height)), near, 1) is not None
    made = planner(name, world, body, FEW, room=Room(0.8, TRACKING_M))
    assert made.plan(Pose((0.0, 0.0, height)), near, 1) is None
    found = made.plan(Pose((0.0, 0.0, height)), far, 1)
    assert found is not None
    assert nearest(field(world, flat=body.ON_GROUND), found) >= 0.8 - 0.02


def test_who_is_too_close_already_gets_a_way_from_there() -> None:
    """(P-WAY)"""
    world = World(*BOUNDS)
    body = VEHICLES["QUAD"].body
    made = planner(PlannerName.RRT_DRONE, world, body, FEW, room=Room(0.5, TRACKING_M))
    path = made.plan(Pose((3.65, 0.0, 1.0)), (0.0, 0.0, 1.0), 1)
    assert path is not None
    assert tuple(path[0]) == (3.65, 0.0, 1.0)


@pytest.mark.parametrize("name", [PlannerName.STRAIGHT, PlannerName.RRT_DRONE])
def test_who_is_measured_below_the_ground_it_stands_on_gets_a_way(name: PlannerName) -> None:
    """(P-WAY)"""
    made = planner(name, World(), VEHICLES["QUAD"].body, FEW)
    path = made.plan(Pose((0.0, 0.0, -0.02)), (1.0, 0.0, 1.0), 1)
    assert path is not None
    assert path.tolist() == [[0.0, 0.0, -0.02], [1.0, 0.0, 1.0]]


def test_who_is_measured_below_the_ground_is_not_held_for_that() -> None:
    """(P-WAY) Its way begins there, and what it wishes for does not."""
    one = Going(mixed(), 1, 0)
    x, y, _ = one.driven.sensed.position_m
    one.driven.follow([(x, y, -0.03), (2.5, -1.0, 1.5)])
    one.arrive()
    assert one.conditions == set()
