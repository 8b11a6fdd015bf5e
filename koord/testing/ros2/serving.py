"""A differential drive as a node of ROS 2, in real time, by cyclonedds.

It hears Twist on ``PREFIX/cmd_vel``, stops when it has heard none for half a second, and tells
PoseStamped on ``PREFIX/pose``.
"""

from __future__ import annotations

import math
import time
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from koord.testing.cars import Car, arguments, serve
from koord.testing.ros2.messages import Header, Point, Pose, PoseStamped, Quaternion, Time, Twist

#: As nodes of ROS are unless they are told otherwise.
_QOS = Qos(Policy.Reliability.Reliable(0), Policy.Durability.Volatile, Policy.History.KeepLast(10))


class Node:
    """The node."""

    def __init__(self, car: Car, prefix: str, domain: int) -> None:
        self.car = car
        node = DomainParticipant(domain)
        poses = Topic(node, f"rt/{prefix}/pose", PoseStamped)
        self._poses: Any = DataWriter(node, poses, _QOS)
        twists = Topic(node, f"rt/{prefix}/cmd_vel", Twist)
        self._twists: Any = DataReader(node, twists, _QOS)

    def hear(self, now_s: float) -> None:
        """Take the commands that have come."""
        for twist in self._twists.take(100):
            if twist.sample_info.valid_data:
                self.car.hear(twist.linear.x, twist.angular.z, now_s)

    def tell(self) -> None:
        """Publish where the car is."""
        car, now_ns = self.car, time.time_ns()
        header = Header(Time(now_ns // 10**9, now_ns % 10**9), "map")
        turned = Quaternion(z=math.sin(car.heading / 2), w=math.cos(car.heading / 2))
        self._poses.write(PoseStamped(header, Pose(Point(car.x, car.y), turned)))


def main() -> None:
    """Serve one from the command line: ``python -m koord.testing.ros2.serving --prefix car0``."""
    parser = arguments(__doc__)
    parser.add_argument("--domain", type=int, default=0)
    given = parser.parse_args()
    node = Node(Car(tuple(given.start)), given.prefix, given.domain)
    serve(node.car, node.hear, node.tell, given)


if __name__ == "__main__":
    main()
