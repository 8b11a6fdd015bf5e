"""All that can happen to a guardian, in steps of time, and mistakes that this finds."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from koord.runtime.exploration.guardian import VEHICLES, explore_guardian
from koord.runtime.guardian import machine
from koord.runtime.guardian.events import Order
from koord.runtime.guardian.limits import SafetyLimits
from koord.runtime.guardian.modes import Facts, Mode, State, after_order, after_tick
from tests.sampling import first

#: One kind of vehicle by default: the others differ by how they end.
FIRST, *OTHERS = VEHICLES


@pytest.mark.parametrize(
    "vehicle", [FIRST, *(pytest.param(other, marks=pytest.mark.slow) for other in OTHERS)]
)
def test_whatever_happens_the_invariants_hold(vehicle: str) -> None:
    explored = explore_guardian(VEHICLES[vehicle])
    assert explored.violation is None
    assert explored.complete
    assert explored.states > 900


def started(limits: SafetyLimits, state: State, order: Order, now_s: float) -> State:
    """A wrong order: start leads on from stopped."""
    if order is Order.START and state.mode is Mode.STOPPED:
        return replace(state, mode=Mode.RUNNING, since_s=state.now_s)
    return after_order(limits, state, order, now_s)


def patient(limits: SafetyLimits, state: State, facts: Facts, now_s: float) -> State:
    """A wrong tick: whoever is well holds for as long as it likes."""
    if state.mode is Mode.HOLDING and not facts.tripped:
        limits = replace(limits, hold_s=99.0)
    return after_tick(limits, state, facts, now_s)


def hasty(limits: SafetyLimits, state: State, facts: Facts, now_s: float) -> State:
    """A wrong tick: it counts from the first bad tick on how long all is well."""
    after = after_tick(limits, state, facts, now_s)
    return replace(after, clear_since_s=state.clear_since_s or after.clear_since_s)


@pytest.mark.parametrize(
    ("name", "wrong", "claim"),
    first(
        1,
        [
            ("after_order", started, "S-FINAL"),
            ("after_tick", hasty, "S-CLEAR"),
            ("after_tick", patient, "S-LIMIT"),
        ],
    ),
)
def test_a_mistake_is_found_with_its_story(
    name: str, wrong: Callable[..., State], claim: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, name, wrong)
    explored = explore_guardian(VEHICLES["a car"])
    assert explored.violation is not None
    assert explored.violation.broken.claim == claim
    assert explored.violation.story
