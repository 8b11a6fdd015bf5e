"""The driver against nodes of rclpy on Fast DDS: the names and types are those of ROS 2 itself.

rclpy comes from the package index, in an environment of its own: it brings a parser that others
have another version of, and starts Python anew.
"""

from __future__ import annotations

import math
import os
import shlex
import statistics
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest

from koord.runtime.drivers.ros.options import Wire
from koord.runtime.drivers.ros.poses import Fix, fix_of
from koord.runtime.drivers.ros2.dds import DdsGraph
from tests.runtime.platform.ros.driving import Driven
from tests.runtime.platform.ros2.peers import DOMAIN, fresh_prefix
from tests.runtime.platform.ros2.test_driven import driver

pytestmark = pytest.mark.slow

PACKAGES = (
    "ros-kilted-rclpy==9.1.2",
    "ros-kilted-rmw-fastrtps-cpp==9.3.3",
    "ros-kilted-geometry-msgs==5.5.1",
)

#: Tests may install packages if this is set.
ALLOWED = "KOORD_TEST_INSTALL"

NODE = Path(__file__).with_name("rclpy_car.py")

#: There and back through a node, in seconds, as a median.
ROUND_TRIP_S = 0.005


@cache
def rclpy_python() -> str:
    """A Python that has rclpy, made in the user's cache if that is allowed; or skip."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "koord" / "rclpy"
    python = folder / "bin" / "python"
    steps = (
        ["python3.11", "-m", "venv", str(folder)],
        [str(python), "-m", "pip", "install", "--quiet", *PACKAGES],
    )
    if not _has_rclpy(python):
        if not os.environ.get(ALLOWED):
            told = " && ".join(shlex.join(step) for step in steps)
            pytest.skip(f"rclpy is not installed: set {ALLOWED}=1, or run: {told}")
        for step in steps:
            subprocess.run(step, check=True, timeout=900)
    return str(python)


def _has_rclpy(python: Path) -> bool:
    asked = [str(python), "-c", "import rclpy, geometry_msgs.msg"]
    return python.exists() and subprocess.run(asked, timeout=60, check=False).returncode == 0


@contextmanager
def node(prefix: str) -> Iterator[None]:
    """The node as a process."""
    told = {key: os.environ[key] for key in ("PATH", "HOME") if key in os.environ}
    with subprocess.Popen(
        [rclpy_python(), str(NODE), prefix],
        stdin=subprocess.PIPE,
        env={
            **told,
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": str(DOMAIN),
        },
    ) as process:
        try:
            yield
        finally:
            process.kill()


def test_a_pose_goes_through_a_node_and_back_within_a_few_milliseconds() -> None:
    prefix = fresh_prefix()
    graph = DdsGraph(DOMAIN, 10)
    echo = graph.listen(Wire(f"{prefix}/echo", "PoseStamped"))
    poses = graph.listen(Wire(f"{prefix}/pose", "PoseStamped"))
    sender = graph.publish(Wire(f"{prefix}/waypoint", "PoseStamped"))
    trips = []
    with node(prefix):
        end_s = time.monotonic() + 60
        while poses.take() is None or not sender.is_heard:
            assert time.monotonic() < end_s, graph.why_silent(poses.wire)
            time.sleep(0.01)
        for k in range(200):
            header = {"stamp": {"sec": k, "nanosec": 7}, "frame_id": "map"}
            sent = {"header": header, "pose": {"position": {"x": 1.0, "y": 2.0, "z": 3.0}}}
            begun_s = time.perf_counter()
            sender.send(sent)
            back = None
            while back is None and time.perf_counter() - begun_s < 1.0:
                back = echo.take()
            trips.append(time.perf_counter() - begun_s)
            assert k < 10 or fix_of(back) == Fix(
                (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), "map", k + 7e-9
            )
            time.sleep(0.005)
    graph.close()
    assert statistics.median(trips) < ROUND_TRIP_S, sorted(trips)


def test_a_guarded_robot_drives_a_car_of_rclpy_to_a_place() -> None:
    prefix = fresh_prefix()
    goal = (1.0, 0.5, 0.0)
    with node(prefix):
        one = Driven(driver(prefix, "DIFF"))
        one.go_to(goal)
        assert math.dist(one.driven.sensed.position_m, goal) < 0.25
        one.driven.close()
