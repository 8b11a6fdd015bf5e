"""What goes over the wire for each set-point, what is made of messages, and names of topics."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any, cast

import pytest

from koord.runtime.configuration.forms import Topic
from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import turned
from koord.runtime.drivers.ros.commands import Commander, Targets, Wheels, Wings
from koord.runtime.drivers.ros.graph import Fields, Sender, filled
from koord.runtime.drivers.ros.options import PACKAGES, Names, Use, Wire
from koord.runtime.drivers.ros.poses import Fix, NotAPoseError, fix_of, velocity_of
from koord.runtime.drivers.ros.readings import charge, is_reached, reading, written
from koord.runtime.drivers.ros2 import messages as m
from koord.runtime.drivers.ros2.dds import DdsGraph
from koord.runtime.drivers.ros2.driver import Ros2Driver
from koord.runtime.drivers.ros2.options import Ros2Options
from koord.runtime.drivers.setpoints import (
    Arm,
    Disarm,
    Drive,
    Hold,
    Land,
    Position,
    Setpoint,
    Takeoff,
    Track,
    Velocity,
)
from koord.runtime.motion.bodies import VEHICLES
from koord.runtime.motion.world import Point, World
from koord.syntax.diagnostics import KoordError

WORLD = World((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0))
CAR, QUAD = VEHICLES["CAR"].body, VEHICLES["QUAD"].body


class Written:
    """What would be published."""

    def __init__(self, type_name: str) -> None:
        self.wire = Wire("told", type_name)
        self.sent: list[Any] = []

    def send(self, message: Fields) -> None:
        self.sent.append(filled(getattr(m, self.wire.type_name)(), message))


def said(
    make: Callable[[Sender], Commander], type_name: str, *told: tuple[Setpoint, Fix, float]
) -> list[Any]:
    written = Written(type_name)
    commander = make(cast(Sender, written))
    for setpoint, fix, now_s in told:
        commander.command(setpoint, fix, now_s)
    return written.sent


def at(x: float, y: float, z: float = 0.0, heading: float = 0.0) -> Fix:
    return Fix((x, y, z), turned(heading), "map", 0.0)


def linear(message: Any) -> Point:
    twist = getattr(message, "twist", message)
    return twist.linear.x, twist.linear.y, twist.linear.z


# --- what drives --------------------------------------------------------------------------------


def wheels(sender: Sender) -> Commander:
    return Wheels(sender, CAR, 0.0)


@pytest.mark.parametrize("setpoint", [Hold(), Land(), Arm(), Disarm()])
@pytest.mark.parametrize("type_name", ["Twist", "TwistStamped"])
def test_whatever_is_no_wish_is_a_velocity_of_zero_each_time(
    setpoint: Setpoint, type_name: str
) -> None:
    """(P-ROS-STOP)"""
    driving = Drive(1.0, 0.5), at(0, 0), 0.0
    sent = said(wheels, type_name, driving, (setpoint, at(0, 0), 0.1), (setpoint, at(0, 0), 0.2))
    assert [linear(one) for one in sent] == [(1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]


def test_drives_tell_speed_and_yaw_rate_in_the_frame_of_the_body() -> None:
    (sent,) = said(wheels, "TwistStamped", (Drive(-0.4, 0.3, -0.2), at(0, 0, 0, 2.0), 0.0))
    assert linear(sent) == (-0.4, 0.0, 0.0)
    assert sent.twist.angular.z == 0.3
    assert sent.header.frame_id == "base_link"


def test_a_velocity_of_the_world_is_one_ahead_for_what_looks_that_way() -> None:
    north = Velocity((0.0, 0.7, 0.0))
    (sent,) = said(wheels, "Twist", (north, at(0, 0, 0, math.pi / 2), 0.0))
    assert linear(sent) == pytest.approx((0.7, 0.0, 0.0))


def test_steering_is_what_is_wished_or_what_the_yaw_rate_needs() -> None:
    sent = said(
        wheels,
        "AckermannDriveStamped",
        (Drive(1.0, 9.9, 0.3), at(0, 0), 0.0),
        (Drive(0.5, 0.5 * math.tan(-0.2) / 0.33), at(0, 0), 0.0),
        (Hold(), at(0, 0), 0.0),
    )
    assert [one.drive.steering_angle for one in sent] == pytest.approx([0.3, -0.2, -0.2])
    assert [one.drive.speed for one in sent] == [1.0, 0.5, 0.0]


def test_a_wish_of_another_kind_of_vehicle_is_refused_after_a_stop() -> None:
    written = Written("Twist")
    commander = wheels(cast(Sender, written))
    commander.command(Drive(1.0), at(0, 0), 0.0)
    with pytest.raises(DriverError, match="is told Takeoff") as error:
        commander.command(Takeoff(1.0), at(0, 0), 0.1)
    assert linear(written.sent[-1]) == (0.0, 0.0, 0.0)
    assert error.value.hint == "it understands Drive, Velocity and Hold"


# --- what flies ---------------------------------------------------------------------------------


def wings(sender: Sender) -> Commander:
    return Wings(sender, QUAD, 0.0)


@pytest.mark.parametrize(
    ("setpoint", "z", "expected"),
    [
        (Hold(), 1.0, (0.0, 0.0, 0.0)),
        (Velocity((0.1, 0.2, 0.3)), 1.0, (0.1, 0.2, 0.3)),
        (Track((0.1, 0.0, 1.0), (0.2, 0.0, 0.0)), 1.0, (0.3, 0.0, 0.0)),
        (Position((3.0, 0.0, 1.0), None, 0.4), 1.0, (0.4, 0.0, 0.0)),
        (Position((0.2, 0.0, 1.0), None, 0.4), 1.0, (0.2, 0.0, 0.0)),
        (Takeoff(1.5), 0.0, (0.0, 0.0, 0.5)),
        (Takeoff(1.5), 1.4, (0.0, 0.0, 0.1)),
        (Land(), 1.0, (0.0, 0.0, -0.4)),
        (Disarm(), 1.0, (0.0, 0.0, -0.4)),
        (Disarm(), 0.0, (0.0, 0.0, 0.0)),
        (Arm(), 0.0, (0.0, 0.0, 0.0)),
    ],
)
def test_aircraft_are_told_velocities_of_the_world(
    setpoint: Setpoint, z: float, expected: Point
) -> None:
    """(P-ROS-AIR)"""
    here = at(0.0, 0.0, z, heading=1.0)
    (sent,) = said(wings, "TwistStamped", (setpoint, here, 0.0))
    assert linear(sent) == pytest.approx(expected)
    assert sent.header.frame_id == "map"


def test_unstamped_velocities_of_aircraft_are_those_of_the_body() -> None:
    here = at(0.0, 0.0, 1.0, heading=math.pi / 2)
    (sent,) = said(wings, "Twist", (Velocity((0.0, 0.5, 0.1)), here, 0.0))
    assert linear(sent) == pytest.approx((0.5, 0.0, 0.1))


def test_headings_are_turned_to_the_short_way_round() -> None:
    wish = Position((0.0, 0.0, 1.0), -3.0, 0.4)
    (sent,) = said(wings, "TwistStamped", (wish, at(0, 0, 1, heading=3.0), 0.0))
    assert 0.2 < sent.twist.angular.z < 0.3


# --- positions ----------------------------------------------------------------------------------


def places(sent: list[Any]) -> list[Point]:
    return [(p.pose.position.x, p.pose.position.y, p.pose.position.z) for p in sent]


def waypoints(sender: Sender) -> Commander:
    return Targets(sender, CAR, 0.0, streams=False)


def stream(sender: Sender) -> Commander:
    return Targets(sender, QUAD, 0.0, streams=True)


def test_nothing_is_said_before_the_first_wish() -> None:
    quiet: tuple[Setpoint, ...] = (Disarm(), Arm(), Hold())
    assert said(waypoints, "PoseStamped", *((one, at(1, 1), 0.0) for one in quiet)) == []


def test_a_way_point_is_said_once_and_again_after_a_second() -> None:
    wish = Position((2.0, 1.0, 0.0), None, 0.5)
    told = [(wish, at(0, 0), 0.05 * k) for k in range(25)]
    sent = said(waypoints, "PoseStamped", *told)
    assert places(sent) == [(2.0, 1.0, 0.0)] * 2
    assert {one.header.frame_id for one in sent} == {"map"}


def test_who_holds_is_sent_to_where_it_was_when_it_was_told_so() -> None:
    wish = Position((2.0, 1.0, 0.0), None, 0.5)
    told: list[tuple[Setpoint, Fix, float]] = [
        (wish, at(0, 0), 0.0),
        (Hold(), at(0.4, 0.2), 0.1),
        (Hold(), at(0.5, 0.2), 0.2),
    ]
    assert places(said(waypoints, "PoseStamped", *told)) == [(2.0, 1.0, 0.0), (0.4, 0.2, 0.0)]


def test_aircraft_hear_a_stream_of_positions() -> None:
    sent = said(
        stream,
        "PoseStamped",
        (Takeoff(1.0), at(0.5, 0.0), 0.0),
        (Takeoff(1.0), at(0.6, 0.0, 0.5), 0.05),
        (Hold(), at(0.5, 0.0, 1.0), 0.1),
        (Track((0.7, 0.0, 1.0), (0.5, 0.0, 0.0), heading_rad=math.pi), at(0.5, 0.0, 1.0), 0.15),
        (Land(), at(0.8, 0.1, 1.1), 0.2),
        (Land(), at(0.9, 0.1, 0.6), 0.25),
        (Disarm(), at(0.8, 0.1, 0.3), 0.3),
    )
    assert places(sent) == [
        (0.5, 0.0, 1.0),
        (0.5, 0.0, 1.0),
        (0.5, 0.0, 1.0),
        (0.7, 0.0, 1.0),
        (0.8, 0.1, 0.0),
        (0.8, 0.1, 0.0),
        (0.8, 0.1, 0.0),
    ]
    assert (sent[3].pose.orientation.z, sent[3].pose.orientation.w) == pytest.approx((1.0, 0.0))


def test_a_drive_to_way_points_is_refused_and_the_vehicle_stays() -> None:
    written = Written("PoseStamped")
    commander = waypoints(cast(Sender, written))
    with pytest.raises(DriverError, match="is told Drive"):
        commander.command(Drive(1.0), at(0.3, 0.1), 0.0)
    assert places(written.sent) == [(0.3, 0.1, 0.0)]


# --- messages -----------------------------------------------------------------------------------

WEST = m.Quaternion(0.0, 0.0, 1.0, 0.0)  # x, y, z, w: turned by half
HEADER = m.Header(m.Time(5, 500_000_000), "map")
PLACED = m.Pose(m.Point(1.0, 2.0, 3.0), WEST)


@pytest.mark.parametrize(
    "message",
    [
        m.PoseStamped(HEADER, PLACED),
        m.PoseWithCovarianceStamped(HEADER, m.PoseWithCovariance(PLACED)),
        m.Odometry(HEADER, "base_link", m.PoseWithCovariance(PLACED)),
        m.TransformStamped(HEADER, "base_link", m.Transform(m.Vector3(1.0, 2.0, 3.0), WEST)),
    ],
    ids=lambda message: type(message).__name__,
)
def test_poses_are_read_of_each_type(message: Any) -> None:
    back = type(message).deserialize(message.serialize())
    assert fix_of(back) == Fix((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), "map", 5.5)


def test_an_orientation_without_length_is_none() -> None:
    empty = m.PoseStamped(HEADER, m.Pose(m.Point(), m.Quaternion(0.0, 0.0, 0.0, 0.0)))
    with pytest.raises(NotAPoseError, match="the length 0, and not 1"):
        fix_of(empty)


def test_velocities_of_the_body_are_turned_into_the_world() -> None:
    fix, ahead = fix_of(m.PoseStamped(HEADER, PLACED)), m.Twist(m.Vector3(x=0.5))
    odometry = m.Odometry(HEADER, "base_link", twist=m.TwistWithCovariance(ahead))
    own = m.TwistStamped(m.Header(frame_id="base_link"), ahead)
    world = m.TwistStamped(HEADER, ahead)
    assert velocity_of(odometry, fix) == pytest.approx((-0.5, 0.0, 0.0))
    assert velocity_of(own, fix) == pytest.approx((-0.5, 0.0, 0.0))
    assert velocity_of(world, fix) == (0.5, 0.0, 0.0)


def test_scans_are_points_of_the_world_the_scanner_first() -> None:
    ranges = [1.0, math.inf, math.nan, 0.05, 9.0]
    scan = m.LaserScan(
        angle_min=-math.pi / 2, angle_increment=math.pi / 4, range_min=0.1, range_max=4.0
    )
    scan.ranges = ranges
    points = reading(scan, (0.5, 0.0, math.pi / 2), at(1.0, 1.0, 0.2, math.pi / 2))
    d = 4.0 * math.sqrt(0.5)
    expected = [(1.0, 1.5, 0.2), (1.0, 2.5, 0.2), (1.0 - d, 1.5 + d, 0.2), (1.0, -2.5, 0.2)]
    assert points is not None
    assert list(points) == [pytest.approx(point, abs=1e-6) for point in expected]


@pytest.mark.parametrize(
    ("battery", "expected"),
    [
        (m.BatteryState(percentage=0.5), 0.5),
        (m.BatteryState(percentage=math.nan, charge=1.0, capacity=4.0), 0.25),
        (m.BatteryState(percentage=math.nan, charge=math.nan, capacity=math.nan), None),
        (m.BatteryState(percentage=math.nan), None),
    ],
)
def test_a_battery_tells_what_is_left(battery: Any, expected: float | None) -> None:
    assert charge(battery) == expected


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (m.String("TRUE"), True),
        (m.String("reached: True"), True),
        (m.String("FALSE"), False),
        (m.Bool(True), True),
        (m.Bool(False), False),
    ],
)
def test_controllers_say_that_they_are_there_in_text_or_as_truth(
    message: Any, expected: bool
) -> None:
    assert is_reached(message) is expected


@pytest.mark.parametrize(
    ("type_name", "value"),
    [
        ("Bool", True),
        ("Float64", 0.5),
        ("Int32", 7),
        ("String", "open"),
        ("Point", (1.0, 2.0, 3.0)),
    ],
)
def test_values_of_ports_come_back_as_they_went(type_name: str, value: Any) -> None:
    message = filled(getattr(m, type_name)(), written(type_name, value))
    back = type(message).deserialize(message.serialize())
    assert reading(back, (0.0, 0.0, 0.0), None) == value


@pytest.mark.parametrize("type_name", PACKAGES)
def test_types_have_the_names_that_ros_gives_them_on_the_wire(type_name: str) -> None:
    wire = getattr(m, type_name).__idl__.idl_transformed_typename
    assert wire == f"{PACKAGES[type_name]}::msg::dds_::{type_name}_"


# --- names and types ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("use", "topic", "expected"),
    [
        (Use.WAYPOINT, "waypoint", "waypoint_node/waypoint"),
        (Use.WAYPOINT, "/car/waypoint", "car/waypoint"),
        (Use.POSITIONING, "/vrpn_client_node/", "vrpn_client_node/hotdec_car/pose"),
        (Use.POSITIONING, "vrpn_client_node/", "vrpn_client_node/hotdec_car/pose"),
        (Use.POSITIONING, "pose", "waypoint_node/pose"),
        (Use.POSITIONING, "/car{pid}/pose", "car2/pose"),
    ],
)
def test_names_of_topics_are_those_of_the_published_middleware(
    use: Use, topic: str, expected: str
) -> None:
    """(P-ROS-NAMES)"""
    names = Names("/waypoint_node", "hotdec_car", 2)
    wire = names.wire(use, Topic(topic=topic, type="PoseStamped"))
    assert (wire.name, wire.told) == (expected, f"/{expected}")


def test_a_motion_capture_has_robots_under_names_that_topics_can_have() -> None:
    """(P-ROS-PUBLISHED)"""
    topic = Topic(topic="/vrpn_client_node/", type="PoseStamped")
    wire = Names("", "my-car", 2).wire(Use.POSITIONING, topic)
    assert wire.name == "vrpn_client_node/my_car/pose"


@pytest.mark.parametrize("text", ["PoseStamped", "geometry_msgs/PoseStamped"])
def test_types_may_be_named_with_their_package(text: str) -> None:
    names = Names("", "car", 0)
    assert names.wire(Use.POSITIONING, Topic(topic="p", type=text)).type_name == "PoseStamped"


def made(kind: str = "CAR", **options: Any) -> Ros2Driver:
    pose = Topic(topic="pose", type="PoseStamped")
    told = Ros2Options(**{"positioning_topic": pose, **options})
    return Ros2Driver(Device(0, Vehicle("car", kind), WORLD, (0.0, 0.0, 0.0), options=told))


def topic(type_name: str, name: str = "one") -> Topic:
    return Topic(topic=name, type=type_name)


@pytest.mark.parametrize(
    ("kind", "options", "message", "hint"),
    [
        (
            "CAR",
            {"positioning_topic": topic("Pose")},
            "the type `Pose` of `one` (positioning_topic) is not known",
            "geometry_msgs/PoseStamped, nav_msgs/Odometry",
        ),
        (
            "CAR",
            {"positioning_topic": topic("Twist")},
            "the type `Twist` of `one` (positioning_topic) does not fit",
            "nav_msgs/Odometry",
        ),
        (
            "CAR",
            {"positioning_topic": topic("nav_msgs/msg/PoseStamped")},
            "the type `nav_msgs/msg/PoseStamped` of `one` (positioning_topic) does not fit",
            "geometry_msgs/PoseStamped",
        ),
        (
            "CAR",
            {"positioning_topic": topic("PoseStamped", "1/pose")},
            "`/1/pose` (positioning_topic) is no name of a topic",
            "digit",
        ),
        (
            "DIFF",
            {"command_topic": topic("AckermannDriveStamped")},
            "`/one` steers front wheels, and this vehicle has none",
            "Twist",
        ),
        (
            "CAR",
            {"command_topic": topic("PoseStamped")},
            "`/one` tells positions to what drives",
            "waypoint_topic",
        ),
        (
            "CAR",
            {"command_topic": topic("Twist"), "waypoint_topic": topic("PoseStamped")},
            "both `command_topic` and `waypoint_topic` say how the vehicle is moved",
            "leave one",
        ),
        (
            "CAR",
            {"reached_topic": topic("String")},
            "`reached_topic` is about way-points, and there is no `waypoint_topic`",
            "leave both",
        ),
    ],
)
def test_what_does_not_do_is_named_with_what_would(
    kind: str, options: dict[str, Any], message: str, hint: str
) -> None:
    with pytest.raises(DriverError) as error:
        made(kind, **options)
    assert error.value.message == message
    assert hint in error.value.hint


@pytest.mark.parametrize(
    ("kind", "options", "wishes"),
    [
        ("CAR", {}, Wheels.WISHES),
        ("DIFF", {"waypoint_topic": topic("String")}, Targets.WISHES),
        ("QUAD", {}, Wings.WISHES),
        ("QUAD", {"command_topic": topic("PoseStamped")}, Targets.WISHES),
    ],
)
def test_what_is_understood_follows_from_the_topics(
    kind: str, options: dict[str, Any], wishes: tuple[type[Any], ...]
) -> None:
    assert made(kind, **options).capabilities.wishes == wishes


@pytest.mark.parametrize(
    ("text", "message"), [("x", "ROS_DOMAIN_ID is `x`"), ("233", "ROS_DOMAIN_ID is `233`")]
)
def test_a_domain_that_is_none_is_named(
    text: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(DriverError) as error:
        DdsGraph(None, 1)
    assert error.value.message == message


def test_a_dds_that_cannot_be_is_named_with_its_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Nonsense/></CycloneDDS>")
    with pytest.raises(DriverError) as error:
        DdsGraph(99, 1)
    assert error.value.message.startswith("no part can be taken in domain 99 of ROS 2")
    assert "CYCLONEDDS_URI" in error.value.hint


def test_a_library_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "koord.runtime.drivers.ros2.driver")
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(KoordError) as error:
        import_module("koord.runtime.drivers.ros2.driver")
    (told,) = error.value.diagnostics
    assert told.message == "cyclonedds is needed for this and is not installed"
    assert told.hint == "install it with: pip install 'koord[ros2]'"
