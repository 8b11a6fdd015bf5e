"""The driver ``ros2``: vehicles that nodes of ROS 2 move."""

from __future__ import annotations

from typing import ClassVar

from msgspec import Struct

from koord.runtime.drivers.ros.driver import RosDriver
from koord.runtime.drivers.ros.graph import Graph
from koord.runtime.drivers.ros2.options import Ros2Options
from koord.runtime.motion.libraries import require

require(("cyclonedds",), "ros2")  # so that it is told where drivers are listed


class Ros2Driver(RosDriver):
    """The driver of a vehicle that nodes of ROS 2 move."""

    OPTIONS: ClassVar[type[Struct]] = Ros2Options

    def graph(self) -> Graph:
        from koord.runtime.drivers.ros2.dds import DdsGraph

        assert isinstance(self.options, Ros2Options)
        return DdsGraph(self.options.domain, self.options.queue_size)

    def elsewhere(self) -> tuple[str, object] | None:
        assert isinstance(self.options, Ros2Options)
        return "koord.runtime.drivers.ros2.dds:DdsGraph", self.options.domain
