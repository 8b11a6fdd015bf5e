"""The guardian: ``step``, what a robot is to do after an order or at a tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import assert_never

from msgspec.structs import replace

from koord.runtime.drivers.setpoints import Hold, Wish
from koord.runtime.guardian.conditions import Judgement, Setup, judged
from koord.runtime.guardian.events import Answer, Condition, Event, Note, Order, Ordered, Ticked
from koord.runtime.guardian.modes import (
    Mode,
    State,
    after_order,
    after_tick,
    is_clear,
    setpoint,
)


def step(setup: Setup, state: State, event: Event) -> tuple[State, Answer]:
    """Return the state after an event, and what goes to the driver and to people. Pure."""
    match event:
        case Ordered(now_s=now_s, order=order):
            return _order(setup, state, order, now_s)
        case Ticked():
            judgement = judged(setup, state, event)
            return answered(setup, state, judgement, event.now_s, event.wish)
        case _:
            assert_never(event)


def _order(setup: Setup, state: State, order: Order, now_s: float) -> tuple[State, Answer]:
    """Obey an order at once, as long as that moves nothing. (G-ORDER)"""
    after = after_order(setup.limits, state, order, now_s)
    if replace(after, now_s=state.now_s) == state and order is not Order.ESTOP:
        why = _refusal(setup, state, order, after.now_s)
        return after, Answer(None, () if why is None else (Note(after.now_s, why),))
    notes = tuple(_of_mode(state, after, f"people said {order.value}"))
    return after, Answer(setpoint(setup.limits, after, Hold()), notes)


def answered(
    setup: Setup, state: State, judgement: Judgement, now_s: float, wish: Wish | None
) -> tuple[State, Answer]:
    """The state after a tick on which something was judged, and what is to be told. (G-TICK)"""
    after = after_tick(setup.limits, state, judgement.facts, now_s)
    stories = judgement.stories
    after = replace(after, conditions=frozenset(stories), pose=judgement.pose)
    why = _why(state, after, judgement)
    notes = (*_of_conditions(state, after, stories), *_of_mode(state, after, why))
    wished = Hold() if wish is None else wish
    return after, Answer(setpoint(setup.limits, after, wished), notes)


# --- what people are told -----------------------------------------------------------------------


def _of_conditions(before: State, after: State, stories: Mapping[Condition, str]) -> Iterator[Note]:
    """Tell of each condition when it begins and when it ends. (G-NOTE)"""
    for condition in Condition:
        if condition in after.conditions and condition not in before.conditions:
            yield Note(after.now_s, stories[condition], condition)
        elif condition in before.conditions and condition not in after.conditions:
            yield Note(after.now_s, f"over: {condition.value}", condition)


def _of_mode(before: State, after: State, why: str) -> Iterator[Note]:
    if after.mode is not before.mode:
        said = f"{before.mode.value} → {after.mode.value}: {why}"
        yield Note(after.now_s, said)


def _why(before: State, after: State, judgement: Judgement) -> str:
    """Say why a tick changed the mode."""
    match after.mode:
        case Mode.RUNNING:
            return "all is well again"
        case Mode.STOPPED:
            return "it is on the ground and stands"
        case Mode.LANDING if judgement.facts.critical:
            return judgement.stories[Condition.BATTERY]
        case Mode.LANDING:
            held_since_s = after.now_s if before.held_since_s is None else before.held_since_s
            return f"it held for {after.now_s - held_since_s:.1f} s"
        case _:
            return "; ".join(judgement.stories.values())


def _refusal(setup: Setup, state: State, order: Order, now_s: float) -> str | None:
    """Say why an order changes nothing; None: because it is so already."""
    match order, state.mode:
        case Order.ARM | Order.RESET, _ if order in _FROM and state.mode in _FROM[order]:
            return f"{order.value} refused: it is not known to be on the ground and to stand"
        case Order.START, Mode.ARMED if state.conditions:
            names = ", ".join(sorted(one.value for one in state.conditions))
            return f"start refused: {names}"
        case Order.START, Mode.ARMED if not is_clear(setup.limits, state, now_s):
            return f"start refused: all has to be well for {setup.limits.resume_s:g} s first"
        case Order.ARM | Order.START | Order.RESET, _ if state.mode is not _DONE[order]:
            return f"{order.value} refused: it is {state.mode.value}"
        case _:
            return None


#: From which modes an order leads on, and where to.
_FROM = {
    Order.ARM: (Mode.DISARMED, Mode.STOPPED),
    Order.RESET: (Mode.ESTOPPED, Mode.STOPPED),
}
_DONE = {Order.ARM: Mode.ARMED, Order.START: Mode.RUNNING, Order.RESET: Mode.DISARMED}
