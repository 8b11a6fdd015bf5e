"""Direct ways of cars by machine code: to the last bit those of OMPL's curves, or none."""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from koord.runtime.motion.bodies import Car, PlannerName
from koord.runtime.motion.planners import planner
from koord.runtime.motion.planning import PlanningEffort, Pose
from koord.runtime.motion.world import Box, Point, World

curves = pytest.importorskip("koord.runtime.motion.compiled_curves")
rrt: Any = pytest.importorskip("koord.runtime.motion.rrt")

CAR = Car()
WIDE = World((-40, -40, 0), (40, 40, 3))
CORNERS = [(1.2, 0.0), (1.2, 1.2), (0.0, 1.2), (-1.2, 0.0), (0.0, -1.2), (-1.2, -1.2), (0.3, 0.0)]


def made(world: World, *, quick: bool) -> Any:
    found = planner(PlannerName.RRT_CAR, world, CAR, PlanningEffort(), is_quick=quick)
    assert isinstance(found, rrt.CurvePlanner)
    assert found.is_quick == quick
    return found


def queries(count: int, seed: int) -> list[tuple[Pose, Point]]:
    """Poses and goals: some in a grid, as squares have them, and some far from each other."""
    chance, found = random.Random(seed), []
    for k in range(count):
        size = (0.0, 0.2, 1.0, 4.0, 15.0)[k % 5]
        x, y, heading = (chance.uniform(-size, size) for _ in range(3))
        goal = x + chance.uniform(-size, size), y + chance.uniform(-size, size), 0.0
        if size == 0.0:
            (dx, dy), heading = chance.choice(CORNERS), math.pi / 2 * chance.randrange(-2, 3)
            goal = x + dx, y + dy, 0.0
        found.append((Pose((x, y, 0.0), heading), goal))
    return found


def test_direct_ways_are_those_of_ompl() -> None:
    """Shortest curves of every kind, the cusps in them, and their points."""
    by_ompl, by_code, sure = made(WIDE, quick=False), made(WIDE, quick=True), 0
    many = queries(600, 1)
    for start, goal in many:
        wanted = by_ompl.plan(start, goal, 1)
        need_m = rrt.far_m(CAR)
        sure += (
            math.dist(start.position, goal) < 0.01
            or by_code._by_code(start, goal, need_m) is not None
        )
        assert np.array_equal(by_code.plan(start, goal, 1), wanted), (start, goal)
    assert sure > 0.98 * len(many)


def test_where_a_wall_is_near_ompl_is_asked() -> None:
    """Nothing is said of curves of which some place is as near to the edge as a car may be."""
    narrow, known = World((-1.6, -1.6, 0), (1.6, 1.6, 3)), 0
    by_ompl, by_code = made(narrow, quick=False), made(narrow, quick=True)
    for start, goal in queries(100, 2):
        if max(map(abs, (*start.position, *goal))) > 1.5:
            continue
        found = by_code._by_code(start, goal, rrt.far_m(CAR))
        known += found is not None
        if found is not None:
            assert np.array_equal(by_ompl.plan(start, goal, 1), found)
            assert (np.abs(found[:, :2]) < 1.6 - rrt.far_m(CAR)).all()
    assert 0 < known < 60
    # A curve that is free where it begins and ends, and not between.
    start, goal = Pose((1.0, 0.0, 0.0), math.pi / 2), (-1.0, 0.0, 0.0)
    tight = World((-9, -9, 0), (9, 0.5, 3))
    assert made(tight, quick=True)._by_code(start, goal, 0.3) is None


def test_obstacles_and_odd_questions_are_ompls() -> None:
    blocked = replace(WIDE, obstacles=(Box((0.5, -2, 0), (1, 2, 2)),))
    start, goal = Pose((-1.5, 0.0, 0.0), 0.0), (3.0, 0.0, 0.0)
    ways = [made(blocked, quick=quick).plan(start, goal, 3) for quick in (False, True)]
    assert ways[0] is not None
    assert np.array_equal(*ways)
    by_code = made(WIDE, quick=True)
    assert by_code._by_code(Pose((math.nan, 0.0, 0.0)), goal, 0.3) is None
    assert by_code._by_code(start, (math.inf, 0.0, 0.0), 0.3) is None
    huge = made(World((-1e4, -1e4, 0), (1e4, 1e4, 3)), quick=True)
    assert huge._by_code(start, (2000.0, 0.0, 0.0), 0.3) is None
    assert planner(PlannerName.RRT_DUB_CAR, WIDE, CAR, is_quick=True) == planner(
        PlannerName.RRT_DUB_CAR, WIDE, CAR
    )


def test_without_the_library_nothing_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curves, "library", lambda: None)
    assert curves.direct_ways((0.0,)) is None
    monkeypatch.setattr(rrt, "_direct_ways", lambda: None)
    start, goal = queries(3, 3)[2]
    ways = [made(WIDE, quick=quick).plan(start, goal, 1) for quick in (False, True)]
    assert np.array_equal(*ways)
