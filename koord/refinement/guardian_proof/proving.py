"""The proof: whatever is said to a guardian in whatever state, the invariants are kept.

Each step of the proof is of one kind of event and one invariant, and covers all modes, limits,
times and facts. What is assumed of the state before is what S-TIME, S-WAITS and S-LIMIT say of the
state after; the beginning has it too. So it is so after any number of events.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, NamedTuple, cast

from koord.refinement.guardian_proof.symbolic import Symbols, Undecided
from koord.refinement.protocol_proof.steps import Answer, Step
from koord.runtime.drivers.setpoints import Hold, Wish
from koord.runtime.guardian.conditions import Judgement, Setup
from koord.runtime.guardian.events import Condition, Order, Ordered
from koord.runtime.guardian.invariants import INVARIANTS, Transition, broken, is_whole
from koord.runtime.guardian.limits import EstopAction, SafetyLimits
from koord.runtime.guardian.machine import answered, step
from koord.runtime.guardian.modes import Facts, Mode, State, initial

#: The rule of each order.
_RULES: Mapping[Order | None, str] = {
    None: "G-TICK",
    Order.ARM: "G-ARM",
    Order.START: "G-START",
    Order.STOP: "G-STOP",
    Order.LAND: "G-LAND",
    Order.ESTOP: "G-ESTOP",
    Order.RESET: "G-RESET",
}


class Case(NamedTuple):
    """What is not a symbol in a step."""

    order: Order | None  #: None: a tick
    mode: Mode
    clear: bool  #: whether there is a time since when all is clear
    held: bool  #: whether there is one since when it holds, or held
    flies: bool
    estop: EstopAction
    wish: Wish | None


def steps() -> Iterator[Step]:
    """Work out all steps of the proof, in their order."""
    symbols = Symbols()
    began = time.perf_counter()
    whole = all(symbols.ways(lambda: is_whole(initial(_any(symbols, "now")))))
    answer = Answer.PROVED if whole else Answer.REFUTED
    took = time.perf_counter() - began
    yield Step("beginning", "G-DISARMED", "S-TIME", answer, took)
    for order in (None, *Order):
        yield from kept(symbols, order)


def kept(symbols: Symbols, order: Order | None) -> tuple[Step, ...]:
    """Ask of each invariant whether it is kept after an order, or at a tick.

    All of them are asked on each way; each step of the proof has its share of the time.
    """
    began = time.perf_counter()
    refuted: dict[str, tuple[str, ...]] = {}
    is_known = True
    try:
        for case in _cases(order):
            for names in symbols.ways(lambda: _broken(symbols, case)):  # noqa: B023
                for name in names:
                    known = f"mode = {case.mode.value}", f"flies = {case.flies}"
                    refuted.setdefault(name, (*known, *symbols.example()))
    except Undecided:
        is_known = False
    share = (time.perf_counter() - began) / len(INVARIANTS)
    action = "tick" if order is None else order.value
    good = Answer.PROVED if is_known else Answer.UNKNOWN
    return tuple(
        Step(action, _RULES[order], name, Answer.REFUTED, share, refuted[name])
        if name in refuted
        else Step(action, _RULES[order], name, good, share)
        for name in INVARIANTS
    )


def _cases(order: Order | None) -> Iterator[Case]:
    wishes = (None, Hold()) if order is None else (None,)
    choices = product(Mode, (True, False), (True, False), (True, False), EstopAction, wishes)
    for mode, clear, held, flies, estop, wish in choices:
        yield Case(order, mode, clear, held, flies, estop, wish)


def _broken(symbols: Symbols, case: Case) -> tuple[str, ...]:
    """The invariants that a step on symbols breaks, on one of its ways."""
    limits = SafetyLimits(
        flies=case.flies,
        estop=case.estop,
        hold_s=_any(symbols, "hold"),
        resume_s=_any(symbols, "resume"),
    )
    before = State(
        case.mode,
        _any(symbols, "now"),
        _any(symbols, "since"),
        _any(symbols, "clear since") if case.clear else None,
        _any(symbols, "held since") if case.held else None,
        waits=_either(symbols, "waits"),
        at_rest=_either(symbols, "at rest"),
    )
    if limits.hold_s <= 0 or limits.resume_s <= 0 or not is_whole(before):
        return ()  # there are no such limits (``limits.flaws``), and no such state
    # The conditions and their stories are for people; modes follow from the facts alone.
    setup = Setup(limits, cast("Any", None), 1.0)
    event_s = _any(symbols, "event")
    if case.order is not None:
        after, answer = step(setup, before, Ordered(event_s, case.order))
        return tuple(broken(Transition(limits, before, after, answer.setpoint, case.order)))
    facts = Facts(
        tripped=_either(symbols, "tripped"),
        outside=_either(symbols, "outside"),
        critical=_either(symbols, "critical"),
        at_rest=_either(symbols, "rests"),
    )
    judgement = Judgement(dict.fromkeys(Condition, ""), facts, None)
    after, answer = answered(setup, before, judgement, event_s, case.wish)
    told = Transition(limits, before, after, answer.setpoint, facts=facts, wish=case.wish)
    return tuple(broken(told))


def _any(symbols: Symbols, name: str) -> float:
    """A symbol where the guardian expects a number."""
    return cast("float", symbols.number(name))


def _either(symbols: Symbols, name: str) -> bool:
    """A symbol where the guardian expects a truth."""
    return cast("bool", symbols.truth(name))
