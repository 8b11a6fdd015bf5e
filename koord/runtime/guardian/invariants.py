"""The invariants of the guardian (specs/guardian/README.md), each of one step.

They hold whatever came before; they look at what was told and answered, and not at how. As the
modes they are run on symbols too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from msgspec import Struct

from koord.runtime.drivers.setpoints import Arm, Disarm, Hold, Land, Setpoint, Wish
from koord.runtime.guardian.events import Order
from koord.runtime.guardian.limits import EstopAction, SafetyLimits
from koord.runtime.guardian.modes import Facts, Mode, State


class Transition(Struct, frozen=True):
    """A step of the guardian: after an order, or at a tick with facts and a wish."""

    limits: SafetyLimits
    before: State
    after: State
    setpoint: Setpoint | None
    order: Order | None = None
    facts: Facts | None = None
    wish: Wish | None = None


def _still(one: Transition) -> bool:
    """(S-STILL)"""
    if one.setpoint is None or one.after.mode is Mode.RUNNING:
        return True
    if isinstance(one.setpoint, Arm):
        return one.after.mode is Mode.ARMED
    return isinstance(one.setpoint, Hold | Land | Disarm)


def _arm(one: Transition) -> bool:
    """(S-ARM)"""
    return not isinstance(one.setpoint, Arm) or one.after.mode is Mode.ARMED


def _wish(one: Transition) -> bool:
    """(S-WISH)"""
    if one.after.mode is not Mode.RUNNING:
        return True
    if one.facts is None:
        return one.setpoint is None or isinstance(one.setpoint, Hold)
    passed = isinstance(one.setpoint, Hold) if one.wish is None else one.setpoint is one.wish
    return passed and not one.facts.tripped


def _answer(one: Transition) -> bool:
    """(S-ANSWER)"""
    asked = one.order in (None, Order.ESTOP) or one.after.mode is not one.before.mode
    return one.setpoint is not None or not asked


def _limit(one: Transition) -> bool:
    """(S-LIMIT)"""
    before, after = one.before, one.after
    held_s = after.held_since_s
    if after.mode is not Mode.HOLDING:
        return held_s is (before.held_since_s if after.mode is Mode.RUNNING else None)
    if held_s is None or (one.facts is not None and after.now_s - held_s >= one.limits.hold_s):
        return False
    goes_on = before.mode is Mode.HOLDING or after.now_s - before.since_s < one.limits.resume_s
    began_s = before.held_since_s if goes_on else None
    return held_s == (after.now_s if began_s is None else began_s)


def _critical(one: Transition) -> bool:
    """(S-CRITICAL)"""
    if one.facts is None or one.after.mode not in (Mode.RUNNING, Mode.HOLDING):
        return True
    return not one.facts.critical


def _estop(one: Transition) -> bool:
    """(S-ESTOP)"""
    if one.order is not Order.ESTOP:
        return True
    if one.after.mode is not Mode.ESTOPPED:
        return False
    down = Land if one.limits.flies else Hold
    if one.limits.estop is EstopAction.DISARM:
        return isinstance(one.setpoint, Disarm)
    return isinstance(one.setpoint, Disarm | down)


#: Where modes that end something may lead, by which order; e-stops apart. (S-FINAL)
_WAYS_ON: Mapping[Mode, Mapping[Mode, Order | None]] = {
    Mode.ESTOPPED: {Mode.DISARMED: Order.RESET},
    Mode.STOPPED: {Mode.DISARMED: Order.RESET, Mode.ARMED: Order.ARM},
    Mode.LANDING: {Mode.STOPPED: None},
}


def _final(one: Transition) -> bool:
    """(S-FINAL)"""
    before, after = one.before.mode, one.after.mode
    if before is after or before not in _WAYS_ON or one.order is Order.ESTOP:
        return True
    return after in _WAYS_ON[before] and one.order is _WAYS_ON[before][after]


def _people(one: Transition) -> bool:
    """(S-PEOPLE)"""
    before = one.before
    if one.after.mode is not Mode.RUNNING or before.mode is Mode.RUNNING:
        return True
    if before.mode is Mode.ARMED:
        return one.order is Order.START
    return before.mode is Mode.HOLDING and one.order is None and not before.waits


def _waits(one: Transition) -> bool:
    """(S-WAITS)"""
    if one.after.mode is not Mode.HOLDING:
        return not one.after.waits
    was_waiting = one.before.mode is Mode.HOLDING and one.before.waits
    if one.order is Order.STOP or (was_waiting and one.order is not Order.START):
        return one.after.waits
    return one.facts is None or not one.facts.outside or one.after.waits


def _clear(one: Transition) -> bool:
    """(S-CLEAR)"""
    before, after = one.before.clear_since_s, one.after.clear_since_s
    if one.facts is None:
        kept = after is before
    elif one.facts.tripped:
        kept = after is None
    elif before is None:
        kept = after is not None and after == one.after.now_s
    else:
        kept = after is not None and after == before
    if one.after.mode is Mode.RUNNING and one.before.mode is not Mode.RUNNING:
        return kept and after is not None and one.after.now_s - after >= one.limits.resume_s
    return kept


def _drop(one: Transition) -> bool:
    """(S-DROP)"""
    if not one.limits.flies or not isinstance(one.setpoint, Disarm):
        return True
    if one.after.mode is Mode.ESTOPPED and one.limits.estop is EstopAction.DISARM:
        return True
    return one.after.at_rest and (one.facts is None or one.facts.at_rest)


def _time(one: Transition) -> bool:
    """(S-TIME)"""
    before, after = one.before, one.after
    began_s = before.since_s if after.mode is before.mode else after.now_s
    return before.now_s <= after.now_s and _has_begun(after) and after.since_s == began_s


def _has_begun(state: State) -> bool:
    if state.clear_since_s is not None and state.clear_since_s > state.now_s:
        return False
    if state.held_since_s is not None and state.held_since_s > state.now_s:
        return False
    return state.since_s <= state.now_s


def is_whole(state: State) -> bool:
    """Return whether a state is one that each step leaves, and the next one relies on.

    This is what S-TIME, S-WAITS and S-LIMIT say of a state.
    """
    if state.mode is Mode.HOLDING:
        return state.held_since_s is not None and _has_begun(state)
    if state.waits or (state.mode is not Mode.RUNNING and state.held_since_s is not None):
        return False
    return _has_begun(state)


INVARIANTS: Mapping[str, Callable[[Transition], bool]] = {
    "S-STILL": _still,
    "S-ARM": _arm,
    "S-WISH": _wish,
    "S-ANSWER": _answer,
    "S-LIMIT": _limit,
    "S-CRITICAL": _critical,
    "S-ESTOP": _estop,
    "S-FINAL": _final,
    "S-PEOPLE": _people,
    "S-WAITS": _waits,
    "S-CLEAR": _clear,
    "S-DROP": _drop,
    "S-TIME": _time,
}


def broken(one: Transition) -> Iterator[str]:
    """Yield the ids of the invariants that a step breaks."""
    for name, holds in INVARIANTS.items():
        if not holds(one):
            yield name
