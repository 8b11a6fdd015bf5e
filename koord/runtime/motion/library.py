"""The library's functions of paths and maps, on real geometry. (prelude.krd)

One :class:`Library` serves the robots that it is told of: all of them in the simulator, one on a
deployed robot. Positions are triples of floats, paths tuples of positions, maps dictionaries. Every
answer meets the summary that the prelude gives of its function, which is what verification relies
on. Where no way is found, the answer is a path of no points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from msgspec import Struct, field

from koord.runtime.motion import mapping
from koord.runtime.motion.clearance import Clearance, Path
from koord.runtime.motion.planning import Planner, Pose
from koord.runtime.motion.world import Grid, Point

#: A path planned from so near to where a robot is now may be used again.
_SAME_PLACE_M = 0.03

_SAME_HEADING_RAD = 0.05


class Chart(Struct, frozen=True):
    """How maps are drawn: their cells, and how far the scanners reach that they are drawn from."""

    grid: Grid
    range_m: float = 4.0


class _Kept(Struct, frozen=True):
    """What was planned from a pose, and in which round; None: no way was found."""

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
        self._robots = {
            robot: _Memory(made, int(np.random.SeedSequence((seed, robot)).generate_state(1)[0]))
            for robot, made in planners.items()
        }
        self._draw = {
            robot: np.random.default_rng(np.random.SeedSequence((seed, robot, 1)))
            for robot in planners
        }
        self._round = 0
        self.begin_round()

    def begin_round(self) -> None:
        """Let every robot plan again."""
        self._round += 1
        for robot in self._robots.values():
            robot.left = self.plans_per_round

    # --- paths ----------------------------------------------------------------------------------

    def find_path(self, robot: int, start: Point, goal: Point) -> Path:
        """``findPath(start, goal)``: from start to goal, around what stands in the world."""
        return self._planned(robot, start, goal) or ()

    def find_path_around(
        self, robot: int, start: Point, goal: Point, obstacles: Sequence[Point]
    ) -> Path:
        """``findPath(start, goal, obstacles)``: around the points as well."""
        if not obstacles:
            return self.find_path(robot, start, goal)
        return self._plan(self._robots[robot], self._pose_at(robot, start), goal, obstacles) or ()

    def path_from_task(self, robot: int, target: Point) -> Path:
        """``getPathFromTask(task)``: from where the robot is to the task."""
        return self.find_path(robot, self.pose(robot).position, target)

    def will_collide(self, robot: int, target: Point) -> bool:
        """``willCollide(task)``: whether the robot finds no way to a task."""
        return self._planned(robot, self.pose(robot).position, target) is None

    # --- maps -----------------------------------------------------------------------------------

    def scan_to_map(self, scan: Sequence[Point]) -> dict[int, bool]:
        """``scanToMap(scan)``: the cells that a scan saw."""
        return mapping.scan_to_map(self.chart.grid, scan, self.chart.range_m)

    def pick_frontier(self, robot: int, known: Mapping[int, bool], near: Point) -> Point:
        """``pickFrontierPos(known, near)``."""
        return mapping.frontier(self.chart.grid, known, near, self._draw[robot])

    def find_obstacles(self, known: Mapping[int, bool]) -> tuple[Point, ...]:
        """``findObs(known)``: a point in each occupied cell."""
        return mapping.obstacle_points(self.chart.grid, known, self.clearance.ground_m)

    # --- inside ---------------------------------------------------------------------------------

    def _pose_at(self, robot: int, start: Point) -> Pose:
        return Pose(start, self.pose(robot).heading_rad)

    def _planned(self, robot: int, start: Point, goal: Point) -> Path | None:
        known, pose = self._robots[robot], self._pose_at(robot, start)
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
