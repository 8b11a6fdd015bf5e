"""Frames: from those of other systems to koord's, and back, in one place.

Inside koord positions are in metres, east, north, up (ENU); bodies are forward, left, up (FLU);
quaternions are unit, wxyz, and turn vectors of the body into those of the world. ROS and NatNet
write xyzw; MAVLink is north, east, down (NED), with bodies forward, right, down (FRD).
"""

from __future__ import annotations

import math

from koord.runtime.motion.world import Point

#: A unit quaternion, wxyz.
Quaternion = tuple[float, float, float, float]

LEVEL: Quaternion = (1.0, 0.0, 0.0, 0.0)

_HALF = math.sqrt(0.5)


def yaw_of(attitude: Quaternion) -> float:
    """The heading of an attitude, counter-clockwise from the x axis, in rad."""
    w, x, y, z = attitude
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def turned(heading_rad: float) -> Quaternion:
    """The attitude of a level body with a heading."""
    return math.cos(heading_rad / 2), 0.0, 0.0, math.sin(heading_rad / 2)


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The quaternion that turns by ``q`` first and by ``p`` then."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def rotated(attitude: Quaternion, vector: Point) -> Point:
    """A vector of the body, in the world."""
    w, x, y, z = attitude
    _, a, b, c = product(product(attitude, (0.0, *vector)), (w, -x, -y, -z))
    return a, b, c


def in_body(attitude: Quaternion, vector: Point) -> Point:
    """A vector of the world, in the body."""
    w, x, y, z = attitude
    return rotated((w, -x, -y, -z), vector)


# --- NED and FRD, of MAVLink ----------------------------------------------------------------------

#: What turns NED into ENU, and FLU into FRD.
_NED_TO_ENU: Quaternion = (0.0, _HALF, _HALF, 0.0)
_FLU_TO_FRD: Quaternion = (0.0, 1.0, 0.0, 0.0)


def angles_of(attitude: Quaternion) -> tuple[float, float, float]:
    """Roll, pitch and yaw of an attitude: turned by yaw first, about z, then y, then x."""
    w, x, y, z = attitude
    return (
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        yaw_of(attitude),
    )


def ned_to_enu(vector: Point) -> Point:
    """North, east, down as east, north, up; the other way round it is the same."""
    x, y, z = vector
    return y, x, -z


def heading_to_ned(heading_rad: float) -> float:
    """A heading, counter-clockwise from east, as yaw: clockwise from north, from -π to π."""
    return math.remainder(math.pi / 2 - heading_rad, math.tau)


def attitude_from_ned(attitude: Quaternion) -> Quaternion:
    """The attitude of an FLU body in ENU, from that of the same body as FRD in NED."""
    return product(product(_NED_TO_ENU, attitude), _FLU_TO_FRD)


def attitude_to_ned(attitude: Quaternion) -> Quaternion:
    """The attitude of an FRD body in NED, from that of the same body as FLU in ENU."""
    return product(product(_NED_TO_ENU, attitude), _FLU_TO_FRD)


def flu_to_frd(vector: Point) -> Point:
    """Forward, left, up as forward, right, down; the other way round it is the same."""
    x, y, z = vector
    return x, -y, -z


# --- y up, of Motive and of graphics --------------------------------------------------------------

#: What turns a world whose y axis points up into one whose z axis does. Both have the same x axis.
_Y_UP_TO_Z_UP: Quaternion = (_HALF, _HALF, 0.0, 0.0)
_Z_UP_TO_Y_UP: Quaternion = (_HALF, -_HALF, 0.0, 0.0)


def y_up_to_enu(vector: Point) -> Point:
    """East, up, south as east, north, up."""
    x, y, z = vector
    return x, -z, y


def attitude_from_y_up(attitude: Quaternion) -> Quaternion:
    """The attitude of an FLU body in ENU, from that of the same body with axes as of y up.

    Such a body has x ahead, y up and z to the right: axes as of its world, when it was made known.
    """
    return product(product(_Y_UP_TO_Z_UP, attitude), _Z_UP_TO_Y_UP)


# --- orders of quaternions ------------------------------------------------------------------------


def from_xyzw(x: float, y: float, z: float, w: float) -> Quaternion:
    """A quaternion as ROS and NatNet write it."""
    return w, x, y, z


def to_xyzw(attitude: Quaternion) -> tuple[float, float, float, float]:
    """A quaternion for ROS and NatNet."""
    w, x, y, z = attitude
    return x, y, z, w
