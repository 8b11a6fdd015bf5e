"""A differential drive as a node of ROS 2, in real time, by cyclonedds.

It hears Twist on ``PREFIX/cmd_vel``, stops when it has heard none for half a second, and tells
PoseStamped on ``PREFIX/pose``.
"""

from __future__ import annotations

import argparse
import json
import math
import socket
import sys
import time
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from koord.testing.ros2.messages import Header, Point, Pose, PoseStamped, Quaternion, Time, Twist

_PERIOD_S = 0.01

#: It reports every so many steps.
_REPORT = 5

#: How hard it speeds up and brakes, and how it turns faster.
_ACCELERATION, _TURN = 2.0, 8.0

#: Without a command for so long it stops. (`cmd_vel_timeout`)
_DEAD_MAN_S = 0.5

#: As nodes of ROS are unless they are told otherwise.
_QOS = Qos(Policy.Reliability.Reliable(0), Policy.Durability.Volatile, Policy.History.KeepLast(10))


class Car:
    """The node. Its frame is east, north, up."""

    def __init__(self, prefix: str, domain: int, start: tuple[float, float, float]) -> None:
        self.x, self.y, self.heading = start
        self.speed = self.rate = 0.0
        self._wanted = 0.0, 0.0
        self._told_s = -math.inf
        node = DomainParticipant(domain)
        poses = Topic(node, f"rt/{prefix}/pose", PoseStamped)
        self._poses: Any = DataWriter(node, poses, _QOS)
        twists = Topic(node, f"rt/{prefix}/cmd_vel", Twist)
        self._twists: Any = DataReader(node, twists, _QOS)

    def step(self, now_s: float, dt_s: float) -> None:
        """Hear, move and tell."""
        for twist in self._twists.take(100):
            if twist.sample_info.valid_data:
                self._wanted, self._told_s = (twist.linear.x, twist.angular.z), now_s
        speed, rate = self._wanted if now_s - self._told_s <= _DEAD_MAN_S else (0.0, 0.0)
        self.speed = _towards(self.speed, speed, _ACCELERATION * dt_s)
        self.rate = _towards(self.rate, rate, _TURN * dt_s)
        self.heading += self.rate * dt_s
        self.x += self.speed * math.cos(self.heading) * dt_s
        self.y += self.speed * math.sin(self.heading) * dt_s
        now_ns = time.time_ns()
        header = Header(Time(now_ns // 10**9, now_ns % 10**9), "map")
        turned = Quaternion(z=math.sin(self.heading / 2), w=math.cos(self.heading / 2))
        self._poses.write(PoseStamped(header, Pose(Point(self.x, self.y), turned)))

    def report(self) -> str:
        """Where it is, as a line of JSON."""
        return json.dumps({"east": self.x, "north": self.y, "heading": self.heading})

    def seen(self, body: str) -> bytes:
        """Where cameras see it, as its ``body``."""
        place = [self.x, self.y, 0.0]
        return json.dumps({"body": body, "position": place, "heading": self.heading}).encode()


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    return host, int(port)


def _towards(now: float, wanted: float, most: float) -> float:
    return now + max(-most, min(most, wanted - now))


def main() -> None:
    """Serve one from the command line: ``python -m koord.testing.ros2.serving --prefix car0``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prefix", default="car0", help="of its topics")
    parser.add_argument("--domain", type=int, default=0)
    parser.add_argument(
        "--start", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "RAD")
    )
    parser.add_argument("--report", action="store_true", help="tell where it is, as JSON")
    parser.add_argument(
        "--truth",
        type=_address,
        metavar="HOST:PORT",
        help="a fake NatNet server (--told), which sees where it is",
    )
    parser.add_argument("--body", help="its name there; else that of its topics")
    told = parser.parse_args()
    truth = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    car, steps, due_s = Car(told.prefix, told.domain, tuple(told.start)), 0, time.monotonic()
    while True:
        car.step(time.monotonic(), _PERIOD_S)
        steps += 1
        if told.report and steps % _REPORT == 0:
            sys.stdout.write(car.report() + "\n")
            sys.stdout.flush()
        if told.truth is not None:
            truth.sendto(car.seen(told.body or told.prefix), told.truth)
        due_s = max(due_s + _PERIOD_S, time.monotonic() - _PERIOD_S)
        time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main()
