"""The options of the driver ``ros2`` besides those of all drivers that speak ROS."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

from msgspec import Meta

from koord.runtime.drivers.ros.options import RosOptions


class Transport(Enum):
    """What carries topics."""

    AUTO = "auto"  #: cyclonedds where that is installed, else rclpy
    CYCLONEDDS = "cyclonedds"  #: DDS, without an installation of ROS
    RCLPY = "rclpy"  #: whatever RMW an installation of ROS 2 has


class Ros2Options(RosOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The options of the driver ``ros2``."""

    domain: Annotated[int, Meta(ge=0, le=232)] | None = None  #: else ROS_DOMAIN_ID, else 0
    transport: Transport = Transport.AUTO
