"""Routes of robots: paths with a length along them, and a greatest speed at each point.

A route is a path cut into legs where a robot has to turn about. Along it runs its length ``s``. At
each point there is a greatest speed: none at the end of a leg, at bends as much as their curvature
allows, elsewhere the cruising speed; and never more than the robot can slow down from in time.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Bools, Floats, Ints, bounded, lengths
from koord.runtime.motion.bodies import Pace
from koord.runtime.motion.geometry import wrapped

#: Paths of bends are given by points between which they turn by less than this.
CORNER_RAD = float(np.radians(25.0))

#: Points that are no further apart are one.
REPEATED_M = 1e-9

#: So many segments about the one that a robot is on are looked at for the one that is nearest.
WINDOW = 12


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
        self.changes = 0  #: how often some were given paths

    @property
    def end(self) -> Floats:
        """The last points, shape ``(count, 3)``."""
        return self.points[np.arange(len(self.size)), self.size]

    def put(self, robot: int, path: Floats, heading_rad: float = 0.0) -> None:
        """Give a robot a path of at least one point; repeated points are dropped."""
        kept = lengths(path[1:] - path[:-1]) > REPEATED_M
        path = path if kept.all() else np.concatenate([path[:1], path[1:][kept]])
        segments = len(path) - 1
        self.given[robot] += 1
        self.changes += 1
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
        self.changes += 1
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

    def nearest(self, robots: Ints, s: Floats, position: Floats, window: int = WINDOW) -> Floats:
        """The lengths at which routes are nearest to positions, on the leg of ``s``."""
        here, rows = self.segment(robots, s), robots[:, None]
        size = self.size[rows]
        k = np.minimum(
            np.maximum(here - 2, 0)[:, None] + np.arange(window), np.maximum(size - 1, 0)
        )
        same_leg = self.leg_end[rows, k] == self.leg_end[robots, here][:, None]
        a, b = self.points[rows, k], self.points[rows, np.minimum(k + 1, size)]
        along = b - a
        square = _dot(along, along)
        share = _dot(position[:, None] - a, along)
        share = bounded(share / np.where(square > 0, square, 1.0), 0.0, 1.0)
        gap = position[:, None] - a - share[..., None] * along
        apart = np.where(same_leg, _dot(gap, gap), np.inf)
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


def _dot(one: Floats, other: Floats) -> Floats:
    """Products of vectors ``(…, 3)``, added up from the first to the last."""
    parts = one * other
    found: Floats = parts[..., 0] + parts[..., 1] + parts[..., 2]
    return found


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
        if abs(turn[0]) < CORNER_RAD:
            curvature[first] = bend[0]
            starts[first] = course[0] - bend[0] * lengths[0] / 2
        if abs(turn[-1]) < CORNER_RAD:
            curvature[last] = bend[-1]
            ends[last - 1] = course[-1] + bend[-1] * lengths[-1] / 2
    return _Bends(starts, wrapped(ends - starts), curvature)
