"""A vehicle as a node of rclpy, in a Python that has it: `rclpy_node.py KIND NAME POSE PREFIX`.

KIND is `car` (it hears Twist), `follower` (it hears places, and says when it is there) or `echo`
(it sends each place back at once). POSE is the topic of its poses. It ends with its input.
"""

from __future__ import annotations

import math
import sys
import threading
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[4]))

import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from rclpy.node import Node
from std_msgs.msg import String

from tests.runtime.platform.ros.ros_bodies import PERIOD_S, Body, Driven, Follower


class Vehicle(Node):  # type: ignore[misc]
    """The node."""

    def __init__(self, kind: str, name: str, pose: str) -> None:
        super().__init__(name)
        self.body: Body = {"car": Driven, "follower": Follower, "echo": Body}[kind]()
        self.poses = self.create_publisher(PoseStamped, pose, 10)
        self.create_timer(PERIOD_S, self.move)

    def join(self, prefix: str) -> None:
        """Hear what it is told."""
        body = self.body
        self.reached = self.create_publisher(String, f"{prefix}/reached", 10)
        echo = self.create_publisher(PoseStamped, f"{prefix}/echo", 10)
        if isinstance(body, Driven):
            hear = lambda twist: body.drive(twist.linear.x, twist.angular.z)  # noqa: E731
            self.create_subscription(Twist, f"{prefix}/cmd_vel", hear, 10)
        elif isinstance(body, Follower):
            self.create_subscription(PoseStamped, f"{prefix}/waypoint", self.follow, 10)
        else:
            self.create_subscription(PoseStamped, f"{prefix}/waypoint", echo.publish, 10)

    def follow(self, to: PoseStamped) -> None:
        assert isinstance(self.body, Follower)
        self.body.go(to.pose.position.x, to.pose.position.y, to.pose.position.z)

    def move(self) -> None:
        body = self.body
        if isinstance(body, Follower):
            if body.step(PERIOD_S):
                self.reached.publish(String(data="TRUE"))
        else:
            body.move(PERIOD_S)
        pose = PoseStamped()
        pose.header.frame_id = "map"
        pose.header.stamp = self.get_clock().now().to_msg()
        pose.pose.position.x, pose.pose.position.y = body.x, body.y
        pose.pose.position.z = body.z
        pose.pose.orientation.z = math.sin(body.heading / 2)
        pose.pose.orientation.w = math.cos(body.heading / 2)
        self.poses.publish(pose)


def main(kind: str, name: str, pose: str, prefix: str) -> None:
    """Spin until standard input ends."""
    rclpy.init(args=[])
    node = Vehicle(kind, name, pose)
    node.join(prefix)
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    sys.stdin.read()


main(*sys.argv[1:])
