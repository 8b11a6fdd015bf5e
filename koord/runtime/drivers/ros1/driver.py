"""The driver ``ros1``: vehicles that nodes of ROS 1 move."""

from __future__ import annotations

from typing import ClassVar

from msgspec import Struct

from koord.runtime.drivers.driver import Device
from koord.runtime.drivers.ros.driver import RosDriver
from koord.runtime.drivers.ros.graph import Graph
from koord.runtime.drivers.ros1 import library
from koord.runtime.drivers.ros1.options import Ros1Options
from koord.runtime.motion.libraries import absent

if not library.is_installed():  # so that it is told where drivers are listed
    raise absent("rospy", library.INSTALL)


class Ros1Driver(RosDriver):
    """The driver of a vehicle that nodes of ROS 1 move."""

    OPTIONS: ClassVar[type[Struct]] = Ros1Options

    @classmethod
    def address(cls, device: Device) -> tuple[str, bool]:
        """The topic that moves a vehicle; computers may have masters of their own."""
        assert isinstance(device.options, Ros1Options)
        told, _ = super().address(device)
        return told, device.options.master is not None

    def graph(self) -> Graph:
        from koord.runtime.drivers.ros1.graph import RospyGraph

        assert isinstance(self.options, Ros1Options)
        return RospyGraph(self.options.master, self.options.queue_size)

    def elsewhere(self) -> tuple[str, object] | None:
        assert isinstance(self.options, Ros1Options)
        return "koord.runtime.drivers.ros1.graph:RospyGraph", self.options.master
