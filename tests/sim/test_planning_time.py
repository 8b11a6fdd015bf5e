"""Plans take the time that a configuration says, however many robots ask for one."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from koord.runtime.configuration.checking import load
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.bodies import Car, Drone, PlannerName
from koord.runtime.motion.group import TICK_S
from koord.runtime.motion.world import Box, Point, World
from koord.sim.fleet import Fleet, Placed
from koord.sim.scene import scene
from koord.sim.squads import DeviceModel
from koord.syntax.diagnostics import KoordError
from koord.syntax.source import Source

CAR = DeviceModel(Car(), PlannerName.RRT_CAR)
SLOW_CAR = replace(CAR, plan_takes_s=0.12)
SLOW_DRONE = DeviceModel(Drone(), PlannerName.RRT_DRONE, plan_takes_s=0.2)
WALLED = World(obstacles=(Box((-0.3, -2.0, 0.0), (0.3, 2.0, 2.9)),))


def states(fleet: Fleet) -> list[MotionState]:
    return [sensed.state for sensed in fleet.sensed()]


def test_nobody_waits_because_there_are_many() -> None:
    places: list[Point] = [(3.0 * (k % 6), 3.0 * (k // 6), 0.0) for k in range(30)]
    fleet = Fleet(World((-4, -4, 0), (22, 22, 3)), [Placed(CAR, place) for place in places])
    for k, (x, y, _) in enumerate(places):
        fleet.go_to(k, (x, y + 1.2, 0.0))
    fleet.advance_to(TICK_S)
    assert set(states(fleet)) == {MotionState.MOVING}


def test_a_way_is_followed_at_the_first_tick_at_which_it_is_there() -> None:
    fleet = Fleet(World(), [Placed(SLOW_CAR, (0, 0, 0)), Placed(CAR, (2, 2, 0))])
    fleet.go_to(0, (1.2, 0.5, 0))
    fleet.go_to(1, (2, -1, 0))
    found = []
    for _ in range(4):  # ticks at 0, 0.05, 0.1, 0.15
        fleet.advance_to(fleet.now_s + TICK_S)
        found.append(states(fleet))
    assert [one for one, _ in found] == [MotionState.PLANNING] * 3 + [MotionState.MOVING]
    assert found[0][1] is MotionState.MOVING


def test_a_way_is_made_of_what_there_was_when_it_was_asked_for() -> None:
    """So who waits for it, and how long, is no matter of which way it is."""

    def way(model: DeviceModel) -> Floats:
        fleet = Fleet(WALLED, [Placed(model, (-2, 0.2, 0), 0.4)], 3)
        fleet.go_to(0, (2, 0, 0))
        fleet.advance_to(0.3)
        return fleet.path(0)

    assert len(way(CAR)) > 10
    assert np.array_equal(way(CAR), way(SLOW_CAR))


def test_a_plan_for_another_target_is_given_up_and_one_for_the_same_goes_on() -> None:
    fleet = Fleet(World(), [Placed(SLOW_CAR, (0, 0, 0)), Placed(SLOW_CAR, (2, 2, 0))])
    for k in (0, 1):
        fleet.go_to(k, (1.0, -1.0 + k, 0))
    fleet.advance_to(0.1)
    fleet.go_to(0, (-1.0, 1.0, 0))
    fleet.go_to(1, (1.0, 0.0, 0))
    fleet.advance_to(0.2)
    assert states(fleet) == [MotionState.PLANNING, MotionState.MOVING]
    fleet.advance_to(0.3)
    assert states(fleet)[0] is MotionState.MOVING
    assert fleet.path(0)[-1].tolist() == [-1.0, 1.0, 0.0]


def test_who_is_told_something_else_meanwhile_does_not_follow_the_plan() -> None:
    fleet = Fleet(World(), [Placed(SLOW_CAR, (0, 0, 0)), Placed(SLOW_CAR, (2, 2, 0))])
    for k in (0, 1):
        fleet.go_to(k, (1.0, -1.0 + k, 0))
    fleet.advance_to(0.1)
    fleet.follow(0, [(0, 0, 0), (1, 0, 0)])
    fleet.stop(1)
    fleet.advance_to(0.5)
    assert states(fleet) == [MotionState.MOVING, MotionState.STOPPED]
    assert fleet.path(0)[-1].tolist() == [1.0, 0.0, 0.0]


def test_that_there_is_no_way_is_known_as_late() -> None:
    fleet = Fleet(World(), [Placed(SLOW_CAR, (0, 0, 0))])
    fleet.go_to(0, (1.0, 0.0, 2.0))
    fleet.advance_to(3 * TICK_S)
    assert fleet.sensed()[0].plight is None
    fleet.advance_to(4 * TICK_S)
    assert fleet.sensed()[0].plight is not None
    assert states(fleet) == [MotionState.IDLE]


def test_straight_ways_that_are_free_need_no_planner() -> None:
    fleet = Fleet(WALLED, [Placed(SLOW_DRONE, (-2, 0, 1)), Placed(SLOW_DRONE, (-2, 3, 1))])
    fleet.go_to(0, (2.0, 0.0, 1.0))
    fleet.go_to(1, (2.0, 3.0, 1.0))
    fleet.advance_to(TICK_S)
    assert states(fleet) == [MotionState.PLANNING, MotionState.MOVING]


def test_a_drone_that_moves_on_meanwhile_goes_to_where_its_way_begins() -> None:
    fleet = Fleet(WALLED, [Placed(SLOW_DRONE, (-3, -3, 1))])
    fleet.go_to(0, (-1.0, -1.0, 1.0))
    fleet.advance_to(1.5)
    fleet.go_to(0, (2.0, 0.5, 1.0))
    last, steps = fleet.positions(), []

    def watch(fleet: Fleet) -> None:
        nonlocal last
        steps.append(float(np.linalg.norm(fleet.positions() - last)))
        last = fleet.positions()

    fleet.advance_to(12.0, watch)
    assert max(steps) < 1.3 * TICK_S
    assert fleet.positions()[0] == pytest.approx([2.0, 0.5, 1.0], abs=0.05)


TEXT = """
agents: [{pid: 0, on_device: car, position: [-2, 0]}]
world: {bounds: {low: [-4, -4, 0], high: [4, 4, 3]}}
devices:
    car: {bot_type: CAR, planner: RRT_CAR, simulation: {planning: {takes: 0.3}}}
"""


def test_a_configuration_says_what_plans_take() -> None:
    (car,) = scene(load(Source("cars.yaml", TEXT)), landmarks=()).robots
    assert car.model.plan_takes_s == 0.3
    usual = TEXT.replace("{planning: {takes: 0.3}}", "{}")
    (car,) = scene(load(Source("cars.yaml", usual)), landmarks=()).robots
    assert car.model.plan_takes_s == 0.0
    with pytest.raises(KoordError, match="0"):
        load(Source("cars.yaml", TEXT.replace("0.3", "-0.3")))
