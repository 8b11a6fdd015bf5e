"""Exploration of the guardian: all orders and ticks, one after another, until nothing is new.

A tick is a second after the one before, or not later at all, and either all is well or one
condition is there. Of the past a state keeps no more than the limits can tell apart, so there are
finitely many. Besides each step by itself, what came before is checked by counting along.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.drivers.setpoints import Sensed, Velocity
from koord.runtime.exploration.claims import BrokenInvariant, InvariantViolation
from koord.runtime.guardian.conditions import Setup, judged
from koord.runtime.guardian.events import Condition, Event, Order, Ordered, Other, Ticked
from koord.runtime.guardian.invariants import Transition, broken
from koord.runtime.guardian.limits import EstopAction, SafetyLimits
from koord.runtime.guardian.machine import step
from koord.runtime.guardian.modes import Facts, Mode, State, TrustedPose, initial
from koord.runtime.motion.field import field
from koord.runtime.motion.world import Point, World
from koord.runtime.protocol.events import Reason

#: Seconds, and ticks.
_HOLD_S, _RESUME_S = 3.0, 2.0

#: Just inside of the fence, a little outside, and far from both.
_HERE, _OUTSIDE, _ELSEWHERE = (4.75, 0.0, 0.0), (4.85, 0.0, 0.0), (-2.0, 0.0, 0.0)

_LEVEL = (1.0, 0.0, 0.0, 0.0)


class Watched(Struct, frozen=True):
    """A guardian, and what has been counted along since the beginning."""

    state: State
    permits: tuple[Order, ...] = ()  #: arm and start, since it was last disarmed or stopped
    held_s: int | None = None  #: since when it holds, also if it ran for a moment in between
    ran_s: int = 0  #: for how long it has run without a break
    well_s: int | None = None  #: for how long all has been well, at each tick; None: it is not


class GuardianExplored(Struct, frozen=True):
    """The result of an exploration: counts, and the violation, if any."""

    states: int
    transitions: int
    depth: int
    complete: bool
    violation: InvariantViolation | None = None


#: The kinds of vehicle that are explored.
VEHICLES: Mapping[str, SafetyLimits] = {
    "a car": SafetyLimits(estop=EstopAction.DISARM),
    "a drone that lands on e-stop": SafetyLimits(flies=True, estop=EstopAction.LAND),
    "a drone that falls on e-stop": SafetyLimits(flies=True, estop=EstopAction.DISARM),
}


def explore_guardian(limits: SafetyLimits) -> GuardianExplored:
    """Explore all that can happen to a guardian, breadth first, until an invariant is violated."""
    limits = replace(
        limits, hold_s=_HOLD_S, resume_s=_RESUME_S, margin_m=0.2, heartbeat_s=0.5, rounds=5.0
    )
    world = World((-5.0, -5.0, 0.0), (5.0, 5.0, 3.0))
    return _Search(Setup(limits, field(world, flat=not limits.flies), 0.1)).run()


class _Search:
    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._events = tuple(_events())
        self._from: dict[Watched, tuple[Watched, str] | None] = {}
        self._facts: dict[tuple[object, ...], Facts] = {}
        self._transitions = 0

    def run(self) -> GuardianExplored:
        start = Watched(initial(0.0))
        self._from[start] = None
        layer, depth = deque([start]), 0
        while layer:
            depth += 1
            following: deque[Watched] = deque()
            for before in layer:
                for name, event in self._events:
                    self._transitions += 1
                    after, found = self._stepped(before, event)
                    if found is not None:
                        story = (*self._story(before), name)
                        violation = InvariantViolation(found, story)
                        return self._explored(depth, complete=False, violation=violation)
                    if after not in self._from:
                        self._from[after] = (before, name)
                        following.append(after)
            layer = following
        return self._explored(depth, complete=True)

    def _explored(
        self, depth: int, *, complete: bool, violation: InvariantViolation | None = None
    ) -> GuardianExplored:
        return GuardianExplored(len(self._from), self._transitions, depth, complete, violation)

    def _stepped(self, before: Watched, event: Event) -> tuple[Watched, BrokenInvariant | None]:
        """The step that an event makes, and the invariant that it breaks."""
        limits, state = self._setup.limits, before.state
        after, answer = step(self._setup, state, event)
        told = Transition(limits, state, after, answer.setpoint)
        if isinstance(event, Ordered):
            told = replace(told, order=event.order)
        else:
            told = replace(told, facts=self._judged(state, event), wish=event.wish)
        watched = _counted(before, after, told)
        is_tick = told.facts is not None
        for name in (*broken(told), *_miscounted(before, watched, is_tick=is_tick)):
            story = f"{state.mode.value} → {after.mode.value}, {answer.setpoint}"
            return watched, BrokenInvariant(name, story)
        return replace(watched, state=_cut(limits, after)), None

    def _judged(self, state: State, tick: Ticked) -> Facts:
        # What is judged does not depend on anything else of a state.
        key = (state.mode, state.conditions, state.pose, tick)
        if key not in self._facts:
            self._facts[key] = judged(self._setup, state, tick).facts
        return self._facts[key]

    def _story(self, last: Watched) -> tuple[str, ...]:
        lines: list[str] = []
        while (before := self._from[last]) is not None:
            last, name = before
            lines.append(name)
        return tuple(reversed(lines))


def _counted(before: Watched, after: State, told: Transition) -> Watched:
    """What is counted along, after a step."""
    permits = before.permits
    if after.mode in (Mode.DISARMED, Mode.STOPPED, Mode.ESTOPPED, Mode.LANDING):
        permits = ()
    elif told.order in (Order.ARM, Order.START):
        permits = tuple(one for one in Order if one in {*permits, told.order})
    passed_s = round(after.now_s - before.state.now_s)
    held_s, ran_s = before.held_s, 0
    if before.state.mode is Mode.RUNNING:
        ran_s = min(before.ran_s + passed_s, round(_RESUME_S))
    if after.mode is Mode.HOLDING:
        goes_on = held_s is not None and ran_s < _RESUME_S
        held_s = min((held_s or 0) + passed_s, round(_HOLD_S)) if goes_on else 0
    elif after.mode is Mode.RUNNING:
        held_s = None if held_s is None else min(held_s + passed_s, round(_HOLD_S))
    else:
        held_s = None
    ran_s = ran_s if after.mode is Mode.RUNNING else 0
    well_s = before.well_s
    if told.facts is not None:
        well_s = 0 if well_s is None else min(well_s + passed_s, round(_RESUME_S))
        well_s = None if told.facts.tripped else well_s
    return Watched(after, permits, held_s, ran_s, well_s)


def _miscounted(before: Watched, after: Watched, *, is_tick: bool) -> Iterator[str]:
    """Yield the invariants that what was counted along contradicts."""
    if after.state.mode is Mode.RUNNING:
        if after.permits != (Order.ARM, Order.START):
            yield "S-PEOPLE"
        if before.state.mode is not Mode.RUNNING and (after.well_s or 0) < _RESUME_S:
            yield "S-CLEAR"
    if after.state.mode is Mode.HOLDING and is_tick and (after.held_s or 0) >= _HOLD_S:
        yield "S-LIMIT"


def _cut(limits: SafetyLimits, state: State) -> State:
    """A state as of now, with as much of the past as the limits can tell apart."""
    clear_s = state.clear_since_s
    if clear_s is not None:
        clear_s = max(clear_s - state.now_s, -limits.resume_s)
    since_s, held_s = 0.0, state.held_since_s
    if state.mode is Mode.RUNNING:  # in no other mode anybody asks
        since_s = max(state.since_s - state.now_s, -limits.resume_s)
    if held_s is not None:
        held_s = max(held_s - state.now_s, -limits.hold_s)
    pose = None if state.pose is None else TrustedPose(state.pose.position_m, -limits.pose_age_s)
    return replace(
        state, now_s=0.0, since_s=since_s, clear_since_s=clear_s, held_since_s=held_s, pose=pose
    )


# --- events -------------------------------------------------------------------------------------


def _events() -> Iterator[tuple[str, Event]]:
    """Yield all that can happen next, with its name. It is 0 s now."""
    for order in Order:
        yield order.value, Ordered(0.0, order)
    for moves in (False, True):
        how = "moving" if moves else "at rest"
        well = _well(1.0, moves=moves)
        yield f"a tick, {how}", well
        for condition in Condition:
            yield f"a tick, {how}, {condition.value}", _with(well, condition)
        yield f"a tick, {how}, battery critical", _sensed(well, battery=0.01)
        yield f"a tick, {how}, no wish", replace(well, wish=None)
        yield f"a tick at the same time, {how}", _well(0.0, moves=moves)
        yield f"a tick of earlier, {how}", _well(-1.0, moves=moves)


def _well(now_s: float, *, moves: bool) -> Ticked:
    """A tick at which all is well."""
    velocity = (-0.1, 0.0, 0.0) if moves else (0.0, 0.0, 0.0)
    sensed = Sensed(_HERE, _LEVEL, velocity, now_s, battery=1.0, airborne=moves)
    wish = Velocity((-0.1, 0.0, 0.0))
    return Ticked(now_s, sensed, wish, round_age_s=0.1, heartbeat_age_s=0.1)


def _sensed(
    tick: Ticked,
    *,
    position_m: Point = _HERE,
    battery: float = 1.0,
    link: bool = True,
    measured_at_s: float | None = None,
) -> Ticked:
    assert tick.sensed is not None
    at_s = tick.now_s if measured_at_s is None else measured_at_s
    sensed = replace(
        tick.sensed, position_m=position_m, battery=battery, link=link, measured_at_s=at_s
    )
    return replace(tick, sensed=sensed)


def _with(well: Ticked, condition: Condition) -> Ticked:
    """A tick at which one condition is there; those of places may bring another one along."""
    assert well.sensed is not None
    found = {
        Condition.ROUND: replace(well, round_age_s=None),
        Condition.PROTOCOL: replace(well, holding=Reason.NO_MAJORITY),
        Condition.LINK: _sensed(well, link=False),
        Condition.HEARTBEAT: replace(well, heartbeat_age_s=9.0),
        Condition.WATCHDOG: replace(well, watchdog="it has ended"),
        Condition.BATTERY: _sensed(well, battery=0.1),
        Condition.POSE: _sensed(well, measured_at_s=well.now_s - 9.0),
        Condition.JUMP: _sensed(well, position_m=_ELSEWHERE),
        Condition.FENCE: _sensed(well, position_m=_OUTSIDE),
        Condition.AHEAD: replace(well, wish=Velocity((1.0, 0.0, 0.0))),
        Condition.WISH: replace(well, wish=Velocity((99.0, 0.0, 0.0))),
        Condition.APART: replace(well, others=(Other(1, (4.25, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0),)),
    }
    return found[condition]
