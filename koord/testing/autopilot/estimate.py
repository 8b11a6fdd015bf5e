"""Where a simulated aircraft believes that it is: at its true place, or where others say.

With external vision it knows nothing by itself: its estimate is what it is told (EKF2_EV_CTRL of
PX4, EK3_SRC1_POSXY = 6 of ArduPilot), and ends some time after that does.
"""

from __future__ import annotations

import math

from koord.testing.autopilot.airframe import Vector

#: What it is told counts by this share; what is further off is refused at first.
_GAIN, _GATE_M = 0.3, 1.0

#: Whoever says that its nose is turned by more is in another frame.
_GATE_RAD = 0.35

#: Without aid it drifts, m/s.
_DRIFT: Vector = (0.05, 0.03, 0.0)


class Estimate:
    """The error of what it believes, and whether it believes anything."""

    def __init__(self, *, is_external: bool, loss_s: float) -> None:
        self.is_external, self._loss_s = is_external, loss_s
        self.error_m: Vector = (0.0, 0.0, 0.0)
        self.heard = 0  #: messages that counted
        self.refused = 0
        self._taken_s = -math.inf

    def is_valid(self, now_s: float) -> bool:
        """Whether it knows where it is."""
        return not self.is_external or now_s - self._taken_s <= self._loss_s

    def hear(self, said: tuple[Vector, float], true: tuple[Vector, float], now_s: float) -> None:
        """Take note of a position and a yaw that it is told, at its true ones."""
        if not self.is_external:
            return
        (there, yaw), (here, nose) = said, true
        x, y, z = (a - b for a, b in zip(there, here, strict=True))
        off = math.dist((x, y, z), self.error_m)
        turned = abs(math.remainder(yaw - nose, math.tau))
        if not all(map(math.isfinite, (x, y, z, yaw))) or turned > _GATE_RAD:
            self.refused += 1
            return
        if self.is_valid(now_s):
            if off > _GATE_M:
                self.refused += 1
                return
            a, b, c = self.error_m
            self.error_m = a + _GAIN * (x - a), b + _GAIN * (y - b), c + _GAIN * (z - c)
        else:
            self.error_m = x, y, z
        self.heard += 1
        self._taken_s = now_s

    def step(self, now_s: float, dt_s: float) -> None:
        """Drift if nobody helps."""
        if self.is_external and now_s - self._taken_s > 2 * dt_s + 0.1:
            x, y, z = (a + b * dt_s for a, b in zip(self.error_m, _DRIFT, strict=True))
            self.error_m = x, y, z
