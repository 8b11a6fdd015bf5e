"""Plug-ins, made for the robots that use them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar, cast

from msgspec import Struct

from koord.runtime.drivers.registry import CONTROLLERS, MODULES, PLANNERS
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.group import Group
from koord.runtime.motion.planning import Ground
from koord.runtime.motion.world import World
from koord.runtime.plugins.calls import PlugIn, PlugInError
from koord.runtime.plugins.control import (
    ControllerSite,
    FleetControllerType,
    FleetLaw,
    OwnControllerType,
    OwnDriving,
)
from koord.runtime.plugins.modules import ModuleSite, ServedModules
from koord.runtime.plugins.names import leads_fleets, loaded
from koord.runtime.plugins.planning import CheckedPlanner, PlannerSite

Built = TypeVar("Built")


def own_planner(plug_in: PlugIn, ground: Ground) -> CheckedPlanner:
    """The planner of a name. Raises PlugInError."""
    made, options = loaded(PLANNERS, plug_in)
    site = PlannerSite(ground.world, ground.body, options)
    own = _built(f"the planner {plug_in.value}", partial(made, site))
    return CheckedPlanner(plug_in.value, own, ground)


def own_driving(plug_in: PlugIn, group: Group) -> OwnDriving:
    """The motion law of vehicles with controllers of a name. Raises PlugInError."""
    made, options = loaded(CONTROLLERS, plug_in)
    if leads_fleets(made):
        what, story = f"the controller {plug_in.value}", "has to know where all robots are"
        raise PlugInError(what, story, "it is for `koord sim`, where one law leads them all")
    return _each_by_itself(plug_in, made, options, group)


def fleet_driving(plug_in: PlugIn, group: Group) -> OwnDriving | FleetLaw:
    """The same of vehicles that one law may lead together. Raises PlugInError."""
    made, options = loaded(CONTROLLERS, plug_in)
    if leads_fleets(made):
        return cast(FleetControllerType, made)(group, options)
    return _each_by_itself(plug_in, made, options, group)


def _each_by_itself(
    plug_in: PlugIn, made: OwnControllerType, options: Struct, group: Group
) -> OwnDriving:
    site = ControllerSite(group.body, options)
    what = f"the controller {plug_in.value}"
    controllers = [_built(what, partial(made, site)) for _ in range(group.count)]
    return OwnDriving(plug_in.value, controllers, group)


def served_modules(
    named: Iterable[tuple[str, PlugIn]],
    pid: int,
    world: World,
    body: Body,
    seed: int,
    *,
    is_simulated: bool,
) -> ServedModules:
    """The modules of a robot that plug-ins serve. Raises PlugInError."""
    served = {}
    for module, plug_in in named:
        made, options = loaded(MODULES, plug_in)
        site = ModuleSite(pid, world, body, seed, is_simulated, options)
        own = _built(f"the module {plug_in.value}", partial(made, site))
        served[module] = plug_in.value, made, own
    return ServedModules(served)


def _built(what: str, make: Callable[[], Built]) -> Built:
    try:
        return make()
    except Exception as error:
        story = f"cannot be made: {type(error).__name__}: {error}"
        raise PlugInError(what, story, "it is called with its site alone") from error
