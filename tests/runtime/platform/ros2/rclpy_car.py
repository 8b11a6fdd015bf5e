"""A differential drive as a node of rclpy, in a Python that has it: `rclpy_car.py PREFIX`.

It moves by Twist, tells PoseStamped fifty times a second, and answers each way-point at once with
the same pose, so that round trips can be measured. It ends with its standard input.
"""

from __future__ import annotations

import math
import sys
import threading

import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from rclpy.node import Node

_PERIOD_S = 0.02


class Car(Node):  # type: ignore[misc]
    """The node."""

    def __init__(self, prefix: str) -> None:
        super().__init__("car", namespace=prefix)
        self.x = self.y = self.heading = self.speed = self.rate = 0.0
        self.poses = self.create_publisher(PoseStamped, "pose", 10)
        self.echo = self.create_publisher(PoseStamped, "echo", 10)
        self.create_subscription(Twist, "cmd_vel", self.hear, 10)
        self.create_subscription(PoseStamped, "waypoint", self.echo.publish, 10)
        self.create_timer(_PERIOD_S, self.move)

    def hear(self, twist: Twist) -> None:
        self.speed, self.rate = twist.linear.x, twist.angular.z

    def move(self) -> None:
        self.heading += self.rate * _PERIOD_S
        self.x += self.speed * math.cos(self.heading) * _PERIOD_S
        self.y += self.speed * math.sin(self.heading) * _PERIOD_S
        pose = PoseStamped()
        pose.header.frame_id = "map"
        pose.header.stamp = self.get_clock().now().to_msg()
        pose.pose.position.x, pose.pose.position.y = self.x, self.y
        pose.pose.orientation.z = math.sin(self.heading / 2)
        pose.pose.orientation.w = math.cos(self.heading / 2)
        self.poses.publish(pose)


def main(prefix: str) -> None:
    """Spin until standard input ends."""
    rclpy.init(args=[])
    node = Car(prefix)
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    sys.stdin.read()


main(sys.argv[1])
