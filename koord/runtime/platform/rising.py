"""Ways of aircraft that stand on the ground: they begin straight up. (P-TAKEOFF)"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.planning import Planner, Pose
from koord.runtime.motion.world import Point

#: Who is so near to that height, as a share of it, has risen to it.
RISEN = 0.9


class RisingPlanner:
    """A planner whose ways lead up to the height of take-off first, from wherever that is above.

    So a program that claims its way for itself claims what its aircraft really flies.
    """

    def __init__(self, planner: Planner, ground_m: float, height_m: float) -> None:
        self._planner, self._ground_m, self._height_m = planner, ground_m, height_m

    def plan(
        self, start: Pose, goal: Point, seed: int, avoid: Sequence[Point] = ()
    ) -> Floats | None:
        x, y, z = start.position
        if z >= self._ground_m + RISEN * self._height_m:
            return self._planner.plan(start, goal, seed, avoid)
        above = Pose((x, y, self._ground_m + self._height_m), start.heading_rad)
        found = self._planner.plan(above, goal, seed, avoid)
        return None if found is None else np.vstack(([start.position], found))
