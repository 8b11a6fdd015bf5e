"""Who carries topics of ROS 2, and what the node of rclpy makes of its library, held in hand."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from koord.runtime.configuration.forms import Topic
from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.ros.options import Wire
from koord.runtime.drivers.ros2 import client
from koord.runtime.drivers.ros2 import driver as drivers
from koord.runtime.drivers.ros2.client import RclpyGraph, RclpyLatest, RclpySender
from koord.runtime.drivers.ros2.driver import Ros2Driver
from koord.runtime.drivers.ros2.options import Ros2Options, Transport
from koord.runtime.motion.world import World

WORLD = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0))
WIRE = Wire("car/pose", "PoseStamped")


def chosen(transport: Transport) -> Transport:
    told = Ros2Options(
        positioning_topic=Topic(topic="pose", type="PoseStamped"), transport=transport
    )
    return Ros2Driver(
        Device(0, Vehicle("car", "DIFF"), WORLD, (0.0, 0.0, 0.0), options=told)
    ).transport


BOTH = [Transport.CYCLONEDDS, Transport.RCLPY]


@pytest.mark.parametrize(
    ("installed", "wanted", "expected"),
    [
        (BOTH, Transport.AUTO, Transport.CYCLONEDDS),
        (BOTH, Transport.RCLPY, Transport.RCLPY),
        ([Transport.RCLPY], Transport.AUTO, Transport.RCLPY),
        ([Transport.CYCLONEDDS], Transport.AUTO, Transport.CYCLONEDDS),
    ],
)
def test_topics_are_carried_by_whom_the_option_names_or_who_is_there(
    installed: list[Transport],
    wanted: Transport,
    expected: Transport,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(drivers, "_installed", lambda: installed)
    assert chosen(wanted) is expected


def test_a_transport_that_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drivers, "_installed", lambda: [Transport.CYCLONEDDS])
    with pytest.raises(DriverError) as error:
        chosen(Transport.RCLPY)
    assert error.value.message == "`transport: rclpy` is not installed"
    assert "setup file" in error.value.hint


class Handle:
    """What the library keeps of a subscription."""

    def __init__(self, *messages: Any) -> None:
        self.messages = list(messages)

    def __enter__(self) -> Handle:
        return self

    def __exit__(self, *_: object) -> None:
        return

    def take_message(self, message_type: Any, raw: bool) -> Any:
        return (self.messages.pop(0), "info") if self.messages else None


def test_the_latest_of_all_messages_is_taken_once() -> None:
    latest = RclpyLatest(WIRE, SimpleNamespace(handle=Handle("old", "new"), msg_type=None))
    assert [latest.take(), latest.take()] == ["new", None]


def test_what_cannot_be_published_is_named_with_its_topic() -> None:
    def publish(message: Any) -> None:
        raise RuntimeError("the RMW is gone")

    sender = RclpySender(WIRE, SimpleNamespace(publish=publish, msg_type=SimpleNamespace))
    with pytest.raises(DriverError, match="`/car/pose` cannot be published: the RMW is gone"):
        sender.send({"data": 1})


class HeldNode:
    """A node that hears of others what a test says."""

    def __init__(self) -> None:
        self.types: list[str] = []

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        assert name == "/car/pose"
        return [SimpleNamespace(topic_type=one) for one in self.types]

    get_subscriptions_info_by_topic = get_publishers_info_by_topic


def test_silence_and_other_types_are_named() -> None:
    graph, node = RclpyGraph.__new__(RclpyGraph), HeldNode()
    graph.domain, graph._node = 7, node
    told = []
    for types in ([], ["nav_msgs/msg/Odometry"], ["geometry_msgs/msg/PoseStamped"]):
        node.types = types
        told.append((graph.why_silent(WIRE), graph.why_unheard(WIRE), graph.mistyped(WIRE)))
    other = "`/car/pose` has the type nav_msgs/msg/Odometry, not geometry_msgs/msg/PoseStamped"
    silent = "`/car/pose` is published, and nothing was said on it"
    unheard = "nobody listens to `/car/pose` in domain 7"
    assert told == [
        ("nobody publishes `/car/pose` in domain 7", unheard, None),
        (silent, other, other),
        (silent, unheard, None),
    ]


def test_messages_of_ros_1_are_not_taken_for_those_of_ros_2(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    package, messages = ModuleType("geometry_msgs"), ModuleType("geometry_msgs.msg")
    vars(messages)["PoseStamped"] = SimpleNamespace(_md5sum="d3812c3cbc69362b77dc0b19b345f8f5")
    monkeypatch.setitem(sys.modules, "geometry_msgs", package)
    monkeypatch.setitem(sys.modules, "geometry_msgs.msg", messages)
    with pytest.raises(DriverError, match="messages of ROS 1 stand before those of ROS 2"):
        client.message_type("PoseStamped")


def test_messages_that_are_missing_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nav_msgs.msg", None)
    with pytest.raises(DriverError) as error:
        client.message_type("Odometry")
    assert error.value.message.startswith("messages of nav_msgs cannot be loaded")
    assert error.value.hint == "apt-get install ros-$ROS_DISTRO-nav-msgs"
