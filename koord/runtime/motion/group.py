"""Groups of robots of one kind: their orders, routes and motion automata.

A route is a path cut into legs where a robot has to turn about. Along it runs its length ``s``. At
each point there is a greatest speed: none at the end of a leg, at bends as much as their curvature
allows, elsewhere the cruising speed; and never more than the robot can slow down from in time.

Orders come in one robot at a time; :meth:`Group.plan` finds ways to targets, :meth:`Group.update`
steps the automata. What the robots' actuators are to do then is the business of a law of motion
(:mod:`.driving`, :mod:`.flying`), which moves ``s`` along the routes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from koord.runtime.motion import automaton
from koord.runtime.motion.arrays import Bools, Floats, Ints, bounded, lengths
from koord.runtime.motion.automaton import MotionState, Visit
from koord.runtime.motion.bodies import Body, Pace
from koord.runtime.motion.field import field
from koord.runtime.motion.geometry import wrapped
from koord.runtime.motion.planning import Hindrance, Planner, Plight, Pose, hindrance, suits
from koord.runtime.motion.world import Point, World

#: Paths of bends are given by points between which they turn by less than this.
_CORNER_RAD = np.radians(25.0)


class Spot(Struct, frozen=True):
    """Points on robots' routes: arrays with one entry per robot."""

    position: Floats  #: (m, 3)
    tangent: Floats  #: (m, 3), the unit vector of travel
    course_rad: Floats  #: the direction of travel in the plane
    curvature: Floats  #: per metre, positive to the left
    speed_mps: Floats  #: the greatest speed there


class Routes:
    """The routes of ``count`` robots. ``size`` is 0 for a robot that stays at one point."""

    def __init__(self, count: int, pace: Pace, room: int = 2) -> None:
        self.pace = pace
        self.size: Ints = np.zeros(count, np.int64)  #: segments of the route
        self.points: Floats = np.zeros((count, room, 3))
        self.s: Floats = np.zeros((count, room))
        self.speed2: Floats = np.zeros((count, room))  #: the square of the greatest speed
        self.tangent: Floats = np.zeros((count, room, 3))  #: of the segment behind the point
        self.course: Floats = np.zeros((count, room))  #: of the segment behind the point, at first
        self.turn: Floats = np.zeros((count, room))  #: by how much the course changes in it
        self.curvature: Floats = np.zeros((count, room))
        self.leg_end: Floats = np.zeros((count, room))  #: of the segment's leg, its ``s``
        self.way: Floats = np.ones((count, room))  #: of the segment: 1 forwards, -1 backwards
        self.length: Floats = np.zeros(count)
        self.given: Ints = np.zeros(count, np.int64)  #: how many paths robots were given

    @property
    def end(self) -> Floats:
        """The last points, shape ``(count, 3)``."""
        return self.points[np.arange(len(self.size)), self.size]

    def put(self, robot: int, path: Floats, heading_rad: float = 0.0) -> None:
        """Give a robot a path of at least one point; repeated points are dropped."""
        kept = lengths(path[1:] - path[:-1]) > 1e-9
        path = path if kept.all() else np.concatenate([path[:1], path[1:][kept]])
        segments = len(path) - 1
        self.given[robot] += 1
        self._grow(segments + 1)
        self.size[robot] = segments
        self.points[robot, : segments + 1] = path
        self.points[robot, segments + 1 :] = path[-1]
        if segments == 0:
            self.s[robot], self.length[robot], self.speed2[robot] = 0.0, 0.0, 0.0
            self.leg_end[robot], self.tangent[robot], self.way[robot] = 0.0, 0.0, 1.0
            return
        self._measure(robot, path, heading_rad)

    def put_straight(self, robots: Ints, starts: Floats, goals: Floats) -> None:
        """Give robots straight paths, all at once."""
        way = goals - starts
        length = lengths(way)
        here = length > 1e-9
        self.given[robots] += 1
        unit = way / np.where(here, length, 1.0)[:, None]
        self.size[robots] = here
        self.points[robots] = goals[:, None]
        self.points[robots, 0] = np.where(here[:, None], starts, goals)
        self.s[robots] = np.where(here, length, 0.0)[:, None]
        self.s[robots, 0] = 0.0
        self.length[robots] = self.leg_end[robots, 0] = np.where(here, length, 0.0)
        self.speed2[robots] = 0.0
        self.speed2[robots, 0] = np.where(here, self.pace.cruise_mps**2, 0.0)
        self.tangent[robots] = unit[:, None]
        self.course[robots] = np.arctan2(unit[:, 1], unit[:, 0])[:, None]
        self.turn[robots], self.curvature[robots], self.way[robots] = 0.0, 0.0, 1.0

    def segment(self, robots: Ints, s: Floats) -> Ints:
        """The index of the segment that each robot is on at length ``s``."""
        passed = (self.s[robots] <= s[:, None]).sum(1) - 1
        found: Ints = np.maximum(np.minimum(passed, self.size[robots] - 1), 0)
        return found

    def at(self, robots: Ints, s: Floats, k: Ints | None = None) -> Spot:
        """The points of routes at lengths ``s``."""
        k = self.segment(robots, s) if k is None else k
        # Where points and segments lie in arrays that have a row for each robot, from row to row.
        here = robots * self.s.shape[1] + k
        there = here + (self.size[robots] > 0)
        points, tangent = self.points.reshape(-1, 3), self.tangent.reshape(-1, 3)
        begun, end = self.s.take(here), self.s.take(there)
        length = end - begun
        share = bounded((s - begun) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        a, b = points.take(here, 0), points.take(there, 0)
        # Rounding must not take a robot beyond the end of its segment.
        between = bounded(a + share[:, None] * (b - a), np.minimum(a, b), np.maximum(a, b))
        bent, bends = self.curvature.take(here), self.curvature.take(there)
        ahead = self.speed2.take(there) + 2 * self.pace.accel_mps2 * np.maximum(end - s, 0.0)
        return Spot(
            np.where((share == 1.0)[:, None], b, between),
            tangent.take(here, 0),
            self.course.take(here) + share * self.turn.take(here),
            bent + share * (bends - bent),
            np.minimum(np.sqrt(ahead), self.pace.cruise_mps),
        )

    def nearest(self, robots: Ints, s: Floats, position: Floats, window: int = 12) -> Floats:
        """The lengths at which routes are nearest to positions, on the leg of ``s``."""
        here, rows = self.segment(robots, s), robots[:, None]
        size = self.size[rows]
        k = np.minimum(
            np.maximum(here - 2, 0)[:, None] + np.arange(window), np.maximum(size - 1, 0)
        )
        same_leg = self.leg_end[rows, k] == self.leg_end[robots, here][:, None]
        a, b = self.points[rows, k], self.points[rows, np.minimum(k + 1, size)]
        along = b - a
        square = np.einsum("mki,mki->mk", along, along)
        share = np.einsum("mki,mki->mk", position[:, None] - a, along)
        share = bounded(share / np.where(square > 0, square, 1.0), 0.0, 1.0)
        gap = position[:, None] - a - share[..., None] * along
        apart = np.where(same_leg, np.einsum("mki,mki->mk", gap, gap), np.inf)
        best = apart.argmin(1)
        row = np.arange(len(robots))
        chosen = k[row, best]
        found: Floats = self.s[robots, chosen] + share[row, best] * np.sqrt(square[row, best])
        return found

    def _measure(self, robot: int, path: Floats, heading_rad: float) -> None:
        segments = len(path) - 1
        way = path[1:] - path[:-1]
        length = lengths(way)
        unit = way / length[:, None]
        s = np.zeros(segments + 1)
        length.cumsum(out=s[1:])
        turn = np.arccos(bounded(np.einsum("ki,ki->k", unit[:-1], unit[1:]), -1.0, 1.0))
        about: Bools = turn > self.pace.cusp_rad
        leg = np.zeros(segments, np.int64)  # of each segment
        about.cumsum(out=leg[1:])
        ends = np.append(s[1:-1][about], s[-1])
        bends = _bends(way, length, leg)
        limit = np.full(segments + 1, self.pace.cruise_mps**2)
        bent = np.maximum(np.abs(bends.curvature), 1e-9)
        if self.pace.cusp_rad < np.inf:
            limit = np.minimum(limit, self.pace.lateral_mps2 / bent)
        else:
            # At a corner the velocity turns in a time that the acceleration needs for it.
            slow = self.pace.lateral_mps2 * 0.1 / np.maximum(2 * np.sin(turn / 2), 1e-9)
            limit[1:-1] = np.minimum(limit[1:-1], slow**2)
        limit[1:-1][about] = 0.0
        limit[-1] = 0.0
        # The greatest speed from which what comes can be met: a minimum over what lies ahead.
        gain = 2 * self.pace.accel_mps2 * s
        limit = np.minimum.accumulate((limit + gain)[::-1])[::-1] - gain
        forwards = 1.0
        if self.pace.reverses:
            forwards = 1.0 if np.cos(bends.course[0] - heading_rad) >= 0 else -1.0
        row = slice(0, segments)
        self.s[robot, : segments + 1], self.s[robot, segments + 1 :] = s, s[-1]
        self.length[robot] = s[-1]
        self.speed2[robot, : segments + 1] = np.maximum(limit, 0.0)
        self.speed2[robot, segments + 1 :] = 0.0
        self.tangent[robot, row] = unit
        self.course[robot, row], self.turn[robot, row] = bends.course, bends.turn
        self.curvature[robot, : segments + 1] = bends.curvature
        self.leg_end[robot, row] = ends[leg]
        self.leg_end[robot, segments:] = s[-1]
        self.way[robot, row] = forwards * (-1.0) ** leg if self.pace.reverses else 1.0

    def _grow(self, room: int) -> None:
        short = room - self.points.shape[1]
        if short <= 0:
            return
        short = max(short, self.points.shape[1] // 4)
        names = (
            "points",
            "s",
            "speed2",
            "tangent",
            "course",
            "turn",
            "curvature",
            "leg_end",
            "way",
        )
        for name in names:
            old = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.repeat(old[:, -1:], short, 1)], axis=1))


class _Bends(Struct, frozen=True):
    """The course at the start of each segment and its turn; the curvature at points."""

    course: Floats
    turn: Floats
    curvature: Floats


def _bends(way: Floats, length: Floats, leg: Ints) -> _Bends:
    """Courses and curvatures of a path, from the circles through neighbouring points."""
    flat = np.arctan2(way[:, 1], way[:, 0])
    starts, ends = flat.copy(), flat.copy()
    curvature = np.zeros(len(flat) + 1)
    cuts = [0, *(np.flatnonzero(np.diff(leg)) + 1).tolist(), len(flat)]
    for first, last in pairwise(cuts):
        if last - first < 2:
            continue
        course, lengths = flat[first:last], length[first:last]
        turn = wrapped(np.diff(course))
        both = lengths[:-1] + lengths[1:]
        bend = 2 * turn / both
        at = course[:-1] + lengths[:-1] / both * turn
        starts[first + 1 : last], ends[first : last - 1] = at, at
        curvature[first + 1 : last] = bend
        # Where a bend begins or ends with its leg it is as bent there; a corner is no bend.
        if abs(turn[0]) < _CORNER_RAD:
            curvature[first] = bend[0]
            starts[first] = course[0] - bend[0] * lengths[0] / 2
        if abs(turn[-1]) < _CORNER_RAD:
            curvature[last] = bend[-1]
            ends[last - 1] = course[-1] + bend[-1] * lengths[-1] / 2
    return _Bends(starts, wrapped(ends - starts), curvature)


#: A path that begins so near to a robot begins where it is.
_BESIDE_M = 0.1

_STILL: Floats = np.zeros(3)


class Group:
    """Motion automata of ``count`` robots with one body, one planner and one world."""

    def __init__(
        self,
        count: int,
        body: Body,
        world: World,
        planner: Planner,
        visit: Visit,
        seeds: Sequence[int] | None = None,
    ) -> None:
        """Make a group; ``seeds`` are the planners', one for each robot."""
        self.body, self.world, self.planner, self.visit = body, world, planner, visit
        self.count = count
        self.automata = automaton.initial(count)
        self.routes = Routes(count, body.pace)
        self.s: Floats = np.zeros(count)  #: how far along its route each robot is
        self.speed: Floats = np.zeros(count)  #: at which it is to move along it
        self.targets: dict[int, Point] = {}  #: for which there is no path yet
        self.plights: dict[int, Plight] = {}  #: of robots that cannot do what they were told last
        self._beside_m = 1e-9 if body.IS_EXACT else _BESIDE_M
        self._orders = automaton.no_orders(count)
        self._field = field(world, flat=body.ON_GROUND)
        self._seeds = [0] * count if seeds is None else list(seeds)
        self._plans = np.zeros(count, np.int64)

    # --- orders ---------------------------------------------------------------------------------

    def follow(
        self,
        robot: int,
        path: Floats,
        heading_rad: float = 0.0,
        psn: Floats | None = None,
    ) -> None:
        """Let a robot follow a path, shape ``(k, 3)``, in metres.

        One without points leaves the robot where it is, and it never reaches its end. From ``psn``
        a robot goes to the path's start first.
        """
        if self.state(robot) is MotionState.STOPPED:
            return
        self.targets.pop(robot, None)
        self.plights.pop(robot, None)
        if not len(path):
            self.plights[robot] = Plight(Hindrance.NO_POINTS)
            self._orders.failed[robot], self._orders.routed[robot] = True, False
            return
        if psn is not None and np.linalg.norm(psn - path[0]) > self._beside_m:
            path = np.concatenate([psn[None], path])
        moves = self.speed[robot] > 0
        velocity = self._velocity(np.array([robot]))[0] if moves else _STILL
        self.routes.put(robot, path, heading_rad)
        self.s[robot] = 0.0
        self.speed[robot] = max(0.0, float(velocity @ self.routes.tangent[robot, 0]))
        self._orders.routed[robot], self._orders.failed[robot] = True, False
        self._orders.asked[robot] = False

    def go_to(self, robot: int, target: Point) -> None:
        """Set a target: a path to it is planned and followed."""
        if self.state(robot) is MotionState.STOPPED:
            return
        self.targets[robot] = target
        self.plights.pop(robot, None)
        self._orders.asked[robot], self._orders.routed[robot] = True, False
        self._orders.failed[robot] = False

    def hold(self, robot: int) -> None:
        """Stay in place until released."""
        self._orders.held[robot], self._orders.released[robot] = True, False

    def release(self, robot: int) -> None:
        """Resume what was interrupted by holding."""
        self._orders.released[robot], self._orders.held[robot] = True, False

    def stop(self, robot: int) -> None:
        """Stop for good."""
        self._orders.stopped[robot] = True

    # --- steps ----------------------------------------------------------------------------------

    def plan(self, psn: Floats, heading_rad: Floats, most: int = 1_000_000) -> None:
        """Plan paths to the targets from the robots' positions.

        They are straight where a body that can move in any direction meets no obstacle, else the
        planner's, for ``most`` robots at a time.
        """
        if not self.targets:
            return
        robots = np.array(sorted(self.targets))
        if self.body.turning_m == 0:
            robots = self._plan_straight(robots, psn)
        for robot in robots[:most].tolist():
            self._plan_one(robot, psn, float(heading_rad[robot]))

    def update(self, psn: Floats, now_s: float) -> None:
        """Step the automata on orders and measured positions, shape ``(count, 3)``."""
        end = self.routes.end
        self.automata = automaton.step(self.automata, self._orders, psn, end, now_s, self.visit)
        for mask in (self._orders.asked, self._orders.routed, self._orders.failed):
            mask[:] = False
        for mask in (self._orders.held, self._orders.released, self._orders.stopped):
            mask[:] = False

    def replan(self, robots: Sequence[int]) -> None:
        """Find new ways to the ends of routes, for robots that have missed them."""
        for robot in robots:
            x, y, z = self.routes.end[robot].tolist()
            self.go_to(robot, (x, y, z))

    def state(self, robot: int) -> MotionState:
        return MotionState(int(self.automata.state[robot]))

    def path(self, robot: int) -> Floats:
        """The path that a robot follows, shape ``(k, 3)``; a copy."""
        return self.routes.points[robot, : self.routes.size[robot] + 1].copy()

    # --- inside ---------------------------------------------------------------------------------

    def _velocity(self, robots: Ints) -> Floats:
        k = self.routes.segment(robots, self.s[robots])
        velocity: Floats = self.speed[robots, None] * self.routes.tangent[robots, k]
        return velocity

    def _plan_straight(self, robots: Ints, psn: Floats) -> Ints:
        """Plan straight paths where they are free; return the robots that need a planner."""
        goals = np.array([self.targets[robot] for robot in robots.tolist()])
        fits = np.array(
            [suits(self.body, self.world, self.targets[robot]) for robot in robots.tolist()]
        )
        free = fits & self._field.segments_free(psn[robots], goals, self.body.radius_m)
        gone = robots[free]
        velocity = self._velocity(gone)
        self.routes.put_straight(gone, psn[gone], goals[free])
        self.s[gone] = 0.0
        along = np.einsum("ki,ki->k", velocity, self.routes.tangent[gone, 0])
        self.speed[gone] = np.maximum(along, 0.0)
        self._orders.routed[gone] = True
        for robot in gone.tolist():
            del self.targets[robot]
        return robots[~free]

    def _plan_one(self, robot: int, psn: Floats, heading_rad: float) -> None:
        x, y, z = psn[robot].tolist()
        self._plans[robot] += 1
        source = np.random.SeedSequence((self._seeds[robot], int(self._plans[robot])))
        seed = int(source.generate_state(1)[0])
        target = self.targets.pop(robot)
        path = self.planner.plan(Pose((x, y, z), heading_rad), target, seed)
        if path is None:
            self._orders.failed[robot] = True
            why = hindrance(self.body, self.world, target) or Hindrance.NO_WAY
            self.plights[robot] = Plight(why, target)
        else:
            self.follow(robot, path, heading_rad)
