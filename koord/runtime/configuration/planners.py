"""Which planners there are for which vehicle, and what is wrong with the name of one."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches

from koord.runtime.configuration.forms import BotType
from koord.runtime.motion.names import PlannerName

#: The planners that find paths for a vehicle, the one to begin with first.
SUITABLE: Mapping[BotType, tuple[PlannerName, ...]] = {
    BotType.CAR: (PlannerName.RRT_CAR, PlannerName.RRT_STAR_CAR, PlannerName.STRAIGHT),
    BotType.QUAD: (PlannerName.RRT_DRONE, PlannerName.RRT_STAR_DRONE, PlannerName.STRAIGHT),
    BotType.IDEAL: (PlannerName.STRAIGHT, PlannerName.RRT_DRONE, PlannerName.RRT_STAR_DRONE),
}


def named(name: str, type_: BotType) -> PlannerName | tuple[str, str]:
    """The planner of that name for a vehicle, or what is wrong with it and the cure."""
    known = ", ".join(one.value for one in SUITABLE[type_])
    if name not in [one.value for one in PlannerName]:
        near = get_close_matches(name, [one.value for one in SUITABLE[type_]], n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {known}"
        return f"there is no planner {name}", hint
    found = PlannerName(name)
    if found not in SUITABLE[type_]:
        return f"{name} is no planner for a {type_.value}", f"there are {known}"
    return found
