"""Planners: what they must keep to, that seeds repeat them, and that counting stops them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from ompl import base

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Body, Car, Drone, IdealBody, PlannerName
from koord.runtime.motion.curves import SPACING_M, Curve, is_free
from koord.runtime.motion.curves import points as points_of
from koord.runtime.motion.field import field
from koord.runtime.motion.geometry import wrapped
from koord.runtime.motion.planners import planner
from koord.runtime.motion.planning import PlanningEffort, Pose, Room, suits
from koord.runtime.motion.rrt import MARGIN_M, CurvePlanner, car_fits, spaced
from koord.runtime.motion.world import Box, Disc, World
from tests.runtime.motion.worlds import CLUTTERED, EMPTY, places

CAR, DRONE = Car(), Drone()
CARS = [PlannerName.RRT_CAR, PlannerName.RRT_STAR_CAR]
DRONES = [PlannerName.RRT_DRONE, PlannerName.RRT_STAR_DRONE]
FEW = PlanningEffort(steps=1500, star_steps=40)


def headings(path: Floats, start_rad: float) -> list[float]:
    """Where a car points at the points of a path, which it may drive backwards."""
    way = np.diff(path[:, :2], axis=0)
    course = np.arctan2(way[:, 1], way[:, 0])
    found, now = [], start_rad
    for k, angle in enumerate(course.tolist()):
        options = (angle, angle + math.pi)
        now = min(options, key=lambda option: abs(float(wrapped(np.array(option - now)))))
        found.append(now)
        assert k >= 0
    return found


@pytest.mark.parametrize("name", [*CARS, PlannerName.RRT_DUB_CAR])
def test_cars_get_paths_that_they_can_drive(name: PlannerName) -> None:
    made, free = planner(name, CLUTTERED, CAR, FEW), field(CLUTTERED, flat=True)
    there = places(free, 10, seed=3, height_m=0.0, room_m=0.65)
    found = 0
    for k, (start, goal) in enumerate(zip(there[::2], there[1::2], strict=True)):
        path = made.plan(Pose(start, 0.7 * k), goal, seed=k)
        if path is None:
            continue
        found += 1
        assert tuple(path[0]) == start
        assert tuple(path[-1]) == goal
        assert (path[:, 2] == 0.0).all()
        pointing = headings(path, 0.7 * k)
        assert abs(float(wrapped(np.array(pointing[0] - 0.7 * k)))) < 0.2
        length = np.linalg.norm(np.diff(path, axis=0), axis=1)
        # The car turns by no more than its wheels allow over the way between middles of pieces.
        turned = np.abs(wrapped(np.diff(pointing)))
        between = (length[1:] + length[:-1]) / 2
        assert (turned <= between / CAR.turning_m + 0.02).all()
        for (x, y, _), heading in zip(path[:-1].tolist(), pointing, strict=True):
            for ahead in (-0.125, 0.165, 0.455):  # its ends and its middle
                at = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
                assert free.clearance(*at, 0.0) > CAR.width_m / 2 - 0.02
    assert found >= 3


def test_a_planner_of_dubins_curves_drives_forwards_alone() -> None:
    """Also where one of Reeds–Shepp curves would set out backwards, and between obstacles."""
    behind = (-0.8, 0.1, 0.0)
    either = planner(PlannerName.RRT_CAR, EMPTY, CAR, FEW).plan(Pose((0, 0, 0)), behind, seed=1)
    assert either is not None
    assert not _is_forwards(either, 0.0)
    empty, cluttered = (
        planner(PlannerName.RRT_DUB_CAR, world, CAR, FEW) for world in (EMPTY, CLUTTERED)
    )
    there = places(field(CLUTTERED, flat=True), 10, seed=3, height_m=0.0, room_m=0.65)
    tried = [
        cluttered.plan(Pose(start, 0.7), goal, seed=4)
        for start, goal in zip(there[::2], there[1::2], strict=True)
    ]
    found = [path for path in tried if path is not None]
    assert len(found) >= 3
    assert all(_is_forwards(path, 0.7) for path in found)
    path = empty.plan(Pose((0, 0, 0)), behind, seed=1)
    assert path is not None
    assert _is_forwards(path, 0.0)


def test_ways_of_dubins_curves_are_clear_where_they_were_shortened() -> None:
    """The rest of a Dubins curve may be none: from its middle the shortest has a turn more."""
    discs = [
        *((7.5, 7.5, 1.3), (10.3, 10.3, 1.1), (3.4, 11.0, 0.5), (8.0, 3.2, 0.6)),
        *((6.5, 12.6, 0.9), (11.9, 3.9, 1.1), (6.4, 5.5, 0.7)),
    ]
    obstacles = tuple(Disc((x, y), radius_m) for x, y, radius_m in discs)
    world = World((-0.5, -0.5, 0.0), (15.5, 15.5, 1.0), obstacles)
    car = Car(length_m=0.4, width_m=0.3, steering_rad=math.atan(0.33 * 1.15))
    made = planner(PlannerName.RRT_DUB_CAR, world, car, room=Room(least_m=0.5))
    for seed in (5, 8, 9, 13):
        path = made.plan(Pose((1.5, 1.5, 0.0)), (13.5, 13.5, 0.0), seed=seed)
        assert path is not None
        assert field(world, flat=True).path_free(path, 0.49), seed


def _is_forwards(path: Floats, heading_rad: float) -> bool:
    """Return whether a path sets out where the car points, and turns about nowhere."""
    way = np.diff(path[:, :2], axis=0)
    before = np.vstack([[math.cos(heading_rad), math.sin(heading_rad)], way[:-1]])
    return bool((np.einsum("ij,ij->i", way, before) > 0).all())


@pytest.mark.parametrize("name", DRONES)
def test_drones_get_paths_around_obstacles(name: PlannerName) -> None:
    made, free = planner(name, CLUTTERED, DRONE, FEW), field(CLUTTERED, flat=False)
    there = places(free, 16, seed=5, height_m=1.0, room_m=0.4)
    around = 0
    for k, (start, goal) in enumerate(zip(there[::2], there[1::2], strict=True)):
        path = made.plan(Pose(start), goal, seed=k)
        assert path is not None
        assert tuple(path[0]) == start
        assert tuple(path[-1]) == goal
        assert free.path_free(path, DRONE.radius_m)
        around += len(path) > 2
    assert around >= 2


@pytest.mark.parametrize("name", [*CARS, *DRONES])
def test_a_seed_repeats_a_path(name: PlannerName) -> None:
    car = name in CARS
    body: Body = CAR if car else DRONE
    height = 0.0 if car else 1.0
    start, goal = (-2.5, -2.0, height), (2.4, 0.3, height)
    world = World(obstacles=(Box((-0.3, -2.5, 0.0), (0.3, 2.0, 2.9)),))
    made = planner(name, world, body, FEW)
    paths = [made.plan(Pose(start, 0.3), goal, seed=seed) for seed in (1, 2, 1, 2, 3)]
    first, second, again, once_more, _ = paths
    assert first is not None
    assert second is not None
    assert again is not None
    assert once_more is not None
    assert np.array_equal(first, again)
    assert np.array_equal(second, once_more)
    assert len({path.tobytes() for path in paths if path is not None}) >= 2


def test_points_to_avoid_are_avoided() -> None:
    wall = [(0.0, y / 4, 1.0) for y in range(-16, 9)]
    made = planner(PlannerName.RRT_DRONE, EMPTY, DRONE, FEW, avoid_m=0.25)
    straight = made.plan(Pose((-2, 0, 1)), (2, 0, 1), seed=1)
    assert straight is not None
    assert len(straight) == 2
    path = made.plan(Pose((-2, 0, 1)), (2, 0, 1), seed=1, avoid=wall)
    assert path is not None
    gaps = [np.hypot(path[:, 0] - x, path[:, 1] - y).min() for x, y, _ in wall]
    assert min(gaps) > 0.25 + DRONE.radius_m


def test_nobody_is_sent_where_its_kind_does_not_go() -> None:
    assert planner(PlannerName.RRT_CAR, EMPTY, CAR).plan(Pose((0, 0, 0)), (1, 1, 1), 1) is None
    assert planner(PlannerName.RRT_DRONE, EMPTY, DRONE).plan(Pose((0, 0, 1)), (1, 1, 0), 1) is None
    assert planner(PlannerName.STRAIGHT, EMPTY, CAR).plan(Pose((0, 0, 0)), (1, 1, 1), 1) is None
    assert planner(PlannerName.STRAIGHT, EMPTY, DRONE).plan(Pose((0, 0, 0)), (9, 1, 1), 1) is None
    assert suits(IdealBody(), EMPTY, (1, 1, 0))


def test_straight_lines_stop_at_nothing_but_obstacles() -> None:
    made = planner(PlannerName.STRAIGHT, CLUTTERED, DRONE)
    assert made.plan(Pose((-2, 0, 1)), (2, 0, 1), 1) is None
    path = made.plan(Pose((-2, -2, 1)), (2, -2, 1), 1)
    assert path is not None
    assert path.tolist() == [[-2, -2, 1], [2, -2, 1]]


def test_what_cannot_be_reached_is_given_up_after_so_many_steps() -> None:
    """A goal in a closed room: without a count this would go on for ever."""
    walls = (
        Box((0.8, -1.2, 0.0), (0.9, 1.2, 3.0)),
        Box((2.9, -1.2, 0.0), (3.0, 1.2, 3.0)),
        Box((0.8, -1.2, 0.0), (3.0, -1.1, 3.0)),
        Box((0.8, 1.1, 0.0), (3.0, 1.2, 3.0)),
    )
    made = planner(PlannerName.RRT_DRONE, World(obstacles=walls), DRONE, PlanningEffort(steps=300))
    assert made.plan(Pose((-2, 0, 1)), (1.9, 0, 1), 1) is None


def test_a_car_too_near_to_a_wall_may_still_leave() -> None:
    made = planner(PlannerName.RRT_CAR, EMPTY, CAR, FEW)
    path = made.plan(Pose((3.2, 0.0, 0.0), math.pi / 2), (0.0, 0.0, 0.0), seed=4)
    assert path is not None


def test_a_car_fits_where_both_of_its_discs_do() -> None:
    """Also where one look is enough, far from everything."""
    free = field(CLUTTERED, flat=True)
    half = CAR.length_m / 4
    reach = math.hypot(half, CAR.width_m / 2) + MARGIN_M
    fits = car_fits(free, CAR, Pose(places(free, 1, seed=1, height_m=0.0, room_m=0.9)[0]))
    draw = np.random.default_rng(5)
    answers = []
    for x, y, yaw in draw.uniform((-3.4, -3.9, -math.pi), (3.4, 3.9, math.pi), (2000, 3)).tolist():
        discs = [
            free.clearance(x + at * math.cos(yaw), y + at * math.sin(yaw), 0.0)
            for at in (CAR.middle_m + half, CAR.middle_m - half)
        ]
        answers.append(fits.at(x, y, yaw))
        assert answers[-1] == (min(discs) > reach)
    assert 200 < sum(answers) < 1800


def test_turns_about_are_kept_as_points() -> None:
    there = np.linspace(0, 1, 51)
    forth = np.column_stack([there, 0 * there, 0 * there])
    back = np.column_stack([1 - there, 0.1 * there, 0 * there])
    path = spaced(np.concatenate([forth, back]))
    assert (np.abs(path - [1.0, 0.0]).max(1) < 1e-9).sum() == 1
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 0.15 + 1e-9


def test_a_goal_where_the_robot_is_needs_no_tree() -> None:
    path = planner(PlannerName.RRT_CAR, EMPTY, CAR).plan(Pose((1, 1, 0)), (1, 1, 0), 1)
    assert path is not None
    assert path.tolist() == [[1, 1, 0], [1, 1, 0]]


@pytest.mark.parametrize("name", CARS)
def test_a_car_takes_the_shortest_curve_where_it_is_free(
    name: PlannerName, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, goal = planner(name, EMPTY, CAR), (0.3, 1.4, 0.0)
    monkeypatch.setattr(CurvePlanner, "_grown", lambda *_: pytest.fail("a tree was grown"))
    paths = [made.plan(Pose((0, 0, 0), 0.2), goal, seed) for seed in (1, 2)]
    assert paths[0] is not None
    assert paths[1] is not None
    assert np.array_equal(paths[0], paths[1])
    length = np.linalg.norm(np.diff(paths[0], axis=0), axis=1)
    assert length.max() <= SPACING_M + 1e-9
    space = base.ReedsSheppStateSpace(CAR.turning_m * 1.15)
    begin, end = space.allocState(), space.allocState()
    for state, (x, y, yaw) in ((begin, (0.0, 0.0, 0.2)), (end, (*goal[:2], 0.0))):
        state.setX(x)
        state.setY(y)
        state.setYaw(yaw)
    shortest = math.inf
    for k in range(12):
        end.setYaw(math.remainder(math.tau * k / 12, math.tau))
        shortest = min(shortest, space.distance(begin, end))
    assert shortest * 0.99 < length.sum() <= shortest + 1e-9


def test_a_car_does_not_take_a_curve_through_what_is_in_the_way() -> None:
    """Nor the way round it, if it goes on improving, only because that is free as well."""
    world = World(obstacles=(Box((0.9, -0.2, 0.0), (1.0, 0.2, 1.0)),))
    made = planner(PlannerName.RRT_CAR, world, CAR, FEW)
    free = field(world, flat=True)
    path = made.plan(Pose((0, 0, 0)), (2.2, 0, 0), 1)
    assert path is not None
    assert free.path_free(path, CAR.width_m / 2)
    start, goal = Pose((0.0, 0.0, 0.0)), (2.2, 0.0, 0.0)
    assert isinstance(made, CurvePlanner)
    assert replace(made, optimal=True)._direct(free, start, goal, 0.0) is None


ONE = 0.8
"""The radius of the arcs of curves below, in m."""


def curve(*pieces: tuple[float, int]) -> Curve:
    """A curve along an arc: of each piece its length, and whether it is driven forwards."""
    length = sum(piece for piece, _ in pieces)

    def at(share: float) -> tuple[float, float, float]:
        left, angle = share * length, 0.0
        for piece, way in pieces:
            angle += way * min(left, piece) / ONE
            left -= min(left, piece)
        return ONE * math.sin(angle), ONE * (1 - math.cos(angle)), angle

    return Curve(length, ONE, at)


@pytest.mark.parametrize(
    "pieces",
    [
        [(1.0, 1)],
        [(0.4, 1), (0.3, -1)],
        [(0.3, 1), (0.3, -1)],  # where it turns about is a point that is looked at
        [(0.5, -1), (0.02, 1), (0.4, -1)],  # twice between two of those
        [(0.013, -1), (0.9, 1), (0.004, -1)],
    ],
)
def test_a_car_turns_about_at_points_of_its_path(pieces: list[tuple[float, int]]) -> None:
    made = curve(*pieces)
    path, along, corners = points_of(made), 0.0, []
    for piece, _ in pieces:
        corners.append(made.at(along / made.length_m)[:2])
        along += piece
    for corner in [*corners, made.at(1.0)[:2]]:
        assert np.linalg.norm(path - corner, axis=1).min() < 1e-3
    length = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert length.max() <= SPACING_M
    assert length.sum() == pytest.approx(made.length_m, rel=0.01)


def test_a_curve_is_looked_at_no_further_apart_than_is_sure() -> None:
    straight = Curve(2.0, ONE, lambda share: (2 * share, 0.0, 0.0))
    seen: list[float] = []

    def spare(state: tuple[float, float, float]) -> float:
        seen.append(state[0])
        return max(0.0, 0.7 - state[0])

    assert is_free(straight, spare)
    gaps = np.diff(seen)
    assert gaps[0] == pytest.approx(0.7)
    assert gaps[1:].max() <= 0.05 + 1e-9
    assert seen[-1] == 2.0
    assert not is_free(straight, lambda state: -1.0 if 1.2 < state[0] < 1.3 else 0.0)
    assert not is_free(straight, lambda state: -1.0 if state[0] > 1.99 else 0.0)
