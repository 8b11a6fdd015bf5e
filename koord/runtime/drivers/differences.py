"""The velocity of who tells positions alone."""

from __future__ import annotations

from koord.runtime.motion.world import Point

#: Positions that are further apart than this tell no velocity, in s.
_LONGEST_S = 1.0


class Differences:
    """The velocity of positions, from their differences, through a low pass of first order."""

    def __init__(self, smoothing_s: float) -> None:
        self._smoothing_s = smoothing_s
        self._last: tuple[Point, float, float] | None = None
        self.velocity_mps: Point = (0.0, 0.0, 0.0)

    def hear(self, position_m: Point, stamp_s: float, now_s: float) -> None:
        """Take a position that was heard now. Time is that of stamps, if they go on, else now.

        Stamps may be of any clock.
        """
        if self._last is not None:
            before_m, stamped_s, heard_s = self._last
            dt_s = stamp_s - stamped_s
            if not 0 < dt_s <= _LONGEST_S:
                dt_s = now_s - heard_s
            if dt_s <= 0:
                return
            share = dt_s / (self._smoothing_s + dt_s) if dt_s <= _LONGEST_S else 1.0
            x, y, z = (
                v + share * ((b - a) / dt_s - v)
                for v, a, b in zip(self.velocity_mps, before_m, position_m, strict=True)
            )
            self.velocity_mps = x, y, z
        self._last = position_m, stamp_s, now_s
