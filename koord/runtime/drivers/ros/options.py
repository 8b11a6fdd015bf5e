"""The options of drivers that speak ROS: topics, their types, and what the vehicle is like.

Names of topics are resolved as in the published middleware: those that begin with a slash stand
as they are, others under ``ros_node_prefix``; a positioning topic that ends with a slash is the
node of a motion capture, which publishes ``<node>/<robot>/pose``. (P-ROS-NAMES)
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import Enum

from msgspec import Struct

from koord.runtime.configuration.forms import Natural, NotNegative, Positive, Topic
from koord.runtime.configuration.model import MotionAutomaton
from koord.runtime.configuration.topics import topic_word
from koord.runtime.drivers.driver import DriverError

#: Packages of the types that are known, by the types' names.
PACKAGES = {
    "AckermannDriveStamped": "ackermann_msgs",
    "BatteryState": "sensor_msgs",
    "Bool": "std_msgs",
    "Float64": "std_msgs",
    "Int32": "std_msgs",
    "LaserScan": "sensor_msgs",
    "NavSatFix": "sensor_msgs",
    "Odometry": "nav_msgs",
    "Point": "geometry_msgs",
    "PoseStamped": "geometry_msgs",
    "PoseWithCovarianceStamped": "geometry_msgs",
    "String": "std_msgs",
    "TransformStamped": "geometry_msgs",
    "Twist": "geometry_msgs",
    "TwistStamped": "geometry_msgs",
}


class Use(Enum):
    """What a topic is for; the value says it in messages."""

    POSITIONING = "positioning_topic"
    FIX = "topic"
    VELOCITY = "velocity_topic"
    COMMAND = "command_topic"
    WAYPOINT = "waypoint_topic"
    REACHED = "reached_topic"
    SENSOR = "sensors"
    ACTUATOR = "actuators"


#: The types that fit each use.
FITTING = {
    Use.POSITIONING: ("PoseStamped", "Odometry", "PoseWithCovarianceStamped", "TransformStamped"),
    Use.FIX: ("NavSatFix",),  #: of GPS
    Use.VELOCITY: ("TwistStamped", "Odometry"),
    Use.COMMAND: ("Twist", "TwistStamped", "AckermannDriveStamped", "PoseStamped"),
    # Published configurations say String of way-points. Their middleware did not read that, and
    # sent what positions are told in.
    Use.WAYPOINT: ("PoseStamped", "String"),
    Use.REACHED: ("String", "Bool"),
    Use.SENSOR: ("LaserScan", "BatteryState", "Float64", "Bool", "Int32", "String", "Point"),
    Use.ACTUATOR: ("Float64", "Bool", "Int32", "String", "Point"),
}


class SensorTopic(Topic, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A topic of a sensor, and where that sits on the vehicle: m forward, m left, rad."""

    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


class RosOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the drivers of ROS 1 and of ROS 2 have in common."""

    positioning_topic: Topic | None = None  #: without, a localiser says where the vehicle is
    velocity_topic: Topic | None = None  #: without: from odometry, or from differences of poses
    command_topic: Topic | None = None  #: without, and without way-points: `cmd_vel`
    waypoint_topic: Topic | None = None  #: the vehicle's own controller drives to these
    reached_topic: Topic | None = None  #: that controller says that it is there
    motion_automaton: MotionAutomaton | None = (
        None  #: of the published middleware (P-ROS-PUBLISHED)
    )
    ros_node_prefix: str = ""  #: of relative names of topics; `{pid}` is the robot's
    queue_size: Natural = 10  #: messages that are kept for who is slow; 0 is 1
    frame: str | None = None  #: `frame_id` that poses must have; without: that of the first
    sensors: Mapping[str, SensorTopic] = {}  #: by ports of the program
    actuators: Mapping[str, Topic] = {}  #: by ports of the program
    takeoff: Positive = 1.0  #: m above the ground, to which aircraft rise first
    wait: NotNegative = 5.0  #: s, for the first pose
    silent: Positive = 1.0  #: s without a pose after which the vehicle does not answer
    pose_age: Positive = 0.2  #: s, how old poses usually are at most
    smoothing: NotNegative = 0.1  #: s, of velocities from differences of poses
    #: s without commands after which the vehicle stops by itself (P-ROS-DEAD-MAN)
    dead_man: Positive | None = None


class Wire(Struct, frozen=True):
    """A topic as it is called in the network."""

    name: str  #: without the leading slash
    type_name: str  #: as in :data:`PACKAGES`

    @property
    def told(self) -> str:
        """Its name as ROS shows it."""
        return f"/{self.name}"


class Names(Struct, frozen=True):
    """What names of topics of one robot begin with."""

    prefix: str
    robot: str
    pid: int

    def wire(self, use: Use, topic: Topic) -> Wire:
        """The topic in the network. Raises DriverError for names and types that do not do."""
        path = topic.topic
        if use is Use.POSITIONING and path.endswith("/"):
            word = topic_word(self.robot)
            path = f"/{path}{word}/pose"  # of a node for all robots, not of this robot's
        elif not path.startswith("/"):
            path = f"{self.prefix}/{path}"
        name = re.sub("/+", "/", path.replace("{pid}", str(self.pid))).strip("/")
        if re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name, re.ASCII) is None:
            raise DriverError(
                f"`/{name}` ({use.value}) is no name of a topic",
                "parts of names are letters, digits and `_`, and do not begin with a digit",
            )
        return Wire(name, _fitting(use, topic))


def told_type(type_name: str) -> str:
    """A type as configurations name it."""
    return f"{PACKAGES[type_name]}/{type_name}"


def _fitting(use: Use, topic: Topic) -> str:
    """The plain name of a topic's type. Raises DriverError for one that does not fit."""
    package, _, name = topic.type.rpartition("/")
    fits = name in FITTING[use] and package in ("", PACKAGES[name], f"{PACKAGES[name]}/msg")
    if not fits:
        known = "does not fit" if name in PACKAGES else "is not known"
        raise DriverError(
            f"the type `{topic.type}` of `{topic.topic}` ({use.value}) {known}",
            f"there are {', '.join(map(told_type, FITTING[use]))}",
        )
    return "PoseStamped" if use is Use.WAYPOINT else name
