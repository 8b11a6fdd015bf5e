"""Bounded model checking: what breaks, in the first round that can break it, shown by a run."""

from __future__ import annotations

from fractions import Fraction
from functools import partial
from typing import Any

import pytest
from msgspec.structs import replace

from koord.semantics.domain import EXACT
from koord.semantics.recordings import execute
from koord.syntax import core
from koord.syntax.faults import FaultKind
from koord.syntax.system import Status, dealt
from koord.syntax.types import BOOL, FLOAT, INT, ListType, MapType, Type
from koord.verify import bounded_check
from koord.verify.bounded_check import BoundedCheck
from koord.verify.claims import ClaimPhase, claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.moments import SymbolicConfiguration
from koord.verify.encoding.unrolling import Unrolling
from tests.semantics import programs
from tests.semantics.building import (
    PID,
    TRUE,
    TRYSTOP,
    Build,
    I,
    J,
    array,
    bound,
    contract,
    e,
    exists,
    forall,
    length,
    lst,
    ran,
    stopped,
    table,
    when,
)
from tests.verify.asking import Checked, bounded, judged


def lasts(checked: Checked, name: str) -> str:
    """The rule of the step that a counterexample ends with."""
    shown = checked.violated[name]
    return list(execute(EXACT, checked.system, shown.recording))[-1].rule


# --- properties -----------------------------------------------------------------------------------


@pytest.mark.parametrize("rounds", [1, 2, 4])
def test_a_violation_is_found_in_the_first_round_that_has_one(rounds: int) -> None:
    """[PROP-INVARIANT]: after the program turns of the round in which it breaks."""
    program = programs.late_violation(rounds)
    assert bounded(program, rounds=rounds - 1).rounds == {}
    checked = bounded(program, rounds=rounds + 2)
    assert checked.rounds == {"Small": rounds}
    assert len(checked.violated["Small"].recording.rounds) == rounds
    assert lasts(checked, "Small") in ("EVENT-TRANS", "SKIP")


def test_what_breaks_after_init_breaks_in_round_0() -> None:
    """[INIT]: a run without rounds shows it."""
    b = Build()
    x = b.local("x", INT, PID)
    b.event("Go", TRUE, x.set(x + 1))
    b.invariant("Zero", forall(I, x.at(I).eq(0)))
    checked = bounded(b.program())
    assert checked.rounds == {"Zero": 0}
    assert checked.violated["Zero"].phase is ClaimPhase.INIT
    assert checked.violated["Zero"].recording.rounds == ()


def test_a_moment_inside_a_round_counts() -> None:
    """[T-PREFIX]: one robot has moved and the other has not, though both must."""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(x + 1), urgent=True)
    together = forall(I, forall(J, x.at(I).eq(x.at(J))))
    b.invariant("Together", together)
    b.invariant("AtRound", together, at_round=True)
    checked = bounded(b.program(), robots=3, rounds=3)
    assert checked.rounds == {"Together": 1}
    assert checked.violated["Together"].phase is ClaimPhase.INSIDE
    # Those that have not moved are not in the run.
    assert len(checked.violated["Together"].recording.rounds[-1].order) < 3


def test_at_round_means_after_init_and_after_the_environments_turn() -> None:
    """[PROP-ROUND]: a port that the model puts right again in the same round."""
    b = Build()
    heat, goal = b.sensor("heat", INT, 0), b.actuator("wish", INT, 0)
    b.module("Unit", [heat.set(goal), goal.set(0)])
    b.event("Ask", TRUE, goal.set(3))
    b.invariant("Calm", forall(I, goal.at(I).eq(0)))
    b.invariant("CalmAtRound", forall(I, goal.at(I).eq(0)), at_round=True)
    b.invariant("Cold", forall(I, heat.at(I) < 3), at_round=True)
    checked = bounded(b.program(), robots=1)
    assert checked.rounds == {"Calm": 1, "Cold": 1}
    assert checked.violated["Calm"].phase is ClaimPhase.MIDDLE
    assert checked.violated["Cold"].phase is ClaimPhase.END
    assert lasts(checked, "Cold") == "ENV-TRANS"


def test_a_port_may_break_an_invariant_in_the_environments_turn() -> None:
    """[PROP-INVARIANT]: also in a function, and the store still counts before it."""
    b = Build()
    heat = b.sensor("heat", INT, 0)
    b.module("Unit", [heat.set(heat + 1)])
    n = bound("n", 0, INT)
    b.function("low", [n], BOOL, core.Return((n < 2).expr))
    b.invariant("Low", forall(I, b.call("low", heat.at(I))))
    b.event("Nothing", e(False, BOOL))
    assert bounded(b.program(), robots=1).rounds == {"Low": 2}


def test_a_statement_that_faults_does_not_hold() -> None:
    """[PROP-FAULT]: an entry that is not there, in a formula that would hold without it."""
    b = Build()
    x = b.local("x", ListType(INT), lst(INT, 0))
    b.event("Drop", e(0, INT) < length(x), x.pop())
    b.invariant("First", forall(I, ~x.at(I)[0].ne(0)))
    b.invariant("Guarded", forall(I, (e(0, INT) < length(x.at(I))) >> x.at(I)[0].eq(0)))
    b.invariant("Nobody", ~(x.at(7)[0].eq(5)))
    checked = bounded(b.program())
    assert checked.rounds == {"Nobody": 0, "First": 1}


def test_ran_and_stopped_in_properties() -> None:
    """[PROP-RAN] [PROP-STOPPED]: who asked goes on running events until all have."""
    b = Build()
    n = b.local("n", INT, 0)
    b.event("Ask", n < 2, TRYSTOP, n.set(n + 1))
    b.invariant("Never", ~exists(I, ran(0, I) & n.at(I).eq(2)))
    b.invariant("NotAlone", exists(I, stopped(I)) >> forall(I, stopped(I)))
    b.invariant("OneAsk", forall(I, n.at(I).eq(2)) >> stopped(0))
    checked = bounded(b.program(), rounds=4)
    assert checked.rounds == {"Never": 2}
    assert all(robot.status != Status.STOPPED for robot in checked.last("Never").robots)


def test_who_has_stopped_runs_no_event() -> None:
    """[STOP]: there is not even a candidate for it, in later rounds either."""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(x + 1), when(PID.eq(0), core.Stop()))
    b.invariant("Once", x.at(0) < 2)
    b.invariant("Ever", x.at(1) < 3)
    checked = bounded(b.program(), rounds=4)
    assert checked.rounds == {"Ever": 3}
    assert not checked.bounded.unreplayed


def test_all_claims_go_on_being_asked_after_one_is_violated() -> None:
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(x + 1))
    for limit in (3, 1, 2):
        b.invariant(f"Below{limit}", forall(I, x.at(I) < limit))
    assert bounded(b.program(), rounds=4).rounds == {"Below1": 1, "Below2": 2, "Below3": 3}


# --- assumptions and what is left open ------------------------------------------------------------


def test_assumptions_restrict_where_runs_begin() -> None:
    """[PROP-ASSUME]: and each counterexample begins there."""
    b = Build()
    x = b.local("x", INT, core.Start.ARBITRARY)
    b.event("Down", x > 0, x.set(x - 1))
    b.assume(forall(I, (x.at(I) >= 2) & (x.at(I) <= 9)))
    b.assume(forall(I, forall(J, I.ne(J) >> x.at(I).ne(x.at(J)))))
    b.invariant("Positive", forall(I, x.at(I) > 0))
    b.invariant("Inside", forall(I, x.at(I) <= 9))
    b.invariant("Both", exists(I, x.at(I) > 0))
    checked = bounded(b.program(), rounds=4)
    assert checked.rounds == {"Positive": 2, "Both": 3}
    starts = [start.value for start in checked.violated["Both"].recording.opening.starts]
    assert sorted(str(value) for value in starts) == ["2", "3"]


def test_an_assumption_that_faults_does_not_hold() -> None:
    """[PROP-FAULT] [PROP-ASSUME]"""
    b = Build()
    x = b.local("x", INT, core.Start.ARBITRARY)
    b.assume(forall(I, (e(6, INT) / x.at(I)).eq(3)))
    b.invariant("Two", forall(I, x.at(I).eq(2)))
    assert bounded(b.program(), rounds=1).rounds == {}


def test_sensors_without_a_model_keep_contracts_and_nothing_else() -> None:
    """[ENV-FREE] [ENV-CONTRACT]: requires before implies ensures after."""
    b = Build()
    heat, on = b.sensor("heat", INT, 0), b.actuator("on", BOOL, False)
    b.module(contracts=[contract("Slow", [~on], [heat.primed <= heat + 1])])
    b.event("Switch", TRUE, on.set(True))
    b.invariant("One", forall(I, heat.at(I) <= 1))
    b.invariant("Calm", forall(I, (heat.at(I) > 2) >> on.at(I)))
    checked = bounded(b.program(), robots=1, rounds=2)
    # Without the switch it is warmer than 1 after two rounds; with it, after one.
    assert checked.rounds == {"One": 1}
    assert bounded(b.program(), robots=1, rounds=3).rounds == {"One": 1, "Calm": 3}


def test_a_contract_of_a_model_is_claimed() -> None:
    """[PROP-CONTRACT]: where its ``requires`` holds and the turn does not fault."""
    b = Build()
    heat = b.sensor("heat", INT, 0)
    zero = b.sensor("zero", INT, 0)
    rises = contract("Rises", [], [heat.primed > heat])
    low = contract("Low", [heat < 2], [heat.primed <= 2])
    never = contract("Never", [heat.eq(3)], [zero.primed.eq(5)])
    model = [heat.set(heat + 1), when(heat.eq(3), zero.set(e(1, INT) / zero))]
    b.module("Unit", model, contracts=[rises, low, never])
    b.event("Nothing", e(False, BOOL))
    checked = bounded(b.program(), robots=1, rounds=5)
    # ``Never`` is broken only in a turn that faults: [FAULT] ends the run there.
    assert checked.rounds == {"no fault": 4}
    broken = contract("Falls", [heat.eq(2)], [heat.primed < heat])
    (agent,) = b.program().agents
    module = replace(agent.modules[0], contracts=(rises, broken))
    program = replace(b.program(), agents=(replace(agent, modules=(module,)),))
    assert bounded(program, robots=1, rounds=5).rounds == {"contract Falls": 3, "no fault": 4}


def test_a_model_reads_the_values_before_the_turn() -> None:
    """[ENV-MODEL]: also behind a write of the same port."""
    b = Build()
    x, y = b.sensor("x", INT, 0), b.sensor("y", INT, -1)
    b.module("Unit", [x.set(x + 1), y.set(x)])
    b.event("Nothing", e(False, BOOL))
    b.invariant("Old", forall(I, y.at(I).eq(x.at(I) - 1)))
    assert bounded(b.program(), robots=1).rounds == {}


def test_choices_range_over_both_bounds() -> None:
    """[CHOOSE]: fresh for each robot and each round."""
    b = Build()
    x = b.sensor("x", FLOAT, 0)
    b.module("Unit", [x.set(x + b.choose(-1, Fraction(1, 2)))])
    b.event("Nothing", e(False, BOOL))
    b.invariant("Low", forall(I, x.at(I) > -2))
    b.invariant("High", forall(I, x.at(I) < 1))
    b.invariant("Apart", forall(I, forall(J, x.at(I) - x.at(J) < Fraction(3, 2))))
    b.invariant("Bounds", forall(I, (x.at(I) >= -3) & (x.at(I) <= Fraction(3, 2))))
    checked = bounded(b.program(), rounds=3)
    assert checked.rounds == {"Low": 2, "High": 2, "Apart": 1}


def test_external_functions_answer_within_their_summaries() -> None:
    """[EXTERNAL]: equal questions get equal answers, fresh ones do not."""
    program = programs.external_planner()
    assert bounded(program, rounds=2).rounds == {}
    b = Build()
    n, up = bound("n", 0, INT), bound("result", 1, INT)
    b.external("above", [n], up, requires=[n >= 0], ensures=[up > n])
    b.external("dice", [n], up, ensures=[up >= 1, up <= n], fresh=True)
    x, y = b.local("x", INT, 0), b.local("y", INT, 0)
    b.event("Ask", TRUE, x.set(b.ask("above", 7)), y.set(b.ask("dice", 6)))
    b.invariant("Eight", forall(I, x.at(I) <= 8))
    b.invariant("Six", forall(I, y.at(I) <= 6))
    b.invariant("Agree", (y.at(0).eq(0)) | y.at(1).eq(0) | y.at(0).eq(y.at(1)))
    assert bounded(b.program(), rounds=1).rounds == {"Eight": 1, "Agree": 1}
    b.event("Wrong", TRUE, x.set(b.ask("above", -1)))
    checked = bounded(b.program(), rounds=1)
    assert "PRECONDITION" in str(checked.last("no fault").fault)


# --- faults ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", FaultKind)
def test_every_kind_of_fault_is_found(kind: FaultKind) -> None:
    """[FAULT] [T-FAULT]: the robot and the kind are those of the run that shows it."""
    checked = bounded(programs.fault_demo(kind), robots=2, rounds=2)
    assert checked.rounds == {"no fault": 1}
    fault = checked.last("no fault").fault
    assert fault is not None
    assert (fault.kind, fault.robot) == (kind, 1)
    assert checked.violated["no fault"].robot == 1


def test_a_guard_that_faults_is_a_fault_and_does_not_oblige() -> None:
    """[SELECT] [SKIP] [FAULT]"""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Go", (e(1, INT) / x).eq(1), urgent=True)
    b.event("Up", x > -3, x.set(x - 1))
    b.invariant("Down", forall(I, x.at(I).eq(0)))
    # It may be selected, and then it faults; nobody has to select it.
    assert bounded(b.program(), robots=1, rounds=2).rounds == {"no fault": 1, "Down": 1}


def test_a_fault_in_an_event_that_would_lose_its_lock_counts() -> None:
    """[FAULT] [T-FAULT]: a robot works its event out before anyone knows who wins."""
    b = Build()
    x, q = b.allwrite("x", INT, 0), b.local("q", INT, 0)
    wins = b.atomic(x.set(x + 1))
    b.event("Win", PID.eq(0), wins, urgent=True)
    b.event("Slip", PID.eq(1) & x.eq(0), b.atomic(x.set(e(1, INT) / q)), urgent=True)
    checked = bounded(b.program(), rounds=1)
    assert checked.rounds == {"no fault": 1}


def test_a_faulted_run_ends() -> None:
    """[FAULT]: no property is asked of a faulted configuration, and nothing follows it."""
    b = Build()
    x, q = b.local("x", INT, 0), b.local("q", INT, 0)
    b.event("Slip", x.eq(0), x.set(5), x.set(e(1, INT) / q), x.set(9), urgent=True)
    b.invariant("Zero", forall(I, x.at(I).eq(0)))
    checked = bounded(b.program(), rounds=3)
    assert checked.rounds == {"no fault": 1}
    assert not checked.bounded.unreplayed


def test_a_fault_in_init_counts_where_the_assumptions_hold() -> None:
    """[INIT] [PROP-ASSUME]: a start that is assumed away cannot fault."""
    b = Build()
    x, y = b.local("x", INT, core.Start.ARBITRARY), b.local("y", INT, 0)
    b.init(y.set(e(6, INT) / x))
    b.assume(forall(I, (x.at(I) >= 0) & (x.at(I) < 3)))
    assert bounded(b.program(), rounds=0).rounds == {"no fault": 0}
    b.assume(forall(I, x.at(I).ne(0)))
    assert bounded(b.program(), rounds=1).rounds == {}


# --- lost updates ---------------------------------------------------------------------------------


def test_an_update_is_lost_if_another_writes_the_location() -> None:
    """[LOST-UPDATE]"""
    assert bounded(programs.counter_race()).rounds == {"Counted": 1, "no lost update of count": 1}
    assert bounded(programs.sum_of_ids(), rounds=2).rounds == {}


def test_writes_at_other_keys_and_indices_lose_nothing() -> None:
    """[LOST-UPDATE] [LOCATION]: by location, not by variable."""
    b = Build()
    x = b.allwrite("x", core_array(), array(INT, 0, 0, 0))
    b.event("Up", TRUE, x[PID].set(x[PID] + 1))
    assert bounded(b.program(), robots=3, rounds=2).rounds == {}
    b.event("Other", x[0].eq(1) & PID.eq(2), x[1].set(7))
    assert bounded(b.program(), robots=3, rounds=3).rounds == {"no lost update of x": 2}
    b = Build()
    m = b.allwrite("m", MapType(INT, INT), table(INT, INT, *((k, 0) for k in range(3))))
    b.event("Up", TRUE, m[PID].set(m[PID] + 1))
    assert bounded(b.program(), robots=3, rounds=2).rounds == {}
    b.event("Other", m[0].eq(1) & PID.eq(2), m[1].set(7))
    assert bounded(b.program(), robots=3, rounds=3).rounds == {"no lost update of m": 2}


def core_array() -> Type:
    return array(INT, 0, 0, 0).type


def test_what_shows_a_lost_update_has_an_update_in_it() -> None:
    """[LOST-UPDATE]: two plain writes that meet lose nothing."""
    b = Build()
    x = b.allwrite("x", INT, 0)
    b.event("Set", PID > 0, x.set(5))
    assert bounded(b.program(), robots=3, rounds=2).rounds == {}
    b.event("Up", PID.eq(0), x.set(x + 1))
    checked = bounded(b.program(), robots=3, rounds=2)
    assert checked.rounds == {"no lost update of x": 1}
    assert checked.violated["no lost update of x"].recording.rounds[0].events[0] == 1


def test_an_update_in_a_round_that_faults_is_not_lost() -> None:
    """[LOST-UPDATE] [FAULT]: the fault ends the run before the other writes."""
    b = Build()
    x, q = b.allwrite("x", INT, 0), b.local("q", INT, 0)
    b.event("Up", TRUE, x.set(x + 1), q.set(e(1, INT) / q))
    checked = bounded(b.program(), rounds=2)
    assert checked.rounds == {"no fault": 1}
    assert not checked.bounded.unreplayed


# --- going on, and giving up ----------------------------------------------------------------------


def test_a_check_goes_on_from_where_it_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[SymbolicConfiguration] = []
    look = bounded_check._look

    def counted(unrolling: Unrolling, moment: SymbolicConfiguration, *rest: Any) -> Any:
        looks.append(moment)
        return look(unrolling, moment, *rest)

    monkeypatch.setattr(bounded_check, "_look", counted)
    system = dealt(programs.late_violation(4), 2)
    check = BoundedCheck(system, partial(judged, system))
    claims = claims_of(system)
    assert check.check(claims, (), 2, Deadline()) == {}
    assert check.completed == 2
    assert len(looks) == 1 + 2 * 2
    (found,) = check.check(claims, (), 6, Deadline()).values()
    assert found.counterexample is not None
    assert found.counterexample.round == 4
    # Nothing was looked at twice: each round has a middle and an end.
    assert len(looks) == 1 + 2 * 6


def test_a_tired_check_goes_on_from_where_it_stopped() -> None:
    """Out of effort is not out of time: with more of it the same configuration is looked at."""
    system = dealt(programs.late_violation(4), 2)
    check = BoundedCheck(system, partial(judged, system))
    claims = claims_of(system)
    assert check.check(claims, (), 2, Deadline()) == {}
    assert check.check(claims, (), 6, Deadline(), Effort(0)) == {}
    assert (check.tired, check.completed, check.reason) == (True, 2, "")
    (verdict,) = check.check(claims, (), 6, Deadline(), Effort.of_seconds(9)).values()
    assert not check.tired
    assert verdict.counterexample is not None
    assert verdict.counterexample.round == 4


def test_out_of_time_says_how_far_it_came() -> None:
    system = dealt(programs.late_violation(4), 2)
    check = BoundedCheck(system, partial(judged, system))
    check.check(claims_of(system), (), 2, Deadline())
    assert check.check(claims_of(system), (), 9, Deadline.after(0)) == {}
    assert (check.completed, check.reason) == (2, "timeout")


def test_equal_seeds_give_equal_recordings() -> None:
    for program in (programs.counter_race(), programs.rover(), programs.external_planner()):
        b = [bounded(program, robots=3, seed=7) for _ in range(2)]
        shown = [{n: c.recording for n, c in one.violated.items()} for one in b]
        assert shown[0] == shown[1]


def test_what_is_proved_is_taken_for_granted() -> None:
    """A claim that is proved need not be asked; nor may it change what others do."""
    system = dealt(programs.sum_of_ids(), 3)
    claims = claims_of(system)
    check = BoundedCheck(system, partial(judged, system))
    assert check.check(claims[1:], claims[:1], 3, Deadline()) == {}
    assert check.completed == 3


def test_kinds_of_robot_and_numbers_of_them() -> None:
    """Locals and events are by kind; a property may speak of one kind."""
    program = programs.two_kinds()
    assert bounded(program, robots=3, rounds=4).rounds == {}
    system = replace(dealt(program, 3), kinds=(1, 0, 0))
    (agent, drone) = program.agents
    thirsty = replace(
        agent, events=(replace(agent.events[0], guard=core.Const(True, BOOL)), *agent.events[1:])
    )
    system = replace(system, program=replace(program, agents=(thirsty, drone)))
    checked = bounded(system, rounds=5)
    assert checked.rounds == {"Fuel": 4}
    events = [round_.events for round_ in checked.violated["Fuel"].recording.rounds]
    assert all(one[1] == 0 for one in events) or all(one[2] == 0 for one in events)
