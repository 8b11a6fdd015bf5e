"""Orders and modes, by hand: who arms, starts, holds, lands, stops, and is stopped."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace

from koord.runtime.drivers.setpoints import Arm, Disarm, Hold, Land, Takeoff, Velocity
from koord.runtime.guardian.events import Condition, Order
from koord.runtime.guardian.limits import EstopAction
from koord.runtime.guardian.modes import Mode
from tests.runtime.guardian.guarded import CAR, DRONE, Guarded

FAST = Velocity((0.5, 0.0, 0.0), 0.1)

#: In the air, as drones are that were taken off.
AIRBORNE = {"airborne": True, "position_m": (0.0, 0.0, 1.0)}


def flying() -> Guarded:
    robot = Guarded(DRONE)
    robot.wait(1.1)
    robot.order(Order.ARM)
    robot.order(Order.START)
    robot.tick(wish=Takeoff(1.0))
    assert robot.answer.setpoint == Takeoff(1.0)
    for height_m in (0.25, 0.5, 0.75, 1.0):
        robot.now_s += 0.25
        robot.tick(robot.well(airborne=True, position_m=(0.0, 0.0, height_m)))
    assert robot.mode() is Mode.RUNNING
    return robot


def test_from_the_beginning_to_a_wish() -> None:
    """(G-TICK, G-ORDER, G-ARM, G-START, S-WISH, S-ANSWER)"""
    robot = Guarded()
    assert robot.tick(wish=FAST).setpoint == Disarm()
    robot.wait(1.1)
    assert robot.order(Order.ARM).setpoint == Arm()
    assert robot.tick(wish=FAST).setpoint == Arm()
    assert robot.order(Order.START).setpoint == Hold()
    assert robot.tick(wish=FAST).setpoint is FAST
    assert robot.tick(replace(robot.well(), wish=None)).setpoint == Hold()


def test_all_has_to_be_well_for_a_while_before_the_start() -> None:
    """(G-CLEAR, S-CLEAR)"""
    robot = Guarded()
    robot.tick()
    robot.order(Order.ARM)
    assert robot.order(Order.START).setpoint is None
    assert "all has to be well for 1 s first" in robot.texts()
    robot.wait(0.5).tick(replace(robot.well(), round_age_s=9.0))
    assert robot.order(Order.START).setpoint is None
    assert "start refused: no committed round" in robot.texts()
    robot.wait(0.9).order(Order.START)
    assert robot.mode() is Mode.ARMED
    robot.wait(0.2).order(Order.START)
    assert robot.mode() is Mode.RUNNING


def test_who_is_not_at_rest_is_not_armed() -> None:
    """(G-ARM)"""
    robot = Guarded()
    robot.tick(robot.well(velocity_mps=(0.3, 0.0, 0.0)))
    robot.order(Order.ARM)
    assert robot.mode() is Mode.DISARMED
    assert "arm refused: it is not known to be on the ground and to stand" in robot.texts()


def test_a_robot_that_was_started_again_in_the_air_lands() -> None:
    """(G-DISARMED, S-DROP)"""
    robot = Guarded(DRONE)
    assert robot.tick(robot.well(**AIRBORNE)).setpoint == Land()
    assert robot.order(Order.ARM).setpoint is None
    assert robot.tick(robot.well(airborne=False)).setpoint == Disarm()


def test_who_holds_goes_on_when_all_is_well_again() -> None:
    """(G-HOLD, G-RESUME, S-STILL, S-PEOPLE)"""
    robot = Guarded().running()
    overdue = replace(robot.well(), round_age_s=0.6)
    assert robot.tick(overdue, FAST).setpoint == Hold()
    assert robot.mode() is Mode.HOLDING
    robot.wait(0.9)
    assert robot.mode() is Mode.HOLDING
    robot.wait(0.2)
    assert robot.tick(wish=FAST).setpoint is FAST


def test_one_bad_tick_makes_it_wait_from_the_beginning() -> None:
    """(G-CLEAR)"""
    robot = Guarded().running()
    robot.tick(replace(robot.well(), round_age_s=0.6))
    robot.wait(0.9).tick(replace(robot.well(), round_age_s=0.6))
    robot.wait(0.9)
    assert robot.mode() is Mode.HOLDING


@pytest.mark.parametrize(("limits", "down"), [(DRONE, Land()), (CAR, Hold())], ids=str)
def test_who_holds_for_too_long_lands(limits: object, down: object) -> None:
    """(G-END, S-LIMIT, S-FINAL)"""
    robot = Guarded(DRONE if limits is DRONE else CAR).running()
    moving = robot.well(airborne=True, velocity_mps=(0.2, 0.0, 0.0), position_m=(0.0, 0.0, 1.0))
    while robot.mode() in (Mode.RUNNING, Mode.HOLDING):
        robot.now_s += 0.5
        robot.tick(replace(moving, now_s=robot.now_s, round_age_s=None))
        assert robot.now_s < 20
    assert robot.now_s == pytest.approx(1.1 + 0.5 + 10.0)
    assert robot.mode() is Mode.LANDING
    assert robot.answer.setpoint == down
    assert "holding → landing: it held for 10.0 s" in robot.texts()
    robot.order(Order.START)
    assert robot.mode() is Mode.LANDING
    assert robot.tick(robot.well(airborne=False)).setpoint == Disarm()
    assert robot.mode() is Mode.STOPPED


def test_who_holds_again_and_again_lands_too() -> None:
    """(G-END, S-LIMIT): running for less than a second in between does not count."""
    robot = Guarded().running()
    ran = 0
    while robot.mode() in (Mode.RUNNING, Mode.HOLDING):
        robot.tick(replace(robot.well(), round_age_s=9.0))
        robot.wait(1.5)
        ran += robot.mode() is Mode.RUNNING
    assert ran == 6
    assert robot.mode() is Mode.STOPPED


def test_who_ran_for_a_while_may_hold_for_as_long_again() -> None:
    """(G-END)"""
    robot = Guarded().running()
    for _ in range(10):
        robot.tick(replace(robot.well(), round_age_s=9.0))
        robot.wait(3.0)
        assert robot.mode() is Mode.RUNNING


def test_a_landing_of_which_nothing_is_known_goes_on() -> None:
    """(G-END, S-DROP)"""
    robot = flying()
    robot.order(Order.LAND)
    robot.now_s += 60
    nothing = replace(robot.well(), sensed=None)
    assert robot.tick(nothing).setpoint == Land()
    low = robot.well(airborne=None, position_m=(0.0, 0.0, 0.1))
    assert robot.tick(low).setpoint == Disarm()


def test_people_stop_and_start() -> None:
    """(G-STOP, S-WAITS)"""
    robot = Guarded().running()
    assert robot.order(Order.STOP).setpoint == Hold()
    robot.wait(5.0)
    assert robot.mode() is Mode.HOLDING
    robot.order(Order.START)
    assert robot.tick(wish=FAST).setpoint is FAST
    robot.order(Order.STOP)
    robot.wait(10.1)
    assert robot.mode() is Mode.STOPPED


def test_who_is_armed_only_is_disarmed_by_stop_and_land() -> None:
    """(G-STOP, G-LAND, S-ARM)"""
    for order in (Order.STOP, Order.LAND):
        robot = Guarded(DRONE).wait(1.1)
        robot.order(Order.ARM)
        assert robot.order(order).setpoint == Disarm()
        assert robot.mode() is Mode.DISARMED


def test_landing_is_for_good() -> None:
    """(G-LAND, S-FINAL)"""
    robot = flying()
    assert robot.order(Order.LAND).setpoint == Land()
    for order in (Order.ARM, Order.START, Order.STOP, Order.RESET):
        assert robot.order(order).setpoint is None
    robot.tick(robot.well(airborne=False))
    assert robot.mode() is Mode.STOPPED
    assert robot.order(Order.START).setpoint is None
    assert robot.order(Order.ARM).setpoint == Arm()


@pytest.mark.parametrize("mode", list(Mode), ids=lambda mode: mode.value)
def test_an_e_stop_is_answered_at_once_in_each_mode(mode: Mode) -> None:
    """(G-ESTOP, S-ESTOP)"""
    robot = flying()
    robot.state = replace(robot.state, mode=mode)
    expected = Disarm() if robot.state.at_rest else Land()
    assert robot.order(Order.ESTOP).setpoint == expected
    assert robot.mode() is Mode.ESTOPPED
    assert robot.order(Order.ESTOP).setpoint is not None


def test_an_e_stop_may_take_the_power_away() -> None:
    """(G-ESTOP, S-ESTOP)"""
    robot = flying()
    robot.setup = replace(robot.setup, limits=replace(DRONE, estop=EstopAction.DISARM))
    assert robot.order(Order.ESTOP).setpoint == Disarm()
    car = Guarded().running()
    car.tick(car.well(velocity_mps=(0.5, 0.0, 0.0)), FAST)
    assert car.order(Order.ESTOP).setpoint == Disarm()


def test_only_people_lead_out_of_an_e_stop() -> None:
    """(G-RESET, S-FINAL)"""
    robot = flying()
    robot.order(Order.ESTOP)
    robot.wait(5)
    for order in (Order.ARM, Order.START, Order.STOP, Order.LAND):
        assert robot.order(order).setpoint is None
        assert robot.mode() is Mode.ESTOPPED
    robot.tick(robot.well(**AIRBORNE))
    assert robot.order(Order.RESET).setpoint is None
    assert "reset refused" in robot.texts()
    robot.tick(robot.well(airborne=False))
    assert robot.order(Order.RESET).setpoint == Disarm()
    assert robot.order(Order.START).setpoint is None
    assert robot.mode() is Mode.DISARMED


def test_who_left_the_fence_waits_for_people() -> None:
    """(G-PEOPLE, S-WAITS)"""
    robot = Guarded().running()
    for x in (4.4, 4.6, 4.75, 4.9, 4.75, 4.6):
        robot.state = replace(robot.state, pose=None)
        robot.tick(robot.well(position_m=(x, 0.0, 0.0)))
    assert robot.conditions == set()
    for _ in range(60):
        robot.now_s += 0.05
        robot.tick(robot.well(position_m=(4.6, 0.0, 0.0)))
    assert robot.mode() is Mode.HOLDING
    assert robot.state.clear_since_s is not None
    robot.order(Order.START)
    robot.tick(robot.well(position_m=(4.6, 0.0, 0.0)))
    assert robot.mode() is Mode.RUNNING


def test_start_from_outside_starts_nothing() -> None:
    """(G-PEOPLE)"""
    robot = Guarded().running()
    outside = replace(robot.well(position_m=(4.9, 0.0, 0.0)), now_s=robot.now_s)
    robot.tick(outside)
    robot.order(Order.START)
    robot.tick(outside)
    robot.wait(3.0)
    assert robot.mode() is Mode.HOLDING


def test_an_empty_battery_lands_at_once() -> None:
    """(G-CRITICAL, S-CRITICAL)"""
    robot = flying()
    assert robot.tick(robot.well(**AIRBORNE, battery=0.01)).setpoint == Land()
    assert "running → landing: the battery is at 1% (limit 15%)" in robot.texts()


def test_conditions_are_told_once_when_they_begin_and_end() -> None:
    """(G-NOTE)"""
    robot = Guarded().running()
    old = replace(robot.well(), round_age_s=0.75)
    robot.tick(old)
    assert [note.text for note in robot.answer.notes] == [
        "no round was committed for 0.75 s (limit 0.50 s)",
        "running → holding: no round was committed for 0.75 s (limit 0.50 s)",
    ]
    assert robot.tick(replace(old, round_age_s=0.8)).notes == ()
    assert [note.text for note in robot.tick().notes] == ["over: no committed round"]


@pytest.mark.parametrize("now_s", [-5.0, math.nan, -math.inf])
def test_time_does_not_run_backwards(now_s: float) -> None:
    """(S-TIME)"""
    robot = Guarded().running()
    robot.tick(replace(robot.well(), now_s=now_s))
    assert robot.state.now_s == robot.now_s
    assert robot.conditions == {Condition.POSE}
    robot.order(Order.LAND)
    assert robot.mode() is Mode.LANDING
