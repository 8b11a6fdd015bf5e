"""Rapidly exploring random trees, by OMPL: the one file that imports it. (LaValle 1998)

Every plan makes its own space, tree and random numbers from the seed, and is stopped by counting
steps: OMPL's clocks take no part, so a seed repeats a run.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import pairwise
from operator import index
from threading import Lock
from typing import TYPE_CHECKING, Any, ClassVar, SupportsIndex

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.curves import CHECK_M, SPACING_M, Curve, State, is_free
from koord.runtime.motion.curves import points as points_of
from koord.runtime.motion.field import Field
from koord.runtime.motion.libraries import missing, require
from koord.runtime.motion.planning import Ground, PlanningEffort, Pose, suits
from koord.runtime.motion.world import Point, World

if TYPE_CHECKING:
    from koord.runtime.motion.compiled_curves import DirectWays

require(("ompl",), "sim")

#: Paths keep this much more from obstacles than the body needs.
MARGIN_M = 0.03

#: A car's paths have circles this much wider than its tightest, to leave its controller room.
_WIDER = 1.15

#: A car may arrive pointing in any of so many directions.
_HEADINGS = 12

#: A goal so near is where the robot is.
_HERE_M = 0.01

#: So near to the start a robot may be closer to obstacles, if it is no closer than it stands.
_LEAVING_M = 0.5


#: A way with room to spare gets so small a share of the steps.
_SHARE = 4

#: OMPL has one source of chance for all threads of a process: one plan at a time is made of it.
_chance = Lock()


def _new_lock() -> None:
    """Replace the lock in a forked process, which has none of the threads that may hold it."""
    global _chance
    _chance = Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_new_lock)


@cache
def _ompl() -> Any:
    """OMPL, imported when a way is first sought by it: many runs never do. Raises KoordError."""
    try:
        import ompl.base
        import ompl.geometric
        import ompl.util
    except ImportError as error:
        raise missing("ompl", "sim") from error
    ompl.util.setLogLevel(ompl.util.LOG_NONE)
    return ompl


class TreePlanner(Struct, frozen=True):
    """A planner that grows a random tree from the seed."""

    ground: Ground
    effort: PlanningEffort
    optimal: bool

    #: Seeds may be numbers, or become such.
    takes_late_seeds: ClassVar[bool] = True

    def plan(
        self, start: Pose, goal: Point, seed: SupportsIndex, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        """Plan a path from exactly the start to exactly the goal; None if none was found."""
        room = self.ground.room
        if not suits(self.ground.body, self.ground.world, goal):
            return None
        free, begin = self.ground.field(avoid), self.ground.standing(start)
        if free.clearance(*goal) < room.least_m:
            return None
        points = None
        if room.spare_m > 0:  # what is found at all is mostly found soon
            some = replace(self.effort, steps=math.ceil(self.effort.steps / _SHARE))
            thrifty = replace(self, effort=some)
            points = thrifty._way(free, begin, goal, room.wide_m, seed)
        if points is None:
            points = self._way(free, begin, goal, room.least_m, seed)
        if points is not None:
            points[0], points[-1] = start.position, goal
        return points

    def _way(
        self, free: Field, start: Pose, goal: Point, keeps_m: float, seed: SupportsIndex
    ) -> Floats | None:
        """Find the points of a path whose positions keep so far from walls and obstacles."""
        direct = self._direct(free, start, goal, keeps_m)
        if direct is not None:
            return direct
        with _chance:
            _ompl().util.RNG.setSeed(index(seed) % 2**31 + 1)
            return self._grown(free, start, goal, keeps_m)

    def _direct(self, free: Field, start: Pose, goal: Point, keeps_m: float) -> Floats | None:
        """The points of a path that needs no tree, if there is one."""
        raise NotImplementedError

    def _grown(self, free: Field, start: Pose, goal: Point, keeps_m: float) -> Floats | None:
        """Grow a tree, and return the points of a path in it."""
        raise NotImplementedError


class SpacePlanner(TreePlanner, frozen=True):
    """A planner for bodies that set out in any direction: RRT in R³, or on the ground plane."""

    def _direct(self, free: Field, start: Pose, goal: Point, keeps_m: float) -> Floats | None:
        line = np.array([start.position, goal])
        return line if free.path_free(line, max(self.ground.body.radius_m, keeps_m)) else None

    def _grown(self, free: Field, start: Pose, goal: Point, keeps_m: float) -> Floats | None:
        body = self.ground.body
        axes = 2 if body.ON_GROUND else 3
        space = _bounded(_ompl().base.RealVectorStateSpace(axes), self.ground.world, axes)
        reach_m = max(body.radius_m + MARGIN_M, self.ground.room.least_m)
        enough = _keeping(free, start.position, goal, reach_m, keeps_m)

        height = (lambda _: start.position[2]) if body.ON_GROUND else (lambda state: state[2])

        def valid(state: Any) -> bool:
            return enough(state[0], state[1], height(state))

        query = _Query(space, valid, self.effort, self.optimal, range_m=2.0)
        begin, end = query.state(), query.state()
        for axis in range(axes):
            begin[axis], end[axis] = start.position[axis], goal[axis]
        path = query.solve(begin, [end])
        if path is None:
            return None
        _ompl().geometric.PathSimplifier(query.information).reduceVertices(path, maxSteps=30)
        return np.array([(s[0], s[1], height(s)) for s in path.getStates()])


class CurvePlanner(TreePlanner, frozen=True):
    """A planner for cars: RRT on Reeds–Shepp curves, or ``forwards`` alone on Dubins curves.

    Where a single curve is free it is the path; of those that end in some heading the shortest.
    Points of a path are 0.15 m apart, with a point wherever the car reverses. Who ``is_quick`` asks
    machine code first, which knows the same curves where nothing is near.
    """

    forwards: bool = False
    is_quick: bool = False

    def _direct(self, free: Field, start: Pose, goal: Point, keeps_m: float) -> Floats | None:
        if math.dist(start.position, goal) < _HERE_M:
            return np.array([start.position, goal])
        body, z = self.ground.body, start.position[2]
        need_m = max(far_m(body), keeps_m, self.ground.room.least_m)
        if self.is_quick and not free.obstacles:
            points = self._by_code(start, goal, need_m)
            if points is not None:
                return points
        enough = _keeping(free, start.position, goal, self.ground.room.least_m, keeps_m)
        fits = car_fits(free, body, start)

        def spare_m(state: State) -> float:
            x, y, heading = state
            spare = free.clearance(x, y, z) - need_m
            if spare > 0:
                return spare
            return 0.0 if enough(x, y, z) and fits.at(x, y, heading) else -1.0

        for curve in _curves(self._space(), start, goal, body.turning_m * _WIDER):
            if is_free(curve, spare_m):
                return self._on_ground(points_of(curve))
            if self.optimal:  # it takes the shortest of all, or looks for it
                break
        return None

    def _grown(self, free: Field, start: Pose, goal: Point, keeps_m: float) -> Floats | None:
        body, world = self.ground.body, self.ground.world
        space = _bounded(self._space(), world, 2)
        fits = car_fits(free, body, start)
        enough = _keeping(free, start.position, goal, self.ground.room.least_m, keeps_m)
        z = start.position[2]

        def valid(state: Any) -> bool:
            x, y = state.getX(), state.getY()
            return enough(x, y, z) and fits.at(x, y, state.getYaw())

        query = _Query(space, valid, self.effort, self.optimal, range_m=2.5)
        begin = query.state()
        _place(begin, start.position, start.heading_rad)
        ends = []
        for heading in _headings():
            end = query.state()
            _place(end, goal, heading)
            ends.append(end)
        path = query.solve(begin, ends)
        if path is None:
            return None
        found = _ompl().geometric.PathGeometric(path)
        _ompl().geometric.PathSimplifier(query.information).partialShortcutPath(path, maxSteps=30)
        # A Dubins curve that is cut may go on by another one, with a whole turn more.
        if self.forwards and not path.check():
            path = found
        path.interpolate(max(8, math.ceil(path.length() / 0.02)))
        fine = np.array([(s.getX(), s.getY(), s.getYaw()) for s in path.getStates()])
        return self._on_ground(spaced(fine))

    def _by_code(self, start: Pose, goal: Point, need_m: float) -> Floats | None:
        """The points of the shortest curve if all of it is that far from the edge; None: ask."""
        ways = _direct_ways()
        if ways is None:
            return None
        (x, y, _), world = start.position, self.ground.world
        heading = math.remainder(start.heading_rad, 2 * math.pi)
        radius_m = self.ground.body.turning_m * _WIDER
        edges = (*world.low[:2], *world.high[:2])
        return ways.find((x, y, heading), goal[:2], radius_m, edges, need_m, world.ground)

    def _space(self) -> Any:
        """The space of a car's poses, with the shortest curve between any two."""
        made = _ompl().base.DubinsStateSpace if self.forwards else _ompl().base.ReedsSheppStateSpace
        return made(self.ground.body.turning_m * _WIDER)

    def _on_ground(self, flat: Floats) -> Floats:
        return np.column_stack([flat, np.full(len(flat), self.ground.world.ground)])


@cache
def _headings() -> tuple[float, ...]:
    """The headings in which a car may arrive."""
    headings = (2 * math.pi * k / _HEADINGS - math.pi for k in range(_HEADINGS))
    return tuple(math.remainder(heading, 2 * math.pi) for heading in headings)


@cache
def _direct_ways() -> DirectWays | None:
    from koord.runtime.motion.compiled_curves import direct_ways

    return direct_ways(_headings())


def _curves(space: Any, start: Pose, goal: Point, radius_m: float) -> Iterator[Curve]:
    """Yield the curve to a goal in each heading, the shortest first; each until the next one."""
    begin, here, end = (space.allocState() for _ in range(3))
    _place(begin, start.position, start.heading_rad)
    _place(end, goal, 0.0)
    interpolate, x, y, yaw = space.interpolate, here.getX, here.getY, here.getYaw

    def at(share: float) -> State:
        interpolate(begin, end, share, here)
        return x(), y(), yaw()

    found = []
    for heading in _headings():
        end.setYaw(heading)
        found.append((space.distance(begin, end), heading))
    found.sort(key=lambda one: one[0])
    for length_m, heading in found:
        end.setYaw(heading)
        yield Curve(length_m, radius_m, at)


def _bounded(space: Any, world: World, axes: int) -> Any:
    """The state space with the bounds of the world."""
    bounds = _ompl().base.RealVectorBounds(axes)
    for axis in range(axes):
        bounds.setLow(axis, world.low[axis])
        bounds.setHigh(axis, world.high[axis])
    space.setBounds(bounds)
    return space


class _Query(Struct):
    """A planning query for OMPL: a space, its validity check, and a limit of steps."""

    space: Any
    valid: Callable[[Any], bool]
    effort: PlanningEffort
    optimal: bool
    range_m: float
    information: Any = None

    def __post_init__(self) -> None:
        self.information = _ompl().base.SpaceInformation(self.space)
        self.information.setStateValidityChecker(self.valid)
        self.information.setStateValidityCheckingResolution(CHECK_M / self.space.getMaximumExtent())
        self.information.setup()

    def state(self) -> Any:
        return self.information.allocState()

    def solve(self, start: Any, goals: Sequence[Any]) -> Any:
        """A path that reaches one of the goals, or None.

        One that goes on improving may not have come there in its steps: then any path will do.
        """
        goals = [goal for goal in goals if self.valid(goal)]
        if not goals or not self.valid(start):
            return None
        if self.optimal:
            path = self._grow(_ompl().geometric.RRTstar, self.effort.star_steps, start, goals)
            if path is not None:
                return path
        return self._grow(_ompl().geometric.RRTConnect, self.effort.steps, start, goals)

    def _grow(self, kind: Any, steps: int, start: Any, goals: Sequence[Any]) -> Any:
        problem = _ompl().base.ProblemDefinition(self.information)
        problem.addStartState(start)
        target = _ompl().base.GoalStates(self.information)
        for goal in goals:
            target.addState(goal)
        problem.setGoal(target)
        tree = kind(self.information)
        tree.setProblemDefinition(problem)
        tree.setRange(self.range_m)
        tree.setup()
        left = steps

        def used_up() -> bool:
            nonlocal left
            left -= 1
            return left < 0

        tree.solve(_ompl().base.PlannerTerminationCondition(used_up))
        return problem.getSolutionPath() if problem.hasExactSolution() else None


def _leaving(free: Field, start: Point, reach_m: float) -> Callable[[float, float, float], bool]:
    """A check that a position has clearance: the reach, or near the start what it has there."""
    at_start = free.clearance(*start) - 1e-3
    if at_start >= reach_m:
        return lambda x, y, z: free.clearance(x, y, z) > reach_m

    def enough(x: float, y: float, z: float) -> bool:
        clearance = free.clearance(x, y, z)
        if clearance > reach_m:
            return True
        near = math.dist((x, y, z), start) < _LEAVING_M
        return near and clearance >= at_start

    return enough


def _keeping(
    free: Field, start: Point, goal: Point, reach_m: float, keeps_m: float
) -> Callable[[float, float, float], bool]:
    """A check that a position has clearance: what is kept, or near the ends what they have there.

    It has the reach in any case, or near the start what it has there.
    """
    has_reach = _leaving(free, start, reach_m)
    if keeps_m <= reach_m:
        return has_reach
    ends = [(end, free.clearance(*end) - 1e-3) for end in (start, goal)]

    def enough(x: float, y: float, z: float) -> bool:
        clearance = free.clearance(x, y, z)
        if clearance > keeps_m:
            return True
        here = (x, y, z)
        near = any(clearance >= m and math.dist(here, end) < _LEAVING_M for end, m in ends)
        return near and has_reach(x, y, z)

    return enough


class Fits(Struct, frozen=True):
    """Checks that a car fits: two discs cover it, half its length apart."""

    at: Callable[[float, float, float], bool]  #: at x, y, pointing in a direction in rad


def far_m(body: Body) -> float:
    """The clearance with which a car fits wherever it points."""
    ahead_m, behind_m, reach = _discs(body)
    return reach + max(abs(ahead_m), abs(behind_m)) + 1e-6


def _discs(body: Body) -> tuple[float, float, float]:
    """How far ahead and behind the two discs are that cover a car, and their radius with margin."""
    length, width, middle = body.outline_m
    half = length / 4
    return middle + half, half - middle, math.hypot(half, width / 2) + MARGIN_M


def car_fits(free: Field, body: Body, start: Pose) -> Fits:
    """Make checks that a car fits at places; where it starts it may be as near as it is."""
    ahead_m, behind_m, reach = _discs(body)
    x0, y0, z = start.position
    cos0, sin0 = math.cos(start.heading_rad), math.sin(start.heading_rad)
    front = _leaving(free, (x0 + ahead_m * cos0, y0 + ahead_m * sin0, z), reach)
    back = _leaving(free, (x0 - behind_m * cos0, y0 - behind_m * sin0, z), reach)
    far = far_m(body)

    def fits(x: float, y: float, yaw: float) -> bool:
        if free.clearance(x, y, z) > far:
            return True
        cos, sin = math.cos(yaw), math.sin(yaw)
        return front(x + ahead_m * cos, y + ahead_m * sin, z) and back(
            x - behind_m * cos, y - behind_m * sin, z
        )

    return Fits(fits)


def _place(state: Any, position: Point, heading_rad: float) -> None:
    state.setX(position[0])
    state.setY(position[1])
    state.setYaw(math.remainder(heading_rad, 2 * math.pi))


def spaced(fine: Floats) -> Floats:
    """Points of a curve ``(k, 3)`` of x, y, heading: evenly spaced between its reversals.

    Where the car turns about (drives on the other way), its path has a cusp, and that is kept.
    """
    x, y, heading = fine.T
    step_x, step_y = x[1:] - x[:-1], y[1:] - y[:-1]
    kept = np.ones(len(fine), np.bool_)
    np.greater(np.hypot(step_x, step_y), 1e-9, out=kept[1:])
    ahead = step_x * np.cos(heading[:-1]) + step_y * np.sin(heading[:-1]) > 0
    x, y, ways = x[kept], y[kept], ahead[kept[1:]]
    length = np.hypot(x[1:] - x[:-1], y[1:] - y[:-1])
    cusps = np.flatnonzero(ways[1:] != ways[:-1]) + 1
    parts = [fine[:1, :2]]
    for first, last in pairwise([0, *cusps.tolist(), len(x) - 1]):
        along = np.zeros(last - first + 1)
        length[first:last].cumsum(out=along[1:])
        count = max(1, math.ceil(along[-1] / SPACING_M))
        at = along[-1] * np.arange(1, count + 1) / count
        leg = slice(first, last + 1)
        parts.append(np.array([np.interp(at, along, x[leg]), np.interp(at, along, y[leg])]).T)
    return np.concatenate(parts)
