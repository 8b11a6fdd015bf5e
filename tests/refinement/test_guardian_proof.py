"""The guardian keeps its invariants for all limits, times and facts; the proof of that can fail."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from koord.refinement.guardian_proof import proving
from koord.refinement.guardian_proof.proving import kept, steps
from koord.refinement.guardian_proof.symbolic import Symbols
from koord.refinement.protocol_proof.steps import Answer
from koord.runtime.guardian import machine
from koord.runtime.guardian.events import Order
from koord.runtime.guardian.invariants import INVARIANTS
from koord.runtime.guardian.limits import SafetyLimits
from koord.runtime.guardian.modes import Facts, Mode, State, after_order, after_tick, initial
from tests.sampling import first


def test_every_step_of_the_proof_is_proved() -> None:
    found = list(steps())
    assert [step for step in found if step.answer is not Answer.PROVED] == []
    assert len(found) == 1 + len(INVARIANTS) * (1 + len(Order))


def resets_itself(limits: SafetyLimits, state: State, facts: Facts, now_s: float) -> State:
    """A wrong tick: an e-stop is over after 1,000 s."""
    after = after_tick(limits, state, facts, now_s)
    if after.mode is Mode.ESTOPPED and after.now_s - state.since_s > 1000:
        return replace(after, mode=Mode.DISARMED, since_s=after.now_s)
    return after


def holds_on(limits: SafetyLimits, state: State, facts: Facts, now_s: float) -> State:
    """A wrong tick: who holds when T is over and all is well goes on holding."""
    after = after_tick(limits, state, facts, now_s)
    if state.mode is Mode.HOLDING and after.mode is Mode.LANDING and not facts.tripped:
        return replace(state, now_s=after.now_s, clear_since_s=after.clear_since_s)
    return after


def starts_early(limits: SafetyLimits, state: State, order: Order, now_s: float) -> State:
    """A wrong order: start counts half of the time."""
    return after_order(replace(limits, resume_s=0.5), state, order, now_s)


def deaf(limits: SafetyLimits, state: State, order: Order, now_s: float) -> State:
    """A wrong order: who is disarmed hears no e-stop."""
    if state.mode is Mode.DISARMED:
        return state
    return after_order(limits, state, order, now_s)


@pytest.mark.parametrize(
    ("name", "wrong", "order", "refuted"),
    first(
        2,
        [
            ("after_order", deaf, Order.ESTOP, "S-ESTOP"),
            ("after_order", starts_early, Order.START, "S-CLEAR"),
            ("after_tick", resets_itself, None, "S-FINAL"),
            ("after_tick", holds_on, None, "S-LIMIT"),
        ],
    ),
)
def test_a_mistake_is_refuted_with_an_example(
    name: str,
    wrong: Callable[..., State],
    order: Order | None,
    refuted: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(machine, name, wrong)
    found = {step.statement: step for step in kept(Symbols(), order)}
    assert found[refuted].answer is Answer.REFUTED
    assert found[refuted].counterexample[0].startswith("mode = ")
    assert found["S-ARM"].answer is Answer.PROVED


def test_a_wrong_beginning_is_refuted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proving, "initial", lambda now_s: replace(initial(now_s), waits=True))
    assert next(steps()).answer is Answer.REFUTED


# --- functions on symbols -----------------------------------------------------------------------


def test_all_ways_of_a_function_are_gone_once() -> None:
    symbols = Symbols()
    a, b = symbols.number("a"), symbols.number("b")
    yes = symbols.truth("yes")

    def run() -> str:
        if a < b:
            return "less" if yes else "less, no"
        if a > b:
            return "more"
        return "equal" if a - b >= 0 else "never"

    assert sorted(symbols.ways(run)) == ["equal", "less", "less, no", "more"]


def test_an_example_goes_the_way_that_was_gone() -> None:
    symbols = Symbols()
    a, b = symbols.number("a"), symbols.number("b")
    found = {answer: symbols.example() for answer in symbols.ways(lambda: bool(a - b > b))}
    for answer, example in found.items():
        values = {name: eval(value) for name, value in (one.split(" = ") for one in example)}
        assert (values["a"] - values["b"] > values["b"]) is answer


def test_what_was_answered_is_not_asked_again() -> None:
    symbols = Symbols()
    yes = symbols.truth("yes")
    assert sorted(symbols.ways(lambda: (bool(yes), bool(yes)))) == [(False, False), (True, True)]
