"""Planners by the names that configurations have for them, published ones too."""

from __future__ import annotations

from difflib import get_close_matches

from koord.runtime.motion.bodies import VEHICLES, PlannerName

#: Planners by the names that the published middleware has for them too.
_PLANNERS = {
    "SimplePlanner": PlannerName.STRAIGHT.value,
    "Reeds_Shepp": PlannerName.RRT_CAR.value,  # trees of the curves of Reeds and Shepp
}

#: Published names of planners that each type of vehicle has one of its own of.
_GENERAL = ("RRT", "RRT_STAR")


def planner_named(name: str, type_name: str) -> PlannerName | tuple[str, str]:
    """The planner of a name for a vehicle, or a message with the cure."""
    suitable = [one.value for one in VEHICLES[type_name].planners]
    name = _PLANNERS.get(name, name)
    if name in _GENERAL:
        name = next(one for one in suitable if one.startswith(f"{name}_"))
    known = ", ".join(suitable)
    if name not in [one.value for one in PlannerName]:
        near = get_close_matches(name, suitable, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {known}"
        return f"there is no planner {name}", hint
    if name not in suitable:
        return f"{name} is no planner for a {type_name}", f"there are {known}"
    return PlannerName(name)
