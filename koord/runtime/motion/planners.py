"""The planners by the names that configurations give them. OMPL is loaded where it is needed."""

from __future__ import annotations

from typing import assert_never

from koord.runtime.motion.bodies import Body, Car
from koord.runtime.motion.names import PlannerName
from koord.runtime.motion.planning import Effort, Ground, Planner, Straight
from koord.runtime.motion.world import World


def planner(
    name: PlannerName,
    world: World,
    body: Body,
    effort: Effort = Effort(),
    avoid_m: float = 0.25,
) -> Planner:
    """The planner of that name. Raises KoordError if it needs a library that is not installed.

    ``avoid_m`` is the radius of what stands at a point to avoid.
    """
    match name:
        case PlannerName.STRAIGHT:
            return Straight(Ground(world, body, avoid_m))
        case PlannerName.RRT_CAR | PlannerName.RRT_STAR_CAR:
            from koord.runtime.motion.rrt import CurvePlanner

            car = body if isinstance(body, Car) else Car()
            return CurvePlanner(Ground(world, car, avoid_m), car, effort, name.optimal)
        case PlannerName.RRT_DRONE | PlannerName.RRT_STAR_DRONE:
            from koord.runtime.motion.rrt import SpacePlanner

            return SpacePlanner(Ground(world, body, avoid_m), effort, name.optimal)
        case _:
            assert_never(name)
