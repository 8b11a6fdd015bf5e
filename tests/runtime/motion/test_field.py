"""Free space: by the point, by the segment, and shapely's opinion of both."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.field import field
from koord.runtime.motion.world import Box, Disc, Polygon, World
from tests.runtime.motion.worlds import CLUTTERED

COORDINATE = st.floats(-3.4, 3.4)
HEIGHT = st.floats(0.0, 3.0)
PLACE = st.tuples(COORDINATE, COORDINATE, HEIGHT)
REACH = 0.3


@given(COORDINATE, COORDINATE)
def test_clearance_on_the_ground_is_what_shapely_says(x: float, y: float) -> None:
    free = field(CLUTTERED, flat=True)
    here = shapely.Point(x, y)
    shapes = [
        shapely.Point(0, 0).buffer(0.6, quad_segs=64),
        shapely.box(1, 1, 1.6, 3),
        shapely.Polygon([(-2, 1), (-1, 1), (-1, 2.5)]),
    ]
    walls = min(x + 3.5, 3.5 - x, y + 4, 4 - y)
    expected = min(walls, *(here.distance(shape) for shape in shapes))
    assert max(free.clearance(x, y, 0.0), 0.0) == pytest.approx(expected, abs=1e-3)


@given(PLACE, PLACE, st.booleans())
def test_segments_are_free_where_all_their_points_are(
    start: tuple[float, float, float], end: tuple[float, float, float], flat: bool
) -> None:
    free = field(CLUTTERED, flat=flat)
    a, b = np.array([start]), np.array([end])
    if flat:
        a[:, 2] = b[:, 2] = 0.0
    points = a + np.linspace(0, 1, 200)[:, None] * (b - a)
    least = min(free.clearance(*p) for p in points.tolist())
    spacing = float(np.linalg.norm(b - a)) / 199
    found = bool(free.segments_free(a, b, REACH)[0])
    if least > REACH + spacing:
        assert found
    if least < REACH - 1e-9:
        assert not found


def test_a_robot_on_the_ground_passes_below_what_hangs_high() -> None:
    world = World(obstacles=(Disc((0.0, 0.0), 0.5, 1.0, 2.0),))
    assert field(world, flat=True).clearance(0, 0, 0) > 3
    way, up = np.array([[-2.0, 0, 1.5], [2.0, 0, 1.5]]), np.array([0.0, 0, 1])
    assert not field(world, flat=False).path_free(way, REACH)
    assert field(world, flat=False).path_free(way + up, REACH)
    assert field(world, flat=False).path_free(way - up, REACH)


def test_a_steep_segment_is_blocked_only_where_it_is_as_high() -> None:
    world = World(obstacles=(Box((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0)),))
    free = field(world, flat=False)
    over = np.array([[-3.0, 0, 0.2], [-1.4, 0, 1.6], [1.4, 0, 1.6], [3.0, 0, 0.2]])
    assert free.path_free(over, REACH)
    through = np.array([[-3.0, 0, 0.2], [3.0, 0, 2.6]])
    assert not free.path_free(through, REACH)


def test_leaving_the_world_is_not_free() -> None:
    free = field(World(), flat=False)
    assert not free.path_free(np.array([[0.0, 0, 1], [3.4, 0, 1]]), REACH)
    assert not free.path_free(np.array([[0.0, 0, 1], [0, 0, 2.9]]), REACH)
    assert not free.path_free(np.array([[0.0, 0, 1], [0, 0, -0.1]]), REACH)
    assert free.path_free(np.array([[0.0, 0, 0], [3.1, 0, 2.6]]), REACH)


def test_polygons_may_be_hollow() -> None:
    corners = ((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (2.0, 3.0), (2.0, 1.0), (1.0, 1.0), (1.0, 3.0))
    hollow = Polygon((*corners, (0.0, 3.0)))
    free = field(World((-1, -1, 0), (4, 4, 1), (hollow,)), flat=True)
    assert free.clearance(1.5, 2.0, 0) == pytest.approx(0.5)
    assert free.clearance(0.5, 2.0, 0) == 0.0
