"""A differential drive as a node of ROS 1, in real time, by rospy, with a master of its own.

It hears Twist on ``/PREFIX/cmd_vel``, stops when it has heard none for half a second, and tells
PoseStamped on ``/PREFIX/pose``.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

sys.path.append("/usr/lib/python3/dist-packages")  # where Debian has it, after all else

import rospy
from geometry_msgs.msg import PoseStamped, Twist

from koord.testing.cars import Car, arguments, serve


class Node:
    """The node; rospy's threads hear."""

    def __init__(self, car: Car, prefix: str) -> None:
        self.car = car
        rospy.init_node(prefix, argv=[], disable_signals=True)
        self._poses = rospy.Publisher(f"/{prefix}/pose", PoseStamped, queue_size=1)
        rospy.Subscriber(f"/{prefix}/cmd_vel", Twist, self._hear)

    def _hear(self, twist: Any) -> None:
        self.car.hear(twist.linear.x, twist.angular.z, time.monotonic())

    def tell(self) -> None:
        """Publish where the car is."""
        car, pose = self.car, PoseStamped()
        pose.header.stamp, pose.header.frame_id = rospy.Time.now(), "map"
        pose.pose.position.x, pose.pose.position.y = car.x, car.y
        pose.pose.orientation.z = math.sin(car.heading / 2)
        pose.pose.orientation.w = math.cos(car.heading / 2)
        self._poses.publish(pose)


@contextmanager
def master(port: int) -> Iterator[None]:
    """A master of this process alone."""
    os.environ |= {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    with subprocess.Popen(
        ["rosmaster", "--core", "-p", str(port)], stdout=subprocess.DEVNULL
    ) as process:
        try:
            yield
        finally:
            process.kill()


def main() -> None:
    """Serve one from the command line: ``python -m koord.testing.ros1.serving --prefix car0``."""
    parser = arguments(__doc__)
    parser.add_argument("--master", type=int, default=11311, metavar="PORT", help="of its master")
    given = parser.parse_args()
    with master(given.master):
        node = Node(Car(tuple(given.start)), given.prefix)
        serve(node.car, lambda _: None, node.tell, given)


if __name__ == "__main__":
    main()
