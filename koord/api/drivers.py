"""The drivers and localisers of vehicles that are installed."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping

from msgspec import to_builtins

from koord.runtime.drivers.driver import DriverType
from koord.runtime.drivers.localiser import LocaliserType
from koord.runtime.drivers.registry import (
    CONTROLLERS,
    DRIVERS,
    LOCALISERS,
    MODULES,
    PLANNERS,
    Registry,
)
from koord.runtime.drivers.registry import DriverEntry as DriverEntry
from koord.runtime.plugins.names import plug_ins
from koord.version import __version__

#: koord's own drivers.
OWN = {
    "crazyflie": "koord.runtime.drivers.crazyflie.driver:CrazyflieDriver",
    "ideal": "koord.sim.driver:IDEAL",
    "mavlink": "koord.runtime.drivers.mavlink.driver:MavlinkDriver",
    "robotarium": "koord.runtime.drivers.robotarium.driver:RobotariumDriver",
    "ros1": "koord.runtime.drivers.ros1.driver:Ros1Driver",
    "ros2": "koord.runtime.drivers.ros2.driver:Ros2Driver",
    "sim": "koord.sim.driver:SIMULATED",
}


#: koord's own localisers.
OWN_LOCALISERS = {
    "gps": "koord.runtime.drivers.localisers.gps:GpsLocaliser",
    "motioncapture": "koord.runtime.drivers.localisers.motioncapture:MotionCaptureLocaliser",
    "natnet": "koord.runtime.drivers.localisers.natnet:NatNetLocaliser",
    "topic": "koord.runtime.drivers.localisers.topic:TopicLocaliser",
}


def registry() -> Registry[DriverType]:
    """All drivers that are installed."""
    return Registry(DRIVERS, OWN, __version__)


def localiser_registry() -> Registry[LocaliserType]:
    """All localisers that are installed."""
    return Registry(LOCALISERS, OWN_LOCALISERS, __version__)


def installed_drivers() -> tuple[DriverEntry, ...]:
    """The drivers that configurations can name, and what those lack that cannot be loaded.

    >>> [driver.name for driver in koord.installed_drivers()]
    ['crazyflie', 'ideal', 'mavlink', 'robotarium', 'ros1', 'ros2', 'sim']
    """
    return tuple(registry().entries())


def installed_localisers() -> tuple[DriverEntry, ...]:
    """The localisers that configurations can name, and what those lack that cannot be loaded.

    >>> [localiser.name for localiser in koord.installed_localisers()]
    ['gps', 'motioncapture', 'natnet', 'topic']
    """
    return tuple(localiser_registry().entries())


def installed_plug_ins() -> Mapping[str, tuple[DriverEntry, ...]]:
    """The planners, controllers and modules that configurations can name, by kind.

    >>> sorted(koord.installed_plug_ins())
    ['controller', 'module', 'planner']
    """
    registries = (plug_ins(PLANNERS), plug_ins(CONTROLLERS), plug_ins(MODULES))
    return {one.group.noun: tuple(one.entries()) for one in registries}


def drivers_json(found: Mapping[str, Iterable[DriverEntry]]) -> str:
    """What is installed, by kind (``driver``), as ``koord drivers --json`` prints it."""
    told = {f"{noun}s": to_builtins(tuple(entries)) for noun, entries in found.items()}
    return json.dumps({"version": 1, **told}, indent=2)
