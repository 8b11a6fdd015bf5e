"""The driver ``ros2``: vehicles that nodes of ROS 2 move."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import ClassVar

from msgspec import Struct

from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.ros.driver import RosDriver
from koord.runtime.drivers.ros.graph import Graph
from koord.runtime.drivers.ros2.options import Ros2Options, Transport
from koord.runtime.motion.libraries import missing

#: What can carry topics, the better first, and the graph of each.
_GRAPHS = {
    Transport.CYCLONEDDS: "koord.runtime.drivers.ros2.dds:DdsGraph",
    Transport.RCLPY: "koord.runtime.drivers.ros2.client:RclpyGraph",
}

_INSTALL = {
    Transport.CYCLONEDDS: "pip install 'koord[ros2]'",
    Transport.RCLPY: "start koord with the Python of ROS 2, where its setup file was sourced",
}


def _installed() -> list[Transport]:
    return [one for one in _GRAPHS if find_spec(one.value) is not None]


if not _installed():  # so that it is told where drivers are listed
    raise missing("cyclonedds", "ros2")


class Ros2Driver(RosDriver):
    """The driver of a vehicle that nodes of ROS 2 move."""

    OPTIONS: ClassVar[type[Struct]] = Ros2Options

    def __init__(self, device: Device) -> None:
        """Find out which topics there are to be, and who carries them. Raises DriverError."""
        assert isinstance(device.options, Ros2Options)
        self.domain, self.transport = device.options.domain, _carrier(device.options.transport)
        super().__init__(device)

    def graph(self) -> Graph:
        return joined(self.transport, self.domain, self.options.queue_size)

    def elsewhere(self) -> tuple[str, object] | None:
        return _GRAPHS[self.transport], self.domain


def joined(transport: Transport, domain: int | None, depth: int) -> Graph:
    """Take part in the graph of a domain. Raises DriverError."""
    module, _, name = _GRAPHS[_carrier(transport)].partition(":")
    made: Graph = getattr(import_module(module), name)(domain, depth)
    return made


def _carrier(wanted: Transport) -> Transport:
    """Who carries topics. Raises DriverError if it is to be who is not there."""
    there = _installed()
    if wanted is Transport.AUTO:
        return there[0]
    if wanted not in there:
        raise DriverError(f"`transport: {wanted.value}` is not installed", _INSTALL[wanted])
    return wanted
