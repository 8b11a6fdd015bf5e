"""What all ways into the graph of ROS 2 share: domains, types as ROS shows them, streams."""

from __future__ import annotations

import os

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.ros.options import PACKAGES

HINT = (
    "is the node started, and in this domain (ROS_DOMAIN_ID)? "
    "`ros2 topic list -t` shows names and types"
)

#: Types of which every message replaces the one before: who tells them may do so with best effort,
#: as drivers of sensors do (`sensor_data` in ROS), or reliably.
STREAMS = frozenset(
    {
        "BatteryState",
        "LaserScan",
        "Odometry",
        "PoseStamped",
        "PoseWithCovarianceStamped",
        "TransformStamped",
        "TwistStamped",
    }
)


def told_type(type_name: str) -> str:
    """A type as ROS 2 shows it."""
    return f"{PACKAGES[type_name]}/msg/{type_name}"


def domain_of(stated: int | None) -> int:
    """A domain; None: that of the environment, as for all of ROS 2. Raises DriverError."""
    if stated is not None:
        return stated
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdecimal() or int(text) > 232:
        raise DriverError(f"ROS_DOMAIN_ID is `{text}`", "it is a number from 0 to 232")
    return int(text)
