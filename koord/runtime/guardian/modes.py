"""The modes of a guarded robot, and how they follow each other: the part that is proved.

``koord/refinement/guardian_proof`` runs these very functions on symbols. So they compare times and
conditions, and look at nothing else.
"""

from __future__ import annotations

from enum import Enum
from typing import assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.drivers.setpoints import Arm, Disarm, Hold, Land, Setpoint, Wish
from koord.runtime.guardian.events import Condition, Order
from koord.runtime.guardian.limits import EstopAction, SafetyLimits
from koord.runtime.motion.world import Point


class Mode(Enum):
    """The modes of a robot."""

    DISARMED = "disarmed"
    ARMED = "armed"  #: motors have power, nothing moves
    RUNNING = "running"  #: motion's wishes go to the driver
    HOLDING = "holding"
    LANDING = "landing"  #: what drives comes to its last stop
    STOPPED = "stopped"
    ESTOPPED = "e-stopped"


class TrustedPose(Struct, frozen=True):
    """The last pose that the robot can have got to."""

    position_m: Point
    measured_at_s: float


class State(Struct, frozen=True):
    """The state of a guardian."""

    mode: Mode
    now_s: float  #: of the last event
    since_s: float  #: when the mode began
    clear_since_s: float | None = None  #: since when no condition is there; None: one is
    held_since_s: float | None = None  #: when this hold began, or the first of some in a row
    waits: bool = False  #: it holds until people say START (G-STOP, G-PEOPLE)
    at_rest: bool = False  #: it was on the ground and still at the last tick
    conditions: frozenset[Condition] = frozenset()
    pose: TrustedPose | None = None


class Facts(Struct, frozen=True):
    """What a tick comes to, as far as modes are concerned."""

    tripped: bool  #: a condition is there
    outside: bool  #: the condition FENCE is
    critical: bool  #: the battery is about to be empty
    at_rest: bool  #: an aircraft: it is on the ground; what drives: it stands


def initial(now_s: float) -> State:
    """The state at the beginning. A robot that is in the air by then lands. (G-DISARMED)"""
    return State(Mode.DISARMED, now_s, now_s)


def is_clear(limits: SafetyLimits, state: State, now_s: float) -> bool:
    """Return whether no condition has been there for long enough to move. (G-CLEAR)"""
    return state.clear_since_s is not None and now_s - state.clear_since_s >= limits.resume_s


def after_order(limits: SafetyLimits, state: State, order: Order, now_s: float) -> State:
    """The state after an order; the same but for the time if it does not fit."""
    state = replace(state, now_s=max(state.now_s, now_s))
    match order, state.mode:
        case Order.ESTOP, _:  # (G-ESTOP)
            return _enter(state, Mode.ESTOPPED)
        case Order.RESET, Mode.ESTOPPED | Mode.STOPPED if state.at_rest:  # (G-RESET)
            return _enter(state, Mode.DISARMED)
        case Order.ARM, Mode.DISARMED | Mode.STOPPED if state.at_rest:  # (G-ARM)
            return _enter(state, Mode.ARMED)
        case Order.START, Mode.ARMED if is_clear(limits, state, state.now_s):  # (G-START)
            return _enter(state, Mode.RUNNING)
        case Order.START, Mode.HOLDING:  # (G-PEOPLE, G-JUMP)
            return replace(state, waits=False, pose=None)
        case Order.STOP, Mode.RUNNING:  # (G-STOP)
            return replace(_hold(limits, state), waits=True)
        case Order.STOP, Mode.HOLDING:
            return replace(state, waits=True)
        case Order.STOP | Order.LAND, Mode.ARMED:
            return _enter(state, Mode.DISARMED)
        case Order.LAND, Mode.RUNNING | Mode.HOLDING:  # (G-LAND)
            return _enter(state, Mode.LANDING)
        case _:
            return state


def after_tick(limits: SafetyLimits, state: State, facts: Facts, now_s: float) -> State:
    """The state after a tick."""
    now_s = max(state.now_s, now_s)
    clear_since_s = state.clear_since_s if state.clear_since_s is not None else now_s
    state = replace(
        state,
        now_s=now_s,
        clear_since_s=None if facts.tripped else clear_since_s,
        at_rest=facts.at_rest,
    )
    if state.mode is Mode.RUNNING and facts.tripped:  # (G-HOLD)
        state = _hold(limits, state)
    match state.mode:
        case Mode.RUNNING | Mode.HOLDING if facts.critical:  # (G-CRITICAL)
            return _enter(state, Mode.LANDING)
        case Mode.HOLDING if now_s - (state.held_since_s or 0.0) >= limits.hold_s:  # (G-END)
            return _enter(state, Mode.LANDING)
        case Mode.HOLDING if facts.outside:  # (G-PEOPLE)
            return replace(state, waits=True)
        case Mode.HOLDING if not state.waits and is_clear(limits, state, now_s):  # (G-RESUME)
            return _enter(state, Mode.RUNNING)
        case Mode.LANDING if facts.at_rest:  # (G-END)
            return _enter(state, Mode.STOPPED)
        case _:
            return state


def setpoint(limits: SafetyLimits, state: State, wish: Wish) -> Setpoint:
    """What goes to the driver in a state: the wish as it is, or one that is safe. (G-TICK)"""
    match state.mode:
        case Mode.RUNNING:
            return wish
        case Mode.HOLDING:
            return Hold()
        case Mode.LANDING:
            return _down(limits)
        case Mode.ARMED:
            return Arm()
        case Mode.DISARMED | Mode.STOPPED:  # (G-DISARMED)
            return Disarm() if state.at_rest else _down(limits)
        case Mode.ESTOPPED:  # (G-ESTOP)
            at_once = limits.estop is EstopAction.DISARM or state.at_rest
            return Disarm() if at_once else _down(limits)
        case _:
            assert_never(state.mode)


def _down(limits: SafetyLimits) -> Setpoint:
    return Land() if limits.flies else Hold()


def _enter(state: State, mode: Mode) -> State:
    if mode is state.mode:
        return state
    held_since_s = state.held_since_s if mode is Mode.RUNNING else None
    return replace(state, mode=mode, since_s=state.now_s, held_since_s=held_since_s, waits=False)


def _hold(limits: SafetyLimits, state: State) -> State:
    """Hold after it ran; if it did so for a moment only, the hold before goes on. (G-END)"""
    held_since_s = state.held_since_s
    if held_since_s is None or state.now_s - state.since_s >= limits.resume_s:
        held_since_s = state.now_s
    return replace(_enter(state, Mode.HOLDING), held_since_s=held_since_s)
