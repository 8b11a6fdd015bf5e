"""The limits of the guardian as data: what is still safe, for a vehicle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import Enum

from msgspec import Struct

from koord.runtime.motion.bodies import Body
from koord.runtime.motion.world import World


class EstopAction(Enum):
    """What an e-stop does with a vehicle that is on its way."""

    LAND = "land"  #: it comes down, or to a stop, and is disarmed then
    DISARM = "disarm"  #: it is disarmed at once; what is in the air falls


class DeadMan(Enum):
    """What stops a vehicle whose robot is killed, where that is said. (P-WATCHDOG)"""

    WATCHDOG = "watchdog"  #: a watchdog, whatever the vehicle does
    NONE = "none"  #: nothing, on purpose


class SafetyLimits(Struct, frozen=True, kw_only=True):
    """The limits for a robot. The defaults are those of a small indoor car."""

    flies: bool = False  #: it lands; else it stops
    hold_s: float = 10.0  #: T: who holds for as long lands or stops
    resume_s: float = 1.0  #: how long all has to have been well before it moves (again)
    rounds: float = 5.0  #: k: holds without a committed round for k·δ
    pose_age_s: float = 0.5  #: older poses do not count
    jump_m: float = 0.3  #: further than this from where it can have got to, a pose is wrong
    margin_m: float = 0.2  #: its position keeps as far from walls and obstacles
    speed_mps: float = 1.2  #: the fastest that motion may wish for
    reaction_s: float = 0.2  #: from a set-point until the vehicle obeys
    braking_mps2: float = 1.5  #: how hard it brakes at least
    separation_m: float = 0.6  #: between positions of robots: d_s of the paper (II-A)
    separation_more_m: float = 0.1  #: so much more before it goes on
    battery_low: float = 0.15  #: holds below
    battery_critical: float = 0.05  #: lands or stops below
    battery_more: float = 0.05  #: so much more before it goes on
    heartbeat_s: float | None = None  #: greatest age of the e-stop's heartbeat; None: it has none
    estop: EstopAction = EstopAction.DISARM
    watchdog_s: float = 0.5  #: a robot that is silent for longer is stopped by its watchdog
    dead_man: DeadMan | None = None  #: None: the vehicle itself, or else a watchdog
    start_m: float = 0.5  #: it is armed no further from where its configuration has it
    still_mps: float = 0.05  #: slower than this it stands
    landed_m: float = 0.15  #: not higher above the ground it has landed


def usual(body: Body) -> SafetyLimits:
    """The limits of a vehicle about which a configuration says nothing."""
    # Motion corrects what is off its path: it may be faster than it cruises.
    speed_mps = 1.5 * body.pace.cruise_mps
    margin_m = body.inner_radius_m + 0.05
    if body.ON_GROUND:
        return SafetyLimits(speed_mps=speed_mps, margin_m=margin_m)
    return SafetyLimits(
        flies=True,
        speed_mps=speed_mps,
        margin_m=margin_m,
        pose_age_s=0.3,
        reaction_s=0.3,
        braking_mps2=2.0,
        battery_low=0.25,
        battery_critical=0.15,
        estop=EstopAction.LAND,
    )


#: May be 0: what is added to another limit, or is a tolerance.
_MAY_BE_ZERO = frozenset({"jump_m", "separation_more_m", "battery_more"})


def flaws(limits: SafetyLimits) -> Iterator[tuple[str, str]]:
    """Yield the names of limits that make no sense, each with what is wrong with it."""
    for name in limits.__struct_fields__:
        value = getattr(limits, name)
        if isinstance(value, float | int) and not isinstance(value, bool):
            if not math.isfinite(value) or value < 0:
                yield name, f"{value:g} is no limit"
            elif value == 0 and name not in _MAY_BE_ZERO:
                yield name, "this has to be more than 0"
    if limits.rounds < 1:
        yield "rounds", "no round is committed in less than the time of a round"
    if limits.resume_s >= limits.hold_s:
        yield "resume_s", f"who holds would land (`hold`: {limits.hold_s:g}) before it could go on"
    if not limits.battery_critical < limits.battery_low <= 1:
        yield "battery_low", f"has to be above `battery_critical` ({limits.battery_critical:g})"
    elif limits.battery_low + limits.battery_more > 1:
        yield "battery_more", "no battery is ever so full that it would go on"


def margin_flaw(margin_m: float, world: World, *, flies: bool) -> str | None:
    """Return what is wrong with a margin in a world: that nothing is left of it."""
    sides = [world.high[0] - world.low[0], world.high[1] - world.low[1]]
    least = min(sides) / 2
    if flies:
        least = min(least, world.high[2] - world.low[2])
    if margin_m < least:
        return None
    return f"a margin of {margin_m:g} m leaves nothing of a world where {least:g} m is most"
