"""The library's functions on paths and maps, with real geometry. (prelude.krd)

A scan is what a scanner reports: first where it stood, then where each of its beams ended, which
is at an obstacle if it is nearer than the scanner's range. A map has a truth value for each cell
that is known: whether something stands in it. Where obstacles fill whole cells, maps of exact
scans are right: a cell is free only if a beam passed through it, occupied only if one ended in it.

One :class:`Library` serves the robots that it is told of: all of them in the simulator, one on a
deployed robot. Positions are triples of floats, paths tuples of positions, maps dictionaries. Every
answer meets the summary that the prelude gives of its function, which is what verification relies
on. Where no way is found, the answer is a path of no points.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np
from msgspec import Struct, field

from koord.runtime.motion import shapes
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.clearance import Clearance, Path
from koord.runtime.motion.planning import Planner, Pose
from koord.runtime.motion.world import Grid, Obstacle, Point, World

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
    """A point on the boundary of the known part of the world; ``near`` itself if there is none.

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
    """The cells that contain an obstacle: the contents of a complete map."""
    return _occupied(world.grid, world.obstacles)


@lru_cache(maxsize=8)
def _occupied(grid: Grid, obstacles: tuple[Obstacle, ...]) -> frozenset[int]:
    """The cells of a grid that contain an obstacle; runs that follow each other have the same."""
    found = set()
    footprints = [shapes.footprint(obstacle) for obstacle in obstacles]
    for cell in range(grid.cells):
        x, y = grid.centre(cell)
        if any(shapes.overlaps(where, (x, y), grid.cell_m) for where in footprints):
            found.add(cell)
    return frozenset(found)


def _distances(grid: Grid, known: Mapping[int, bool], near: Point) -> dict[int, int]:
    """The reachable free cells, with their distances in steps."""
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
    """The cells that beams pass through, sampled at an eighth of a cell."""
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


#: A path planned from so near to where a robot is now may be used again.
_SAME_PLACE_M = 0.03

_SAME_HEADING_RAD = 0.05


class Chart(Struct, frozen=True):
    """The parameters of maps: the grid, and the range of scanners in metres."""

    grid: Grid
    range_m: float = 4.0


class _Kept(Struct, frozen=True):
    """A cached plan: its pose and round; None: no path was found."""

    pose: Pose
    path: Path | None
    round: int


class _Memory(Struct):
    planner: Planner
    seed: int
    plans: int = 0  #: so many were made in all
    left: int = 0  #: so many may still be made in this round
    kept: dict[Point, _Kept] = field(default_factory=dict)


class Library:
    """The functions, for robots with these planners.

    ``pose`` says where a robot is and points now. A robot may plan ``plans_per_round`` times a
    round; when it has, and for ``keep_rounds`` rounds anyway, it gets the path again that it last
    got for the same start and goal, or learns that there is none.
    """

    def __init__(
        self,
        planners: Mapping[int, Planner],
        pose: Callable[[int], Pose],
        clearance: Clearance,
        chart: Chart,
        seed: int = 0,
        plans_per_round: int = 4,
        keep_rounds: int = 0,
    ) -> None:
        self.pose, self.clearance, self.chart = pose, clearance, chart
        self.plans_per_round, self.keep_rounds = plans_per_round, keep_rounds
        self._planners, self._seed = planners, seed
        self._memories: dict[int, _Memory] = {}  #: of robots that have planned
        self._draw: dict[int, np.random.Generator] = {}  #: of robots that have drawn
        self._round = 0
        self.begin_round()

    def reseed(self, seed: int) -> None:
        """Let answers from now on hang on another seed; what is kept stays."""
        self._seed = seed
        self._draw.clear()
        for robot, memory in self._memories.items():
            memory.seed = self._plans_seed(robot)

    def begin_round(self) -> None:
        """Begin a round, in which every robot may plan again."""
        self._round += 1
        for memory in self._memories.values():
            memory.left = self.plans_per_round

    # --- paths ----------------------------------------------------------------------------------

    def find_path(self, robot: int, start: Point, goal: Point) -> Path:
        """Answer ``findPath(start, goal)``: a path around the world's obstacles."""
        return self._planned(robot, start, goal) or ()

    def find_path_around(
        self, robot: int, start: Point, goal: Point, obstacles: Sequence[Point]
    ) -> Path:
        """Answer ``findPath(start, goal, obstacles)``: a path around the points as well."""
        if not obstacles:
            return self.find_path(robot, start, goal)
        return self._plan(self._memory(robot), self._pose_at(robot, start), goal, obstacles) or ()

    def path_from_task(self, robot: int, target: Point) -> Path:
        """Answer ``getPathFromTask(task)``: a path from the robot's position to the task."""
        return self.find_path(robot, self.pose(robot).position, target)

    def will_collide(self, robot: int, target: Point) -> bool:
        """Answer ``willCollide(task)``: whether the robot finds no path to a task."""
        return self._planned(robot, self.pose(robot).position, target) is None

    # --- maps -----------------------------------------------------------------------------------

    def scan_to_map(self, scan: Sequence[Point]) -> dict[int, bool]:
        """Answer ``scanToMap(scan)``: the cells that a scan saw."""
        return scan_to_map(self.chart.grid, scan, self.chart.range_m)

    def pick_frontier(self, robot: int, known: Mapping[int, bool], near: Point) -> Point:
        """Answer ``pickFrontierPos(known, near)``."""
        if robot not in self._draw:
            seed = np.random.SeedSequence((self._seed, robot, 1))
            self._draw[robot] = np.random.default_rng(seed)
        return frontier(self.chart.grid, known, near, self._draw[robot])

    def find_obstacles(self, known: Mapping[int, bool]) -> tuple[Point, ...]:
        """Answer ``findObs(known)``: a point in each occupied cell."""
        return obstacle_points(self.chart.grid, known, self.clearance.ground_m)

    # --- inside ---------------------------------------------------------------------------------

    def _memory(self, robot: int) -> _Memory:
        """What is known of a robot's plans; it may plan as often as any in this round."""
        if robot not in self._memories:
            seed, left = self._plans_seed(robot), self.plans_per_round
            self._memories[robot] = _Memory(self._planners[robot], seed, left=left)
        return self._memories[robot]

    def _plans_seed(self, robot: int) -> int:
        return int(np.random.SeedSequence((self._seed, robot)).generate_state(1)[0])

    def _pose_at(self, robot: int, start: Point) -> Pose:
        return Pose(start, self.pose(robot).heading_rad)

    def _planned(self, robot: int, start: Point, goal: Point) -> Path | None:
        known, pose = self._memory(robot), self._pose_at(robot, start)
        before = known.kept.get(goal)
        if before is not None and not _alike(before.pose, pose):
            before = None
        is_new = before is not None and self._round - before.round < self.keep_rounds
        if known.left > 0 and not is_new:
            made = self._plan(known, pose, goal, ())
            known.kept[goal] = _Kept(pose, made, self._round)
            return made
        if before is None or before.path is None:
            return None
        return start, *before.path[1:]

    def _plan(self, known: _Memory, pose: Pose, goal: Point, avoid: Sequence[Point]) -> Path | None:
        known.left -= 1
        known.plans += 1
        source = np.random.SeedSequence((known.seed, known.plans))
        seed = int(source.generate_state(1)[0])
        made = known.planner.plan(pose, goal, seed, avoid)
        if made is None:
            return None
        return tuple((x, y, z) for x, y, z in made.tolist())


def _alike(one: Pose, other: Pose) -> bool:
    gap = float(np.linalg.norm(np.subtract(one.position, other.position)))
    turn = abs(one.heading_rad - other.heading_rad)
    return gap <= _SAME_PLACE_M and min(turn, 2 * np.pi - turn) <= _SAME_HEADING_RAD
