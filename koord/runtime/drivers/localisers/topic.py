"""The localiser ``topic``: poses on a topic of ROS. (P-LOCATE-TOPIC)"""

from __future__ import annotations

from enum import Enum
from importlib import import_module
from typing import Annotated, ClassVar, assert_never

from msgspec import Meta, Struct

from koord.runtime.configuration.forms import Name, Positive, Topic
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.localiser import LocaliserOptions
from koord.runtime.drivers.ros.graph import Graph, Latest
from koord.runtime.drivers.ros.options import Names, Use
from koord.runtime.drivers.ros.poses import NotAPoseError, fix_of
from koord.runtime.drivers.ros1 import library
from koord.runtime.drivers.ros2.options import Transport
from koord.runtime.drivers.setpoints import Located
from koord.syntax.diagnostics import KoordError

#: Messages that are kept for who is slow.
_QUEUE = 10


class Carrier(Enum):
    """What carries the topic."""

    ROS_1 = "ros1"
    ROS_2 = "ros2"


class GraphOptions(LocaliserOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which graph of topics it is."""

    ros: Carrier = Carrier.ROS_2
    transport: Transport = Transport.AUTO  #: of ROS 2
    domain: Annotated[int, Meta(ge=0, le=232)] | None = None  #: of ROS 2, else ROS_DOMAIN_ID
    master: Name | None = None  #: of ROS 1, else ROS_MASTER_URI


class TopicOptions(GraphOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which topic it is; `{pid}` in its name is the robot's."""

    topic: Name
    type: Name = "PoseStamped"
    frame: str | None = None  #: `frame_id` that poses must have; without: that of the first
    silent: Positive = 0.5  #: s without a pose until people are told why


def joined(of: GraphOptions) -> Graph:
    """Take part in a graph of topics. Raises DriverError, also for a library that is missing."""
    match of.ros:
        case Carrier.ROS_1:
            if not library.is_installed():
                raise DriverError("rospy is needed for `ros: ros1`", library.INSTALL)
            from koord.runtime.drivers.ros1.graph import RospyGraph

            return RospyGraph(of.master, _QUEUE)
        case Carrier.ROS_2:
            try:
                ros2 = import_module("koord.runtime.drivers.ros2.driver")
            except KoordError as error:
                (told, *_) = error.diagnostics
                raise DriverError(told.message, told.hint or "") from None
            made: Graph = ros2.joined(of.transport, of.domain, _QUEUE)
            return made
        case _:
            assert_never(of.ros)


class TopicLocaliser:
    """The localiser of one vehicle. A pose counts from the tick that hears it. (P-ROS-POSE)"""

    OPTIONS: ClassVar[type[Struct]] = TopicOptions

    def __init__(self, device: Device) -> None:
        """Find out which topic it is; nothing is opened. Raises DriverError."""
        assert isinstance(device.options, TopicOptions)
        self.options = device.options
        named = Topic(topic=self.options.topic, type=self.options.type)
        names = Names("", device.vehicle.name, device.pid)
        self.wire = names.wire(Use.POSITIONING, named)
        self._graph: Graph | None = None
        self._latest: Latest | None = None
        self._located: Located | None = None
        self._frame = self.options.frame
        self._trouble: str | None = None  #: why the pose that was heard last does not count
        self._now_s = 0.0

    def open(self, now_s: float) -> None:
        self._graph, self._now_s = joined(self.options), now_s
        self._latest = self._graph.listen(self.wire)

    def locate(self, now_s: float) -> Located | None:
        self._now_s = now_s
        message = None if self._latest is None else self._latest.take()
        if message is None:
            return self._located
        try:
            fix = fix_of(message)
        except NotAPoseError as error:
            self._trouble = str(error)
            return self._located
        if self._frame not in (None, fix.frame):
            self._trouble = f"they are in the frame `{fix.frame}`, not in `{self._frame}`"
            return self._located
        self._frame, self._trouble = fix.frame, None
        self._located = Located(fix.position_m, fix.attitude, now_s)
        return self._located

    @property
    def remarks(self) -> tuple[str, ...]:
        graph = self._graph
        if graph is None:
            return ()
        if self._trouble is not None:
            return (
                f"topic: poses on `{self.wire.told}` do not count: {self._trouble}; see `frame`",
            )
        if (trouble := graph.trouble or graph.mistyped(self.wire)) is not None:
            return (f"topic: {trouble}",)
        if self._located is None:
            return (f"topic: {graph.why_silent(self.wire)}; {graph.hint}",)
        if self._now_s - self._located.measured_at_s > self.options.silent:
            return (f"topic: nothing is said on `{self.wire.told}` any more: does its node run?",)
        return ()

    def close(self) -> None:
        if self._graph is not None:
            self._graph.close()
