"""Each invariant can be broken: a step that breaks it, and one next to it that does not."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from koord.runtime.drivers.setpoints import Arm, Disarm, Hold, Land, Velocity
from koord.runtime.guardian.events import Order
from koord.runtime.guardian.invariants import INVARIANTS, Transition, broken, is_whole
from koord.runtime.guardian.limits import EstopAction
from koord.runtime.guardian.modes import Facts, Mode, State
from tests.runtime.guardian.guarded import DRONE

WELL = Facts(tripped=False, outside=False, critical=False, at_rest=False)
BAD = replace(WELL, tripped=True)
WISH = Velocity((0.1, 0.0, 0.0))


def state(mode: Mode, **more: object) -> State:
    """A state at 20 s, in which a mode began at 15 s and all has been well since 12 s."""
    held_since_s = 15.0 if mode is Mode.HOLDING else None
    return replace(State(mode, 20.0, 15.0, 12.0, held_since_s), **more)


RUNS = Transition(DRONE, state(Mode.RUNNING), state(Mode.RUNNING), WISH, facts=WELL, wish=WISH)
HOLDS = Transition(DRONE, state(Mode.HOLDING), state(Mode.HOLDING), Hold(), facts=WELL)
RESUMES = replace(
    RUNS,
    before=state(Mode.HOLDING),
    after=state(Mode.RUNNING, since_s=20.0, held_since_s=15.0),
)
RAN = {"since_s": 19.5, "held_since_s": 15.0}  #: for half a second, after it had held
HOLDS_AGAIN = replace(
    HOLDS,
    before=state(Mode.RUNNING, **RAN),
    after=state(Mode.HOLDING, since_s=20.0, clear_since_s=None),
    facts=BAD,
)
ENTERS_ESTOP = Transition(
    DRONE,
    state(Mode.RUNNING),
    state(Mode.ESTOPPED, since_s=20.0),
    Land(),
    Order.ESTOP,
)
ARMED = Transition(DRONE, state(Mode.ARMED), state(Mode.ARMED), Arm(), facts=WELL)
IS_RESET = Transition(
    DRONE,
    state(Mode.ESTOPPED, at_rest=True),
    state(Mode.DISARMED, since_s=20.0, at_rest=True),
    Disarm(),
    Order.RESET,
)


@pytest.mark.parametrize("good", [RUNS, HOLDS, RESUMES, HOLDS_AGAIN, ENTERS_ESTOP, ARMED, IS_RESET])
def test_good_steps_break_nothing(good: Transition) -> None:
    assert list(broken(good)) == []


@pytest.mark.parametrize(
    ("claim", "wrong"),
    [
        ("S-STILL", replace(HOLDS, setpoint=WISH)),
        ("S-ARM", replace(HOLDS, setpoint=Arm())),
        ("S-WISH", replace(RUNS, setpoint=Velocity((0.1, 0.0, 0.1)))),
        ("S-WISH", replace(RUNS, facts=BAD)),
        ("S-WISH", replace(RUNS, facts=None, order=Order.START)),
        ("S-ANSWER", replace(RUNS, setpoint=None)),
        ("S-ANSWER", replace(ENTERS_ESTOP, before=ENTERS_ESTOP.after, setpoint=None)),
        ("S-ANSWER", replace(IS_RESET, setpoint=None)),
        ("S-LIMIT", replace(HOLDS, after=state(Mode.HOLDING, held_since_s=10.0))),
        ("S-LIMIT", replace(HOLDS, after=state(Mode.HOLDING, held_since_s=16.0))),
        ("S-LIMIT", replace(HOLDS_AGAIN, after=state(Mode.HOLDING, held_since_s=20.0))),
        ("S-LIMIT", replace(HOLDS_AGAIN, before=state(Mode.RUNNING, held_since_s=5.0))),
        ("S-LIMIT", replace(RUNS, after=state(Mode.RUNNING, held_since_s=5.0))),
        ("S-CRITICAL", replace(HOLDS, facts=replace(BAD, critical=True))),
        ("S-ESTOP", replace(ENTERS_ESTOP, after=ENTERS_ESTOP.before)),
        ("S-ESTOP", replace(ENTERS_ESTOP, setpoint=Hold())),
        ("S-ESTOP", replace(ENTERS_ESTOP, limits=replace(DRONE, estop=EstopAction.DISARM))),
        ("S-FINAL", replace(IS_RESET, order=Order.START)),
        ("S-FINAL", replace(IS_RESET, after=state(Mode.ARMED, since_s=20.0))),
        ("S-FINAL", replace(RESUMES, before=state(Mode.LANDING))),
        ("S-FINAL", replace(RESUMES, before=state(Mode.STOPPED))),
        ("S-PEOPLE", replace(RESUMES, before=state(Mode.ARMED))),
        ("S-PEOPLE", replace(RESUMES, before=state(Mode.DISARMED))),
        ("S-PEOPLE", replace(RESUMES, before=state(Mode.HOLDING, waits=True))),
        ("S-WAITS", replace(HOLDS, before=state(Mode.HOLDING, waits=True))),
        ("S-WAITS", replace(HOLDS, facts=replace(BAD, outside=True))),
        ("S-WAITS", replace(HOLDS, facts=None, order=Order.STOP)),
        ("S-WAITS", replace(RUNS, after=state(Mode.RUNNING, waits=True))),
        ("S-CLEAR", replace(RESUMES, after=state(Mode.RUNNING, since_s=20.0, clear_since_s=19.5))),
        ("S-CLEAR", replace(HOLDS, facts=BAD)),
        ("S-CLEAR", replace(HOLDS, before=state(Mode.HOLDING, clear_since_s=None))),
        ("S-DROP", replace(IS_RESET, after=state(Mode.DISARMED, since_s=20.0))),
        ("S-DROP", replace(ENTERS_ESTOP, setpoint=Disarm())),
        ("S-TIME", replace(HOLDS, after=state(Mode.HOLDING, now_s=19.0))),
        ("S-TIME", replace(HOLDS, after=state(Mode.HOLDING, since_s=16.0))),
        ("S-TIME", replace(RESUMES, after=state(Mode.RUNNING))),
        ("S-TIME", replace(HOLDS, after=state(Mode.HOLDING, clear_since_s=21.0))),
    ],
)
def test_a_step_that_breaks_an_invariant_is_seen(claim: str, wrong: Transition) -> None:
    assert claim in list(broken(wrong))


def test_each_invariant_is_broken_above() -> None:
    marks = test_a_step_that_breaks_an_invariant_is_seen.pytestmark  # type: ignore[attr-defined]
    assert {claim for claim, _ in marks[0].args[1]} == set(INVARIANTS)


def test_a_state_that_no_step_leaves_is_not_whole() -> None:
    assert is_whole(state(Mode.HOLDING, waits=True))
    assert not is_whole(state(Mode.ARMED, waits=True))
    assert not is_whole(state(Mode.ARMED, since_s=21.0))
    assert not is_whole(state(Mode.ARMED, clear_since_s=21.0))
    assert not is_whole(state(Mode.ARMED, held_since_s=15.0))
    assert not is_whole(state(Mode.HOLDING, held_since_s=None))
    assert not is_whole(state(Mode.HOLDING, held_since_s=21.0))
