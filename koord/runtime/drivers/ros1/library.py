"""rospy as it is installed: in Python's path, as a terminal with ROS has it, or by a distribution.

Debian and ROS put it where the Python of the system looks, among whatever else is installed there;
other environments, such as koord's, do not look there. From there its own modules alone are taken:
nothing else that is in that folder (numpy, yaml, …) stands in for what koord was installed with.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.ros.options import PACKAGES

#: Where ROS and Debian put it; and the variable that names another folder.
FOLDERS = ("/opt/ros/noetic/lib/python3/dist-packages", "/usr/lib/python3/dist-packages")
ELSEWHERE = "KOORD_ROS1"

#: What rospy consists of, and what it needs that is made for ROS.
_OWN = (
    "actionlib_msgs",
    "catkin",
    "catkin_pkg",
    "genmsg",
    "genpy",
    "roscpp",
    "rosgraph",
    "rosgraph_msgs",
    "roslib",
    "rospkg",
    "rospy",
)

#: The modules that are taken from there.
MODULES = frozenset({*_OWN, *PACKAGES.values()})

INSTALL = "apt-get install python3-rospy python3-geometry-msgs python3-nav-msgs python3-sensor-msgs"

#: Messages that distributions may lack, as their packages define them.
_DEFINED = {
    "AckermannDriveStamped": (
        "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n",
        "MSG: ackermann_msgs/AckermannDrive\nfloat32 steering_angle\n"
        "float32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\nfloat32 jerk\n",
        "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n",
    )
}


class _Finder:
    """Finds modules of ROS 1 in one folder, and nothing else."""

    def __init__(self, folder: str) -> None:
        self.folder = folder

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if path is not None or name not in MODULES:
            return None
        return PathFinder.find_spec(name, [self.folder])


def folder() -> str | None:
    """The folder that has rospy, if Python does not find it by itself."""
    elsewhere = os.environ.get(ELSEWHERE)
    for one in FOLDERS if elsewhere is None else (elsewhere,):
        if Path(one, "rospy", "__init__.py").exists():
            return one
    return None


def is_installed() -> bool:
    """True if it is there; nothing is imported."""
    return find_spec("rospy") is not None or folder() is not None


@cache
def rospy() -> Any:
    """The library. Raises DriverError if it is not there, or cannot be in this process."""
    if "rclpy" in sys.modules:
        raise DriverError(
            "this process speaks ROS 2 by rclpy, whose messages have the names of those of ROS 1",
            "drive vehicles of ROS 1 by a process of their own",
        )
    if find_spec("rospy") is None and (found := folder()) is not None:
        sys.meta_path.insert(0, _Finder(found))
    try:
        library = import_module("rospy")
        if not hasattr(import_module("std_msgs.msg").Header, "_md5sum"):
            raise DriverError(
                "messages of ROS 2 stand before those of ROS 1 in Python's path",
                "start koord where ROS 1 alone is set up",
            )
    except ImportError as error:
        raise DriverError(f"rospy cannot be loaded: {error}", INSTALL) from None
    return library


def message_type(type_name: str) -> Any:
    """The class of a message. Raises DriverError if its package is not installed."""
    rospy()
    package = PACKAGES[type_name]
    try:
        return getattr(import_module(f"{package}.msg"), type_name)
    except ImportError as error:
        if type_name not in _DEFINED:
            name = package.replace("_", "-")
            raise DriverError(
                f"messages of {package} cannot be loaded: {error}",
                f"apt-get install python3-{name}, or ros-noetic-{name}",
            ) from None
    return _defined(type_name)


@cache
def _defined(type_name: str) -> Any:
    """A message from its definition."""
    dynamic = import_module("genpy.dynamic")
    full, parts = f"{PACKAGES[type_name]}/{type_name}", _DEFINED[type_name]
    return dynamic.generate_dynamic(full, ("=" * 80 + "\n").join(parts))[full]
