"""The driver with rclpy as its transport, in a Python that has that (`test_rclpy.py` runs it)."""

from __future__ import annotations

import math
import time
from importlib.util import find_spec

import pytest

from koord.runtime.configuration.forms import Topic
from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.ros.graph import filled
from koord.runtime.drivers.ros.options import Wire
from koord.runtime.drivers.ros.poses import Fix
from koord.runtime.drivers.ros.readings import reading, written
from koord.runtime.drivers.ros2.client import RclpyGraph, message_type
from koord.runtime.drivers.ros2.driver import Ros2Driver
from koord.runtime.drivers.ros2.options import Ros2Options, Transport
from koord.runtime.drivers.setpoints import Drive, Hold, Position
from tests.runtime.platform.ros.driving import (
    ROUND_TRIP_S,
    WORLD,
    Driven,
    driven_until,
    there_and_back,
    until,
)
from tests.runtime.platform.ros2.peers import DOMAIN, fresh_prefix
from tests.runtime.platform.ros2.rclpy_peers import node

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("rclpy") is None, reason="this Python has no rclpy"),
]

POSE = Topic(topic="pose", type="PoseStamped")


def driver(prefix: str, **options: object) -> Ros2Driver:
    told = {"positioning_topic": POSE, "wait": 30.0, "ros_node_prefix": prefix, **options}
    made = Ros2Options(domain=DOMAIN, transport=Transport.RCLPY, **told)  # type: ignore[arg-type]
    return Ros2Driver(Device(3, Vehicle("car3", "DIFF"), WORLD, (0.0, 0.0, 0.0), options=made))


def test_a_car_drives_as_it_is_told_and_holds() -> None:
    prefix = fresh_prefix()
    with node("car", prefix, DOMAIN):
        made = driver(prefix)
        made.open(time.monotonic())
        driven_until(made, Drive(0.5), lambda s: s.position_m[0] > 0.2)
        made.command(Hold(), time.monotonic())
        until(made, lambda s: math.hypot(*s.velocity_mps) < 0.01)
        made.close()


def test_a_follower_goes_to_places_and_says_when_it_is_there() -> None:
    prefix = fresh_prefix()
    topics = {
        name: Topic(topic=name.removesuffix("_topic"), type="String")
        for name in ("waypoint_topic", "reached_topic")
    }
    with node("follower", prefix, DOMAIN):
        made = driver(prefix, **topics)
        made.open(time.monotonic())
        wish = Position((0.4, 0.3, 0.0), None, 0.5)
        sensed = driven_until(made, wish, lambda _: made.reached is True)
        assert math.dist(sensed.position_m, wish.position_m) < 0.02
        made.close()


def test_a_guarded_robot_drives_a_car_to_a_place() -> None:
    prefix, goal = fresh_prefix(), (1.0, 0.5, 0.0)
    with node("car", prefix, DOMAIN):
        one = Driven(driver(prefix))
        one.go_to(goal)
        assert math.dist(one.driven.sensed.position_m, goal) < 0.25
        one.driven.close()


def test_a_pose_goes_through_a_node_and_back_within_a_few_milliseconds() -> None:
    prefix, graph, trips = fresh_prefix(), RclpyGraph(DOMAIN, 10), []
    echo = graph.listen(Wire(f"{prefix}/echo", "PoseStamped"))
    sender = graph.publish(Wire(f"{prefix}/waypoint", "PoseStamped"))
    with node("echo", prefix, DOMAIN):
        end_s = time.monotonic() + 60
        while not (sender.is_heard and graph.published(echo.wire)):
            assert time.monotonic() < end_s, graph.why_unheard(sender.wire)
            time.sleep(0.01)
        for k in range(200):
            sent = {"header": {"stamp": {"sec": k}}, "pose": {"position": {"x": 1.5}}}
            back, trip_s = there_and_back(sender, echo, sent)
            trips.append(trip_s)
            assert k < 10 or (back is not None and back.header.stamp.sec == k)
            time.sleep(0.005)
    graph.close()
    assert min(trips) < ROUND_TRIP_S, sorted(trips)


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
def test_values_of_ports_come_back_as_they_went(type_name: str, value: object) -> None:
    message = filled(message_type(type_name)(), written(type_name, value))
    assert reading(message, (0.0, 0.0, 0.0), None) == value


def test_scans_and_batteries_are_read() -> None:
    limits = {"range_min": 0.125, "range_max": 4.0, "ranges": [1.0, math.inf]}
    fix = Fix((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), "map", 0.0)
    scan = filled(message_type("LaserScan")(), limits)
    assert reading(scan, (0.0, 0.0, 0.0), fix) == ((1, 2, 3), (2, 2, 3), (5, 2, 3))
    battery = filled(message_type("BatteryState")(), {"percentage": 0.75})
    assert reading(battery, (0.0, 0.0, 0.0), None) == 0.75


def complaint(prefix: str, **options: object) -> str:
    with pytest.raises(DriverError) as error:
        driver(prefix, **options).open(time.monotonic())
    return error.value.message


def test_what_is_not_there_or_is_otherwise_is_named() -> None:
    prefix = fresh_prefix()
    assert complaint(prefix, wait=0.3) == f"nobody publishes `/{prefix}/pose` in domain {DOMAIN}"
    with node("car", prefix, DOMAIN) as car:
        made = driver(prefix, silent=0.4)
        made.open(time.monotonic())
        assert complaint(prefix, positioning_topic=Topic(topic="pose", type="Odometry")) == (
            f"`/{prefix}/pose` has the type geometry_msgs/msg/PoseStamped, "
            "not nav_msgs/msg/Odometry"
        )
        stamped = Topic(topic="cmd_vel", type="TwistStamped")
        assert complaint(prefix, command_topic=stamped, wait=10.0) == (
            f"`/{prefix}/cmd_vel` has the type geometry_msgs/msg/Twist, "
            "not geometry_msgs/msg/TwistStamped"
        )
        deaf = Topic(topic="nowhere", type="Twist")
        assert complaint(prefix, command_topic=deaf, wait=10.0) == (
            f"nobody listens to `/{prefix}/nowhere` in domain {DOMAIN}"
        )
        assert complaint(prefix, frame="odom").endswith("in the frame `map`, not in `odom`")
        made.sense(time.monotonic())
        car.kill()
        car.wait()
        until(made, lambda s: not s.link)
        made.close()
