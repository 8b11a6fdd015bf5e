"""Nodes that speak as those of ROS 2 do, as processes of their own: `peers.py KIND DOMAIN PREFIX`.

They move in real time, and end with their standard input.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

from koord.runtime.drivers.ros.options import PACKAGES, Wire
from koord.runtime.drivers.ros2.dds import DdsGraph

#: DDS on this machine alone, without multicast, for all that tests start.
LOOPBACK = (
    "<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast><Interfaces>"
    '<NetworkInterface name="lo" multicast="false"/></Interfaces></General><Discovery>'
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>40"
    '</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>'
    "</Domain></CycloneDDS>"
)

#: A domain of this process; what else runs beside it has other names of topics if not another one.
DOMAIN = int(os.environ.get("KOORD_TEST_DOMAIN", 10 + os.getpid() % 80))

_PERIOD_S = 0.01
_SOON_S = 0.0002
_NUMBERS = count()


def fresh_prefix() -> str:
    """A prefix of topics that nobody else has."""
    return f"t{os.getpid()}_{next(_NUMBERS)}"


@contextmanager
def peer(kind: str, prefix: str, domain: int = DOMAIN) -> Iterator[subprocess.Popen[bytes]]:
    """A peer as a process, ended and waited for."""
    root = str(Path(__file__).parents[4])
    with subprocess.Popen(
        [sys.executable, "-m", "tests.runtime.platform.ros2.peers", kind, str(domain), prefix],
        stdin=subprocess.PIPE,
        cwd=root,
        env={**os.environ, "CYCLONEDDS_URI": LOOPBACK, "PYTHONPATH": root},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


class Body:
    """A pose that moves, and the topics that all peers have."""

    def __init__(self, domain: int, prefix: str) -> None:
        self.graph, self.prefix = DdsGraph(domain, 10), prefix
        self.x = self.y = self.z = self.heading = self.speed = self.rate = 0.0
        self.poses = self.topic("pose", "PoseStamped", self.graph.publish)
        self.odometry = self.topic("odom", "Odometry", self.graph.publish)

    def topic(self, name: str, type_name: str, make: Any) -> Any:
        assert type_name in PACKAGES
        return make(Wire(f"{self.prefix}/{name}", type_name))

    def tell(self) -> None:
        now_ns = time.time_ns()
        stamp = {"sec": now_ns // 10**9, "nanosec": now_ns % 10**9}
        header = {"stamp": stamp, "frame_id": "map"}
        turn = {"z": math.sin(self.heading / 2), "w": math.cos(self.heading / 2)}
        pose = {"position": {"x": self.x, "y": self.y, "z": self.z}, "orientation": turn}
        self.poses.send({"header": header, "pose": pose})
        twist = {"linear": {"x": self.speed}, "angular": {"z": self.rate}}
        self.odometry.send({"header": header, "pose": {"pose": pose}, "twist": {"twist": twist}})

    def run(self) -> None:
        due_s = time.monotonic()
        while True:
            self.move(_PERIOD_S)
            self.tell()
            due_s = max(due_s + _PERIOD_S, time.monotonic() - _PERIOD_S)
            time.sleep(max(0.0, due_s - time.monotonic()))

    def move(self, dt_s: float) -> None:
        self.heading += self.rate * dt_s
        self.x += self.speed * math.cos(self.heading) * dt_s
        self.y += self.speed * math.sin(self.heading) * dt_s


class Car(Body):
    """It integrates what it is told on one of three topics, and stops when it is told nothing."""

    DEAD_MAN_S = 0.5

    def __init__(self, domain: int, prefix: str) -> None:
        super().__init__(domain, prefix)
        listen = self.graph.listen
        self.twists = self.topic("cmd_vel", "Twist", listen)
        self.stamped = self.topic("cmd_vel_stamped", "TwistStamped", listen)
        self.drives = self.topic("drive", "AckermannDriveStamped", listen)
        self.scans = self.topic("scan", "LaserScan", self.graph.publish)
        self.batteries = self.topic("battery", "BatteryState", self.graph.publish)
        self.told_at_s = time.monotonic()

    def move(self, dt_s: float) -> None:
        heard = self.twists.take(), self.stamped.take(), self.drives.take()
        for message in heard:
            if message is None:
                continue
            self.told_at_s = time.monotonic()
            if hasattr(message, "drive"):
                self.speed = message.drive.speed
                self.rate = self.speed * math.tan(message.drive.steering_angle) / 0.33
            else:
                twist = getattr(message, "twist", message)
                self.speed, self.rate = twist.linear.x, twist.angular.z
        if time.monotonic() - self.told_at_s > self.DEAD_MAN_S:
            self.speed = self.rate = 0.0
        super().move(dt_s)

    def tell(self) -> None:
        super().tell()
        ranges = [1.0, math.inf, math.nan, 0.01]
        turn = math.pi / 2
        limits = {"angle_increment": turn, "range_min": 0.1, "range_max": 4.0}
        self.scans.send({**limits, "ranges": ranges})
        self.batteries.send({"percentage": 0.75})


class Runaway(Car):
    """It goes on with what it was told last, for ever."""

    DEAD_MAN_S = math.inf


class Follower(Body):
    """It goes straight to each way-point that is new, and says then that it is there."""

    def __init__(self, domain: int, prefix: str) -> None:
        super().__init__(domain, prefix)
        self.waypoints = self.topic("waypoint", "PoseStamped", self.graph.listen)
        self.reached = self.topic("reached", "String", self.graph.publish)
        self.aim: tuple[float, float] | None = None
        self.heard: tuple[float, float] | None = None

    def move(self, dt_s: float) -> None:
        message = self.waypoints.take()
        if message is not None:
            told = message.pose.position.x, message.pose.position.y
            if told != self.heard:  # it is said again and again
                self.aim = self.heard = told
        self.speed = 0.0
        if self.aim is None:
            return
        way = self.aim[0] - self.x, self.aim[1] - self.y
        far_m = math.hypot(*way)
        if far_m > 0.005:
            self.heading = math.atan2(way[1], way[0])
            self.speed = min(0.5, far_m / dt_s)
        else:
            self.reached.send({"data": "TRUE"})
            self.aim = None
        super().move(dt_s)


class Echo(Body):
    """It sends each place back at once."""

    def __init__(self, domain: int, prefix: str) -> None:
        super().__init__(domain, prefix)
        self.places = self.topic("waypoint", "PoseStamped", self.graph.listen)
        self.echo = self.topic("echo", "PoseStamped", self.graph.publish)

    def run(self) -> None:
        while True:
            message = self.places.take()
            if message is not None:
                self.echo.send({"pose": {"position": {"x": message.pose.position.x}}})
            time.sleep(_SOON_S)


KINDS = {"car": Car, "echo": Echo, "follower": Follower, "runaway": Runaway}


def main(kind: str, domain: str, prefix: str) -> None:
    """Run a peer until standard input ends."""
    body = KINDS[kind](int(domain), prefix)
    threading.Thread(target=body.run, daemon=True).start()
    sys.stdin.read()


if __name__ == "__main__":
    main(*sys.argv[1:])
