"""Planners by their names in configurations. OMPL is loaded where it is needed."""

from __future__ import annotations

from koord.runtime.motion.bodies import Body, PlannerName
from koord.runtime.motion.planning import CLOSE, Ground, Planner, PlanningEffort, Room, Straight
from koord.runtime.motion.world import World
from koord.runtime.plugins.calls import PlugIn


def planner(
    name: PlannerName | PlugIn,
    world: World,
    body: Body,
    effort: PlanningEffort = PlanningEffort(),
    avoid_m: float = 0.25,
    room: Room = CLOSE,
    *,
    is_quick: bool = False,
) -> Planner:
    """The planner of a name. Raises KoordError if it needs a library that is not installed.

    ``avoid_m`` is the radius of what stands at a point to avoid, ``room`` what ways keep from walls
    and obstacles besides what the body needs. Who ``is_quick`` finds by machine code what can be
    found by it: the same ways.
    """
    ground = Ground(world, body, avoid_m, room)
    if isinstance(name, PlugIn):
        from koord.runtime.plugins.loading import own_planner

        return own_planner(name, ground)
    if name is PlannerName.STRAIGHT:
        return Straight(ground)
    from koord.runtime.motion.rrt import CurvePlanner, SpacePlanner

    if body.turning_m > 0:
        forwards = name is PlannerName.RRT_DUB_CAR
        return CurvePlanner(ground, effort, name.optimal, forwards, is_quick and not forwards)
    return SpacePlanner(ground, effort, name.optimal)
