"""The driver of ROS 1 against a master and nodes of rospy, in processes of their own."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest

from koord.runtime.configuration.forms import Topic
from koord.runtime.configuration.model import Vehicle
from koord.runtime.drivers.driver import Device, DriverError
from koord.runtime.drivers.localisers.topic import Carrier, TopicLocaliser, TopicOptions
from koord.runtime.drivers.ros.graph import Fields, filled
from koord.runtime.drivers.ros.options import PACKAGES, Wire
from koord.runtime.drivers.ros.poses import Fix, fix_of, velocity_of
from koord.runtime.drivers.ros.readings import reading, written
from koord.runtime.drivers.ros1 import library
from koord.runtime.drivers.ros1.options import Ros1Options
from koord.runtime.drivers.setpoints import Drive, Hold
from tests.runtime.platform.ros.driving import (
    ROUND_TRIP_S,
    WORLD,
    Driven,
    driven_until,
    there_and_back,
    until,
)
from tests.runtime.platform.ros1.peers import (
    INSTALL,
    environment,
    fresh_prefix,
    master,
    node,
    uri,
)

if not library.is_installed():
    pytest.skip(f"rospy is not installed: run .ci/peers, or {INSTALL}", allow_module_level=True)

from koord.runtime.drivers.ros1.driver import Ros1Driver
from koord.runtime.drivers.ros1.graph import RospyGraph, _named

# rospy calls what Python will not have for long, and leaves sockets to be collected.
pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]

#: A value of each type that ports can have.
VALUES = (
    ("Bool", True),
    ("Float64", 0.5),
    ("Int32", 7),
    ("String", "open"),
    ("Point", (1.0, 2.0, 3.0)),
)

POSE = Topic(topic="pose", type="PoseStamped")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where all of ROS writes."""
    for name, value in environment(tmp_path).items():
        monkeypatch.setenv(name, value)
    return tmp_path


@pytest.fixture
def core(home: Path) -> Iterator[None]:
    """A master."""
    with master(home):
        yield


def driver(prefix: str, **options: object) -> Ros1Driver:
    told = {"positioning_topic": POSE, "wait": 30.0, "ros_node_prefix": prefix, **options}
    made = Ros1Options(**told)  # type: ignore[arg-type]
    return Ros1Driver(Device(3, Vehicle("car3", "DIFF"), WORLD, (0.0, 0.0, 0.0), options=made))


def complaint(prefix: str, **options: object) -> tuple[str, str]:
    with pytest.raises(DriverError) as error:
        driver(prefix, **options).open(time.monotonic())
    return error.value.message, error.value.hint


def remarked(made: Ros1Driver, *wanted: str) -> None:
    """Tick until all that is remarked, but for silence, begins with what is wanted."""
    end_s = time.monotonic() + 30.0
    while True:
        made.sense(time.monotonic())
        made.command(Hold(), time.monotonic())
        told = [one for one in made.remarks if not one.startswith("nothing is heard on")]
        if len(told) == len(wanted) and all(map(str.startswith, told, wanted)):
            return
        assert time.monotonic() < end_s, made.remarks
        time.sleep(0.02)


def test_a_car_of_rospy_drives_as_it_is_told_and_holds(core: None, home: Path) -> None:
    prefix = fresh_prefix()
    with node("car", prefix, home):
        made = driver(prefix)
        made.open(time.monotonic())
        driven_until(made, Drive(0.5), lambda s: s.position_m[0] > 0.2)
        made.command(Hold(), time.monotonic())
        sensed = until(made, lambda s: math.hypot(*s.velocity_mps) < 0.01)
        assert sensed.position_m[1] == pytest.approx(0.0, abs=1e-6)
        made.close()


@pytest.mark.slow
def test_who_leaves_stops_the_car_with_the_last_words(core: None, home: Path) -> None:
    """The vehicle's own timer would stop it after half a second."""
    prefix = fresh_prefix()
    with node("car", prefix, home):
        first, other = driver(prefix), driver(prefix, command_topic=Topic(topic="x", type="Twist"))
        first.open(time.monotonic())
        driven_until(first, Drive(0.5), lambda s: s.position_m[0] > 0.2)
        other._links = other._linked()
        until_sensed_s = time.monotonic() + 10.0
        while other.sense(time.monotonic()) is None:
            assert time.monotonic() < until_sensed_s
            first.command(Drive(0.5), time.monotonic())
            time.sleep(0.02)
        left_m = first.sense(time.monotonic())
        first.close()
        stopped = until(other, lambda s: math.hypot(*s.velocity_mps) < 0.01)
        assert left_m is not None
        assert math.dist(stopped.position_m, left_m.position_m) < 0.2
        other.close()


@pytest.mark.slow
def test_a_pose_goes_through_a_node_and_back_within_a_few_milliseconds(
    core: None, home: Path
) -> None:
    prefix = fresh_prefix()
    with node("echo", prefix, home):
        graph = RospyGraph(None, 10)
        echo = graph.listen(Wire(f"{prefix}/echo", "PoseStamped"))
        sender = graph.publish(Wire(f"{prefix}/waypoint", "PoseStamped"))
        end_s = time.monotonic() + 30.0
        while not (sender.is_heard and echo.is_connected):
            assert time.monotonic() < end_s, graph.why_unheard(sender.wire)
            time.sleep(0.01)
        trips = []
        for k in range(200):
            sent = {"header": {"stamp": {"sec": k}}, "pose": {"position": {"x": 1.5}}}
            back, trip_s = there_and_back(sender, echo, sent)
            trips.append(trip_s)
            assert k < 10 or (back is not None and back.header.stamp.secs == k)
            time.sleep(0.005)
        graph.close()
    assert min(trips) < ROUND_TRIP_S, sorted(trips)


@pytest.mark.slow
def test_a_guarded_robot_drives_a_car_of_rospy_to_a_place(core: None, home: Path) -> None:
    prefix, goal = fresh_prefix(), (1.0, 0.5, 0.0)
    with node("car", prefix, home):
        one = Driven(driver(prefix))
        one.go_to(goal)
        assert math.dist(one.driven.sensed.position_m, goal) < 0.25
        one.driven.close()


# --- what is wrong ------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_master_that_is_lost_is_told_and_known_again_when_it_is_back(home: Path) -> None:
    """(P-ROS-MASTER)"""
    prefix = fresh_prefix()
    lost = f"the master of ROS 1 at {uri()} does not answer"
    with master(home) as process, node("car", prefix, home) as car:
        made = driver(prefix, silent=0.5)
        made.open(time.monotonic())
        process.kill()
        process.wait()
        remarked(made, lost)
        # What is connected stays so.
        sensed = driven_until(made, Drive(0.5), lambda s: s.velocity_mps[0] > 0.3)
        assert sensed.link
        with master(home):
            remarked(made)
            car.kill()
            car.wait()
            remarked(made, "nobody listens to")
            with node("car", prefix, home, name="other"):
                remarked(made)
                until(made, lambda s: s.link)
        made.close()


@pytest.mark.slow
def test_a_master_that_is_not_there_is_named(home: Path) -> None:
    message, hint = complaint(fresh_prefix(), wait=3.0)
    assert message == f"the master of ROS 1 at {uri()} does not answer"
    assert "ROS_MASTER_URI" in hint


@pytest.mark.slow
def test_what_is_not_there_or_is_otherwise_is_named(core: None, home: Path) -> None:
    prefix = fresh_prefix()
    with node("car", prefix, home) as car:
        first = driver(prefix)
        first.open(time.monotonic())  # the peer is there
        first.close()
        of_text = Topic(topic="reached", type="PoseStamped")
        assert complaint(prefix, positioning_topic=of_text)[0] == (
            f"`/{prefix}/reached` has the type std_msgs/String, not geometry_msgs/PoseStamped"
        )
        stamped = Topic(topic="cmd_vel", type="TwistStamped")
        assert complaint(prefix, command_topic=stamped, wait=2.0)[0] == (
            f"`/{prefix}/cmd_vel` has the type geometry_msgs/Twist, not geometry_msgs/TwistStamped"
        )
        deaf = Topic(topic="nowhere", type="Twist")
        assert complaint(prefix, command_topic=deaf, wait=1.0)[0] == (
            f"nobody listens to `/{prefix}/nowhere` at the master {uri()}"
        )
        assert complaint(prefix, frame="odom")[0] == (
            f"poses on `/{prefix}/pose` do not count: they are in the frame `map`, not in `odom`"
        )
        car.kill()
        car.wait()
        assert complaint(prefix, wait=1.0)[0] == (
            f"`/{prefix}/pose` is published by /car_{prefix}, which does not answer"
        )


@pytest.mark.slow
def test_a_car_that_dies_has_no_link_and_nobody_who_listens(core: None, home: Path) -> None:
    prefix = fresh_prefix()
    with node("car", prefix, home) as car:
        made = driver(prefix, silent=0.4)
        made.open(time.monotonic())
        car.kill()
        car.wait()
        until(made, lambda s: not s.link)
        remarked(made, "nobody listens to")
        made.close()


@pytest.mark.slow
def test_a_topic_of_ros_1_says_where_another_vehicle_is(core: None, home: Path) -> None:
    """(P-LOCATE-TOPIC)"""
    prefix = fresh_prefix()
    told = TopicOptions(topic=f"/{prefix}/pose", ros=Carrier.ROS_1)
    device = Device(0, Vehicle("hawk", "QUAD"), WORLD, (0.0, 0.0, 0.0), options=told)
    with node("car", prefix, home) as car:
        made = TopicLocaliser(device)
        made.open(time.monotonic())
        end_s = time.monotonic() + 30.0
        while (located := made.locate(time.monotonic())) is None:
            assert time.monotonic() < end_s, made.remarks
            time.sleep(0.02)
        assert located.position_m == (0.0, 0.0, 0.0)
        assert made.remarks == ()
        car.kill()
        car.wait()
        while "nothing is said" not in "".join(made.remarks):
            assert time.monotonic() < end_s + 30.0
            made.locate(time.monotonic())
            time.sleep(0.02)
        made.close()


@pytest.mark.slow
def test_one_process_has_one_master(core: None) -> None:
    RospyGraph(None, 1).close()
    with pytest.raises(DriverError, match="cannot be at http://elsewhere:11311 too"):
        RospyGraph("http://elsewhere:11311", 1)


def test_messages_that_no_package_has_are_those_of_their_definition() -> None:
    drive = library._defined("AckermannDriveStamped")
    assert drive._md5sum == "1fd5d7f58889cefd44d29f6653240d0c"
    assert drive().drive.steering_angle == 0.0


@pytest.mark.parametrize("type_name", PACKAGES)
def test_all_types_are_those_of_ros_1(type_name: str) -> None:
    assert library.message_type(type_name)._type == f"{PACKAGES[type_name]}/{type_name}"


def sent(type_name: str, fields: Fields) -> Any:
    """A message as it comes over the wire."""
    made = library.message_type(type_name)
    wire = BytesIO()
    filled(made(), _named(fields)).serialize(wire)
    return made().deserialize(wire.getvalue())


def test_messages_of_ros_1_are_read_as_those_of_ros_2() -> None:
    header = {"stamp": {"sec": 5, "nanosec": 500_000_000}, "frame_id": "map"}
    pose = {"position": {"x": 1.0, "y": 2.0, "z": 3.0}, "orientation": {"w": 1.0}}
    fix = Fix((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), "map", 5.5)
    assert fix_of(sent("PoseStamped", {"header": header, "pose": pose})) == fix
    assert fix_of(sent("Odometry", {"header": header, "pose": {"pose": pose}})) == fix
    twist = sent("TwistStamped", {"header": header, "twist": {"linear": {"x": 0.5}}})
    assert velocity_of(twist, fix) == (0.5, 0.0, 0.0)
    drive = sent("AckermannDriveStamped", {"header": header, "drive": {"steering_angle": 0.25}})
    assert drive.drive.steering_angle == 0.25
    scan = sent("LaserScan", {"range_min": 0.1, "range_max": 4.0, "ranges": [1.0, math.inf]})
    assert reading(scan, (0.0, 0.0, 0.0), fix) == ((1, 2, 3), (2, 2, 3), (5, 2, 3))
    assert reading(sent("BatteryState", {"percentage": 0.75}), (0.0, 0.0, 0.0), None) == 0.75


@pytest.mark.parametrize(("type_name", "value"), VALUES)
def test_values_of_ports_come_back_as_they_went(type_name: str, value: object) -> None:
    assert reading(sent(type_name, written(type_name, value)), (0.0, 0.0, 0.0), None) == value


def test_what_else_is_in_the_folder_stands_in_for_nothing() -> None:
    import yaml

    library.rospy()
    if (folder := library.folder()) is not None:
        assert not yaml.__file__.startswith(folder)
