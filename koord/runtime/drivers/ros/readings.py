"""Sensors and actuators of the program's own modules: messages as values of ports, and back."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from koord.runtime.drivers.frames import rotated
from koord.runtime.drivers.ros.graph import Fields
from koord.runtime.drivers.ros.poses import Fix, vector_of
from koord.runtime.motion.world import Point


def reading(message: Any, at: tuple[float, float, float], fix: Fix | None) -> Any | None:
    """The value of a port; None: the message says nothing that can be used."""
    match type(message).__name__:
        case "LaserScan":
            return None if fix is None else scanned(message, at, fix)
        case "BatteryState":
            return charge(message)
        case "Point":
            return vector_of(message)
        case _:
            return message.data


def charge(message: Any) -> float | None:
    """What is left of a battery, 0 to 1; None: it does not tell."""
    if not math.isnan(message.percentage):
        return float(message.percentage)
    share = message.charge / message.capacity if message.capacity else math.nan
    return None if math.isnan(share) else share


def scanned(message: Any, at: tuple[float, float, float], fix: Fix) -> tuple[Point, ...]:
    """The scanner's position, and each beam's end point, in the world.

    Beams that meet nothing end at the scanner's range; those that tell an error are left out.
    """
    ahead, left, turn = at
    here = _in_world(fix, (ahead, left, 0.0))
    ends = []
    for k, told_m in enumerate(message.ranges):
        if math.isnan(told_m) or told_m < message.range_min:
            continue
        range_m = min(told_m, message.range_max)
        angle = turn + message.angle_min + k * message.angle_increment
        beam = (ahead + range_m * math.cos(angle), left + range_m * math.sin(angle), 0.0)
        ends.append(_in_world(fix, beam))
    return here, *ends


def _in_world(fix: Fix, vector: Point) -> Point:
    x, y, z = (a + b for a, b in zip(fix.position_m, rotated(fix.attitude, vector), strict=True))
    return x, y, z


#: How values of ports are written in messages, by types.
_WRITTEN: dict[str, Callable[[Any], Fields]] = {
    "Bool": lambda value: {"data": bool(value)},
    "Float64": lambda value: {"data": float(value)},
    "Int32": lambda value: {"data": int(value)},
    "String": lambda value: {"data": str(value)},
    "Point": lambda value: dict(zip("xyz", map(float, value), strict=False)),
}


def written(type_name: str, value: Any) -> Fields:
    """The message of a type that tells the value of a port."""
    return _WRITTEN[type_name](value)


def is_reached(message: Any) -> bool:
    """Whether a controller says that it is there; in text as in the published middleware."""
    return "TRUE" in message.data.upper() if isinstance(message.data, str) else bool(message.data)
