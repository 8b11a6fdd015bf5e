"""The scanner, against shapely; and the maps that are drawn from scans."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from koord.runtime.motion.field import field
from koord.runtime.motion.library import frontier, obstacle_points, occupied, scan_to_map
from koord.runtime.motion.world import Box, Grid, World
from koord.sim.lidar import Lidar, Scanner
from tests.runtime.motion.worlds import CLUTTERED

LIDAR = Lidar(beams=36, range_m=2.5)
SOLID = shapely.union_all(
    [
        shapely.Point(0, 0).buffer(0.6, quad_segs=256),
        shapely.box(1, 1, 1.6, 3),
        shapely.Polygon([(-2, 1), (-1, 1), (-1, 2.5)]),
        shapely.box(-9, -9, 9, 9) - shapely.box(-3.5, -4, 3.5, 4),
    ]
)


@given(st.floats(-3.4, 3.4), st.floats(-3.9, 3.9), st.floats(-3, 3))
def test_beams_end_where_something_begins(x: float, y: float, heading: float) -> None:
    if field(CLUTTERED, flat=True).clearance(x, y, 0.0) < 0.01:
        return
    scan = Scanner(LIDAR, CLUTTERED, 0.2).scan((x, y, 0.2), heading)
    assert scan[0] == (x, y, 0.2)
    assert len(scan) == 1 + LIDAR.beams
    for k, (ex, ey, ez) in enumerate(scan[1:]):
        angle = heading + 2 * math.pi * k / LIDAR.beams
        far = x + 2.5 * math.cos(angle), y + 2.5 * math.sin(angle)
        beam = shapely.LineString([(x, y), far])
        expected = min(2.5, shapely.distance(shapely.Point(x, y), beam & SOLID))
        if (beam & SOLID).is_empty:
            expected = 2.5
        assert math.hypot(ex - x, ey - y) == pytest.approx(expected, abs=2e-3)
        assert ez == 0.2


def test_a_scanner_sees_what_is_as_high_as_it() -> None:
    world = World(obstacles=(Box((1.0, -1.0, 1.0), (2.0, 1.0, 2.0)),))
    below = Scanner(LIDAR, world, 0.2).scan((0, 0, 0.2), 0.0)
    beside = Scanner(LIDAR, world, 1.5).scan((0, 0, 1.5), 0.0)
    assert below[1][0] == 2.5
    assert beside[1][0] == 1.0


def test_noise_is_on_what_was_met() -> None:
    lidar = Lidar(beams=36, range_m=3.6, noise_m=0.02)
    draw = np.random.default_rng(1)
    scans = [Scanner(lidar, World(), 0.2).scan((0, 0, 0.2), 0.0, draw) for _ in range(200)]
    ahead = np.array([scan[1][0] for scan in scans])
    assert ahead.std() == pytest.approx(0.02, rel=0.2)
    up = np.array([scan[10][1] for scan in scans])  # nothing within reach there
    assert up == pytest.approx(np.full(200, 3.6))


WHOLE = World((0, 0, 0), (8, 8, 1), (Box((3.0, 3.0, 0.0), (5.0, 4.0, 1.0)),), cell_m=1.0)


@example(3.21875, 4.262711446604004, 1.15625, 1.0)  # a beam ends beside a corner
@given(st.floats(0.1, 7.9), st.floats(0.1, 7.9), st.floats(-3, 3), st.floats(1.0, 6.0))
def test_scans_of_whole_cells_are_right(x: float, y: float, heading: float, reach: float) -> None:
    if field(WHOLE, flat=True).clearance(x, y, 0.0) < 0.01:
        return
    scan = Scanner(Lidar(90, reach), WHOLE, 0.5).scan((x, y, 0.5), heading)
    walls = occupied(WHOLE)
    found = scan_to_map(WHOLE.grid, scan, reach)
    assert walls == {3 * 8 + 3, 3 * 8 + 4}
    for cell, there in found.items():
        assert there == (cell in walls)
    assert found == scan_to_map(WHOLE.grid, scan, reach)


def test_no_scan_shows_nothing() -> None:
    assert scan_to_map(WHOLE.grid, [], 3.0) == {}
    assert scan_to_map(WHOLE.grid, [(1.0, 1.0, 0.0)], 3.0) == {}


GRID = Grid((0.0, 0.0), 1.0, 4, 3)


def test_cells_are_numbered_row_by_row() -> None:
    assert [GRID.cell(*GRID.centre(cell)) for cell in range(GRID.cells)] == list(range(12))
    assert GRID.cell(-0.1, 1) is None
    assert GRID.cell(1, 3.0) is None
    assert GRID.beside(0) == (1, 4)
    assert GRID.beside(5) == (1, 4, 6, 9)


def test_a_frontier_is_a_free_cell_beside_an_unknown_one() -> None:
    draw = np.random.default_rng(0)
    known = {0: False, 1: False, 2: False, 4: True, 5: True, 6: False}
    for _ in range(10):
        x, y, z = frontier(GRID, known, (0.5, 0.5, 1.2), draw)
        cell = GRID.cell(x, y)
        assert cell in (2, 6)
        assert z == 1.2
    behind_walls = {0: False, 1: True, 4: True, 11: False}
    assert frontier(GRID, behind_walls, (0.5, 0.5, 0.0), draw) == (0.5, 0.5, 0.0)
    assert frontier(GRID, {}, (0.5, 0.5, 0.0), draw) == (0.5, 0.5, 0.0)


def test_obstacles_are_in_the_middles_of_cells() -> None:
    assert obstacle_points(GRID, {0: True, 1: False, 7: True}, 0.0) == (
        (0.5, 0.5, 0.0),
        (3.5, 1.5, 0.0),
    )
