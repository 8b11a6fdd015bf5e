"""The conditions under which a robot holds, one at a time, at their limits."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace

from koord.runtime.drivers.setpoints import (
    Arm,
    Disarm,
    Drive,
    Hold,
    Land,
    Position,
    Takeoff,
    Track,
    Velocity,
    Wish,
)
from koord.runtime.guardian.events import Condition, Order, Other
from koord.runtime.guardian.modes import Mode
from koord.runtime.motion.world import Point
from koord.runtime.protocol.events import Reason
from tests.runtime.guardian.guarded import CAR, DRONE, Guarded

#: The braking distance at 1 m/s: 0.2 s until it obeys, then at 1.5 m/s².
BRAKING_M = 0.2 + 1 / 3


def at(position_m: Point, limits: object = CAR) -> Guarded:
    """A robot that runs at a place."""
    robot = Guarded(CAR if limits is CAR else DRONE)
    robot.running()
    robot.state = replace(robot.state, pose=None)
    return robot


def told(
    position_m: Point, wish: Wish | None = None, *, limits: object = CAR, **more: object
) -> str:
    """What is said of a robot at a place that wishes for something; nothing if all is well."""
    robot = at(position_m, limits)
    others = more.pop("others", ())
    tick = replace(robot.well(position_m=position_m, **more), others=others)
    robot.tick(tick, wish)
    assert (robot.mode() is Mode.RUNNING) == (not robot.conditions)
    return ", ".join(sorted(one.name for one in robot.conditions))


# --- ages ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("age_s", "holds"),
    [(0.0, False), (0.5, False), (0.51, True), (None, True), (math.nan, True), (-0.51, True)],
)
def test_a_round_has_been_committed_lately(age_s: float | None, *, holds: bool) -> None:
    """(G-ROUND, G-NUMBER): five rounds of 0.1 s."""
    robot = Guarded().running()
    robot.tick(replace(robot.well(), round_age_s=age_s))
    assert robot.conditions == ({Condition.ROUND} if holds else set())


def test_what_the_protocol_says_is_told() -> None:
    """(G-PROTOCOL)"""
    robot = Guarded().running()
    robot.tick(replace(robot.well(), holding=Reason.NO_MAJORITY))
    assert robot.conditions == {Condition.PROTOCOL}
    assert "the protocol holds: fewer than a majority answer" in robot.texts()


def test_the_vehicle_answers() -> None:
    """(G-LINK)"""
    robot = Guarded().running()
    robot.tick(robot.well(link=False))
    assert robot.conditions == {Condition.LINK}
    robot = Guarded().running()
    robot.tick(replace(robot.well(), sensed=None))
    assert robot.conditions == {Condition.LINK}


@pytest.mark.parametrize(("age_s", "holds"), [(0.2, False), (0.31, True), (None, True)])
def test_the_e_stop_is_heard(age_s: float | None, *, holds: bool) -> None:
    """(G-HEARTBEAT)"""
    robot = Guarded().running()
    robot.setup = replace(robot.setup, limits=replace(CAR, heartbeat_s=0.3))
    robot.tick(replace(robot.well(), heartbeat_age_s=age_s))
    assert robot.conditions == ({Condition.HEARTBEAT} if holds else set())


def test_who_has_lost_its_watchdog_holds_and_says_so() -> None:
    """(G-WATCHDOG)"""
    robot = Guarded().running()
    robot.tick(replace(robot.well(), watchdog="the watchdog has ended"))
    assert robot.conditions == {Condition.WATCHDOG}
    assert "the watchdog has ended" in robot.texts()


@pytest.mark.parametrize(
    ("age_s", "holds"), [(0.0, False), (0.5, False), (0.51, True), (math.nan, True), (-0.6, True)]
)
def test_the_pose_is_young(age_s: float, *, holds: bool) -> None:
    """(G-POSE): a stamp from the future is as wrong as an old one."""
    robot = Guarded().running()
    robot.tick(robot.well(measured_at_s=robot.now_s - age_s))
    assert robot.conditions == ({Condition.POSE} if holds else set())


# --- numbers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("battery", "holds"),
    [(None, False), (1.0, False), (0.15, False), (0.14, True), (87.0, True), (math.nan, True)],
)
def test_the_battery_is_not_low(battery: float | None, *, holds: bool) -> None:
    """(G-BATTERY, G-NUMBER): a percentage is no share of 1."""
    robot = Guarded().running()
    robot.tick(robot.well(battery=battery))
    assert robot.conditions == ({Condition.BATTERY} if holds else set())
    assert robot.mode() is (Mode.HOLDING if holds else Mode.RUNNING)


def test_a_battery_that_was_low_has_to_recover() -> None:
    """(G-BATTERY)"""
    robot = Guarded().running()
    robot.tick(robot.well(battery=0.14))
    robot.tick(robot.well(battery=0.18))
    assert robot.conditions == {Condition.BATTERY}
    robot.tick(robot.well(battery=0.21))
    assert robot.conditions == set()


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e300])
def test_a_place_that_cannot_be_is_none(number: float) -> None:
    """(G-NUMBER, G-POSE)"""
    assert told((number, 0.0, 0.0)) == "POSE"
    assert told((0.0, 0.0, 0.0), velocity_mps=(0.0, number, 0.0)) == "POSE"


# --- jumps --------------------------------------------------------------------------------------


def test_a_pose_that_jumps_is_not_believed() -> None:
    """(G-JUMP): 0.3 m, and 1.2 m/s for the time between the two."""
    robot = Guarded().running()
    robot.now_s += 0.1
    robot.tick(robot.well(position_m=(0.41, 0.0, 0.0)))
    assert robot.conditions == set()
    robot.now_s += 0.1
    robot.tick(robot.well(position_m=(0.84, 0.0, 0.0)))
    assert robot.conditions == {Condition.JUMP}
    assert "0.43 m from the last one that can be (limit 0.42 m)" in robot.texts()


def test_after_a_jump_the_old_place_is_believed_and_the_new_one_is_not() -> None:
    """(G-JUMP)"""
    robot = Guarded().running()
    for _ in range(40):
        robot.now_s += 0.1
        robot.tick(robot.well(position_m=(1.5, 1.5, 0.0)))
        assert robot.conditions == {Condition.JUMP}
    robot.tick()
    assert robot.conditions == set()


def test_people_who_start_again_have_looked_where_it_is() -> None:
    """(G-JUMP)"""
    robot = Guarded().running()
    robot.tick(robot.well(position_m=(1.5, 1.5, 0.0)))
    robot.order(Order.START)
    robot.tick(robot.well(position_m=(1.5, 1.5, 0.0)))
    assert robot.conditions == set()


def test_a_robot_that_is_not_armed_may_be_carried() -> None:
    """(G-JUMP)"""
    robot = Guarded()
    robot.tick()
    robot.tick(robot.well(position_m=(2.0, 2.0, 0.0)))
    assert robot.conditions == set()


# --- the fence ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("position_m", "expected"),
    [
        ((4.79, 0.0, 0.0), ""),
        ((4.81, 0.0, 0.0), "FENCE"),
        ((-5.5, 0.0, 0.0), "FENCE"),
        ((0.0, -4.9, 0.0), "FENCE"),
        ((2.29, 0.0, 0.0), ""),
        ((2.31, 0.0, 0.0), "FENCE"),
        ((3.0, 0.0, 0.0), "FENCE"),
        ((3.0, 0.0, 9.0), "FENCE"),  # what drives has no height
    ],
)
def test_the_fence_has_walls_and_obstacles(position_m: Point, expected: str) -> None:
    """(G-FENCE): with a margin of 0.2 m."""
    assert told(position_m) == expected


@pytest.mark.parametrize(
    ("position_m", "expected"),
    [
        ((0.0, 0.0, 2.79), ""),
        ((0.0, 0.0, 2.81), "FENCE"),
        ((0.0, 0.0, -0.1), ""),  # on the ground, as measured
        ((0.0, 0.0, -0.3), "FENCE"),
        ((4.9, 0.0, 1.0), "FENCE"),
    ],
)
def test_the_fence_of_a_drone_has_a_ceiling(position_m: Point, expected: str) -> None:
    """(G-FENCE)"""
    assert told(position_m, limits=DRONE) == expected


def test_it_can_stop_before_the_fence() -> None:
    """(G-AHEAD): by what it wishes for, and by its velocity."""
    short, far = 2.3 - BRAKING_M - 0.01, 2.3 - BRAKING_M + 0.01
    ahead, back = Velocity((1.0, 0.0, 0.0)), Velocity((-1.0, 0.0, 0.0))
    assert told((short, 0.0, 0.0), ahead) == ""
    assert told((far, 0.0, 0.0), ahead) == "AHEAD"
    assert told((far, 0.0, 0.0), back) == ""
    assert told((far, 0.0, 0.0), Hold(), velocity_mps=(1.0, 0.0, 0.0)) == "AHEAD"
    assert told((far, 0.0, 0.0), back, velocity_mps=(1.0, 0.0, 0.0)) == "AHEAD"
    assert told((far, 0.0, 0.0), Position((2.25, 0.0, 0.0), None, 1.0)) == ""
    assert told((1.5, 0.0, 0.0), Position((4.5, 0.0, 0.0), None, 0.2)) == ""
    assert told((2.2, 0.0, 0.0), Position((4.5, 0.0, 0.0), None, 1.0)) == "AHEAD"


def test_what_drives_goes_where_it_points() -> None:
    """(G-AHEAD): forwards and backwards."""
    far = (2.3 - BRAKING_M + 0.01, 0.0, 0.0)
    behind = (0.0, 0.0, 0.0, 1.0)
    assert told(far, Drive(1.0)) == "AHEAD"
    assert told(far, Drive(-1.0)) == ""
    assert told(far, Drive(1.0), attitude=behind) == ""
    assert told(far, Drive(-1.0), attitude=behind) == "AHEAD"
    assert told(far, Drive(1.0), attitude=(math.nan, 0.0, 0.0, 0.0)) == "POSE"


def test_what_is_tracked_is_on_the_way() -> None:
    """(G-AHEAD): to the position, and on from there until it stands."""
    up = (0.0, 1.0, 0.0)
    assert told((2.2, 0.5, 0.0), Track((2.2, 0.6, 0.0), up)) == ""
    assert told((1.0, 0.0, 0.0), Track((2.0, 0.0, 0.0), (1.0, 0.0, 0.0))) == "AHEAD"
    assert told((2.0, 0.0, 0.0), Track((4.0, 0.0, 0.0), up)) == "AHEAD"  # through the block


def test_what_lands_is_not_on_its_way_out_of_the_world() -> None:
    """(G-AHEAD): the ground is no wall."""
    down = {"velocity_mps": (0.0, 0.0, -1.0), "airborne": True}
    assert told((0.0, 0.0, 0.3), Land(), limits=DRONE, **down) == ""
    assert told((0.0, 0.0, 2.5), Velocity((0.0, 0.0, 1.0)), limits=DRONE) == "AHEAD"
    assert told((0.0, 0.0, 0.0), Takeoff(2.0), limits=DRONE) == ""


@pytest.mark.parametrize(
    "wish",
    [
        Velocity((1.21, 0.0, 0.0)),
        Velocity((math.nan, 0.0, 0.0)),
        Velocity((0.1, 0.0, 0.0), math.inf),
        Drive(1.21),
        Drive(-1.21),
        Drive(0.1, math.nan),
        Drive(0.1, 0.0, math.inf),
        Track((9.0, 0.0, 0.0), (0.1, 0.0, 0.0)),
        Track((0.0, 0.0, 0.0), (0.0, 1.21, 0.0)),
        Track((0.0, 0.0, 0.0), (0.0, 0.1, 0.0), (math.nan, 0.0, 0.0)),
        Position((9.0, 0.0, 0.0), None, 0.5),
        Position((3.0, 0.0, 0.0), None, 0.5),
        Position((0.0, 0.0, 0.0), math.nan, 0.5),
        Position((0.0, 0.0, 0.0), None, 2.0),
        Position((0.0, 0.0, 0.0), None, -1.0),
        Takeoff(1.0),
        Land(),
        Arm(),
        Disarm(),
        "forward",
    ],
    ids=str,
)
def test_wishes_that_are_not_passed_on(wish: Wish) -> None:
    """(G-WISH, G-NUMBER)"""
    assert told((0.0, 0.0, 0.0), wish) == "WISH"


@pytest.mark.parametrize("height_m", [math.nan, 2.9, -1.0, 1e9])
def test_heights_that_are_not_risen_to(height_m: float) -> None:
    """(G-WISH)"""
    assert told((0.0, 0.0, 0.0), Takeoff(height_m), limits=DRONE) == "WISH"


# --- other robots -------------------------------------------------------------------------------


def near(x: float, age_s: float = 0.0, speed_mps: float = 0.0) -> tuple[Other, ...]:
    """Another robot on the x axis, that comes nearer with a speed."""
    return (Other(1, (x, 0.0, 0.0), (-speed_mps, 0.0, 0.0), age_s),)


AHEAD = Velocity((1.0, 0.0, 0.0))
HERE = (0.0, 0.0, 0.0)


def unseen_m(age_s: float) -> float:
    """How far another robot may have got besides, since it was seen."""
    return 1.5 * (age_s + 0.2) ** 2


#: The least distance of which nothing is said, of a robot that is driven towards one that stands.
APART_M = 0.5 + BRAKING_M + unseen_m(0.0)


def test_robots_keep_apart() -> None:
    """(G-APART): 0.5 m, at the end of the braking distance."""
    assert told(HERE, AHEAD, others=near(APART_M + 0.01)) == ""
    assert told(HERE, AHEAD, others=near(APART_M - 0.01)) == "APART"
    moving = {"velocity_mps": (1.0, 0.0, 0.0)}
    assert told(HERE, Hold(), others=near(APART_M - 0.01), **moving) == "APART"


def test_both_robots_have_to_brake() -> None:
    """(G-APART)"""
    assert told(HERE, AHEAD, others=near(APART_M + BRAKING_M + 0.01, speed_mps=1.0)) == ""
    assert told(HERE, AHEAD, others=near(APART_M + BRAKING_M - 0.01, speed_mps=1.0)) == "APART"
    assert told(HERE, AHEAD, others=near(APART_M + 0.01, speed_mps=-1.0)) == ""


def test_what_was_seen_long_ago_has_moved_on() -> None:
    """(G-APART): for 5 rounds of 0.1 s; then its own guardian holds it."""
    for age_s, known_s in ((0.1, 0.1), (0.5, 0.5), (60.0, 0.5), (math.nan, 0.5), (-1.0, 0.5)):
        least_m = 0.5 + 2 * BRAKING_M + 1.0 * known_s + unseen_m(known_s)
        assert told(HERE, AHEAD, others=near(least_m + 0.01, age_s, 1.0)) == ""
        assert told(HERE, AHEAD, others=near(least_m - 0.01, age_s, 1.0)) == "APART"


def test_who_moves_away_or_stands_is_not_too_close() -> None:
    """(G-APART)"""
    for speed_mps in (0.0, 1.0):
        assert told(HERE, Hold(), others=near(0.3, 0.0, speed_mps)) == ""
        assert told(HERE, Velocity((-1.0, 0.0, 0.0)), others=near(0.3, 0.0, speed_mps)) == ""
    assert told(HERE, Velocity((0.0, 1.0, 0.0)), others=near(0.3)) == ""
    assert told(HERE, Velocity((0.3, 0.0, 0.0)), others=near(0.3)) == "APART"


def test_robots_have_to_be_a_little_further_apart_to_go_on() -> None:
    """(G-APART)"""
    robot = Guarded().running()
    for gap_m, expected in ((0.49, True), (0.55, True), (0.61, False), (0.55, False)):
        robot.tick(replace(robot.well(), others=near(gap_m - 0.5 + APART_M)), AHEAD)
        assert (Condition.APART in robot.conditions) is expected


def test_a_robot_at_no_place_is_too_close() -> None:
    """(G-NUMBER, G-APART)"""
    assert told(HERE, others=near(math.nan)) == "APART"
    assert told(HERE, others=near(2.0, 0.0, math.inf)) == "APART"


# --- at rest ------------------------------------------------------------------------------------

STILL = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("sensed", "expected"),
    [
        ({"airborne": False}, True),
        ({"airborne": True}, False),
        ({"airborne": False, "link": False}, False),
        ({"airborne": False, "measured_at_s": -9.0}, True),  # its autopilot knows
        ({"airborne": None}, True),
        ({"airborne": None, "position_m": (0.0, 0.0, 0.14)}, True),
        ({"airborne": None, "position_m": (0.0, 0.0, 0.16)}, False),
        ({"airborne": None, "velocity_mps": (0.0, 0.0, -0.06)}, False),
        ({"airborne": None, "measured_at_s": -9.0}, False),
        ({"airborne": None, "link": False}, False),
    ],
)
def test_an_aircraft_at_rest_is_on_the_ground(sensed: dict[str, object], *, expected: bool) -> None:
    """(G-END)"""
    robot = Guarded(DRONE)
    robot.tick(robot.well(**sensed))
    assert robot.state.at_rest is expected


@pytest.mark.parametrize(
    ("sensed", "expected"),
    [
        ({"velocity_mps": STILL}, True),
        ({"velocity_mps": (0.04, 0.0, 0.0)}, True),
        ({"velocity_mps": (0.0, -0.06, 0.0)}, False),
        ({"velocity_mps": (math.nan, 0.0, 0.0)}, False),
        ({"airborne": False, "velocity_mps": (1.0, 0.0, 0.0)}, False),
        ({"measured_at_s": -9.0}, False),
        ({"link": False}, False),
    ],
)
def test_what_drives_is_at_rest_when_it_stands(
    sensed: dict[str, object], *, expected: bool
) -> None:
    """(G-END)"""
    robot = Guarded()
    robot.tick(robot.well(**sensed))
    assert robot.state.at_rest is expected
