"""Clearance of paths: ``pathsClear``, ``onPath``, ``apart`` on real geometry.

A robot that follows a path is within ``tracking_m`` of it, one that stays at a point within
``resting_m`` of that. Two paths are clear if robots so near to them are still more than
``safety_m`` apart (d_s of the paper, II-A)::

    pathsClear(a, b)   ⇔   dist(a, b) > safety + reach(a) + reach(b)
    onPath(p, a)       ⇔   dist(p, a) ≤ reach(a) − resting (+ slack)

with reach(a) = tracking if a leads anywhere, else resting. So a robot on its path that stops there
and is known by its position from then on is clear of all that its path was clear of, which is what
the summaries of *Task* and *Delivery* say. Where a robot really is may be off by ``resting_m`` more
than that: whoever watches contracts on the physical trace gives that as the slack.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from msgspec import Struct

from koord.runtime.motion import shapes
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.geometry import path_distance, point_path
from koord.runtime.motion.world import Point

Path: TypeAlias = tuple[Point, ...]

#: What rounding may take a point off its path.
_ROUNDING_M = 1e-9


class Clearance(Struct, frozen=True):
    """The safety distances of robots, in metres."""

    safety_m: float = 0.6
    tracking_m: float = 0.2
    resting_m: float = 0.1
    ground_m: float = 0.0

    def paths_clear(self, one: Path, other: Path) -> bool:
        """Return whether robots that follow two paths keep apart; an empty path is clear of any."""
        if not one or not other:
            return True
        # The order of the two must not show in the last bit of the answer.
        first, second = (
            (_known(one), _known(other)) if one <= other else (_known(other), _known(one))
        )
        reach = self.safety_m + self._reach(first) + self._reach(second)
        gap = 0.0
        for a, b, c, d in zip(first.low, first.high, second.low, second.high, strict=True):
            apart = max(a - d, c - b, 0.0)
            gap += apart * apart
        if gap > reach * reach * (1 + 1e-12):
            return True
        if first.level and second.level:
            rise = abs(first.low[2] - second.low[2])
            if rise > reach:
                return True
            flat = math.sqrt(reach * reach - rise * rise)
            return not shapes.flat_paths_within(first.points[:, :2], second.points[:, :2], flat)
        return path_distance(first.points, second.points) > reach

    def on_path(self, p: Point, path: Path, slack_m: float = 0.0) -> bool:
        """Return whether a robot at a point is on a path."""
        if not path:
            return False
        known = _known(path)
        reach = self._reach(known) - self.resting_m
        return point_path(np.array(p), known.points) <= reach + slack_m + _ROUNDING_M

    def apart(self, p: Point, q: Point) -> bool:
        """Return whether two robots are at a safe distance."""
        return math.dist(p, q) > self.safety_m

    def _reach(self, known: _Known) -> float:
        return self.tracking_m if known.leads else self.resting_m


def clearance_of(bodies: Sequence[Body], tracking_m: float, ground_m: float = 0.0) -> Clearance:
    """The clearance at which no two bodies touch, at any heading."""
    largest = sorted((body.radius_m for body in bodies), reverse=True)[:2]
    return Clearance(sum(largest), tracking_m, min(0.1, tracking_m), ground_m)


class _Known(Struct, frozen=True):
    """Cached data of a path: its points, extent and shape."""

    points: Floats
    low: Point
    high: Point
    leads: bool  #: to another point than it begins at
    level: bool  #: all at one height


@lru_cache(maxsize=8192)
def _known(path: Path) -> _Known:
    points = np.array(path, dtype=np.float64)
    points.flags.writeable = False
    (a, b, c), (d, e, f) = points.min(0).tolist(), points.max(0).tolist()
    return _Known(points, (a, b, c), (d, e, f), (a, b, c) != (d, e, f), c == f)
