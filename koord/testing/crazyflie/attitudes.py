"""Attitudes as a Crazyflie has them: from forward, left, up to east, north, up; wxyz."""

from __future__ import annotations

import math

Quaternion = tuple[float, float, float, float]


def yaw_of(attitude: Quaternion) -> float:
    """The yaw of an attitude, counter-clockwise, in rad."""
    w, x, y, z = attitude
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def unpacked(packed: int) -> Quaternion:
    """A quaternion of 32 bits (`quatcompress.h`): all but its largest part, of 10 bits each."""
    largest = packed >> 30
    parts = [0.0] * 4
    for k in (3, 2, 1, 0):
        if k != largest:
            size = (packed & 0x1FF) / 0x1FF * math.sqrt(0.5)
            parts[k] = -size if packed >> 9 & 1 else size
            packed >>= 10
    parts[largest] = math.sqrt(max(0.0, 1 - sum(c * c for c in parts)))
    x, y, z, w = parts
    return w, x, y, z
