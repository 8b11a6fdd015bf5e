"""The options of the driver ``ros2`` besides those of all drivers that speak ROS."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from koord.runtime.drivers.ros.options import RosOptions


class Ros2Options(RosOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The options of the driver ``ros2``."""

    domain: Annotated[int, Meta(ge=0, le=232)] | None = None  #: else ROS_DOMAIN_ID, else 0
