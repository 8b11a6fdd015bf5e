"""Topics that a device states as the published middleware has them, and who drives it then."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import msgspec

from koord.runtime.configuration.forms import Device, Motion

#: Fields of a device in the published middleware that are options of drivers that speak ROS.
ROS_OPTIONS = (
    "positioning_topic",
    "queue_size",
    "reached_topic",
    "ros_node_prefix",
    "waypoint_topic",
)

#: The driver of a device that names topics and no driver, as the published middleware: which ROS
#: that is, the environment says. (P-ROS-PUBLISHED)
PUBLISHED = "ros"

#: The drivers that speak it.
ROS_DRIVERS = (PUBLISHED, "ros1", "ros2")


def driver_of(device: Device) -> str | None:
    """What drives a device."""
    if device.driver is None and "positioning_topic" in _stated(device):
        return PUBLISHED
    return device.driver


def names_topics(value: Mapping[Any, Any]) -> bool:
    """Return whether the value of a device in a file says where its vehicle is heard."""
    motion = value.get("motion")
    return any(isinstance(one, dict) and "positioning_topic" in one for one in (value, motion))


def topics(name: str, device: Device, automaton: str | None) -> dict[str, Any]:
    """The options that a device states as the published middleware has them."""
    driver = driver_of(device)
    if driver not in ROS_DRIVERS:
        return {}
    options = {key: msgspec.to_builtins(value) for key, value in _stated(device).items()}
    if automaton is not None:
        options["motion_automaton"] = automaton
    if driver == PUBLISHED:
        prefix = options.get("ros_node_prefix", "")
        own = topic_word(name)
        if prefix.strip("/").partition("/")[0] not in (name, own):  # as its launcher writes it
            options["ros_node_prefix"] = f"{own}/{prefix}"
    return options


def topic_word(name: str) -> str:
    """The name of a device as ROS can have it in the name of a topic: `my-car` is `my_car`.

    Nodes that publish poses of what has another name do the same.
    """
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{word}" if word[0].isdigit() else word


def _stated(device: Device) -> dict[str, Any]:
    """What a device states of topics; fields under ``motion`` count as its own."""
    return {**_given(device.motion or Motion()), **_given(device)}


def _given(form: Motion) -> dict[str, Any]:
    values = {name: getattr(form, name) for name in ROS_OPTIONS}
    return {name: value for name, value in values.items() if value is not None}
