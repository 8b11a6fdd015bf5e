"""A robot's part in the graph of ROS 2 as a node of rclpy, on whatever carries that (its RMW).

Nothing is spun, and there is no executor: each tick takes the latest message from where the RMW has
it, so nothing has to be locked. The node answers nobody: it has no parameters and no services.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from importlib import import_module
from typing import Any

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.ros.graph import Fields, filled
from koord.runtime.drivers.ros.options import PACKAGES, Wire
from koord.runtime.drivers.ros2.graph import STREAMS, Ros2Graph

#: Whoever reads gets so long to have heard the last words, in s.
_LAST_WORDS_S = 0.2

_SETUP = "start koord with the Python of ROS 2, where its setup file was sourced"


def loaded() -> Any:
    """The library. Raises DriverError if it cannot be in this process."""
    try:
        library = import_module("rclpy")
        import_module("rclpy.context")
    except ImportError as error:
        raise DriverError(f"rclpy cannot be loaded: {error}", _SETUP) from None
    return library


def message_type(type_name: str) -> Any:
    """The class of a message. Raises DriverError if its package is not there."""
    package = PACKAGES[type_name]
    try:
        found = getattr(import_module(f"{package}.msg"), type_name)
    except ImportError as error:
        name = package.replace("_", "-")
        raise DriverError(
            f"messages of {package} cannot be loaded: {error}",
            f"apt-get install ros-$ROS_DISTRO-{name}",
        ) from None
    if "rospy" in sys.modules or hasattr(found, "_md5sum"):
        raise DriverError(
            "messages of ROS 1 stand before those of ROS 2 in this process",
            "drive vehicles of ROS 2 by a process of their own, where ROS 2 alone is set up",
        )
    return found


class RclpyLatest:
    """What is heard on a topic: the latest message, once."""

    def __init__(self, wire: Wire, subscription: Any) -> None:
        self.wire = wire
        self._subscription = subscription

    def take(self) -> Any | None:
        """The latest message that was not taken yet, without waiting."""
        subscription, latest = self._subscription, None
        with subscription.handle:
            while told := subscription.handle.take_message(subscription.msg_type, False):
                latest, _ = told
        return latest


class RclpySender:
    """A topic that is published."""

    def __init__(self, wire: Wire, publisher: Any) -> None:
        self.wire = wire
        self.publisher = publisher

    @property
    def is_heard(self) -> bool:
        """True if somebody subscribes to it."""
        return bool(self.publisher.get_subscription_count())

    def send(self, message: Fields) -> None:
        """Publish, without waiting: who reads too slowly hears the next one."""
        try:
            self.publisher.publish(filled(self.publisher.msg_type(), message))
        except Exception as error:  # RMWs have errors of their own
            raise DriverError(f"`{self.wire.told}` cannot be published: {error}") from None


class RclpyGraph(Ros2Graph):
    """A node in a domain, with the quality of service that its nodes have unless told otherwise."""

    def __init__(self, domain: int | None, depth: int) -> None:
        """Join a domain; None: that of ROS_DOMAIN_ID. Raises DriverError."""
        super().__init__(domain)
        self._depth = max(1, depth)
        self._rclpy = rclpy = loaded()
        self._context = rclpy.context.Context()
        try:
            rclpy.init(
                args=[],
                context=self._context,
                domain_id=self.domain,
                signal_handler_options=rclpy.signals.SignalHandlerOptions.NO,
            )
            self._node = rclpy.create_node(
                f"koord_{os.getpid()}",
                context=self._context,
                use_global_arguments=False,
                enable_rosout=False,
                start_parameter_services=False,
            )
        except Exception as error:  # RMWs have errors of their own
            raise DriverError(
                f"no part can be taken in domain {self.domain} of ROS 2: {error}",
                "is RMW_IMPLEMENTATION one that is installed?",
            ) from None
        self._senders: list[RclpySender] = []

    def listen(self, wire: Wire) -> RclpyLatest:
        """Subscribe to a topic. Raises DriverError."""
        streams = wire.type_name in STREAMS
        qos = self._qos(1, "BEST_EFFORT" if streams else "RELIABLE")
        subscription = self._node.create_subscription(
            message_type(wire.type_name), f"/{wire.name}", lambda _: None, qos
        )
        return RclpyLatest(wire, subscription)

    def publish(self, wire: Wire) -> RclpySender:
        """Advertise a topic. Raises DriverError."""
        publisher = self._node.create_publisher(
            message_type(wire.type_name), f"/{wire.name}", self._qos(self._depth, "RELIABLE")
        )
        self._senders.append(RclpySender(wire, publisher))
        return self._senders[-1]

    def _qos(self, depth: int, reliability: str) -> Any:
        qos = self._rclpy.qos
        return qos.QoSProfile(depth=depth, reliability=getattr(qos.ReliabilityPolicy, reliability))

    def published(self, wire: Wire) -> set[str]:
        return _types(self._node.get_publishers_info_by_topic(f"/{wire.name}"))

    def heard(self, wire: Wire) -> set[str]:
        return _types(self._node.get_subscriptions_info_by_topic(f"/{wire.name}"))

    def close(self) -> None:
        """Leave the domain, when what was said last has been heard."""
        patience = self._rclpy.duration.Duration(seconds=_LAST_WORDS_S)
        for sender in self._senders:
            sender.publisher.wait_for_all_acked(patience)
        self._node.destroy_node()
        self._rclpy.shutdown(context=self._context, uninstall_handlers=False)


def _types(ends: Iterable[Any]) -> set[str]:
    return {str(end.topic_type) for end in ends}
