"""A vehicle as a node of rospy, in a Python that has it: `rospy_node.py KIND NAME POSE PREFIX`.

KIND is `car` (it hears Twist), `follower` (it hears places, and says when it is there) or `echo`
(it sends each place back at once). POSE is the topic of its poses. It ends with its input.
"""

from __future__ import annotations

import math
import sys
import threading
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[4]))

import rospy
from geometry_msgs.msg import PoseStamped, Twist
from std_msgs.msg import String

from tests.runtime.platform.ros.ros_bodies import PERIOD_S, Body, Driven, Follower


def tell(poses: rospy.Publisher, body: Body) -> None:
    pose = PoseStamped()
    pose.header.frame_id, pose.header.stamp = "map", rospy.Time.now()
    pose.pose.position.x, pose.pose.position.y = body.x, body.y
    pose.pose.position.z = body.z
    pose.pose.orientation.z = math.sin(body.heading / 2)
    pose.pose.orientation.w = math.cos(body.heading / 2)
    poses.publish(pose)


def main(kind: str, name: str, pose: str, prefix: str) -> None:
    """Move until standard input ends."""
    rospy.init_node(name, disable_signals=True)
    body = {"car": Driven, "follower": Follower, "echo": Body}[kind]()
    poses = rospy.Publisher(pose, PoseStamped, queue_size=1, tcp_nodelay=True)
    reached = rospy.Publisher(f"{prefix}/reached", String, queue_size=1)
    echo = rospy.Publisher(f"{prefix}/echo", PoseStamped, queue_size=10, tcp_nodelay=True)
    if isinstance(body, Driven):
        rospy.Subscriber(
            f"{prefix}/cmd_vel",
            Twist,
            lambda twist: body.drive(twist.linear.x, twist.angular.z),
            tcp_nodelay=True,
        )
    elif isinstance(body, Follower):
        rospy.Subscriber(
            f"{prefix}/waypoint",
            PoseStamped,
            lambda to: body.go(to.pose.position.x, to.pose.position.y, to.pose.position.z),
        )
    else:
        rospy.Subscriber(f"{prefix}/waypoint", PoseStamped, echo.publish, tcp_nodelay=True)

    def run() -> None:
        rate = rospy.Rate(1 / PERIOD_S)
        while not rospy.is_shutdown():
            if isinstance(body, Follower):
                if body.step(PERIOD_S):
                    reached.publish("TRUE")
            else:
                body.move(PERIOD_S)
            tell(poses, body)
            rate.sleep()

    threading.Thread(target=run, daemon=True).start()
    sys.stdin.read()
    rospy.signal_shutdown("it ends")


main(*sys.argv[1:])
