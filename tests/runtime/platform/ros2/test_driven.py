"""The driver against nodes in processes of their own, over DDS."""

from __future__ import annotations

import math
import time
from typing import Any

import pytest

from koord.runtime.configuration.forms import Topic
from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.ros.options import SensorTopic
from koord.runtime.drivers.ros2.driver import Ros2Driver
from koord.runtime.drivers.ros2.options import Ros2Options
from koord.runtime.drivers.setpoints import Drive, Hold, Position
from koord.runtime.guardian.events import Order
from tests.runtime.platform.ros.driving import WORLD, Driven, driven_until, until
from tests.runtime.platform.ros2.peers import DOMAIN, fresh_prefix, peer
from tests.sampling import first

POSE = Topic(topic="pose", type="PoseStamped")


def driver(prefix: str, kind: str = "CAR", **options: Any) -> Ros2Driver:
    told = {"positioning_topic": POSE, "wait": 30.0, **options}
    made = Ros2Options(ros_node_prefix=prefix, domain=DOMAIN, **told)
    return Ros2Driver(Device(3, Vehicle("car3", kind), WORLD, (0.0, 0.0, 0.0), options=made))


COMMANDS = {
    "Twist": None,
    "TwistStamped": Topic(topic="cmd_vel_stamped", type="geometry_msgs/msg/TwistStamped"),
    "AckermannDriveStamped": Topic(topic="drive", type="AckermannDriveStamped"),
}


@pytest.mark.parametrize("command", first(1, COMMANDS))
def test_a_car_drives_and_turns_as_it_is_told_and_holds(command: str) -> None:
    prefix = fresh_prefix()
    with peer("car", prefix):
        made = driver(prefix, command_topic=COMMANDS[command])
        made.open(time.monotonic())
        wish = Drive(0.8, 0.8 * math.tan(0.2) / 0.33, 0.2)
        sensed = driven_until(made, wish, lambda s: yaw_of(s.attitude) > 0.5)
        speed = math.hypot(*sensed.velocity_mps)
        # On the arc: y = r (1 - cos yaw).
        radius, yaw = 0.33 / math.tan(0.2), yaw_of(sensed.attitude)
        assert sensed.position_m[1] == pytest.approx(radius * (1 - math.cos(yaw)), abs=0.03)
        assert 0.3 < speed < 1.2
        made.command(Hold(), time.monotonic())
        until(made, lambda s: math.hypot(*s.velocity_mps) < 0.01)
        made.close()


def test_a_car_that_is_told_nothing_stops_by_its_own_timer() -> None:
    """(P-ROS-DEAD-MAN)"""
    prefix = fresh_prefix()
    with peer("car", prefix):
        made = driver(prefix, dead_man=0.5, positioning_topic=Topic(topic="odom", type="Odometry"))
        assert made.capabilities.dead_man_s == 0.5
        made.open(time.monotonic())
        driven_until(made, Drive(0.5), lambda s: s.velocity_mps[0] == pytest.approx(0.5))
        until(made, lambda s: s.velocity_mps[0] == 0.0)
        made.close()


def test_what_has_stopped_telling_is_old_first_and_then_no_link() -> None:
    prefix = fresh_prefix()
    with peer("car", prefix) as process:
        made = driver(prefix, silent=0.4)
        made.open(time.monotonic())
        until(made, lambda s: time.monotonic() - s.measured_at_s < 0.1)
        process.kill()
        process.wait()
        seen = until(made, lambda s: not s.link)
        assert time.monotonic() - seen.measured_at_s > 0.4
        made.close()


def test_sensors_of_the_program_are_read() -> None:
    prefix = fresh_prefix()
    sensors = {
        "pscan": SensorTopic(topic="scan", type="LaserScan", at=(0.2, 0.0, 0.0)),
        "charge": SensorTopic(topic="battery", type="sensor_msgs/BatteryState"),
    }
    with peer("car", prefix):
        made = driver(prefix, sensors=sensors)
        assert made.capabilities.tells_battery
        made.open(time.monotonic())
        until(made, lambda _: len(made.ports()) == 2)
        assert until(made, lambda _: True).battery == 0.75
        assert made.ports()["charge"] == 0.75
        here, ahead, left = made.ports()["pscan"]
        assert here == pytest.approx((0.2, 0.0, 0.0))
        assert ahead == pytest.approx((1.2, 0.0, 0.0))
        assert left == pytest.approx((0.2, 4.0, 0.0))  # nothing was met within the range
        made.close()


def test_a_follower_is_sent_to_way_points_and_says_when_it_is_there() -> None:
    prefix = fresh_prefix()
    told: dict[str, Any] = {
        "waypoint_topic": Topic(topic="waypoint", type="String"),
        "reached_topic": Topic(topic="reached", type="String"),
    }
    with peer("follower", prefix):
        made = driver(prefix, **told)
        made.open(time.monotonic())
        made.command(Hold(), time.monotonic())
        for goal in ((0.5, 0.0, 0.0), (0.5, 0.4, 0.0)):
            wish = Position(goal, None, 0.5)
            made.command(wish, time.monotonic())
            assert made.reached is None
            sensed = driven_until(made, wish, lambda _: made.reached is True)
            assert math.dist(sensed.position_m, goal) < 0.02
        made.command(Position((-3.0, 0.0, 0.0), None, 0.5), time.monotonic())
        until(made, lambda s: s.position_m[0] < 0.3)
        made.command(Hold(), time.monotonic())
        until(made, lambda s: math.hypot(*s.velocity_mps) < 0.01)
        made.close()


@pytest.mark.parametrize("kind", [pytest.param("CAR", marks=pytest.mark.slow), "DIFF"])
def test_a_guarded_robot_drives_a_car_of_ros_to_a_place(kind: str) -> None:
    prefix = fresh_prefix()
    with peer("car", prefix):
        one = Driven(driver(prefix, kind))
        goal = (1.2, 0.1, 0.0)
        one.go_to(goal)
        assert math.dist(one.driven.sensed.position_m, goal) < 0.25
        one.driven.order(Order.ESTOP, time.monotonic())
        one.until(lambda: one.driven.is_at_rest)
        one.driven.close()


def test_a_guarded_robot_sends_a_follower_of_ros_along_its_way() -> None:
    prefix = fresh_prefix()
    with peer("follower", prefix):
        made = driver(prefix, "DIFF", waypoint_topic=Topic(topic="waypoint", type="PoseStamped"))
        one = Driven(made)
        corner, goal = (0.6, 0.0, 0.0), (0.6, 0.6, 0.0)
        one.until(one.started)
        one.driven.follow([(0.0, 0.0, 0.0), corner, goal])
        furthest_m = 0.0

        def arrived() -> bool:
            nonlocal furthest_m
            x, y, _ = one.driven.sensed.position_m
            furthest_m = max(furthest_m, min(abs(y), abs(x - 0.6)))
            return one.driven.sensors.reached

        one.driven.tick(time.monotonic(), 0.0)
        one.until(arrived)
        assert math.dist(one.driven.sensed.position_m, goal) < 0.25
        assert furthest_m < 0.2
        one.driven.close()


# --- what is wrong ------------------------------------------------------------------------------


def complaint(prefix: str, **options: Any) -> tuple[str, str]:
    with pytest.raises(DriverError) as error:
        driver(prefix, **options).open(time.monotonic())
    return error.value.message, error.value.hint


def test_a_vehicle_that_nobody_publishes_is_named_with_its_domain() -> None:
    prefix = fresh_prefix()
    message, hint = complaint(prefix, wait=0.2)
    assert message == f"nobody publishes `/{prefix}/pose` in domain {DOMAIN}"
    assert "ros2 topic list" in hint


def test_a_topic_of_another_type_is_named_with_both() -> None:
    prefix = fresh_prefix()
    wrong = Topic(topic="odom", type="PoseStamped")
    with peer("car", prefix):
        message, _ = complaint(prefix, positioning_topic=wrong)
    assert message == (
        f"`/{prefix}/odom` has the type nav_msgs/msg/Odometry, not geometry_msgs/msg/PoseStamped"
    )


def test_a_command_that_nobody_hears_is_named() -> None:
    prefix = fresh_prefix()
    deaf = Topic(topic="nowhere", type="Twist")
    with peer("car", prefix):
        first = driver(prefix)
        first.open(time.monotonic())  # the peer is there
        message, _ = complaint(prefix, command_topic=deaf, wait=3.0)
        first.close()
    assert message == f"nobody listens to `/{prefix}/nowhere` in domain {DOMAIN}"


def test_a_sensor_of_another_type_is_named() -> None:
    prefix = fresh_prefix()
    sensors = {"scan": SensorTopic(topic="battery", type="LaserScan")}
    with peer("car", prefix):
        message, _ = complaint(prefix, sensors=sensors)
    assert message == (
        f"`/{prefix}/battery` has the type sensor_msgs/msg/BatteryState, "
        "not sensor_msgs/msg/LaserScan"
    )


def test_a_frame_that_does_not_match_is_named() -> None:
    prefix = fresh_prefix()
    with peer("car", prefix):
        message, hint = complaint(prefix, frame="odom")
    assert message == (
        f"poses on `/{prefix}/pose` do not count: they are in the frame `map`, not in `odom`"
    )
    assert "`frame`" in hint
