"""What the node of ROS 1 makes of its master and of others, by a library held in hand."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.ros.options import Wire
from koord.runtime.drivers.ros1 import graph as graphs
from koord.runtime.drivers.ros1 import library
from koord.runtime.drivers.ros1.graph import RospyGraph
from koord.runtime.drivers.ros1.master import Role, Seen
from koord.runtime.drivers.ros1.node import Node
from koord.syntax.diagnostics import KoordError

URI = "http://here:11311"
POSE, TOLD = Wire("car/pose", "PoseStamped"), Wire("car/cmd_vel", "Twist")


class Made:
    """A topic of the library."""

    def __init__(self, name: str, message_type: Any, *rest: Any, **options: Any) -> None:
        self.name, self.rest, self.options = name, rest, options
        self.connections = 0
        self.published: list[Any] = []
        self.is_open = True

    def get_num_connections(self) -> int:
        return self.connections

    def publish(self, message: Any) -> None:
        if not self.is_open:
            raise Library.ROSException("publish() to a closed topic")
        self.published.append(message)

    def unregister(self) -> None:
        self.is_open = False


class Library:
    """rospy, as far as it is asked."""

    class ROSException(Exception):  # noqa: N818 - so it is called
        """What the library raises."""

    Subscriber = Publisher = Made

    def __init__(self) -> None:
        self.core = SimpleNamespace()
        self.shut = False

    def init_node(self, name: str, **options: Any) -> None:
        assert options["disable_signals"]
        self.name = f"/{name}_1"

    def get_name(self) -> str:
        return self.name

    def get_node_uri(self) -> str:
        return "http://here:2"

    def is_shutdown(self) -> bool:
        return self.shut


class HeldMaster:
    """A master of which a test says what it tells."""

    def __init__(self) -> None:
        self.uri, self.caller = URI, "/koord"
        self.seen = Seen()
        self.known: dict[str, str | None] = {}
        self.registered: list[tuple[str, str, Role]] = []
        self.is_lost = False

    def look(self) -> Seen:
        if self.is_lost:
            raise ConnectionRefusedError
        return self.seen

    def register(self, topic: str, type_name: str, role: Role, own_uri: str) -> None:
        self.registered.append((topic, type_name, role))

    def types(self, topic: str, role: Role, nodes: tuple[str, ...]) -> dict[str, str | None]:
        return {node: self.known[node] for node in nodes}

    def place(self, topic: str, role: Role, *nodes: str) -> None:
        lot = {**self.seen.nodes.get(role, {}), topic: nodes}
        self.seen = Seen({**self.seen.nodes, role: lot})


class Message:
    """A message with whatever fields it is given."""

    def __getattr__(self, name: str) -> Any:
        if name in ("header", "stamp", "linear"):
            vars(self)[name] = Message()
            return vars(self)[name]
        raise AttributeError(name)


class Held:
    """A graph whose node looks at its master when it is told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.library = Library()
        monkeypatch.setattr(library, "rospy", lambda: self.library)
        monkeypatch.setattr(library, "message_type", lambda _: Message)
        monkeypatch.setattr("atexit.register", lambda _: None)
        self.node = Node(URI)
        self.master = HeldMaster()
        self.node.master = self.master  # type: ignore[assignment]
        monkeypatch.setattr(graphs, "node_at", lambda _: self.node)
        self.graph = RospyGraph(None, 3)
        self.poses, self.commands = self.graph.listen(POSE), self.graph.publish(TOLD)


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Held:
    return Held(monkeypatch)


def test_nothing_waits_for_a_master_and_nothing_is_said_without(held: Held) -> None:
    """(P-ROS-MASTER)"""
    held.commands.send({"linear": {"x": 1.0}})
    assert held.poses.take() is None
    assert not held.commands.is_heard
    assert held.graph.trouble == f"the master of ROS 1 at {URI} does not answer"
    held.node.look()
    held.commands.send({"linear": {"x": 2.0}})
    (said,) = held.commands.made.published
    assert said.linear.x == 2.0
    assert held.commands.made.options["queue_size"] == 3


def test_the_latest_message_is_taken_once(held: Held) -> None:
    held.node.look()
    assert held.poses.made.name == "/car/pose"
    (hear,) = held.poses.made.rest
    hear("first")
    hear("second")
    assert [held.poses.take(), held.poses.take()] == ["second", None]


def test_stamps_are_named_as_ros_1_does(held: Held) -> None:
    held.node.look()
    held.commands.send({"header": {"stamp": {"sec": 5, "nanosec": 7}, "frame_id": "map"}})
    (said,) = held.commands.made.published
    assert (said.header.stamp.secs, said.header.stamp.nsecs) == (5, 7)


def test_a_master_that_was_started_anew_is_told_all_again(held: Held) -> None:
    held.node.look()
    assert not held.master.registered  # the library does that itself
    held.master.place("/car/pose", Role.LISTEN, "/koord_1")
    held.master.place("/car/cmd_vel", Role.PUBLISH, "/koord_1")
    held.node.look()
    assert not held.master.registered
    held.master.seen = Seen()
    held.node.look()
    assert held.master.registered == [
        ("/car/pose", "geometry_msgs/PoseStamped", Role.LISTEN),
        ("/car/cmd_vel", "geometry_msgs/Twist", Role.PUBLISH),
    ]


def test_a_master_that_has_not_answered_for_long_is_lost(
    held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    held.node.look()
    held.master.is_lost = True
    for clock[0], is_lost in ((101.0, False), (102.0, True)):
        with pytest.raises(ConnectionRefusedError):
            held.node.look()
        assert (held.graph.trouble is not None) is is_lost
    held.master.is_lost = False
    held.node.look()
    assert held.graph.trouble is None


def test_why_nothing_is_heard_is_told_by_who_is_there(held: Held) -> None:
    told = []
    for known in ({}, {"/vrpn": "geometry_msgs/PoseStamped"}, {"/vrpn": None}):
        held.master.known = dict(known)
        held.master.place("/car/pose", Role.PUBLISH, *known)
        held.node.look()
        told.append((held.graph.why_silent(POSE), held.graph.mistyped(POSE)))
    assert told == [
        (f"nobody publishes `/car/pose` at the master {URI}", None),
        ("`/car/pose` is published by /vrpn, and nothing was said on it", None),
        ("`/car/pose` is published by /vrpn, which does not answer", None),
    ]


def test_why_nobody_listens_is_told_by_who_is_there(held: Held) -> None:
    told = []
    for known in ({}, {"/car": "nav_msgs/Odometry"}, {"/car": None}):
        held.master.known = dict(known)
        held.master.place("/car/cmd_vel", Role.LISTEN, *known)
        held.node.look()
        told.append(held.graph.why_unheard(TOLD))
    assert told == [
        f"nobody listens to `/car/cmd_vel` at the master {URI}",
        "`/car/cmd_vel` has the type nav_msgs/Odometry, not geometry_msgs/Twist",
        "`/car/cmd_vel` is listened to by /car, which does not answer",
    ]


def test_one_end_of_the_right_type_will_do(held: Held) -> None:
    held.master.known = {"/a": "nav_msgs/Odometry", "/b": "geometry_msgs/PoseStamped"}
    held.master.place("/car/pose", Role.PUBLISH, "/a", "/b")
    held.node.look()
    assert held.graph.mistyped(POSE) is None
    held.master.place("/car/pose", Role.PUBLISH, "/a")
    held.node.look()
    assert held.graph.mistyped(POSE) == (
        "`/car/pose` has the type nav_msgs/Odometry, not geometry_msgs/PoseStamped"
    )
    held.poses.made.connections = 1
    assert held.graph.mistyped(POSE) is None


def test_a_node_that_was_shut_down_is_told(held: Held) -> None:
    held.node.look()
    held.library.shut = True
    held.commands.made.unregister()
    assert held.graph.trouble == (
        "the node /koord_1 was shut down, as by `rosnode kill`: start it again"
    )
    with pytest.raises(DriverError, match=r"`/car/cmd_vel` cannot be published: publish\(\) to"):
        held.commands.send({"linear": {"x": 1.0}})


def test_who_leaves_closes_its_topics(held: Held) -> None:
    held.node.look()
    leaving = threading.Thread(target=held.graph.close)
    leaving.start()
    while not held.node._left:
        pass
    held.node.close_left()
    leaving.join()
    assert not held.poses.made.is_open
    assert not held.commands.made.is_open
    held.node.look()  # nothing is opened anew
    assert not held.poses.made.is_open


def test_a_library_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys
    from importlib import import_module

    monkeypatch.delitem(sys.modules, "koord.runtime.drivers.ros1.driver", raising=False)
    monkeypatch.setattr(library, "is_installed", lambda: False)
    with pytest.raises(KoordError) as error:
        import_module("koord.runtime.drivers.ros1.driver")
    (told,) = error.value.diagnostics
    assert told.message == "rospy is needed for this and is not installed"
    assert told.hint is not None
    assert told.hint.startswith("install it with: apt-get install python3-rospy")


def test_both_libraries_of_ros_are_not_for_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "rclpy", SimpleNamespace())
    with pytest.raises(DriverError, match="this process speaks ROS 2 by rclpy"):
        library.rospy.__wrapped__()
