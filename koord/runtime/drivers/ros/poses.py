"""What poses of ROS say, in koord's frames, and how fast they move."""

from __future__ import annotations

import math
from typing import Any

from msgspec import Struct

from koord.runtime.drivers.frames import Quaternion, from_xyzw, rotated
from koord.runtime.motion.world import Point

#: Orientations are unit quaternions up to this.
_UNIT = 0.05


class Fix(Struct, frozen=True):
    """A pose that was heard."""

    position_m: Point
    attitude: Quaternion  #: of unit length, wxyz
    frame: str
    stamp_s: float  #: by the clock of who measured it, which may be any


class NotAPoseError(Exception):
    """Raised for messages whose position or orientation is none."""


def fix_of(message: Any) -> Fix:
    """What PoseStamped, Odometry, … say. Raises NotAPoseError."""
    header = message.header
    if hasattr(message, "transform"):
        place, turn = message.transform.translation, message.transform.rotation
    else:
        pose = getattr(message.pose, "pose", message.pose)
        place, turn = pose.position, pose.orientation
    attitude = from_xyzw(turn.x, turn.y, turn.z, turn.w)
    length = math.hypot(*attitude)
    if not abs(length - 1.0) <= _UNIT:
        raise NotAPoseError(f"its orientation has the length {length:g}, and not 1")
    w, x, y, z = (c / length for c in attitude)
    if not all(map(math.isfinite, vector_of(place))):
        raise NotAPoseError("its position is no number")
    return Fix(vector_of(place), (w, x, y, z), header.frame_id, seconds(header.stamp))


def seconds(stamp: Any) -> float:
    """A stamp of ROS 2, or of ROS 1."""
    if hasattr(stamp, "nanosec"):
        return float(stamp.sec + stamp.nanosec * 1e-9)
    return float(stamp.secs + stamp.nsecs * 1e-9)


def vector_of(message: Any) -> Point:
    """A Vector3 or Point."""
    return message.x, message.y, message.z


def velocity_of(message: Any, fix: Fix) -> Point:
    """The velocity in the world that TwistStamped or Odometry tell.

    Odometry tells it in the body's frame; a twist in that of its header, which is the world's if
    it is that of poses, and else the body's.
    """
    if hasattr(message, "pose"):
        return rotated(fix.attitude, vector_of(message.twist.twist.linear))
    velocity = vector_of(message.twist.linear)
    return velocity if message.header.frame_id == fix.frame else rotated(fix.attitude, velocity)
