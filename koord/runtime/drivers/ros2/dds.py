"""A robot's part in the graph of ROS 2 as a participant in DDS, without ROS: by cyclonedds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.ros.graph import Fields, filled
from koord.runtime.drivers.ros.options import Wire
from koord.runtime.drivers.ros2.graph import STREAMS, Ros2Graph

if TYPE_CHECKING:
    from cyclonedds.builtin import BuiltinDataReader
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader

#: The greatest number of messages that are taken, of which the last counts.
_MOST = 8

#: So many ends of topics are read about at a time.
_ENDS = 1000

#: What DDS answers if a message finds no room because somebody reads slowly.
_TIMEOUT = -10


class DdsLatest:
    """What is heard on a topic: the latest message, once."""

    def __init__(self, wire: Wire, reader: DataReader[Any]) -> None:
        self.wire = wire
        self._reader = reader

    def take(self) -> Any | None:
        """The latest message that was not taken yet, without waiting."""
        from cyclonedds.core import DDSException

        try:
            samples = self._reader.take(_MOST)
        except (DDSException, ValueError):  # what cannot be read, such as text that is no UTF-8
            return None
        valid = [sample for sample in samples if sample.sample_info.valid_data]
        return valid[-1] if valid else None


class DdsSender:
    """A topic that is published."""

    def __init__(self, wire: Wire, writer: DataWriter[Any], make: type[Any]) -> None:
        self.wire = wire
        self._writer, self._make = writer, make

    @property
    def is_heard(self) -> bool:
        """True if somebody subscribes to it."""
        return bool(self._writer.get_matched_subscriptions())

    def send(self, message: Fields) -> None:
        """Publish, without waiting: who reads too slowly hears the next one."""
        from cyclonedds.core import DDSException

        try:
            self._writer.write(filled(self._make(), message))
        except DDSException as error:
            if error.code != _TIMEOUT:
                raise DriverError(f"`{self.wire.told}` cannot be published: {error}") from None


class _Ends:
    """The ends of topics that the network tells of: writers, or readers."""

    def __init__(self, told: BuiltinDataReader) -> None:
        self._told = told
        self._known: dict[Any, tuple[str, str]] = {}  #: topic and type, by the end's key

    def types(self, wire: Wire) -> set[str]:
        """The types that ends of a topic have, as ROS shows them."""
        for end in self._told.take(_ENDS):
            if end.sample_info.valid_data:
                self._known[end.key] = end.topic_name, end.type_name
            else:
                self._known.pop(end.key, None)
        return {
            type_name.replace("::dds_::", "::").replace("::", "/").removesuffix("_")
            for topic, type_name in self._known.values()
            if topic == f"rt/{wire.name}"
        }


class DdsGraph(Ros2Graph):
    """A participant in a DDS domain, with the names and the quality of service of ROS 2.

    Writers are reliable, volatile, and keep the last ones, as those of rclpy and rclcpp are unless
    they are told otherwise. So are readers, but those of streams, which hear both kinds of writers.
    """

    def __init__(self, domain: int | None, depth: int) -> None:
        """Join a domain; None: that of ROS_DOMAIN_ID. Raises DriverError."""
        from cyclonedds import builtin
        from cyclonedds.core import DDSException
        from cyclonedds.domain import DomainParticipant

        super().__init__(domain)
        self._depth = max(1, depth)
        try:
            self._participant = DomainParticipant(self.domain)
            publications, subscriptions = (
                builtin.BuiltinDataReader(self._participant, topic)
                for topic in (
                    builtin.BuiltinTopicDcpsPublication,
                    builtin.BuiltinTopicDcpsSubscription,
                )
            )
        except DDSException as error:
            raise DriverError(
                f"no part can be taken in domain {self.domain} of ROS 2: {error.msg}",
                "is there a network interface, is CYCLONEDDS_URI right, and ROS_DOMAIN_ID "
                "at most 232?",
            ) from None
        self._publishers, self._subscribers = _Ends(publications), _Ends(subscriptions)

    def listen(self, wire: Wire) -> DdsLatest:
        """Subscribe to a topic."""
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader

        streams = wire.type_name in STREAMS
        reliability = Policy.Reliability.BestEffort if streams else Policy.Reliability.Reliable(0)
        qos = Qos(reliability, Policy.Durability.Volatile, Policy.History.KeepLast(1))
        return DdsLatest(wire, DataReader(self._participant, self._topic(wire), qos=qos))

    def publish(self, wire: Wire) -> DdsSender:
        """Advertise a topic."""
        from cyclonedds.core import Policy, Qos
        from cyclonedds.pub import DataWriter

        # With a time to wait for who reads slowly, a command could be late by that.
        qos = Qos(
            Policy.Reliability.Reliable(0),
            Policy.Durability.Volatile,
            Policy.History.KeepLast(self._depth),
        )
        topic = self._topic(wire)
        return DdsSender(wire, DataWriter(self._participant, topic, qos=qos), topic.data_type)

    def _topic(self, wire: Wire) -> Any:
        from cyclonedds.topic import Topic

        from koord.runtime.drivers.ros2 import messages

        return Topic(self._participant, f"rt/{wire.name}", getattr(messages, wire.type_name))

    def published(self, wire: Wire) -> set[str]:
        return self._publishers.types(wire)

    def heard(self, wire: Wire) -> set[str]:
        return self._subscribers.types(wire)

    def close(self) -> None:
        """Leave the domain."""
        del self._publishers, self._subscribers, self._participant
