"""The library's functions: each answer meets the summary that the prelude gives of it."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.bodies import Car, Drone, PlannerName
from koord.runtime.motion.clearance import Clearance
from koord.runtime.motion.library import Chart, Library
from koord.runtime.motion.planners import planner
from koord.runtime.motion.planning import PlanningEffort, Pose
from koord.runtime.motion.world import Box, Point, World
from tests.runtime.motion.worlds import CLUTTERED

CAR, DRONE = 0, 1
POSES = {CAR: Pose((-2.5, -2.0, 0.0), 0.4), DRONE: Pose((2.0, -2.0, 1.0))}
PLANNERS = {
    CAR: planner(PlannerName.RRT_CAR, CLUTTERED, Car(), PlanningEffort(400, 20)),
    DRONE: planner(PlannerName.RRT_DRONE, CLUTTERED, Drone(), PlanningEffort(400, 20)),
}
#: Goals of all sorts: free, inside of obstacles, on the ground, in the air, outside of the world.
GOAL = st.tuples(
    st.floats(-4.5, 4.5), st.floats(-4.5, 4.5), st.one_of(st.just(0.0), st.floats(0, 4))
)


def library(seed: int = 1, plans: int = 100) -> Library:
    return Library(
        PLANNERS, lambda robot: POSES[robot], Clearance(), Chart(CLUTTERED.grid), seed, plans
    )


@given(st.sampled_from([CAR, DRONE]), GOAL)
def test_find_path_leads_from_start_to_goal(robot: int, goal: Point) -> None:
    start = POSES[robot].position
    path = library().find_path(robot, start, goal)
    if path != ():
        assert path[0] == start
        assert path[-1] == goal


@given(GOAL, st.lists(GOAL, max_size=4))
def test_find_path_around_points_begins_at_its_start(goal: Point, points: list[Point]) -> None:
    start = POSES[DRONE].position
    path = library().find_path_around(DRONE, start, goal, points)
    if path != ():
        assert path[0] == start
        assert path[-1] == goal
        for x, y, _ in points:
            assert min(math.hypot(x - p[0], y - p[1]) for p in path[1:-1] or [goal]) > 0.5 - 0.25


@given(st.sampled_from([CAR, DRONE]), GOAL)
def test_paths_to_tasks_end_at_them(robot: int, goal: Point) -> None:
    path = library().path_from_task(robot, goal)
    if path != ():
        assert path[0] == POSES[robot].position
        assert path[-1] == goal


def test_who_finds_no_way_will_collide() -> None:
    made = library()
    assert made.will_collide(DRONE, (0.0, 0.0, 1.0))
    assert not made.will_collide(DRONE, (2.0, 0.0, 1.0))
    assert made.will_collide(CAR, (2.0, 0.0, 1.0))
    assert made.find_path(CAR, POSES[CAR].position, (2.0, 0.0, 1.0)) == ()
    assert made.find_path_around(CAR, POSES[CAR].position, (2.0, 0.0, 1.0), [(9.0, 9.0, 0.0)]) == ()


def test_plans_are_limited_and_then_repeated() -> None:
    made = library(plans=2)
    goal = (2.2, 2.0, 0.0)
    start = POSES[CAR].position
    first, second = (made.find_path(CAR, start, goal) for _ in range(2))
    assert first != second  # `extern fresh`: planned anew
    assert made.find_path(CAR, start, goal) == second
    near = (start[0] + 0.01, start[1], 0.0)
    again = made.find_path(CAR, near, goal)
    assert again[0] == near
    assert again[1:] == second[1:]
    other = (2.2, 2.2, 0.0)
    assert made.find_path(CAR, start, other) == ()  # no plan left, none known: no way this round
    made.begin_round()
    assert made.find_path(CAR, start, other)[-1] == other


def test_seeds_repeat_answers() -> None:
    goals = [(2.2, 2.0, 0.0), (2.5, -2.0, 0.0), (2.2, 2.0, 0.0)]
    one, same, other = (
        [library(seed).find_path(CAR, POSES[CAR].position, goal) for goal in goals]
        for seed in (1, 1, 2)
    )
    assert one == same
    assert one != other


def test_what_robots_know_of_a_world_grows_until_they_know_it() -> None:
    """The U of the Mapping example: a drone scans, picks a frontier, and goes there."""
    from koord.runtime.motion.library import occupied
    from koord.sim.lidar import Lidar, Scanner

    world = World(
        (0.0, 0.0, 0.0),
        (8.0, 8.0, 3.0),
        (
            Box((2.0, 2.0, 0.0), (3.0, 6.0, 3.0)),
            Box((3.0, 2.0, 0.0), (5.0, 3.0, 3.0)),
            Box((5.0, 2.0, 0.0), (6.0, 6.0, 3.0)),
        ),
        cell_m=1.0,
    )
    made = planner(PlannerName.RRT_DRONE, world, Drone())
    at = {0: Pose((1.0, 1.0, 1.0))}
    functions = Library(
        {0: made}, at.__getitem__, Clearance(), Chart(world.grid, 3.0), seed=2, plans_per_round=99
    )
    scanner = Scanner(Lidar(beams=180, range_m=3.0), world, 1.0)
    known: dict[int, bool] = {}
    walls = occupied(world)
    assert len(walls) == 4 + 2 + 4
    for _ in range(60):
        seen = functions.scan_to_map(scanner.scan(at[0].position, 0.0))
        for cell, there in seen.items():
            assert there == (cell in walls)  # every scan is right
        known.update(seen)
        here = at[0].position
        goal = functions.pick_frontier(0, known, here)
        path = functions.find_path(0, here, goal)
        if path == ():
            continue
        at[0] = Pose(goal)
    free = set(range(world.grid.cells)) - walls
    # Corners of the U behind other walls cannot be seen; everything else is known.
    assert {cell for cell, there in known.items() if not there} == free
    assert {cell for cell, there in known.items() if there} >= walls - {27, 28}
    points = functions.find_obstacles(known)
    assert len(points) == sum(known.values()) <= len(known)
    assert np.allclose([p[2] for p in points], 0.0)
