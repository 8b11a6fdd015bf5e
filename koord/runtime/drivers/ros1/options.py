"""The options of the driver ``ros1`` besides those of all drivers that speak ROS."""

from __future__ import annotations

from koord.runtime.configuration.forms import Name
from koord.runtime.drivers.ros.options import RosOptions


class Ros1Options(RosOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The options of the driver ``ros1``."""

    master: Name | None = None  #: URI of its master, else ROS_MASTER_URI
