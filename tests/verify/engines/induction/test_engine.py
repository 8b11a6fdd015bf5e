"""Inductive proofs: what they prove holds for ever, and what does not hold they never prove."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from koord.semantics.recordings import Recording
from koord.syntax import core
from koord.syntax.system import System, dealt
from koord.syntax.types import BOOL, FLOAT, INT, ArrayType, ListType, RecordType
from koord.verify.bounded_check import BoundedCheck, Unroller
from koord.verify.claims import Claim, ClaimPhase, claims_of
from koord.verify.effort import PER_SECOND, Deadline, Effort
from koord.verify.engines.engine import Task
from koord.verify.engines.induction import engine as induction
from koord.verify.engines.induction.engine import ANSWERED_S, PROOF_S, InductionEngine
from koord.verify.engines.induction.proving import Inductive, prove
from koord.verify.ledger import Ledger, VerificationProblem
from koord.verify.reduction.problems import plain_problem
from koord.verify.verdicts import Bounds, Counterexample
from tests.semantics import programs
from tests.semantics.building import (
    PID,
    STOP,
    TRUE,
    TRYSTOP,
    Build,
    E,
    I,
    J,
    bound,
    contract,
    e,
    exists,
    forall,
    length,
    lst,
    ran,
    rec,
    stopped,
    when,
)
from tests.verify.asking import bounded, inductive

PAIR = RecordType("Pair", (("a", INT), ("b", INT)))


def counting(limit: int = 5) -> Build:
    b = Build("counting")
    n = b.local("n", INT, 0)
    b.event("Up", n < limit, n.set(n + 1))
    b.invariant("Low", forall(I, n.at(I) <= limit))
    return b


def test_an_inductive_invariant_is_proved_for_all_rounds() -> None:
    proved, reasons = inductive(counting().program())
    assert proved == {"Low", "no fault"}
    assert reasons == {}


def test_what_is_true_need_not_be_inductive() -> None:
    b = counting(2)
    n = core_local(b)
    # 3 is never reached, but nothing says so of 7 → 8.
    b.invariant("Not8", forall(I, n.at(I).ne(8)))
    b.event("Jump", n > 6, n.set(8))
    assert inductive(b.program(), depth=1)[0] == {"Low", "no fault", "Not8"}
    b.properties.pop(0)
    proved, reasons = inductive(b.program())
    assert (proved, reasons) == ({"no fault"}, {"Not8": "not inductive"})


def core_local(b: Build, slot: int = 0) -> E:
    return E(core.Read(core.Place(b.kind.locals[slot].variable)))


def test_claims_serve_each_other_as_lemmas_and_the_false_ones_do_not() -> None:
    """What fails is dropped, and what rested on it is asked again."""
    b = Build()
    x, y = b.local("x", INT, 0), b.local("y", INT, 0)
    b.event("Go", TRUE, y.set(x), x.set(x + 1))
    b.invariant("Ordered", forall(I, y.at(I) <= x.at(I)))
    b.invariant("Small", forall(I, x.at(I) < 3))
    b.invariant("Smaller", forall(I, y.at(I) < 3))
    # Smaller is inductive given Small, which is false.
    proved, reasons = inductive(b.program())
    assert proved == {"Ordered", "no fault"}
    assert set(reasons) == {"Small", "Smaller"}


def test_a_longer_step_proves_more() -> None:
    """A value that comes two rounds after the one it is copied from."""
    b = Build()
    x, y = b.local("x", INT, 0), b.local("y", INT, 0)
    b.event("Shift", TRUE, y.set(x), x.set(0), urgent=True)
    b.invariant("Zero", forall(I, y.at(I).eq(0)), at_round=True)
    assert inductive(b.program(), depth=1)[0] == {"no fault"}
    assert inductive(b.program(), depth=2)[0] == {"no fault", "Zero"}


def test_the_base_of_a_longer_step_is_asked_for() -> None:
    """[PROP-INVARIANT]: an invariant that breaks in round 2 is not proved by a step of three."""
    for depth in (1, 2, 3):
        for rounds in (1, 2, 3):
            proved, _ = inductive(programs.late_violation(rounds), depth=depth)
            assert proved == {"no fault"}


def test_a_step_of_three_rounds_rests_on_two_that_were_looked_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """NotTwo breaks in the second round, yet no three rounds without that lead to it."""
    b = Build("late")
    n = b.local("n", INT, 0)
    b.event("Count", TRUE, n.set(n + 1), urgent=True)
    b.invariant("Low", forall(I, n.at(I) >= 0))
    b.invariant("NotTwo", forall(I, n.at(I).ne(2)))
    system = dealt(b.program(), 1)
    claims = claims_of(system)
    ledger = Ledger(VerificationProblem(system, _unasked, system), Bounds(9), Deadline(), claims)
    look = BoundedCheck.check

    def tired(self: BoundedCheck, claims: Any, proved: Any, rounds: int, *rest: Any) -> Any:
        self.tired = rounds > 0
        return {} if self.tired else look(self, claims, proved, rounds, *rest)

    monkeypatch.setattr(BoundedCheck, "check", tired)
    InductionEngine(Unroller()).work(ledger, Task())
    assert [claim.name for claim in ledger.open()] == ["NotTwo"]


def _unasked(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
    raise AssertionError("nothing is to be replayed")


# --- the moments of a round -----------------------------------------------------------------------


def test_what_breaks_in_the_middle_of_a_round_only_is_not_proved() -> None:
    """[PROP-INVARIANT] [PROP-ROUND]: the model puts the port right again."""
    b = Build()
    goal = b.actuator("wish", INT, 0)
    b.module("Unit", [goal.set(0)])
    b.event("Ask", TRUE, goal.set(3))
    b.invariant("Calm", forall(I, goal.at(I).eq(0)))
    b.invariant("CalmAtRound", forall(I, goal.at(I).eq(0)), at_round=True)
    system = dealt(b.program(), 2)
    # Asked of the middle too, though the end is all right.
    claims = claims_of(system)
    result = prove(system, claims, (), Deadline())
    assert {c.name for c in result.proved} == {"CalmAtRound", "no fault"}


def test_what_breaks_inside_a_round_only_is_not_proved() -> None:
    """[T-PREFIX]: everybody moves, so it is seen only while some have not."""
    b = Build()
    x = b.local("x", BOOL, False)
    b.event("Flip", TRUE, x.set(~x), urgent=True)
    together = forall(I, forall(J, x.at(I).eq(x.at(J))))
    b.invariant("Together", together)
    b.invariant("AtRound", together, at_round=True)
    system = dealt(b.program(), 2)
    result = prove(system, claims_of(system), (), Deadline())
    assert {c.name for c in result.proved} == {"AtRound", "no fault"}


def test_faults_and_contracts_and_updates_are_asked_for_too() -> None:
    """[FAULT] [PROP-CONTRACT] [LOST-UPDATE]"""
    b = Build()
    x, y = b.allwrite("x", INT, 0), b.allwrite("y", INT, 0)
    heat = b.sensor("heat", INT, 0)
    falls = contract("Falls", [heat > 5], [heat.primed < 5])
    keeps = contract("Keeps", [heat > 5], [heat.primed > 5])
    b.module("Unit", [heat.set(heat + 1)], contracts=[falls, keeps])
    b.event("Up", x.ne(7), x.set(x + 1), when(x.eq(9), y.set(e(1, INT) / (x - 9))))
    b.event("Locked", TRUE, b.atomic(y.set(y + 1)))
    system = dealt(b.program(), 2)
    proved, reasons = inductive(system)
    # Nobody updates y outside of its lock.
    assert proved == {"contract Keeps"}
    assert set(reasons) == {"no fault", "contract Falls", "no lost update of x"}


# --- where a step begins --------------------------------------------------------------------------


def test_what_nobody_writes_is_as_it_was_after_init() -> None:
    """[INIT]: constants that a run begins with, assumptions about them, and their lengths."""
    b = Build()
    start = b.local("start", INT, core.Start.ARBITRARY)
    goal = b.allread("goal", INT, PID + 3)
    route = b.local("route", ListType(INT), lst(INT, 1, 2, 3))
    near = b.local("near", FLOAT, 0)
    b.assume(forall(I, (start.at(I) >= 0) & (start.at(I) < 2)))
    k = b.local("k", INT, 0)
    b.event("Go", TRUE, k.set(start), route[k].set(goal[PID]), near.set(0))
    b.invariant("Start", forall(I, k.at(I) < 2))
    b.invariant("Goal", forall(I, goal[I].eq(I + 3)))
    b.invariant("Length", forall(I, length(route.at(I)).eq(3)))
    assert inductive(b.program())[0] == {"Start", "Goal", "Length", "no fault"}


def test_what_somebody_writes_may_be_anything() -> None:
    """By an event, in a part, through a loop, by the other kind, in the environment, in INIT."""
    b = Build("writes")
    x = b.allwrite("x", PAIR, rec(PAIR, 0, 0))
    b.agent("One")
    n = b.local("n", INT, 0)
    b.event("Go", n > 3, x.field("a").set(1))
    b.agent("Two")
    m, heat = b.local("m", ArrayType(INT, 2), array_of(0, 0)), b.sensor("heat", INT, 0)
    b.module("Unit", [when(heat > 3, heat.set(0))])
    b.event("Go", heat > 4, m[0].set(1))
    b.invariant("A", x.field("a").eq(0))
    b.invariant("M", forall(I, m.at(I)[0].eq(0), core.RobotRange(1)))
    b.invariant("Heat", forall(I, heat.at(I).eq(0), core.RobotRange(1)))
    b.invariant("N", forall(I, n.at(I).eq(0), core.RobotRange(0)))
    # n is never written, so One never goes; heat is, so Two may, as far as the text tells.
    proved, _ = inductive(System(b.program(), (0, 1)))
    assert {"A", "N", "Heat"} <= proved
    b.properties.pop(2)
    proved, _ = inductive(System(b.program(), (0, 1)))
    assert "M" not in proved


def array_of(*items: int) -> E:
    return E(
        core.MakeList(tuple(core.Const(item, INT) for item in items), ArrayType(INT, len(items)))
    )


def test_sensors_without_a_model_may_be_anything_after_a_round() -> None:
    """[ENV-FREE]"""
    b = Build()
    heat = b.sensor("heat", INT, 0)
    b.module()
    x = b.local("x", INT, 0)
    b.event("Go", heat.eq(0), x.set(1))
    b.event("Other", heat.eq(5), x.set(7))
    b.invariant("One", forall(I, x.at(I) <= 1))
    assert "One" not in inductive(b.program())[0]
    assert bounded(b.program(), rounds=3).rounds == {"One": 2}


def test_a_status_is_one_that_the_program_gives() -> None:
    """[STOP]: without ``stop`` nobody is stopped; with it a stopped robot stays so."""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(x + 1))
    b.invariant("Running", forall(I, ~stopped(I)))
    assert "Running" in inductive(b.program())[0]
    b.event("End", x > 5, STOP)
    assert "Running" not in inductive(b.program())[0]
    b.event("Ask", x < 0, TRYSTOP)
    b.invariant("Done", exists(I, stopped(I)) >> exists(I, x.at(I) > 5))
    # With one robot nothing moves once it has stopped.
    assert "Done" not in inductive(b.program(), robots=2)[0]


def test_who_asked_goes_on_until_all_have() -> None:
    """[STOP] [END-PROG]: and no longer: the last who asks does nothing after it."""
    b = Build()
    n = b.local("n", INT, 0)
    b.event("Ask", n.eq(0), TRYSTOP, n.set(1))
    b.event("Late", n.eq(1), n.set(2))
    b.invariant("NotAll", ~forall(I, n.at(I).eq(2)))
    b.invariant("None", forall(I, n.at(I) < 2))
    assert bounded(b.program(), robots=1, rounds=4).rounds == {}
    assert bounded(b.program(), robots=2, rounds=4).rounds == {"None": 2}
    assert not {"NotAll", "None"} & inductive(b.program(), robots=2)[0]


def test_the_event_that_ran_is_one_of_the_robots() -> None:
    """[PROP-RAN]"""
    b = Build()
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(1))
    b.invariant("Ran", forall(I, ran(0, I) >> x.at(I).eq(1)))
    assert inductive(b.program())[0] == {"Ran", "no fault"}


def test_what_is_set_stays_set() -> None:
    """[ATOM]: and what was unset after INIT may still be."""
    b = Build()
    x, y, n = b.local("x", INT, 0), b.local("y", INT), b.local("n", INT, 0)
    b.event("Copy", n > 0, x.set(y))
    b.event("Write", n.eq(0), y.set(4), n.set(1))
    proved, reasons = inductive(b.program())
    assert proved == set()
    assert reasons == {"no fault": "not inductive"}
    # That it is set once n is not 0 would be the lemma; as it is, search or BMC has to help.
    assert bounded(b.program(), rounds=4).rounds == {}


def test_a_lock_makes_an_invariant_inductive() -> None:
    """[ATOMIC] [T-ONE-WINNER]"""
    b = Build()
    owner, mine = b.allwrite("owner", INT, -1), b.local("mine", BOOL, False)
    take = (owner.set(PID), mine.set(True))
    b.event("Take", owner.eq(-1), b.atomic(*take))
    b.invariant("Mine", forall(I, mine.at(I) >> owner.eq(I)))
    assert "Mine" in inductive(b.program(), robots=3)[0]
    (agent,) = b.program().agents
    unlocked = replace(agent.events[0], effect=take, lock_classes=frozenset())
    program = replace(b.program(), agents=(replace(agent, events=(unlocked,)),))
    assert "Mine" not in inductive(program, robots=3)[0]
    assert bounded(program, robots=3).rounds["Mine"] == 1


# --- limits ---------------------------------------------------------------------------------------


def test_lists_of_any_length_are_not_covered_and_not_claimed_to_be() -> None:
    """[ATOM]: a list that is written whole may have any length after a round."""
    b = Build()
    x = b.local("x", ListType(INT), lst(INT))
    b.event("Grow", TRUE, x.append(1))
    b.invariant("Short", forall(I, length(x.at(I)) <= 3))
    proved, reasons = inductive(b.program(), robots=1)
    assert proved == set()
    assert all(why == "not inductive" or "not covered" in why for why in reasons.values())
    assert bounded(b.program(), robots=1, rounds=4).rounds == {"Short": 4}


def test_lists_that_only_a_question_brings_in_are_not_covered_either() -> None:
    """[EXTERNAL]: a function of the property's answers with lists of any length."""
    b = Build()
    n, path = bound("n", 0, INT), bound("result", 1, ListType(INT))
    b.external("path", [n], path)
    x = b.local("x", INT, 0)
    b.event("Go", x < 5, x.set(x + 1))
    b.invariant("Short", forall(I, length(b.ask("path", x.at(I))) <= 3))
    proved, reasons = inductive(b.program(), robots=1)
    assert proved == set()
    assert "not covered" in reasons["Short"]


def test_out_of_time_nothing_is_proved() -> None:
    system = dealt(programs.sum_of_ids(), 3)
    result = prove(system, claims_of(system), (), Deadline.after(0))
    # What nothing in the program can break needs no question.
    assert {c.name for c in result.proved} == {"no fault"}
    assert set(result.reasons.values()) == {"timeout"}


@pytest.mark.parametrize("program", programs.RUNNING, ids=lambda p: p.name)
def test_proofs_and_violations_never_meet(program: core.Program) -> None:
    proved, _ = inductive(program)
    assert not proved & set(bounded(program, rounds=4).rounds)


def test_where_all_is_answered_proofs_cost_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claims that were seen to hold as far as was asked are proved for all rounds, or soon not."""
    b = Build("answered")
    n = b.local("n", INT, 0)
    b.event("Count", n < 9, n.set(n + 1))
    b.invariant("Low", forall(I, n.at(I) < 99))
    system = dealt(b.program(), 2)
    given: list[int] = []

    def attempt(*of: Any, **more: Any) -> Inductive:
        effort: Effort = of[4]
        given.append(effort.left)
        return Inductive({}, {}, {})

    monkeypatch.setattr(induction, "prove", attempt)
    for rounds in (2, 20):
        ledger = Ledger(plain_problem(system), Bounds(rounds), Deadline(), claims_of(system))
        unrolling = Unroller()
        unrolling.through(ledger, 2)
        InductionEngine(unrolling).work(ledger, Task(rounds=1))
    assert given == [int(ANSWERED_S * PER_SECOND), int(PROOF_S * PER_SECOND)]
