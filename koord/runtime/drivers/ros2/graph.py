"""What all ways into the graph of ROS 2 share: domains, types as ROS shows them, streams."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.ros.graph import differs
from koord.runtime.drivers.ros.options import PACKAGES, Wire

#: Types of which every message replaces the one before: who tells them may do so with best effort,
#: as drivers of sensors do (`sensor_data` in ROS), or reliably.
STREAMS = frozenset(
    {
        "BatteryState",
        "LaserScan",
        "NavSatFix",
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


class Ros2Graph(ABC):
    """A robot's part in the graph of a domain, and what it can tell of others there."""

    hint = (
        "is the node started, and in this domain (ROS_DOMAIN_ID)? "
        "`ros2 topic list -t` shows names and types"
    )
    trouble = None  #: there is nobody whom all need

    def __init__(self, domain: int | None) -> None:
        """In a domain; None: that of ROS_DOMAIN_ID. Raises DriverError."""
        self.domain = domain_of(domain)

    @abstractmethod
    def published(self, wire: Wire) -> set[str]:
        """The types with which a topic is published, as ROS shows them."""

    @abstractmethod
    def heard(self, wire: Wire) -> set[str]:
        """The types with which somebody subscribes to a topic."""

    def why_silent(self, wire: Wire) -> str:
        """Why nothing is heard on a topic, as far as the network tells."""
        if self.published(wire):
            return f"`{wire.told}` is published, and nothing was said on it"
        return f"nobody publishes `{wire.told}` in domain {self.domain}"

    def why_unheard(self, wire: Wire) -> str:
        """Why nobody hears a topic, as far as the network tells."""
        return differs(wire, self.heard(wire), told_type(wire.type_name)) or (
            f"nobody listens to `{wire.told}` in domain {self.domain}"
        )

    def mistyped(self, wire: Wire) -> str | None:
        """What is wrong if a topic is published, but not with its type."""
        return differs(wire, self.published(wire), told_type(wire.type_name))
