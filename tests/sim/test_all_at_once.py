"""What is done for all robots at once is what is done for one after the other."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.bodies import Body, DifferentialDrive, Drone, PlannerName
from koord.runtime.motion.planning import all_suit, suits
from koord.runtime.motion.world import Box, Point, World
from koord.runtime.ports import placed
from koord.runtime.shapes import FLOAT, INT, Record, Shape, from_plain
from koord.sim.fleet import Fleet, Placed
from koord.sim.radio import Radio, Reception
from koord.sim.reading import placed_in
from koord.sim.squads import DeviceModel

WORLD = World((-3, -3, 0), (3, 3, 3), obstacles=(Box((-0.5, -0.5, 0), (0.5, 0.5, 3)),))

Flat = namedtuple("Flat", ("x", "y"))
Place = namedtuple("Place", ("x", "y", "z"))

EDGES = st.sampled_from([-3.0, 3.0, 0.0, 0.1, 0.05, 3.5, -0.0, float("nan"), float("inf")])
POINTS = st.tuples(*[st.one_of(EDGES, st.floats(-4, 4))] * 3)


@pytest.mark.parametrize("body", [Drone(), DifferentialDrive()])
@given(points=st.lists(POINTS, min_size=1, max_size=9))
def test_points_suit_at_once_as_one_by_one(body: Body, points: list[Point]) -> None:
    found = all_suit(body, WORLD, np.array(points, np.float64)).tolist()
    assert found == [suits(body, WORLD, point) for point in points]


def sent(*, at_once: bool, takes_s: float) -> Fleet:
    """Drones and rovers that are sent twice; of some it is known before that they cannot go."""
    drone = DeviceModel(Drone(), PlannerName.RRT_DRONE, plan_takes_s=takes_s)
    rover = DeviceModel(DifferentialDrive(), PlannerName.RRT_DIFF)
    places = [(-2.0, -2.0 + 0.9 * k, 0.0) for k in range(5)]
    robots = [Placed(rover if k == 4 else drone, place) for k, place in enumerate(places)]
    fleet = Fleet(WORLD, robots)
    for robot in (0, 1):
        fleet.wait_for_takeoff(robot)
    fleet.take_off(0, up=True)
    for x, then_s in ((2.0, 0.2), (-1.0, 1.0), (1.0, 0.6), (9.0, 0.2), (-1.3, 1.0)):
        targets = {k: (x, -2.0 + 0.9 * k, 0.0 if k == 4 else 1.0) for k in range(5)}
        if at_once:
            fleet.go_to_all(targets)
        else:
            for robot, target in targets.items():
                fleet.go_to(robot, target)
        fleet.advance_to(fleet.now_s + then_s)
        if x == -1.0:
            fleet.stop(2)
            fleet.advance_to(fleet.now_s + 0.1)
    fleet.take_off(1, up=True)
    fleet.advance_to(fleet.now_s + 3.0)
    return fleet


@pytest.mark.parametrize("takes_s", [0.0, 0.3])
def test_robots_are_sent_at_once_as_one_by_one(takes_s: float) -> None:
    one, other = (sent(at_once=at_once, takes_s=takes_s) for at_once in (False, True))
    assert np.array_equal(one.positions(), other.positions())
    assert np.array_equal(one.paths_given(), other.paths_given())
    for (mine, _), (its, _) in zip(one.squads, other.squads, strict=True):
        assert mine.group.targets == its.group.targets
        assert mine.group.plights == its.group.plights
        assert np.array_equal(mine.group.orders, its.group.orders)
    start = np.array([robot.start for robot in other.robots])
    went = np.abs(other.positions() - start).max(1) > 0.2
    assert went.tolist() == [True] * 5


@pytest.mark.parametrize("count", [1, 7, 201])
def test_who_hears_whom_is_looked_at_once_as_one_by_one(count: int) -> None:
    draw = np.random.default_rng(count)
    reception = Reception(Radio(2.5), np.zeros((count, 3)))
    for _ in range(4):
        places = draw.integers(-3, 4, (count, 3)).astype(np.float64) / 2
        reception.measure(places)
        for robot in range(0, count, 1 + count // 20):
            heard = reception.heard(robot)
            assert heard == tuple(reception._row(robot).tolist())
            assert heard is reception.heard(robot)


def test_what_does_not_change_is_heard_by_the_same_object() -> None:
    places = np.array([(0.0, 0, 0), (1.0, 0, 0), (9.0, 0, 0)])
    reception = Reception(Radio(2.0), places)
    before = [reception.heard(robot) for robot in range(3)]
    places[2, 0] = 2.5
    reception.measure(places)
    assert [reception.heard(robot) for robot in range(3)] == [
        *((False, True, False), (True, False, True), (False, True, False))
    ]
    assert reception.heard(0) is before[0]


@pytest.mark.parametrize(
    "shape",
    [
        FLOAT,
        Record(Flat, (FLOAT, FLOAT)),
        Record(Place, (FLOAT, FLOAT, FLOAT)),
    ],
)
def test_places_are_told_at_once_as_one_by_one(shape: Shape) -> None:
    points: list[Point] = [(1.0, 2.0, 3.0), (-0.0, 1e300, 0.5)]
    found = placed_in(shape, np.array(points), 2)
    wanted = [from_plain(shape, placed(shape, point), 2) for point in points]
    assert list(found) == wanted
    assert [type(one) for one in found] == [type(one) for one in wanted]


def test_places_are_told_in_no_other_shape() -> None:
    with pytest.raises(ValueError, match="is no int"):
        placed_in(INT, np.zeros((1, 3)), 1)
