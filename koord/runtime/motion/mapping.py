"""Maps of the world that robots draw from scans: which cells are occupied, and where to look next.

A scan is what a scanner reports: first where it stood, then where each of its beams ended, which
is at an obstacle if it is nearer than the scanner's range. A map has a truth value for each cell
that is known: whether something stands in it. Where obstacles fill whole cells, maps of exact
scans are right: a cell is free only if a beam passed through it, occupied only if one ended in it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from koord.runtime.motion import shapes
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.world import Grid, Point, World

#: A beam that ends on the edge of an obstacle is taken to end so far inside of it.
_INTO_M = 1e-3

#: What is so near to the edge of a cell is not ascribed to any.
_EDGE_M = 1e-4

#: A frontier is chosen among so many of the nearest.
_CHOICES = 3


def scan_to_map(grid: Grid, scan: Sequence[Point], range_m: float) -> dict[int, bool]:
    """The cells that a scan saw, in ascending order: True where something stands."""
    if len(scan) < 2:
        return {}
    points = np.array(scan, dtype=np.float64)[:, :2]
    origin, ends = points[0], points[1:]
    way = ends - origin
    length = np.hypot(way[:, 0], way[:, 1])
    unit = way / np.maximum(length, 1e-12)[:, None]
    # What was met at the corner of a cell may belong to any of four.
    place = (ends - np.array(grid.origin)) / grid.cell_m
    corner = (np.abs(place - np.round(place)) * grid.cell_m < 2 * _INTO_M).all(1)
    hit = (length < range_m - 1e-9) & ~corner
    seen = dict.fromkeys(_cells(grid, origin, unit, length), False)
    inside = ends[hit] + _INTO_M * unit[hit]
    seen.update(dict.fromkeys(_number(grid, inside), True))
    return dict(sorted(seen.items()))


def frontier(
    grid: Grid, known: Mapping[int, bool], near: Point, draw: np.random.Generator
) -> Point:
    """A point where the known part of the world ends; ``near`` itself if it ends nowhere.

    It is the middle of a free cell beside an unknown one: one of the nearest by way of free cells,
    away from walls if that can be.
    """
    best: list[tuple[bool, int, int]] = []
    for cell, steps in _distances(grid, known, near).items():
        around = grid.beside(cell)
        if any(beside not in known for beside in around):
            best.append((any(known.get(beside, False) for beside in around), steps, cell))
    if not best:
        return near
    choices = sorted(best)[:_CHOICES]
    _, _, cell = choices[int(draw.integers(len(choices)))]
    x, y = grid.centre(cell)
    return x, y, near[2]


def obstacle_points(grid: Grid, known: Mapping[int, bool], height_m: float) -> tuple[Point, ...]:
    """A point in each occupied cell: its middle."""
    middles = (grid.centre(cell) for cell, occupied in known.items() if occupied)
    return tuple((x, y, height_m) for x, y in middles)


def occupied(world: World) -> frozenset[int]:
    """The cells in which something stands: what a complete map should say."""
    grid = world.grid
    found = set()
    footprints = [shapes.footprint(obstacle) for obstacle in world.obstacles]
    for cell in range(grid.cells):
        x, y = grid.centre(cell)
        if any(shapes.overlaps(where, (x, y), grid.cell_m) for where in footprints):
            found.add(cell)
    return frozenset(found)


def _distances(grid: Grid, known: Mapping[int, bool], near: Point) -> dict[int, int]:
    """The free cells that can be come to, by how many steps away they are."""
    here = grid.cell(near[0], near[1])
    if here is None or known.get(here, True):
        free = [cell for cell, there in known.items() if not there]
        if not free:
            return {}
        here = min(free, key=lambda cell: (_square(grid.centre(cell), near), cell))
    steps, waiting = {here: 0}, deque([here])
    while waiting:
        cell = waiting.popleft()
        for beside in grid.beside(cell):
            if beside not in steps and known.get(beside) is False:
                steps[beside] = steps[cell] + 1
                waiting.append(beside)
    return steps


def _square(centre: tuple[float, float], near: Point) -> float:
    return (centre[0] - near[0]) ** 2 + (centre[1] - near[1]) ** 2


def _cells(grid: Grid, origin: Floats, unit: Floats, length: Floats) -> list[int]:
    """The cells that beams pass through, as far as points an eighth of a cell apart show."""
    spacing = grid.cell_m / 8
    along = np.arange(0.0, float(length.max(initial=0.0)), spacing)
    at = origin + unit[:, None] * along[None, :, None]
    return _number(grid, at[along[None] < length[:, None] - _EDGE_M])


def _number(grid: Grid, points: Floats) -> list[int]:
    """The cells of points ``(k, 2)``, without those on an edge or outside."""
    place = (points - np.array(grid.origin)) / grid.cell_m
    cell = np.floor(place)
    inside = np.abs(place - np.round(place)).min(1, initial=1.0) > _EDGE_M / grid.cell_m
    inside &= (cell >= 0).all(1) & (cell < [grid.columns, grid.rows]).all(1)
    kept = cell[inside].astype(np.int64)
    numbers: list[int] = np.unique(kept[:, 1] * grid.columns + kept[:, 0]).tolist()
    return numbers
