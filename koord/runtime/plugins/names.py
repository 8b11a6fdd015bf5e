"""Plug-ins as configurations name them: which there are, and what is wrong with a name.

No library is needed for this, as for reading configurations.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from msgspec import Struct

from koord.runtime.drivers.driver import DriverError
from koord.runtime.drivers.registry import (
    CONTROLLERS,
    MODULES,
    Group,
    Optioned,
    Registry,
    options_of,
)
from koord.runtime.plugins.calls import PlugIn, PlugInError
from koord.version import __version__

Made = TypeVar("Made", bound=Optioned)


def plug_ins(group: Group[Made]) -> Registry[Made]:
    """The plug-ins of a group that are installed, and koord's own."""
    return Registry(group, dict(group.own), __version__)


def flaw(group: Group[Made], plug_in: PlugIn) -> tuple[str, str] | None:
    """Return what is wrong with a plug-in that is named, and a cure."""
    try:
        options_of(plug_ins(group).load(plug_in.value), plug_in.options)
    except DriverError as error:
        return error.message, error.hint
    return None


def loaded(group: Group[Made], plug_in: PlugIn) -> tuple[Made, Struct]:
    """What makes the plug-ins of a name, and the options of this one. Raises PlugInError."""
    try:
        made = plug_ins(group).load(plug_in.value)
        return made, options_of(made, plug_in.options)
    except DriverError as error:
        what = f"the {group.noun} {plug_in.value}"
        raise PlugInError(what, f"cannot be used: {error.message}", error.hint) from None


def leads_fleets(made: object) -> bool:
    """Return whether what makes controllers makes one for all vehicles of a device together."""
    return bool(getattr(made, "OF_FLEETS", False))


def is_of_fleets(controller: PlugIn) -> bool:
    """The same of a controller by its name. Raises DriverError."""
    return leads_fleets(plug_ins(CONTROLLERS).load(controller.value))


def served_ports(named: Iterable[tuple[str, PlugIn]]) -> frozenset[tuple[str, str]]:
    """The modules and ports of programs that plug-ins serve. Raises PlugInError."""
    return frozenset(
        (module, port)
        for module, plug_in in named
        for made, _ in [loaded(MODULES, plug_in)]
        for port in (*made.SENSORS, *made.ACTUATORS)
    )
