"""Random walks of the guardian over real numbers, NaN and infinity among them."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

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
from koord.runtime.guardian.conditions import judged
from koord.runtime.guardian.events import Condition, Event, Order, Ordered, Other, Ticked
from koord.runtime.guardian.invariants import Transition, broken
from koord.runtime.guardian.limits import EstopAction, SafetyLimits
from koord.runtime.guardian.machine import step
from koord.runtime.guardian.modes import initial
from koord.runtime.protocol.events import Reason
from tests.runtime.guardian.guarded import LEVEL, setup_of

NUMBERS = st.one_of(st.floats(-6, 6), st.sampled_from([0.0, 1e308]), st.floats())
PLACES = st.tuples(NUMBERS, NUMBERS, st.one_of(st.floats(0, 3), NUMBERS))
AGES = st.one_of(st.none(), st.floats(0, 0.6), st.floats())

WISHES: st.SearchStrategy[Wish | None] = st.one_of(
    st.none(),
    st.just(Hold()),
    st.just(Land()),
    st.builds(Velocity, PLACES, NUMBERS),
    st.builds(Drive, NUMBERS, NUMBERS, st.one_of(st.none(), NUMBERS)),
    st.builds(Track, PLACES, PLACES, PLACES, st.one_of(st.none(), NUMBERS)),
    st.builds(Position, PLACES, st.one_of(st.none(), NUMBERS), NUMBERS),
    st.builds(Takeoff, NUMBERS),
)

#: A tick of any numbers, whose time is how much later it is.
WILD = st.builds(
    Ticked,
    now_s=st.one_of(st.floats(0, 1), NUMBERS),
    sensed=st.one_of(
        st.none(),
        st.builds(
            Sensed,
            position_m=PLACES,
            attitude=st.one_of(st.just(LEVEL), st.tuples(*[NUMBERS] * 4)),
            velocity_mps=PLACES,
            measured_at_s=NUMBERS,
            battery=st.one_of(st.none(), st.floats(0, 1), st.floats()),
            armed=st.none(),
            airborne=st.sampled_from([None, True, False]),
            link=st.booleans(),
        ),
    ),
    wish=WISHES,
    round_age_s=AGES,
    holding=st.sampled_from([None, *Reason]),
    others=st.lists(st.builds(Other, st.just(1), PLACES, PLACES, NUMBERS), max_size=2).map(tuple),
    heartbeat_age_s=AGES,
)

#: A tick at which all is well, so much later, of a robot that stands or moves.
TAME = st.builds(
    lambda later_s, speed_mps, airborne, wish: Ticked(
        later_s,
        Sensed((0.0, 0.0, 0.1), LEVEL, (speed_mps, 0.0, 0.0), 0.0, 0.9, airborne=airborne),
        wish,
        0.0,
        heartbeat_age_s=0.0,
    ),
    st.floats(0.0, 2.0),
    st.sampled_from([0.0, 0.2]),
    st.sampled_from([None, True, False]),
    st.sampled_from([None, Hold(), Velocity((0.1, 0.2, 0.0))]),
)

EVENTS = st.lists(st.one_of(TAME, TAME, WILD, st.sampled_from(list(Order))), max_size=60)

LIMITS = st.builds(
    SafetyLimits,
    flies=st.booleans(),
    hold_s=st.floats(0.1, 5),
    resume_s=st.floats(0.1, 2),
    heartbeat_s=st.sampled_from([None, 0.3]),
    estop=st.sampled_from(list(EstopAction)),
)


@given(LIMITS, EVENTS)
def test_walks_keep_the_invariants(limits: SafetyLimits, events: list[Ticked | Order]) -> None:
    setup, state, now_s = setup_of(limits), initial(0.0), 0.0
    for one in [Order.ARM, *events]:
        facts = wish = order = None
        if isinstance(one, Order):
            event: Event = Ordered(now_s, one)
            order = one
        else:
            if math.isfinite(one.now_s):
                now_s += one.now_s
            sensed = one.sensed
            if sensed is not None:
                sensed = replace(sensed, measured_at_s=now_s + sensed.measured_at_s)
            event = replace(one, now_s=now_s, sensed=sensed)
            facts, wish = judged(setup, state, event).facts, event.wish
        after, answer = step(setup, state, event)
        told = Transition(limits, state, after, answer.setpoint, order, facts, wish)
        assert list(broken(told)) == []
        state = after


@given(LIMITS, st.lists(WILD, min_size=1, max_size=20))
def test_a_condition_is_told_when_it_begins_and_when_it_ends(
    limits: SafetyLimits, ticks: list[Ticked]
) -> None:
    """(G-NOTE): what was told last of each condition is what is so."""
    setup, state, told = setup_of(limits), initial(0.0), set[Condition]()
    for tick in ticks:
        after, answer = step(setup, state, tick)
        for note in answer.notes:
            assert note.text
            if note.condition is not None:
                assert (note.condition in told) == note.text.startswith("over: ")
                told ^= {note.condition}
        assert told == after.conditions
        state = after
