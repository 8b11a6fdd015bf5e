"""What the driver makes of messages one after the other, by a graph that a test holds in hand."""

from __future__ import annotations

import math
from typing import Any

import pytest

from koord.runtime.configuration.forms import Topic
from koord.runtime.configuration.model import MotionAutomaton, Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import turned
from koord.runtime.drivers.ros.graph import Fields, filled
from koord.runtime.drivers.ros.options import SensorTopic, Wire
from koord.runtime.drivers.ros2 import messages as m
from koord.runtime.drivers.ros2.driver import Ros2Driver
from koord.runtime.drivers.ros2.options import Ros2Options
from koord.runtime.drivers.setpoints import Drive, Hold, Located, Position
from koord.runtime.motion.world import World

WORLD = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0))


class End:
    """Both ends of a topic."""

    is_heard = True

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.says: list[Any] = []
        self.sent: list[Any] = []

    def take(self) -> Any | None:
        return self.says.pop(0) if self.says else None

    def send(self, message: Fields) -> None:
        self.sent.append(filled(getattr(m, self.wire.type_name)(), message))


class HeldGraph:
    """Topics by their names."""

    hint = "look at it"

    def __init__(self) -> None:
        self.trouble: str | None = None
        self.ends: dict[str, End] = {}
        self.closed = False

    def listen(self, wire: Wire) -> End:
        end = self.ends[wire.name] = End(wire)
        if wire.name == "pose":
            end.says.append(pose(0.0))
        return end

    publish = listen

    def mistyped(self, wire: Wire) -> None:
        return None

    def close(self) -> None:
        self.closed = True


def pose(x: float, at_s: float = 0.0, frame: str = "map", w: float = 1.0) -> Any:
    header = m.Header(m.Time(int(at_s), round(at_s % 1 * 1e9)), frame)
    return m.PoseStamped(header, m.Pose(m.Point(x, 0.0, 0.0), m.Quaternion(w=w)))


class Told:
    """An open driver, and its topics."""

    def __init__(self, **options: Any) -> None:
        made = Ros2Options(positioning_topic=Topic(topic="pose", type="PoseStamped"), **options)
        device = Device(0, Vehicle("car", "CAR"), WORLD, (0.0, 0.0, 0.0), options=made)
        self.driver = Ros2Driver(device)
        self.driver.open(10.0)
        assert self.driver._links is not None
        self.graph: Any = self.driver._links.graph

    def hear(self, topic: str, *messages: Any) -> None:
        self.graph.ends[topic].says += messages

    def sent(self, topic: str) -> list[Any]:
        sent: list[Any] = self.graph.ends[topic].sent
        return sent

    def sense(self, now_s: float) -> Any:
        return self.driver.sense(now_s)


@pytest.fixture(autouse=True)
def held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Ros2Driver, "graph", lambda _: HeldGraph())


def test_a_pose_counts_from_when_it_was_heard_whatever_its_stamp_says() -> None:
    """(P-ROS-POSE)"""
    one = Told()
    one.hear("pose", pose(0.1, at_s=123456.0))
    assert one.sense(10.5).measured_at_s == 10.5
    assert one.sense(10.9).measured_at_s == 10.5


def test_the_frame_of_the_first_pose_is_that_of_all() -> None:
    one = Told()
    one.hear("pose", pose(5.0, frame="odom"))
    assert one.sense(10.1).position_m == (0.0, 0.0, 0.0)
    assert one.driver.remarks == (
        "poses on `/pose` do not count: they are in the frame `odom`, not in `map`",
    )
    one.hear("pose", pose(0.2))
    assert one.sense(10.2).position_m == (0.2, 0.0, 0.0)
    assert not one.driver.remarks


def test_a_pose_without_an_orientation_does_not_count() -> None:
    one = Told()
    first = one.sense(10.0)
    one.hear("pose", pose(5.0, w=0.0))
    assert one.sense(10.1) == first
    assert one.driver.remarks == (
        "poses on `/pose` do not count: its orientation has the length 0, and not 1",
    )


def test_a_pose_at_no_place_does_not_count() -> None:
    one = Told()
    first = one.sense(10.0)
    one.hear("pose", pose(math.nan))
    assert one.sense(10.1) == first
    assert one.driver.remarks == ("poses on `/pose` do not count: its position is no number",)


def test_a_vehicle_that_does_not_listen_any_more_is_told() -> None:
    """(P-ROS-LOST)"""
    one, told = Told(ros_node_prefix=""), []
    told.append(one.driver.remarks)
    one.graph.ends["cmd_vel"].is_heard = False
    told.append(one.driver.remarks)
    one.graph.trouble = "the graph is lost"
    told.append(one.driver.remarks)
    one.driver.close()
    told.append(one.driver.remarks)
    deaf = "nobody listens to `/cmd_vel`"
    assert told == [(), (deaf,), ("the graph is lost", deaf), ()]


def test_a_vehicle_that_is_silent_has_no_link_until_it_speaks_again() -> None:
    one = Told(silent=0.5)
    assert one.sense(10.5).link
    assert not one.sense(10.6).link
    one.hear("pose", pose(0.0))
    assert one.sense(10.7).link


def test_a_velocity_that_is_told_counts_as_long_as_it_is_young() -> None:
    one = Told(velocity_topic=Topic(topic="twist", type="TwistStamped"), silent=0.5)
    one.hear("twist", m.TwistStamped(m.Header(frame_id="map"), m.Twist(m.Vector3(x=0.3))))
    assert one.sense(10.1).velocity_mps == (0.3, 0.0, 0.0)
    for k in range(2, 9):
        one.hear("pose", pose(0.0, at_s=0.1 * k))
        sensed = one.sense(10.0 + 0.1 * k)
    assert sensed.velocity_mps == (0.0, 0.0, 0.0)


def test_what_is_said_of_an_earlier_way_point_is_not_about_the_next() -> None:
    one = Told(
        waypoint_topic=Topic(topic="waypoint", type="String"),
        reached_topic=Topic(topic="reached", type="Bool"),
    )
    answers: list[bool | None] = []
    first, second = (Position((x, 0.0, 0.0), None, 0.5) for x in (1.0, 2.0))
    one.driver.command(first, 10.0)
    one.hear("reached", m.Bool(True))
    one.sense(10.1)
    for wish in (first, second):
        one.driver.command(wish, 10.2)
        answers.append(one.driver.reached)
    assert answers == [True, None]
    assert len(one.sent("waypoint")) == 2


@pytest.mark.parametrize(("automaton", "frame"), [(None, "map"), (MotionAutomaton.CAR, "1")])
def test_way_points_of_published_automata_ask_for_an_answer(
    automaton: MotionAutomaton | None, frame: str
) -> None:
    """(P-ROS-PUBLISHED)"""
    one = Told(
        waypoint_topic=Topic(topic="waypoint", type="PoseStamped"), motion_automaton=automaton
    )
    one.driver.command(Position((1.0, 0.0, 0.0), None, 0.5), 10.0)
    (sent,) = one.sent("waypoint")
    assert sent.header.frame_id == frame


def test_actuators_of_the_program_are_told_on_their_topics() -> None:
    one = Told(actuators={"grip": Topic(topic="gripper", type="Bool")})
    one.driver.act("grip", True)
    one.driver.act("elsewhere", 1)
    assert one.sent("gripper") == [m.Bool(True)]


def test_a_battery_that_does_not_tell_leaves_what_it_told_before() -> None:
    one = Told(sensors={"charge": SensorTopic(topic="battery", type="BatteryState")})
    assert one.sense(10.0).battery is None
    one.hear("battery", m.BatteryState(percentage=0.4), m.BatteryState(percentage=math.nan))
    assert one.sense(10.1).battery == pytest.approx(0.4)
    assert one.sense(10.2).battery == pytest.approx(0.4)


def test_who_leaves_stops_the_vehicle_first() -> None:
    one = Told(ros_node_prefix="")
    one.driver.command(Drive(1.0), 10.0)
    one.driver.command(Hold(), 10.1)
    one.driver.command(Drive(1.0), 10.2)
    one.driver.close()
    one.driver.close()
    assert [twist.linear.x for twist in one.sent("cmd_vel")] == [1.0, 0.0, 1.0, 0.0]
    assert one.graph.closed


def located(x: float, at_s: float, attitude: Any = None) -> Located:
    return Located((x, 1.0, 0.0), attitude, at_s)


class Unheard(Told):
    """A vehicle without a topic that says where it is."""

    def __init__(self, *poses: Located) -> None:
        device = Device(0, Vehicle("car", "CAR"), WORLD, (0.0, 0.0, 0.0), options=Ros2Options())
        self.driver = Ros2Driver(device)
        for one in poses:
            self.driver.locate(one, 10.0)
        self.driver.open(10.0)
        assert self.driver._links is not None
        self.graph = self.driver._links.graph


def test_a_vehicle_may_be_where_a_localiser_says_and_needs_no_topic_then() -> None:
    """(P-ROS-LOCATED)"""
    one = Unheard(located(2.0, 9.9, turned(0.5)))
    sensed = one.sense(10.0)
    assert (sensed.position_m, sensed.attitude) == ((2.0, 1.0, 0.0), turned(0.5))
    assert (sensed.measured_at_s, sensed.link) == (9.9, True)
    one.driver.command(Drive(0.5), 10.0)
    assert one.sent("cmd_vel")
    one.graph.ends["cmd_vel"].is_heard = False
    assert not one.sense(20.0).link


@pytest.mark.parametrize("poses", [(), (located(2.0, 9.9),)])
def test_without_anything_that_says_where_it_is_and_how_it_looks_it_does_not_start(
    poses: tuple[Located, ...],
) -> None:
    """(P-ROS-LOCATED)"""
    with pytest.raises(DriverError) as caught:
        Unheard(*poses)
    assert "`localiser`" in caught.value.hint


def test_a_topic_says_how_it_looks_where_a_localiser_tells_places_alone() -> None:
    """(P-ROS-LOCATED)"""
    one = Told()
    one.driver.locate(located(2.0, 10.4), 10.5)
    one.hear("pose", pose(0.1))
    sensed = one.sense(10.5)
    assert (sensed.position_m, sensed.attitude) == ((2.0, 1.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    assert sensed.measured_at_s == 10.4
