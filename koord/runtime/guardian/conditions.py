"""The conditions under which a robot may not move, each with what people are told of it.

Each comparison is written so that what is missing, or is no number, is a condition. (G-NUMBER)
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import assert_never

import numpy as np
from msgspec import Struct

from koord.runtime.drivers.frames import yaw_of
from koord.runtime.drivers.setpoints import (
    Drive,
    Hold,
    Land,
    Position,
    Sensed,
    Takeoff,
    Track,
    Velocity,
    Wish,
)
from koord.runtime.guardian.events import Condition, Other, Ticked
from koord.runtime.guardian.limits import SafetyLimits
from koord.runtime.guardian.modes import Facts, Mode, State, TrustedPose
from koord.runtime.motion.field import Field
from koord.runtime.motion.geometry import point_segment, segment_segment
from koord.runtime.motion.world import Point

#: A robot that comes no nearer by moving than by standing, but for this, is not closing in.
_NEARER_M = 0.01

#: No length in metres and no speed in metres a second is greater.
_LARGEST = 1e6

#: Batteries that tell a little more than all are full.
_FULL = 1.05


class Setup(Struct, frozen=True):
    """What a guardian knows from the beginning: limits, free space, and the time of a round."""

    limits: SafetyLimits
    field: Field
    delta_s: float


class Judgement(Struct, frozen=True):
    """What is the matter at a tick."""

    stories: dict[Condition, str]  #: the conditions, with numbers
    facts: Facts
    pose: TrustedPose | None  #: the last one that can be


def judged(setup: Setup, state: State, tick: Ticked) -> Judgement:
    """Judge what is known at a tick."""
    sensed = tick.sensed
    stories = dict(_of_surroundings(setup, tick))
    trusted = state.pose
    critical = False
    if sensed is None:
        stories[Condition.LINK] = "the vehicle has told nothing yet"
    else:
        limits = setup.limits
        if not sensed.link:
            stories[Condition.LINK] = "the vehicle does not answer"
        if story := _battery(limits, state, sensed.battery):
            stories[Condition.BATTERY] = story
        critical = sensed.battery is not None and sensed.battery < limits.battery_critical
        if story := _no_pose(limits, sensed, tick.now_s):
            stories[Condition.POSE] = story
        else:
            jump = _jump(limits, state, sensed)
            if jump is None:
                trusted = TrustedPose(sensed.position_m, sensed.measured_at_s)
            else:
                stories[Condition.JUMP] = jump
            stories.update(_of_place(setup, state, sensed, tick))
    facts = Facts(
        tripped=bool(stories),
        outside=Condition.FENCE in stories,
        critical=critical,
        at_rest=sensed is not None and _at_rest(setup, sensed, tick.now_s),
    )
    return Judgement(stories, facts, trusted)


# --- what is not about places -------------------------------------------------------------------


def _of_surroundings(setup: Setup, tick: Ticked) -> Iterator[tuple[Condition, str]]:
    limits = setup.limits
    longest_s = limits.rounds * setup.delta_s
    if not _is_young(tick.round_age_s, longest_s):
        said = f"no round was committed {_for(tick.round_age_s)} (limit {longest_s:.2f} s)"
        yield Condition.ROUND, said
    if tick.holding is not None:
        yield Condition.PROTOCOL, f"the protocol holds: {tick.holding.value}"
    if limits.heartbeat_s is not None and not _is_young(tick.heartbeat_age_s, limits.heartbeat_s):
        missing = _for(tick.heartbeat_age_s)
        said = f"the e-stop has not been heard {missing} (limit {limits.heartbeat_s:.2f} s)"
        yield Condition.HEARTBEAT, said
    if tick.watchdog is not None:
        yield Condition.WATCHDOG, tick.watchdog


def _is_young(age_s: float | None, most_s: float) -> bool:
    """Return whether an age is known and small; what comes from the future is as wrong."""
    return age_s is not None and abs(age_s) <= most_s


def _are_sane(*numbers: float) -> bool:
    """Return whether lengths and speeds are some that can be; NaN is none."""
    return all(abs(one) <= _LARGEST for one in numbers)


def _for(age_s: float | None) -> str:
    return "yet" if age_s is None else f"for {age_s:.2f} s"


def _battery(limits: SafetyLimits, state: State, battery: float | None) -> str | None:
    if battery is None:
        return None
    least = limits.battery_low
    if Condition.BATTERY in state.conditions:
        least += limits.battery_more
    if least <= battery <= _FULL:
        return None
    if 0 <= battery < least:
        return f"the battery is at {battery:.0%} (limit {least:.0%})"
    return f"the battery tells {battery:g}, and not a number from 0 to 1"


def _no_pose(limits: SafetyLimits, sensed: Sensed, now_s: float) -> str | None:
    age_s = now_s - sensed.measured_at_s
    if not _are_sane(*sensed.position_m, *sensed.velocity_mps, *sensed.attitude):
        return "the position, the attitude or the velocity is none that can be"
    if not _is_young(age_s, limits.pose_age_s):
        return f"the pose is {age_s:.2f} s old (limit {limits.pose_age_s:.2f} s)"
    return None


def _jump(limits: SafetyLimits, state: State, sensed: Sensed) -> str | None:
    """Return by how much a pose is further away than the robot can have got. (G-JUMP)

    Once it moves under nobody's eyes it holds, so it does not get further with time.
    """
    if state.pose is None or state.mode in (Mode.DISARMED, Mode.STOPPED, Mode.ESTOPPED):
        return None
    elapsed_s = abs(sensed.measured_at_s - state.pose.measured_at_s)
    furthest_m = limits.jump_m + limits.speed_mps * min(elapsed_s, limits.pose_age_s)
    moved_m = math.dist(sensed.position_m, state.pose.position_m)
    if moved_m <= furthest_m:
        return None
    return f"the pose is {moved_m:.2f} m from the last one that can be (limit {furthest_m:.2f} m)"


def _at_rest(setup: Setup, sensed: Sensed, now_s: float) -> bool:
    """Return whether an aircraft is on the ground, and whether what drives stands. (G-END)"""
    limits = setup.limits
    if limits.flies and sensed.airborne is not None:
        return sensed.link and not sensed.airborne
    if not sensed.link or _no_pose(limits, sensed, now_s) is not None:
        return False
    height_m = sensed.position_m[2] - setup.field.world.ground
    if limits.flies and not abs(height_m) <= limits.landed_m:
        return False
    return math.hypot(*sensed.velocity_mps) <= limits.still_mps


# --- what is about places -----------------------------------------------------------------------


def _of_place(
    setup: Setup, state: State, sensed: Sensed, tick: Ticked
) -> Iterator[tuple[Condition, str]]:
    limits, here = setup.limits, _above_ground(setup, sensed.position_m)
    clearance_m = setup.field.clearance(*here)
    ways = [_braking(limits, sensed.velocity_mps)]
    if tick.wish is not None:
        if story := _unsafe(setup, here, tick.wish):
            yield Condition.WISH, story
        else:
            ways.append(_wished(limits, here, sensed, tick.wish, setup.field.world.ground))
    if not clearance_m >= limits.margin_m:
        where = "inside of" if clearance_m < 0 else f"{clearance_m:.2f} m from"
        said = f"the robot is {where} a wall or an obstacle (margin {limits.margin_m:.2f} m)"
        yield Condition.FENCE, said
    ends = [_ahead(setup, here, way) for way in ways]
    if clearance_m >= limits.margin_m:
        starts = np.array([here] * len(ends))
        free = setup.field.segments_free(starts, np.array(ends), limits.margin_m)
        if not free.all():
            far_m = max(math.dist(here, end) for end, ok in zip(ends, free, strict=True) if not ok)
            said = f"it cannot stop in time: a wall or an obstacle is within {far_m:.2f} m ahead"
            yield Condition.AHEAD, said
    near = [story for other in tick.others if (story := _close(setup, state, here, ends, other))]
    if near:
        yield Condition.APART, "; ".join(near)


def _above_ground(setup: Setup, point: Point) -> Point:
    """A point as the free space takes it: measured on the ground, it may be a little below."""
    x, y, z = point
    ground = setup.field.world.ground
    return (x, y, max(z, ground)) if z >= ground - setup.limits.landed_m else point


def _ahead(setup: Setup, here: Point, way: Point) -> Point:
    """Where a way leads; the ground ends it, and is no wall."""
    return here[0] + way[0], here[1] + way[1], max(here[2] + way[2], setup.field.world.ground)


def _scaled(vector: Point, factor: float) -> Point:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def _stopping_m(limits: SafetyLimits, speed_mps: float) -> float:
    """The way until it stands: before it obeys, and while it brakes."""
    return speed_mps * limits.reaction_s + speed_mps * speed_mps / (2 * limits.braking_mps2)


def _braking(limits: SafetyLimits, velocity_mps: Point) -> Point:
    speed_mps = math.hypot(*velocity_mps)
    if speed_mps == 0:
        return velocity_mps
    return _scaled(velocity_mps, _stopping_m(limits, speed_mps) / speed_mps)


def _wished(limits: SafetyLimits, here: Point, sensed: Sensed, wish: Wish, ground: float) -> Point:
    """How far a wish leads until the robot stands, if it is held at the next tick."""
    match wish:
        case Velocity(velocity_mps=velocity_mps):
            return _braking(limits, velocity_mps)
        case Track(position_m=(x, y, z), velocity_mps=velocity_mps):
            on = _braking(limits, velocity_mps)
            return x + on[0] - here[0], y + on[1] - here[1], z + on[2] - here[2]
        case Drive(speed_mps=speed_mps):
            heading = yaw_of(sensed.attitude)
            ahead = math.cos(heading) * speed_mps, math.sin(heading) * speed_mps, 0.0
            return _braking(limits, ahead)
        case Position(position_m=(x, y, z), speed_mps=speed_mps):
            way = (x - here[0], y - here[1], z - here[2])
            length_m = math.hypot(*way)
            stopping_m = _stopping_m(limits, speed_mps)
            return way if length_m <= stopping_m else _scaled(way, stopping_m / length_m)
        case Takeoff(height_m=height_m):
            return 0.0, 0.0, ground + height_m - here[2]
        case Hold() | Land():
            return 0.0, 0.0, 0.0
        case _:
            assert_never(wish)


def _unsafe(setup: Setup, here: Point, wish: object) -> str | None:
    """Return what is wrong with a wish, wherever the robot is going. (G-WISH)"""
    limits = setup.limits
    match wish:
        case Velocity(velocity_mps=velocity_mps, yaw_rate_radps=rate):
            numbers: tuple[float, ...] = (*velocity_mps, rate)
            speed_mps, target = math.hypot(*velocity_mps), here
        case Drive(speed_mps=ahead_mps, yaw_rate_radps=rate, steering_rad=steering):
            numbers = (ahead_mps, rate, steering or 0.0)
            speed_mps, target = abs(ahead_mps), here
        case Position(position_m=position_m, heading_rad=heading, speed_mps=speed_mps):
            numbers = (*position_m, speed_mps, heading or 0.0)
            target = position_m
        case Track(position_m=position_m, velocity_mps=velocity_mps) as track:
            numbers = (*position_m, *velocity_mps, *track.acceleration_mps2)
            numbers = (*numbers, track.heading_rad or 0.0)
            speed_mps, target = math.hypot(*velocity_mps), position_m
        case Takeoff(height_m=height_m):
            numbers, speed_mps = (height_m,), 0.0
            target = (here[0], here[1], setup.field.world.ground + height_m)
        case Hold() | Land():
            numbers, speed_mps, target = (), 0.0, here
        case _:
            # Motion may be somebody's own: whatever else it says is not passed on.
            return f"motion wishes for {type(wish).__name__}, which is for people alone"
    if not _are_sane(*numbers) or speed_mps < 0:
        return f"motion wishes for what cannot be: {wish}"
    if isinstance(wish, Takeoff | Land) and not limits.flies:
        return f"motion wishes for {type(wish).__name__}, and this vehicle does not fly"
    if not speed_mps <= limits.speed_mps:
        return f"motion wishes for {speed_mps:.2f} m/s (limit {limits.speed_mps:.2f} m/s)"
    if target is not here and not setup.field.clearance(*target) >= limits.margin_m:
        return "motion wishes to go to ({:.2f}, {:.2f}, {:.2f}), outside of the fence".format(
            *target
        )
    return None


def _close(setup: Setup, state: State, here: Point, ends: list[Point], other: Other) -> str | None:
    """Return how near another robot may come, if that is because this one moves. (G-APART)

    The other one has moved on since it was seen, until its own guardian held it for want of rounds,
    and then until it stood.
    """
    limits = setup.limits
    if not _are_sane(*other.position_m, *other.velocity_mps):
        return f"robot {other.pid} is where nothing can be"
    longest_s = limits.rounds * setup.delta_s
    moved_s = other.age_s if 0 <= other.age_s <= longest_s else longest_s
    place = np.array(other.position_m)
    last = place + np.array(other.velocity_mps) * moved_s + _braking(limits, other.velocity_mps)
    start = np.array(here)
    # It may have sped up or turned since, as hard as it brakes, and nothing of that shows yet.
    unseen_m = limits.braking_mps2 * (moved_s + limits.reaction_s) ** 2
    resting_m = math.sqrt(point_segment(start, place, last)) - unseen_m
    nearest_m = math.sqrt(segment_segment(start, np.array(ends), place, last).min()) - unseen_m
    least_m = limits.separation_m
    if Condition.APART in state.conditions:
        least_m += limits.separation_more_m
    if nearest_m >= least_m or nearest_m >= resting_m - _NEARER_M:
        return None
    return (
        f"robot {other.pid}, seen {other.age_s:.2f} s ago, may come as near as {nearest_m:.2f} m "
        f"before both stand (limit {least_m:.2f} m)"
    )
