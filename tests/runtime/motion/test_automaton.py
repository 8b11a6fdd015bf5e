"""The motion automaton: the dwell rule to the step of a virtual clock, and every order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.automaton import (
    Automata,
    MotionState,
    Orders,
    Visit,
    initial,
    moves,
    no_orders,
    step,
)

END = np.array([[1.0, 2.0, 3.0]])
FAR = END + 5.0
VISIT = Visit(epsilon_m=0.2, dwell_s=0.5)
STEP_S = 0.05


def ordered(*names: str) -> Orders:
    orders = no_orders(1)
    for name in names:
        getattr(orders, name)[0] = True
    return orders


def after(automata: Automata, *names: str, at: float = 9.0, now_s: float = 0.0) -> Automata:
    """The automaton of one robot, so far from the end of its route, after orders."""
    psn = END + np.array([[at, 0.0, 0.0]])
    return step(automata, ordered(*names), psn, END, now_s, VISIT)


def state(automata: Automata) -> MotionState:
    return MotionState(int(automata.state[0]))


def reached(automata: Automata) -> bool:
    return bool(automata.reached[0])


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.integers(1, 20))
def test_reached_is_set_exactly_after_the_dwell_time(inside: list[bool], dwell_steps: int) -> None:
    """The rule in words: within ε_v at every step of the last δ_v."""
    visit = Visit(epsilon_m=0.2, dwell_s=dwell_steps * STEP_S)
    automata = after(initial(1), "routed")
    run = 0
    was_reached = False
    for k, near in enumerate(inside):
        # Far is beyond ε_v, and not so far that what was reached is left again.
        psn = END + np.array([[0.1 if near else 0.3, 0.0, 0.0]])
        automata = step(automata, no_orders(1), psn, END, (k + 1) * STEP_S, visit)
        run = run + 1 if near else 0
        was_reached = was_reached or run > dwell_steps
        assert reached(automata) == was_reached


def test_who_was_told_nothing_has_reached_it() -> None:
    assert reached(after(initial(1), now_s=9.0))
    assert not reached(after(initial(1), "asked"))
    assert not reached(after(initial(1), "failed"))
    assert not reached(after(initial(1), "stopped"))


def test_the_edge_of_the_ball_belongs_to_it() -> None:
    automata = after(initial(1), "routed", at=0.0)
    exactly = np.array([[1.0 + VISIT.epsilon_m, 2.0, 3.0]])
    edge = float(np.linalg.norm(exactly - END))
    visit = Visit(edge, 0.1)
    for k in range(4):
        automata = step(automata, no_orders(1), exactly, END, 0.1 * k, visit)
        assert reached(automata) == (k >= 1)


def test_a_robot_that_is_pushed_away_comes_back() -> None:
    automata = after(initial(1), "routed", at=0.0, now_s=0.0)
    automata = after(automata, at=0.0, now_s=0.5)
    assert reached(automata)
    assert state(automata) is MotionState.IDLE
    assert moves(automata)[0]  # it keeps its place
    automata = after(automata, at=0.39, now_s=0.6)
    assert reached(automata)
    automata = after(automata, at=0.41, now_s=0.7)
    assert not reached(automata)
    assert state(automata) is MotionState.MOVING


def test_a_new_route_is_not_reached_however_near_its_end() -> None:
    automata = after(after(initial(1), "routed", at=0.0), at=0.0, now_s=0.6)
    assert reached(automata)
    automata = after(automata, "routed", at=0.0, now_s=0.7)
    assert not reached(automata)
    assert state(automata) is MotionState.MOVING
    assert not reached(after(automata, at=0.0, now_s=1.15))
    assert reached(after(automata, at=0.0, now_s=1.2))


def test_a_target_is_planned_first() -> None:
    automata = after(initial(1), "asked")
    assert state(automata) is MotionState.PLANNING
    assert not moves(automata)[0]
    assert state(after(automata, "routed")) is MotionState.MOVING
    failed = after(automata, "failed")
    assert state(failed) is MotionState.IDLE
    assert not moves(failed)[0]
    assert not reached(after(failed, at=0.0, now_s=9.0))


def test_holding_is_gone_back_from() -> None:
    moving = after(initial(1), "routed")
    held = after(moving, "held")
    assert state(held) is MotionState.HOLDING
    assert not moves(held)[0]
    assert state(after(held)) is MotionState.HOLDING
    assert state(after(held, "released")) is MotionState.MOVING
    assert state(after(after(held, "held"), "released")) is MotionState.MOVING


def test_a_route_given_to_one_that_holds_waits() -> None:
    held = after(initial(1), "held")
    routed = after(held, "routed")
    assert state(routed) is MotionState.HOLDING
    assert state(after(routed, "released")) is MotionState.MOVING


def test_stopped_is_for_good() -> None:
    stopped = after(after(initial(1), "routed", at=0.0), "stopped", at=0.0)
    assert state(stopped) is MotionState.STOPPED
    for name in ("routed", "asked", "held", "released", "failed"):
        automata = after(stopped, name, at=0.0, now_s=9.0)
        assert state(automata) is MotionState.STOPPED
        assert not reached(automata)
        assert not moves(automata)[0]


ORDERS = st.lists(st.sampled_from(Orders.__struct_fields__), max_size=2, unique=True)


@given(st.lists(st.tuples(ORDERS, st.sampled_from([0.0, 0.3, 3.0])), max_size=25))
def test_many_robots_behave_as_singly(told: list[tuple[list[str], float]]) -> None:
    """The arrays hold nothing together but the clock; and the step leaves its inputs alone."""
    alone = initial(1)
    many = initial(3)
    for k, (names, at) in enumerate(told):
        orders = no_orders(3)
        for name in names:
            getattr(orders, name)[1] = True
        psn = np.repeat(END + np.array([[at, 0, 0]]), 3, axis=0)
        before = many.state.copy()
        after_many = step(many, orders, psn, np.repeat(END, 3, axis=0), 0.1 * k, VISIT)
        assert np.array_equal(many.state, before)
        many = after_many
        alone = after(alone, *names, at=at, now_s=0.1 * k)
        assert many.state[1] == alone.state[0]
        assert many.reached[1] == alone.reached[0]
        assert many.state[0] == many.state[2] == MotionState.IDLE
        assert many.reached[0]
        if many.reached[1]:
            assert many.has_route[1] or many.state[1] in (MotionState.IDLE, MotionState.HOLDING)


@pytest.mark.parametrize("name", ["asked", "failed"])
def test_reached_never_outlives_its_route(name: str) -> None:
    automata = after(after(initial(1), "routed", at=0.0), at=0.0, now_s=0.6)
    assert reached(automata)
    assert not reached(after(automata, name, at=0.0, now_s=0.7))
