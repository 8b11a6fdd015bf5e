"""A robot's part in a graph of ROS 1, by rospy: cells with the latest messages, and publishers."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.ros.graph import Fields, differs, filled
from koord.runtime.drivers.ros.options import Wire
from koord.runtime.drivers.ros1 import library
from koord.runtime.drivers.ros1.master import Role
from koord.runtime.drivers.ros1.node import End, node_at

#: Bytes that are read at a time: with fewer than a message has, old ones would be worked through.
_BUFFER = 1 << 20

#: What ROS 1 calls the parts of a stamp.
_STAMP = {"sec": "secs", "nanosec": "nsecs"}

_HINT = (
    "is the node started, and at this master (ROS_MASTER_URI)? Do computers reach each other by "
    "what ROS_IP or ROS_HOSTNAME say? `rostopic info` shows who is on a topic"
)


class RospyLatest(End):
    """What is heard on a topic: rospy's thread puts the latest message into a cell."""

    role = Role.LISTEN

    def __init__(self, wire: Wire) -> None:
        super().__init__(wire)
        self._cell: deque[Any] = deque(maxlen=1)

    def make(self) -> Any:
        return library.rospy().Subscriber(
            f"/{self.wire.name}",
            self.message_type,
            self._cell.append,
            queue_size=1,
            buff_size=_BUFFER,
            tcp_nodelay=True,
        )

    def take(self) -> Any | None:
        """The latest message that was not taken yet, without waiting."""
        try:
            return self._cell.pop()
        except IndexError:
            return None


class RospySender(End):
    """A topic that is published: rospy has a queue and a thread for each who listens."""

    role = Role.PUBLISH

    def __init__(self, wire: Wire, depth: int) -> None:
        super().__init__(wire)
        self._depth = max(1, depth)

    def make(self) -> Any:
        return library.rospy().Publisher(
            f"/{self.wire.name}", self.message_type, queue_size=self._depth, tcp_nodelay=True
        )

    @property
    def is_heard(self) -> bool:
        """True if somebody subscribes to it."""
        return self.is_connected

    def send(self, message: Fields) -> None:
        """Publish, without waiting; before there is a master, nothing is said."""
        if self.made is None:
            return
        try:
            self.made.publish(filled(self.message_type(), _named(message)))
        except library.rospy().ROSException as error:
            raise DriverError(f"`{self.wire.told}` cannot be published: {error}") from None


class RospyGraph:
    """Topics at a master."""

    hint = _HINT

    def __init__(self, master: str | None, depth: int) -> None:
        """Take part in the graph of a master; None: of ROS_MASTER_URI. Raises DriverError."""
        self._node, self._depth = node_at(master), depth
        self._ends: dict[Wire, End] = {}

    def listen(self, wire: Wire) -> RospyLatest:
        """Subscribe to a topic."""
        latest = RospyLatest(wire)
        self._add(latest)
        return latest

    def publish(self, wire: Wire) -> RospySender:
        """Advertise a topic."""
        sender = RospySender(wire, self._depth)
        self._add(sender)
        return sender

    def _add(self, end: End) -> None:
        self._ends[end.wire] = end
        self._node.add(end)

    def why_silent(self, wire: Wire) -> str:
        """Why nothing is heard on a topic, as far as the master and its nodes tell."""
        others = self._ends[wire].others
        if self.trouble is not None:
            return self.trouble
        if not others:
            return f"nobody publishes `{wire.told}` at the master {self._node.master.uri}"
        nodes = " and ".join(others)
        if all(told is None for told in others.values()):
            return f"`{wire.told}` is published by {nodes}, which does not answer"
        return f"`{wire.told}` is published by {nodes}, and nothing was said on it"

    def why_unheard(self, wire: Wire) -> str:
        """Why nobody hears a topic, as far as the master and its nodes tell."""
        if wrong := self.trouble or self.mistyped(wire):
            return wrong
        if others := self._ends[wire].others:
            return f"`{wire.told}` is listened to by {' and '.join(others)}, which does not answer"
        return f"nobody listens to `{wire.told}` at the master {self._node.master.uri}"

    def mistyped(self, wire: Wire) -> str | None:
        """What is wrong if a topic has other ends, none of which has its type."""
        end = self._ends[wire]
        types = {told for told in end.others.values() if told is not None}
        return None if end.is_connected else differs(wire, types, end.told_type)

    @property
    def trouble(self) -> str | None:
        """The master that was lost."""
        return self._node.trouble

    def close(self) -> None:
        """Leave the topics; the node stays until the process ends."""
        self._node.remove(list(self._ends.values()))


def _named(fields: Fields) -> Fields:
    """The fields of a message as ROS 1 calls them."""
    return {
        _STAMP.get(name, name): _named(value) if isinstance(value, Mapping) else value
        for name, value in fields.items()
    }
