"""Plug-ins that devices of a configuration name: planner, controller, and modules of programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
from msgspec import Struct

from koord.runtime.configuration.forms import Device, Served
from koord.runtime.motion.bodies import VEHICLES, PlannerName
from koord.runtime.plugins.calls import PlugIn

#: The fields of a device, with what is wrong there and a cure.
Flaws = list[tuple[tuple[str, ...], str, str]]


class Plugged(Struct, frozen=True):
    """The plug-ins of a device, and what is wrong with them."""

    planner: PlugIn | None
    controller: PlugIn | None
    modules: tuple[tuple[str, PlugIn], ...]
    flaws: Flaws


def plugged(device: Device, planner: str | None) -> Plugged:
    """The plug-ins of a device that names this planner."""
    flaws: Flaws = []
    own_planner = _planner(planner, device.planner_options)
    if own_planner is None and device.planner_options:
        flaws.append((("planner_options",), "these are options of no plug-in", _HINT))
    controller = _plug_in(device.controller, device.controller_options)
    if controller is None and device.controller_options:
        flaws.append((("controller_options",), "these are options of no plug-in", _HINT))
    modules = tuple((module, _served(given)) for module, given in sorted(device.modules.items()))
    flaws += _flaws(device, own_planner, controller, modules)
    return Plugged(own_planner, controller, modules, flaws)


_HINT = "name a plug-in; `koord drivers` lists them"


def _planner(name: str | None, options: Mapping[str, Any]) -> PlugIn | None:
    """The planner of a name that is none of koord's, if there is such a plug-in."""
    if name is None or name in [one.value for one in PlannerName]:
        return None
    from koord.runtime.drivers.registry import PLANNERS
    from koord.runtime.plugins.names import plug_ins

    is_known = ":" in name or name in plug_ins(PLANNERS).names
    return _plug_in(name, options) if is_known else None


def _plug_in(name: str | None, options: Mapping[str, Any]) -> PlugIn | None:
    return None if name is None else PlugIn(name, msgspec.json.encode(options))


def _served(given: str | Served) -> PlugIn:
    if isinstance(given, str):
        return PlugIn(given)
    return PlugIn(given.plug_in, msgspec.json.encode(given.options))


def _flaws(
    device: Device,
    planner: PlugIn | None,
    controller: PlugIn | None,
    modules: tuple[tuple[str, PlugIn], ...],
) -> Iterator[tuple[tuple[str, ...], str, str]]:
    """Yield what is wrong with plug-ins that are named."""
    if planner is None and controller is None and not modules:
        return
    from koord.runtime.drivers.registry import CONTROLLERS, MODULES, PLANNERS
    from koord.runtime.plugins.names import flaw, is_of_fleets

    if planner is not None and (wrong := flaw(PLANNERS, planner)):
        yield ("planner",), *wrong
    if controller is not None:
        if not VEHICLES[device.bot_type].body.ON_GROUND:
            story = f"a {device.bot_type} is steered by its own autopilot"
            yield ("controller",), story, "controllers are for what drives: CAR, DIFF"
        elif wrong := flaw(CONTROLLERS, controller):
            yield ("controller",), *wrong
        elif is_of_fleets(controller) and device.bot_type != "DIFF":
            story = f"the controller {controller.value} is for robots that turn on the spot"
            yield ("controller",), story, "they have the bot_type DIFF"
    for module, plug_in in modules:
        if wrong := flaw(MODULES, plug_in):
            yield ("modules", module), *wrong
