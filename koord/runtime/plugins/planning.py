"""Planners of a lab's own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from msgspec import Struct

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.planning import Ground, Pose, suits
from koord.runtime.motion.world import Point, World
from koord.runtime.plugins.calls import Guarded, PlugInError

#: How long it may think about a path.
_LIMIT_S = 2.0

#: A path begins and ends so near to where it should.
_NEAR_M = 0.1


class PlannerSite(Struct, frozen=True):
    """What a planner plans for."""

    world: World
    body: Body
    options: Any  #: its own


class OwnPlanner(Protocol):
    """A planner, for one kind of vehicle in one world."""

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Sequence[Point] | None:
        """The points of a path from the start to the goal, in metres; None: there is none.

        Random choices hang on the seed alone. ``avoid`` are points where others are.
        """
        ...


class OwnPlannerType(Protocol):
    """What makes the planners of one name: a class, or a function with its options' form."""

    OPTIONS: ClassVar[type[Struct]]

    def __call__(self, site: PlannerSite) -> OwnPlanner: ...


class CheckedPlanner:
    """A planner of a lab's own, whose paths are looked at before anybody follows them."""

    def __init__(self, name: str, own: OwnPlanner, ground: Ground) -> None:
        self.what = f"the planner {name}"
        self.trouble: str | None = None  #: why there was no path last, where that is forgiven
        self.forgives = False  #: a failure is no path; else it is raised
        self._own, self._ground, self._calls = own, ground, Guarded(self.what, _LIMIT_S)

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        if not suits(self._ground.body, self._ground.world, goal):
            return None
        try:
            found = self._calls.call(lambda: self._own.plan(start, goal, seed, avoid))
            self.trouble = None
            return None if found is None else self._checked(found, start, goal, avoid)
        except PlugInError as error:
            if not self.forgives:
                raise
            self.trouble = error.told
            return None

    def _checked(self, found: Any, start: Pose, goal: Point, avoid: Sequence[Point]) -> Floats:
        """A path as an array. Raises PlugInError for what is none."""
        try:
            path = np.array([tuple(map(float, point)) for point in found], dtype=np.float64)
        except (TypeError, ValueError):
            path = np.empty((0, 0))
        if path.ndim != 2 or path.shape[1] != 3 or len(path) < 2 or not np.isfinite(path).all():
            raise self._wrong("is no path", "answer two or more points (x, y, z), or None")
        for words, at, point in (("begin", 0, start.position), ("end", -1, goal)):
            if np.linalg.norm(path[at] - np.array(point)) > _NEAR_M:
                place = ", ".join(f"{c:.2f}" for c in point)
                raise self._wrong(f"does not {words} at ({place})", "begin and end where it is to")
        path[0], path[-1] = start.position, goal
        body = self._ground.body
        if not self._ground.field(avoid).path_free(path, body.inner_radius_m):
            raise self._wrong("leads out of the world, or through an obstacle", "plan around them")
        return path

    def _wrong(self, story: str, cure: str) -> PlugInError:
        return PlugInError(self.what, f"answered what {story}", cure)
