"""Driven vehicles in virtual time: pilot, guardian and simulated driver, of every type."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import cast

import numpy as np
import pytest
from msgspec.structs import replace

from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, Driver, DriverError
from koord.runtime.drivers.setpoints import Arm, Drive, Sensed, Track, Velocity
from koord.runtime.guardian.conditions import Setup
from koord.runtime.guardian.events import Condition, Order, Other
from koord.runtime.guardian.limits import usual
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.bodies import VEHICLES, PlannerName
from koord.runtime.motion.field import field
from koord.runtime.motion.geometry import point_path
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.planners import planner
from koord.runtime.motion.planning import PlanningEffort, Pose
from koord.runtime.motion.world import Box, Point, World
from koord.runtime.platform.pilots import PilotSettings, pilot
from koord.runtime.platform.rising import RisingPlanner
from koord.runtime.platform.vehicle import DrivenVehicle
from koord.runtime.protocol.events import Reason
from koord.sim.driver import DEAD_MAN_S, SimulatedPoint, SimulatedVehicle, point, vehicle
from koord.sim.fleet import Fleet, Placed
from koord.sim.scene import TRACKING_M, device_model

WORLD = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0))
KINDS = sorted(VEHICLES)


class Guarded:
    """One driven vehicle, with a clock of its own."""

    def __init__(
        self,
        kind: str,
        start: Point = (0.0, 0.0, 0.0),
        world: World = WORLD,
        takeoff_height_m: float | None = None,
        made: Callable[[Device], SimulatedVehicle] = vehicle,
    ) -> None:
        self.now = 100.0
        self.round_age_s: float | None = 0.05
        self.reason: Reason | None = None
        told = Vehicle(kind, kind, planner=VEHICLES[kind].planners[0])
        self.model = device_model(told)
        body = self.model.body
        device = Device(0, told, world, start)
        settings = PilotSettings(body, self.model.planner)
        guarded = Setup(usual(body), field(world, flat=body.ON_GROUND), 0.1)
        driver = made(device)
        driver.capabilities = replace(driver.capabilities, takeoff_height_m=takeoff_height_m)
        steersman = pilot(settings, world, wishes=driver.capabilities.wishes)
        self.driven = DrivenVehicle(driver, steersman, guarded, self.now)

    def tick(self, times: int = 1, others: tuple[Other, ...] = ()) -> None:
        for _ in range(times):
            self.now += TICK_S
            self.driven.tick(self.now, self.round_age_s, self.reason, others)

    def until(self, condition: Callable[[], bool], most_s: float = 60.0) -> float:
        """Let time pass until something holds; return how many seconds it took."""
        begun = self.now
        while not condition():
            assert self.now - begun < most_s, (self.mode, self.here, self.driven.notes)
            self.tick()
        return self.now - begun

    def started(self) -> Guarded:
        self.tick()
        self.driven.order(Order.ARM, self.now)
        self.tick(30)
        self.driven.order(Order.START, self.now)
        assert self.mode is Mode.RUNNING, self.driven.notes
        return self

    @property
    def mode(self) -> Mode:
        return self.driven.mode

    @property
    def here(self) -> Point:
        return self.driven.sensed.position_m


def goal_of(kind: str) -> Point:
    return (2.0, 1.0, 1.0 if kind in ("QUAD", "IDEAL") else 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_it_goes_where_it_is_told_along_its_path(kind: str) -> None:
    one = Guarded(kind).started()
    goal = goal_of(kind)
    one.driven.go_to(goal)
    one.tick()
    path = one.driven.pilot.group.path(0)
    furthest = 0.0
    while not one.driven.sensors.reached:
        one.tick()
        furthest = max(furthest, float(point_path(np.array(one.here), path)))
        assert one.now < 200.0, one.here
    assert math.dist(one.here, goal) <= one.model.visit.epsilon_m
    assert furthest <= TRACKING_M
    assert {note.condition for note in one.driven.notes} <= {None, Condition.ROUND}


@pytest.mark.parametrize("kind", KINDS)
def test_it_moves_as_among_simulated_robots(kind: str) -> None:
    """(P-PILOT) The same planner, automaton and law of motion."""
    one = Guarded(kind).started()
    path = [(0.0, 0.0, 0.0), (1.0, 0.2, 0.0), (2.0, 0.0, 0.0)]
    if not one.model.body.ON_GROUND:
        path = [(x, y, x / 2) for x, y, _ in path]
    fleet = Fleet(WORLD, [Placed(one.model, path[0])])
    fleet.follow(0, path)
    one.driven.follow(path)
    begun = one.now
    apart = 0.0
    while one.now - begun < 8.0:
        one.tick()
        fleet.advance_to(one.now - begun + 1e-9)
        apart = max(apart, math.dist(one.here, fleet.positions()[0]))
    # A set-point acts at the next tick, or of predictive control at the one after it; in the
    # simulator it acts in its own.
    assert apart <= 2.5 * TICK_S * one.model.body.pace.cruise_mps + 0.02
    assert math.dist(one.here, path[-1]) < 0.2


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_moves_before_it_is_armed_and_started(kind: str) -> None:
    """(P-TICK) (P-START)"""
    one = Guarded(kind)
    one.tick()
    one.driven.go_to(goal_of(kind))
    one.tick(40)
    assert one.here == (0.0, 0.0, 0.0)
    one.driven.order(Order.ARM, one.now)
    one.tick(40)
    assert one.here == (0.0, 0.0, 0.0)
    one.driven.order(Order.START, one.now)
    one.until(lambda: math.dist(one.here, (0.0, 0.0, 0.0)) > 0.2)


@pytest.mark.parametrize("kind", KINDS)
def test_who_commits_no_round_holds_and_goes_on_with_the_next(kind: str) -> None:
    one = Guarded(kind).started()
    one.driven.go_to(goal_of(kind))
    one.until(lambda: math.dist(one.here, (0.0, 0.0, 0.0)) > 0.5)
    one.round_age_s = 5.0
    one.tick()
    assert one.mode is Mode.HOLDING
    one.tick(40)
    there = one.here
    one.tick(40)
    assert math.dist(one.here, there) < 0.01
    one.round_age_s = 0.05
    one.until(lambda: one.driven.sensors.reached)
    assert math.dist(one.here, goal_of(kind)) <= one.model.visit.epsilon_m


@pytest.mark.parametrize("kind", KINDS)
def test_an_e_stop_reaches_the_driver_at_once_and_is_final(kind: str) -> None:
    one = Guarded(kind).started()
    one.driven.go_to(goal_of(kind))
    one.until(lambda: math.dist(one.here, (0.0, 0.0, 0.0)) > 0.5)
    one.driven.order(Order.ESTOP, one.now)
    one.tick(100)
    there = one.here
    one.driven.order(Order.START, one.now)
    one.tick(40)
    assert one.mode is Mode.ESTOPPED
    assert math.dist(one.here, there) < 0.01
    assert one.here[2] == pytest.approx(0.0, abs=0.06) or kind == "IDEAL"


@pytest.mark.parametrize("kind", KINDS)
def test_a_vehicle_that_is_told_nothing_stops_by_itself(kind: str) -> None:
    """(P-DRIVER) As when the process that drives it is killed."""
    told = Vehicle(kind, kind)
    made = vehicle(Device(0, told, WORLD, (0.0, 0.0, 0.0)))
    made.open(0.0)
    made.command(Arm(), 0.0)
    speed = 0.4
    on_ground = device_model(told).body.ON_GROUND
    moving = Drive(speed) if on_ground else Track((1.0, 0.0, 1.0), (speed, 0.0, 0.0))
    for k in range(20):
        made.command(moving, 0.05 * k)
        made.sense(0.05 * (k + 1))
    last_s = 0.05 * 19
    for k in range(80):
        made.sense(last_s + 0.05 * k)
    still = made.sense(last_s + DEAD_MAN_S + 3.5)
    later = made.sense(last_s + DEAD_MAN_S + 4.5)
    assert still is not None
    assert later is not None
    assert still.position_m[0] > 0.1
    assert math.dist(still.position_m, later.position_m) < 0.05


def test_a_car_does_not_leave_its_fence() -> None:
    """A planner that is wrong is not believed."""
    world = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0), (Box((1.0, -1.0, 0.0), (2.0, 1.0, 1.0)),))
    one = Guarded("CAR", world=WORLD).started()
    body = one.model.body
    one.driven._setup = Setup(usual(body), field(world, flat=True), 0.1)
    one.driven.follow([(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)])
    one.until(lambda: one.mode is Mode.HOLDING)
    one.tick(60)
    assert one.here[0] < 1.0
    assert any(note.condition is Condition.AHEAD for note in one.driven.notes)


def test_straight_planners_of_cars_are_asked_for_by_name() -> None:
    settings = PilotSettings(VEHICLES["CAR"].body, PlannerName.STRAIGHT)
    made = pilot(settings, WORLD)
    assert type(made.planner).__name__ == "Straight"


@pytest.mark.parametrize("kind", KINDS)
def test_who_is_told_to_stop_comes_to_the_ground_and_stays_there(kind: str) -> None:
    """(P-START)"""
    one = Guarded(kind).started()
    one.driven.go_to(goal_of(kind))
    one.until(lambda: math.dist(one.here, (0.0, 0.0, 0.0)) > 0.5)
    assert not one.driven.is_at_rest
    one.driven.order(Order.LAND, one.now)
    took_s = one.until(lambda: one.driven.is_at_rest, most_s=15.0)
    assert took_s > 0.0
    there = one.here
    one.tick(40)
    assert math.dist(one.here, there) < 0.02
    assert kind == "IDEAL" or there[2] == pytest.approx(0.0, abs=0.06)


def test_people_are_told_why_a_vehicle_holds() -> None:
    one = Guarded("CAR").started()
    assert not one.driven.remarks
    one.round_age_s = 5.0
    one.tick()
    assert [remark.partition(" for")[0] for remark in one.driven.remarks] == [
        "no round was committed"
    ]
    one.round_age_s = 0.05
    one.until(lambda: one.mode is Mode.RUNNING)
    assert not one.driven.remarks


# --- take-off -------------------------------------------------------------------------------------


def test_who_has_to_take_off_rises_before_it_follows_its_way() -> None:
    """(P-TAKEOFF)"""
    one = Guarded("QUAD", takeoff_height_m=1.0).started()
    one.driven.go_to((2.0, 1.0, 1.5))
    one.until(lambda: one.here[2] > 0.85)
    assert math.dist(one.here[:2], (0.0, 0.0)) < 0.05
    one.until(lambda: one.driven.sensors.reached)
    assert math.dist(one.here, (2.0, 1.0, 1.5)) <= one.model.visit.epsilon_m
    assert {note.condition for note in one.driven.notes} <= {None, Condition.ROUND}


def test_a_path_from_the_ground_is_joined_above_its_start() -> None:
    one = Guarded("QUAD", takeoff_height_m=1.0).started()
    one.driven.follow([(0.0, 0.0, 0.0), (1.0, 0.0, 0.8), (2.0, 0.0, 0.8)])
    one.until(lambda: one.here[2] > 0.95)
    lowest = 1.0
    while not one.driven.sensors.reached:
        one.tick()
        lowest = min(lowest, one.here[2])
        assert one.now < 200.0, one.here
    assert lowest > 0.7
    assert math.dist(one.here, (2.0, 0.0, 0.8)) <= one.model.visit.epsilon_m


def test_a_path_that_is_not_free_from_above_is_planned_anew() -> None:
    """The way out is below a beam: from above there it is through it."""
    beam = Box((0.5, -4.0, 0.9), (0.9, 4.0, 1.3))
    world = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0), (beam,))
    one = Guarded("QUAD", world=world, takeoff_height_m=1.6).started()
    one.driven.follow([(0.0, 0.0, 0.0), (0.3, 0.0, 0.4), (2.0, 0.0, 0.4), (2.0, 0.0, 1.5)])
    one.until(lambda: one.here[2] > 1.5)
    one.until(lambda: one.driven.sensors.reached)
    assert math.dist(one.here, (2.0, 0.0, 1.5)) <= one.model.visit.epsilon_m


def test_who_lands_and_is_started_again_rises_again() -> None:
    one = Guarded("QUAD", takeoff_height_m=1.0).started()
    one.driven.go_to((1.0, 0.0, 1.5))
    one.until(lambda: one.here[2] > 0.95)
    one.driven.order(Order.LAND, one.now)
    one.until(lambda: one.driven.is_at_rest)
    one.started()
    one.until(lambda: one.here[2] > 0.95)


def test_who_is_sent_nowhere_stays_on_the_ground() -> None:
    """(P-TAKEOFF) A path that is where it stands already leads nowhere."""
    one = Guarded("QUAD", takeoff_height_m=1.0).started()
    one.tick(60)
    one.driven.follow([(0.0, 0.0, 0.0)])
    one.tick(60)
    assert one.here == (0.0, 0.0, 0.0)
    assert one.driven.sensors.reached
    one.driven.follow([(0.0, 0.0, 0.0), (0.0, 0.0, 1.2)])
    one.until(lambda: one.here[2] > 1.1)


def test_ways_from_the_ground_begin_straight_up() -> None:
    """(P-TAKEOFF) So that what is said of a way is true of the rise as well."""
    made = PlanningEffort()
    body = device_model(Vehicle("QUAD", "QUAD")).body
    rising = RisingPlanner(planner(PlannerName.STRAIGHT, WORLD, body, made), WORLD.ground, 1.0)
    path = rising.plan(Pose((1.0, 2.0, 0.0)), (2.0, 2.0, 1.5), 0)
    assert path is not None
    assert path.tolist() == [[1.0, 2.0, 0.0], [1.0, 2.0, 1.0], [2.0, 2.0, 1.5]]
    path = rising.plan(Pose((1.0, 2.0, 0.95)), (2.0, 2.0, 1.5), 0)
    assert path is not None
    assert path.tolist() == [[1.0, 2.0, 0.95], [2.0, 2.0, 1.5]]


@pytest.mark.parametrize("height_m", [None, 1.5])
def test_who_is_asked_to_take_off_flies_from_then_on_until_it_is_asked_to_land(
    height_m: float | None,
) -> None:
    """(P-TAKEOFF)"""
    one = Guarded("QUAD", takeoff_height_m=height_m)
    one.driven.pilot.wait_for_takeoff()
    one.started()
    one.driven.go_to((2.0, 1.0, 1.5))
    one.tick(60)
    assert one.here == (0.0, 0.0, 0.0)
    one.driven.pilot.take_off(True)
    one.until(lambda: one.here[2] > 0.85 * (height_m or 1.0))
    assert math.dist(one.here[:2], (0.0, 0.0)) < 0.05
    one.until(lambda: one.driven.sensors.reached)
    assert math.dist(one.here, (2.0, 1.0, 1.5)) <= one.model.visit.epsilon_m
    one.driven.pilot.take_off(False)
    one.until(lambda: one.here[2] < 0.02)
    assert math.dist(one.here[:2], (2.0, 1.0)) < 0.3
    one.tick(40)
    assert one.here[2] < 0.02
    one.driven.pilot.take_off(True)
    one.until(lambda: one.here[2] > 0.85 * (height_m or 1.0))


def test_what_drives_does_not_mind_being_asked_to_take_off() -> None:
    one = Guarded("CAR")
    one.driven.pilot.wait_for_takeoff()
    one.started()
    one.driven.go_to((2.0, 1.0, 0.0))
    one.driven.pilot.take_off(True)
    one.driven.pilot.take_off(False)
    one.until(lambda: one.driven.sensors.reached)


def test_a_take_off_out_of_the_fence_is_an_error_at_the_start() -> None:
    with pytest.raises(DriverError, match="a take-off to 5 m leads out of the fence"):
        Guarded("QUAD", takeoff_height_m=5.0)


@pytest.mark.parametrize("kind", KINDS)
def test_two_that_would_meet_stop_before_they_touch(kind: str) -> None:
    """Each knows of the other what it said a tenth of a second ago."""
    height = 0.0 if VEHICLES[kind].body.ON_GROUND else 1.0
    left, right = Guarded(kind, (-2.0, 0.0, 0.0)), Guarded(kind, (2.0, 0.0, 0.0))
    for one in (left, right):
        one.started()
    left.driven.follow([(-2.0, 0.0, height), (2.0, 0.0, height)])
    right.driven.follow([(2.0, 0.0, height), (-2.0, 0.0, height)])
    nearest = math.inf
    for _ in range(200):
        seen = [
            Other(pid, one.driven.sensed.position_m, one.driven.sensed.velocity_mps, 0.1)
            for pid, one in enumerate((left, right))
        ]
        left.tick(others=(seen[1],))
        right.tick(others=(seen[0],))
        nearest = min(nearest, math.dist(left.here, right.here))
    assert {left.mode, right.mode} == {Mode.HOLDING}
    assert 0.4 < nearest < 2.5  # of 4 m at the beginning


def test_a_driver_that_waits_at_the_start_is_asked_for_what_it_senses_then() -> None:
    """Not for a time that is over: it may learn from that how far clocks of others are off."""
    asked: list[float] = []

    class Waits:
        def __init__(self) -> None:
            self.driver = vehicle(Device(0, Vehicle("CAR", "CAR"), WORLD, (0.0, 0.0, 0.0)))
            self.capabilities = self.driver.capabilities

        def open(self, now_s: float) -> None:
            self.driver.open(now_s)
            until_s = time.monotonic() + 0.05
            while time.monotonic() < until_s:
                pass

        def sense(self, now_s: float) -> Sensed | None:
            asked.append(now_s)
            return self.driver.sense(now_s)

    body = device_model(Vehicle("CAR", "CAR")).body
    steersman = pilot(PilotSettings(body, PlannerName.RRT_CAR), WORLD)
    guarded = Setup(usual(body), field(WORLD, flat=True), 0.1)
    DrivenVehicle(cast(Driver, Waits()), steersman, guarded, 100.0)
    assert asked[-1] >= 100.05


def test_a_driver_that_blocks_is_named() -> None:
    """(P-DRIVER)"""
    one = Guarded("CAR").started()
    heard = one.driven.driver.sense

    def slow(now_s: float) -> Sensed | None:
        until_s = time.monotonic() + 0.3
        while time.monotonic() < until_s:
            pass
        return heard(now_s)

    one.driven.driver.sense = slow  # type: ignore[method-assign]
    one.tick()
    (remark,) = one.driven.remarks
    assert remark.startswith("the driver took 0.3")
    assert "to sense" in remark


@pytest.mark.parametrize("kind", KINDS)
def test_the_driver_ideal_makes_a_point_of_any_vehicle(kind: str) -> None:
    one = Guarded(kind, made=point).started()
    assert isinstance(one.driven.driver, SimulatedPoint)
    goal = goal_of(kind)
    one.driven.go_to(goal)
    one.until(lambda: not one.driven.sensors.reached)
    one.until(lambda: one.driven.sensors.reached)
    assert math.dist(one.here, goal) <= one.model.visit.epsilon_m
    one.driven.order(Order.LAND, one.now)
    one.until(lambda: one.driven.is_at_rest)
    assert one.here[2] <= 0.05


@pytest.mark.parametrize("kind", ["CAR", "DIFF"])
def test_what_drives_follows_velocities_as_far_as_it_can(kind: str) -> None:
    driver = vehicle(Device(0, Vehicle(kind, kind), WORLD, (0.0, 0.0, 0.0)))
    driver.open(0.0)
    driver.command(Arm(), 0.0)
    now_s = 0.0
    for _ in range(40):
        now_s += TICK_S
        driver.command(Velocity((0.4, 0.0, 0.0), 0.0), now_s)
        driver.sense(now_s)
    sensed = driver.sense(now_s)
    assert sensed is not None
    assert sensed.velocity_mps == pytest.approx((0.4, 0.0, 0.0), abs=0.02)
    assert sensed.position_m[0] > 0.5
