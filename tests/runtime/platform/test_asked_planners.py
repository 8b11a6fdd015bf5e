"""Planners that think for long, and robots that do not wait for them. (P-PLAN)"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

import pytest

from koord.runtime.drivers.setpoints import Setpoint
from koord.runtime.guardian.events import Order
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.geometry import as_path
from koord.runtime.motion.planning import Pose
from koord.runtime.motion.world import Point
from koord.runtime.platform.asking import AskedPlanner
from tests.runtime.platform.test_driven import Guarded
from tests.runtime.platform.test_last_stop import Robot

START, GOAL = Pose((0.0, 0.0, 0.0)), (2.0, 1.0, 0.0)

#: No planner of these tests thinks for longer.
MOST_S = 20.0


class Thinking:
    """A planner that thinks until something holds; a straight line is all that it finds then."""

    def __init__(self, is_done: Callable[[], bool]) -> None:
        self.is_done = is_done
        self.thread: threading.Thread | None = None

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        self.thread = threading.current_thread()
        until_s = time.monotonic() + MOST_S
        while not self.is_done():
            if time.monotonic() > until_s:
                return None
            time.sleep(0.001)
        return as_path([start.position, goal])


@pytest.fixture
def robot() -> Robot:
    return Robot().begin()


def test_a_robot_ticks_while_a_planner_thinks(robot: Robot) -> None:
    """(P-PLAN) Else this planner would never be done."""
    before = len(robot.commanded)
    thinking = Thinking(lambda: len(robot.commanded) >= before + 12)
    robot.driven.pilot.asked._planner = thinking
    found = robot.driven.pilot.asked.plan(START, GOAL, 1)
    assert found is not None
    assert found.tolist() == [[0.0, 0.0, 0.0], [2.0, 1.0, 0.0]]


def test_what_is_wrong_with_a_vehicle_is_told_though_a_planner_thinks(robot: Robot) -> None:
    """(P-PLAN)"""
    is_done = threading.Event()
    robot.driven.pilot.asked._planner = Thinking(is_done.is_set)

    def cut(setpoint: Setpoint, now_s: float) -> None:
        raise OSError("the line is cut")

    robot.command = cut
    with pytest.raises(OSError, match="the line is cut"):
        robot.driven.pilot.asked.plan(START, GOAL, 1)
    assert robot.driven.pilot.asked.is_busy
    is_done.set()


def test_an_e_stop_is_heard_while_a_planner_thinks() -> None:
    """(P-PLAN)"""
    one = Guarded("CAR").started()
    one.driven.follow([(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)])
    one.tick(20)
    ticks = 0

    def meanwhile() -> float:
        nonlocal ticks
        ticks += 1
        one.tick()
        if ticks == 5:
            one.driven.order(Order.ESTOP, one.now)
        return 0.0

    asked = one.driven.pilot.asked
    asked._planner = Thinking(lambda: one.mode is Mode.ESTOPPED and ticks > 60)
    asked.wait_with(meanwhile)
    assert asked.plan(START, GOAL, 1) is not None
    assert one.driven.is_at_rest


def test_who_has_nothing_else_to_do_waits_in_its_own_thread() -> None:
    thinking = Thinking(lambda: True)
    assert AskedPlanner(thinking).plan(START, GOAL, 1) is not None
    assert thinking.thread is threading.current_thread()


def test_what_a_planner_raises_reaches_who_asked() -> None:
    def raising() -> bool:
        raise LookupError("no map")

    asked = AskedPlanner(Thinking(raising))
    asked.wait_with(lambda: 0.01)
    with pytest.raises(LookupError, match="no map"):
        asked.plan(START, GOAL, 1)
    assert not asked.is_busy


def test_ways_to_targets_wait_for_a_planner_that_thinks() -> None:
    """(P-PLAN) It is asked by one only."""
    one = Guarded("CAR").started()
    pilot, states = one.driven.pilot, []

    def meanwhile() -> float:
        one.tick()
        states.append(pilot.group.state(0))
        return 0.0

    pilot.asked._planner = Thinking(lambda: len(states) > 10)
    pilot.asked.wait_with(meanwhile)
    one.driven.go_to(GOAL)
    assert pilot.asked.plan(START, GOAL, 1) is not None
    assert set(states[:10]) == {MotionState.PLANNING}
    one.until(lambda: one.driven.sensors.reached)
