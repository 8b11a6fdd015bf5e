"""Limits of the guardian, as configurations state them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec import Struct
from msgspec.structs import asdict, replace

from koord.runtime.configuration.forms import SafetyForm
from koord.runtime.configuration.reading import Path
from koord.runtime.guardian.limits import SafetyLimits, flaws, margin_flaw, usual
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.world import World

#: What the fields of a form are called among the limits, where that is not the same.
LIMIT_NAMES: Mapping[str, str] = {
    "hold": "hold_s",
    "resume": "resume_s",
    "pose_age": "pose_age_s",
    "jump": "jump_m",
    "margin": "margin_m",
    "speed": "speed_mps",
    "reaction": "reaction_s",
    "braking": "braking_mps2",
    "separation": "separation_m",
    "separation_more": "separation_more_m",
    "heartbeat": "heartbeat_s",
    "start": "start_m",
    "watchdog": "watchdog_s",
    "still": "still_mps",
    "landed": "landed_m",
}
_FIELDS = {limit: name for name, limit in LIMIT_NAMES.items()}


#: Fields that have to fit to another one: it is told there where that one alone is stated.
_TOGETHER: Mapping[str, tuple[str, ...]] = {
    "resume": ("hold",),
    "battery_low": ("battery_critical",),
    "battery_more": ("battery_low",),
}


class StatedSafety(Struct, frozen=True):
    """The limits of a robot, and where each stands that a configuration states."""

    limits: SafetyLimits
    places: Mapping[str, Path]


def stated_safety(body: Body, *forms: tuple[SafetyForm | None, Path]) -> StatedSafety:
    """The limits of a vehicle, with what forms state; later ones count before earlier ones."""
    limits, places = usual(body), dict[str, Path]()
    for form, path in forms:
        if form is None:
            continue
        given = {name: value for name, value in asdict(form).items() if value is not None}
        limits = replace(
            limits, **{LIMIT_NAMES.get(name, name): value for name, value in given.items()}
        )
        places |= {name: (*path, name) for name in given}
    return StatedSafety(limits, places)


def safety_flaws(stated: StatedSafety, world: World | None) -> Iterator[tuple[Path, str]]:
    """Yield what is wrong with limits that are stated, and where."""
    for limit, story in flaws(stated.limits):
        name = _FIELDS.get(limit, limit)
        for one in (name, *_TOGETHER.get(name, ())):
            if one in stated.places:
                yield stated.places[one], f"`{name}`: {story}"
                break
    if world is not None and "margin" in stated.places:
        limits = stated.limits
        narrow = margin_flaw(limits.margin_m, world, flies=limits.flies)
        if narrow is not None:
            yield stated.places["margin"], narrow
