"""What is wrong with worlds and starts is said, each thing by its number."""

from __future__ import annotations

import math
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.bodies import Body, Car, Drone
from koord.runtime.motion.checks import WorldPart, near_pairs, start_complaints, world_complaints
from koord.runtime.motion.world import Box, Disc, Obstacle, Point, Polygon, World
from tests.runtime.motion.worlds import CLUTTERED

GOOD = Disc((0.0, 0.0), 0.5)


@pytest.mark.parametrize(
    ("obstacle", "said"),
    [
        (Box((0, 0, 0), (0, 1, 1)), "low corner"),
        (Disc((0, 0), 0.0), "radius"),
        (Polygon(((0, 0), (1, 1))), "three corners"),
        (Polygon(((0, 0), (1, 1), (1, 0), (0, 1))), "Self-intersection"),
        (Polygon(((0, 0), (1, 1), (2, 2))), "no polygon"),
    ],
)
def test_obstacles_that_are_none(obstacle: Obstacle, said: str) -> None:
    complaints = list(world_complaints(World(obstacles=(GOOD, obstacle))))
    assert [(c.part, c.index) for c in complaints] == [(WorldPart.OBSTACLE, 1)]
    assert said in complaints[0].message


def test_bounds_and_tasks() -> None:
    complaints = list(world_complaints(World((0, 0, 0), (1, 0, 1), (), ((0.5, 0, 0.5), (2, 0, 0)))))
    assert [(c.part, c.index) for c in complaints] == [(WorldPart.BOUNDS, 0), (WorldPart.TASK, 1)]
    assert "along y" in complaints[0].message
    assert "(2, 0, 0)" in complaints[1].message


def test_good_worlds_have_no_complaints() -> None:
    assert list(world_complaints(CLUTTERED)) == []


@pytest.mark.parametrize(
    ("robots", "said"),
    [
        ([(Car(), (9, 0, 0))], [(0, "outside")]),
        ([(Car(), (0, 3, 1))], [(0, "on the ground")]),
        ([(Car(), (0, 0, 0))], [(0, "something stands")]),
        ([(Drone(), (0, -3, 1)), (Drone(), (0.3, -3, 1))], [(1, "0.30 m from robot 0")]),
        ([(Drone(), (0, -3, 1)), (Car(), (2, -3, 0))], []),
        ([(Drone(), (1.3, 2, 1))], [(0, "something stands")]),
        ([(Drone(), (1.3, 2, 2.4))], []),
    ],
)
def test_starts(robots: list[tuple[Body, Point]], said: list[tuple[int, str]]) -> None:
    complaints = list(start_complaints(CLUTTERED, robots))
    assert [c.index for c in complaints] == [index for index, _ in said]
    for complaint, (_, words) in zip(complaints, said, strict=True):
        assert words in complaint.message
        assert complaint.part is WorldPart.ROBOT


def test_programs_may_ask_for_more_distance() -> None:
    robots: list[tuple[Body, Point]] = [(Drone(), (0, -3, 1)), (Drone(), (1, -3, 1))]
    assert list(start_complaints(World(), robots)) == []
    assert len(list(start_complaints(World(), robots, apart_m=1.5))) == 1


_COORDINATES = st.one_of(
    st.integers(-3, 3).map(float), st.floats(-2, 2), st.sampled_from([1e9, 1e9 + 1, -1e300, 0.1])
)


@given(
    st.lists(st.tuples(_COORDINATES, _COORDINATES, _COORDINATES), min_size=1, max_size=12),
    st.sampled_from([0.0, 1e-300, 0.1, 0.5, 1.0, math.sqrt(2), 3.0, 1e8]),
)
def test_pairs_that_are_near_are_found(points: list[Point], reach_m: float) -> None:
    pairs = combinations(range(len(points)), 2)
    near = [(i, k) for i, k in pairs if math.dist(points[i], points[k]) <= reach_m]
    assert sorted(near_pairs(points, reach_m)) == near


def test_starts_of_many_are_told_as_those_of_few() -> None:
    crowd: list[tuple[Body, Point]] = [(Drone(), (2 * (k % 9), k // 9, 1)) for k in range(90)]
    crowd[80] = Drone(), (8, 3.3, 1.2)  # near to robot 31
    world = World((-1, -1, 0), (20, 20, 4))
    (said,) = start_complaints(world, crowd)
    (of_two,) = start_complaints(world, [crowd[31], crowd[80]])
    assert (said.index, said.message) == (80, of_two.message.replace("robot 0", "robot 31"))


def test_a_world_of_too_many_cells_with_something_in_it_is_refused() -> None:
    most = World((0, 0, 0), (500, 500, 3), (GOOD,), cell_m=0.5)
    assert list(world_complaints(most)) == []
    (said,) = world_complaints(World((0, 0, 0), (501, 500, 3), (GOOD,), cell_m=0.5))
    assert said.part is WorldPart.BOUNDS
    assert "at most 1000000 cells" in said.message
    assert list(world_complaints(World((0, 0, 0), (1e9, 4, 3)))) == []
