"""The drivers of vehicles that are installed."""

from __future__ import annotations

import json
from collections.abc import Iterable

from msgspec import to_builtins

from koord.runtime.drivers.registry import DriverEntry as DriverEntry
from koord.runtime.drivers.registry import Registry
from koord.version import __version__

#: koord's own drivers.
OWN = {
    "mavlink": "koord.runtime.drivers.mavlink.driver:MavlinkDriver",
    "ros2": "koord.runtime.drivers.ros2.driver:Ros2Driver",
    "sim": "koord.sim.driver:SIMULATED",
}


def registry() -> Registry:
    """All drivers that are installed."""
    return Registry(OWN, __version__)


def installed_drivers() -> tuple[DriverEntry, ...]:
    """The drivers that configurations can name, and what those lack that cannot be loaded.

    >>> [driver.name for driver in koord.installed_drivers()]
    ['mavlink', 'ros2', 'sim']
    """
    return tuple(registry().entries())


def drivers_json(entries: Iterable[DriverEntry]) -> str:
    """The drivers as ``koord drivers --json`` prints them."""
    return json.dumps({"version": 1, "drivers": to_builtins(tuple(entries))}, indent=2)
