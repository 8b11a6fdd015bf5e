"""How far vehicles in the plane may move before two of them, or one and a wall, can touch.

Contact costs most of what driving does, and mostly nobody is near anybody. What is said here is
true of whole vehicles, in whatever direction they turn: each stays within a circle about its middle
that is as large as the largest of them.
"""

from __future__ import annotations

import math

import numpy as np

from koord.runtime.motion.arrays import Floats

#: Further than this is not looked: a look is true until somebody may have moved so far.
FURTHEST_M = 0.5

#: What rounding may hide.
SLACK_M = 1e-6


class Room:
    """How far all vehicles of a floor may move until one of them can touch something.

    ``walls`` are boxes that hold all that stands still: least x and y, greatest x and y, shape
    ``(k, 4)``.
    """

    def __init__(self, walls: Floats) -> None:
        self.walls = np.ascontiguousarray(walls)
        self.left_m = -1.0  #: how far all may still move

    def suffices(self, state: Floats, radius_m: float, span_s: float, accel_mps2: float) -> bool:
        """Return whether nobody can touch anything for so long, and count that it passes.

        ``state`` has positions, angles, velocities and rates, shape ``(n, 6)``; vehicles change
        their velocities by no more than an acceleration. Who is told that they cannot moves them
        without contact; else nothing is counted on.
        """
        square = state[:, 3] * state[:, 3] + state[:, 4] * state[:, 4]
        most_m = (math.sqrt(square.max()) + accel_mps2 * span_s) * span_s + SLACK_M
        if not most_m <= self.left_m:
            self.left_m = room_m(state[:, :2], radius_m, self.walls)
        self.left_m -= most_m
        return self.left_m >= 0.0


def room_m(middles: Floats, radius_m: float, walls: Floats) -> float:
    """How far each of some circles may move before one can touch another, or a wall: up to 0.5 m.

    ``middles`` has shape ``(n, 2)``. What is negative is no room at all. Not a number is none.
    """
    x, y = middles[:, 0, None], middles[:, 1, None]
    aside = np.maximum(np.maximum(walls[:, 0] - x, x - walls[:, 2]), 0.0)
    above = np.maximum(np.maximum(walls[:, 1] - y, y - walls[:, 3]), 0.0)
    least2 = float((aside * aside + above * above).min(initial=np.inf))
    if not least2 >= 0.0:
        return -1.0
    room = min(math.sqrt(least2) - radius_m, FURTHEST_M)
    # Each is held against the next along the axis, the one after that, and so on.
    axis = int(np.ptp(middles, axis=0).argmax())
    along = middles[np.argsort(middles[:, axis], kind="stable")]
    for step in range(1, len(along)):
        gap = along[step:] - along[:-step]
        if gap[:, axis].min() > 2 * (radius_m + room):
            break
        apart2 = float((gap[:, 0] * gap[:, 0] + gap[:, 1] * gap[:, 1]).min())
        # Both of them move.
        room = min(room, math.sqrt(apart2) / 2 - radius_m)
    return room
