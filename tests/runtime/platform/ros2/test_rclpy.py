"""The driver against nodes of rclpy on Fast DDS: the names and types are those of ROS 2 itself."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from koord.runtime.drivers.ros.options import Wire
from koord.runtime.drivers.ros.poses import Fix, fix_of
from koord.runtime.drivers.ros2.dds import DdsGraph
from tests.runtime.platform.ros.driving import ROUND_TRIP_S, Driven, there_and_back
from tests.runtime.platform.ros2.peers import DOMAIN, fresh_prefix
from tests.runtime.platform.ros2.rclpy_peers import environment, node, rclpy_python
from tests.runtime.platform.ros2.test_driven import driver

pytestmark = pytest.mark.slow


def test_a_pose_goes_through_a_node_and_back_within_a_few_milliseconds() -> None:
    prefix = fresh_prefix()
    graph = DdsGraph(DOMAIN, 10)
    echo = graph.listen(Wire(f"{prefix}/echo", "PoseStamped"))
    poses = graph.listen(Wire(f"{prefix}/pose", "PoseStamped"))
    sender = graph.publish(Wire(f"{prefix}/waypoint", "PoseStamped"))
    trips = []
    with node("echo", prefix, DOMAIN):
        end_s = time.monotonic() + 60
        while poses.take() is None or not sender.is_heard:
            assert time.monotonic() < end_s, graph.why_silent(poses.wire)
            time.sleep(0.01)
        for k in range(200):
            header = {"stamp": {"sec": k, "nanosec": 7}, "frame_id": "map"}
            sent = {"header": header, "pose": {"position": {"x": 1.0, "y": 2.0, "z": 3.0}}}
            back, trip_s = there_and_back(sender, echo, sent)
            trips.append(trip_s)
            assert k < 10 or fix_of(back) == Fix(
                (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), "map", k + 7e-9
            )
            time.sleep(0.005)
    graph.close()
    assert min(trips) < ROUND_TRIP_S, sorted(trips)


def test_a_guarded_robot_drives_a_car_of_rclpy_to_a_place() -> None:
    prefix = fresh_prefix()
    goal = (1.0, 0.5, 0.0)
    with node("car", prefix, DOMAIN):
        one = Driven(driver(prefix, "DIFF"))
        one.go_to(goal)
        assert math.dist(one.driven.sensed.position_m, goal) < 0.25
        one.driven.close()


def test_what_holds_of_the_driver_by_rclpy_holds() -> None:
    """By the Python that has rclpy, with koord and what it needs from here."""
    root, by_rclpy = Path(__file__).parents[4], Path(__file__).with_name("test_by_rclpy.py")
    here = [str(root), *(path for path in sys.path if path.endswith("site-packages"))]
    done = subprocess.run(
        [rclpy_python(), "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "slow", by_rclpy],
        cwd=root,
        env={**os.environ, **environment(DOMAIN), "PYTHONPATH": os.pathsep.join(here)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "skipped" not in done.stdout, done.stdout
