"""Replay: legal runs pass, and of every other the first step that is not right is named."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from koord.sampling.policies import AtRandom, First
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.oracle import Phase
from koord.semantics.recordings import Answer, Opening, Recording, Round
from koord.semantics.storage import Cell
from koord.syntax import core
from koord.syntax.faults import FaultKind
from koord.syntax.system import System, dealt
from koord.syntax.types import BOOL, FLOAT, INT
from koord.traces.replay import ExpectedStep, Refused, planned, replay
from koord.traces.trace import Numbers, Trace, Violation, ViolationKind, traced
from tests.generators.runs import recording
from tests.generators.strategies import systems
from tests.sampling import examples
from tests.semantics import programs
from tests.semantics.building import TRUE, Build, I, bound, contract, e, forall
from tests.semantics.driving import NO_TEXT, drive, played


def first_wrong(trace: Trace) -> Refused:
    refused = replay(trace).refused
    assert refused is not None
    return refused


def with_rounds(trace: Trace, change: Callable[[tuple[Round, ...]], tuple[Round, ...]]) -> Trace:
    made = trace.recording
    return replace(trace, recording=Recording(made.opening, change(made.rounds)))


def with_round(trace: Trace, number: int, **changed: object) -> Trace:
    """The trace with one round of its recording changed."""

    def change(rounds: tuple[Round, ...]) -> tuple[Round, ...]:
        return tuple(
            replace(round_, **changed) if round_ is rounds[number] else round_ for round_ in rounds
        )

    return with_rounds(trace, change)


# --- legal runs ---------------------------------------------------------------------------------


@pytest.mark.parametrize("numbers", Numbers)
@pytest.mark.parametrize("program", programs.RUNNING, ids=lambda p: p.name)
@given(seed=st.integers(0, 10**6))
@examples(6)
def test_every_run_made_by_the_rules_is_legal(
    program: core.Program, numbers: Numbers, seed: int
) -> None:
    """[REPLAY] [DOMAIN]: in both domains, without any tolerance."""
    rng = Random(seed)
    play, trace = played(program, AtRandom(rng), rounds=4, numbers=numbers, rng=rng)
    found = replay(trace)
    assert found.refused is None
    assert found.steps == len(list(planned(trace)))
    assert found.rounds == len(trace.recording.rounds)
    assert (trace.violation is None) == (play.violation is None)


@given(system=systems(), seed=st.integers(0, 10**6))
@examples(40)
def test_generated_runs_are_legal(system: System, seed: int) -> None:
    """[REPLAY] [RECORDING]"""
    made = recording(Random(seed), system, 2)
    if made is not None:
        assert replay(traced(NO_TEXT, system, Numbers.EXACT, made)).refused is None


@pytest.mark.parametrize("kind", FaultKind)
def test_a_run_into_a_fault_is_legal(kind: FaultKind) -> None:
    """[REPLAY] [FAULT]"""
    _, trace = played(programs.fault_demo(kind), First(), rounds=3)
    assert trace.configurations[-1].fault is not None
    assert replay(trace).refused is None


def test_a_run_in_one_domain_is_none_of_the_other() -> None:
    """[REPLAY] [DOMAIN]: there is no tolerance."""
    b = Build()
    x = b.sensor("x", FLOAT, Fraction(1, 10))
    b.module("Unit", [x.set(x + Fraction(1, 10))])
    b.event("Nothing", x > 9)
    trace = drive(b.program(), 1).round(None).round(None).round(None).trace()
    wrong = first_wrong(replace(trace, numbers=Numbers.DOUBLE))
    assert (wrong.rule, wrong.step.round) == ("INIT", -1)


# --- schedules ----------------------------------------------------------------------------------


def test_a_robot_that_moves_twice() -> None:
    """[REPLAY] [EVENT-TRANS]"""
    trace = drive(programs.late_violation(), 2).round("Count", "Count").trace()
    wrong = first_wrong(with_round(trace, 0, order=(0, 0)))
    assert wrong.rule == "EVENT-TRANS"
    wrong = first_wrong(with_round(trace, 0, order=(1,)))
    assert wrong.rule == "EVENT-TRANS"


def test_an_event_that_is_not_enabled() -> None:
    """[REPLAY] [SELECT]"""
    trace = drive(programs.sum_of_ids(), 3).round("Add", None, None).round(None, "Add", None)
    wrong = first_wrong(with_round(trace.trace(), 1, order=(1, 0, 2), events=(0, 0, None)))
    assert wrong == Refused(
        "SELECT",
        ExpectedStep("EVENT-TRANS", 1, 0, "Add"),
        "the pre of Add does not hold for robot 0",
    )


def test_an_event_of_a_robot_that_stopped() -> None:
    """[REPLAY] [STOP]"""
    trace = drive(programs.stopping(), 2).round("Ask", "Grow").round("Ask", "Grow")
    trace = trace.round("Ask", "Stop").round(None, None)
    wrong = first_wrong(with_round(trace.trace(), 3, events=(None, 2)))
    assert (wrong.rule, wrong.step) == ("STOP", ExpectedStep("EVENT-TRANS", 3, 1, "Grow"))


def test_a_lock_that_is_taken() -> None:
    """[REPLAY] [ATOMIC]"""
    trace = drive(programs.lock_demo(), 2).round("Left", None).trace()
    wrong = first_wrong(with_round(trace, 0, events=(0, 0)))
    assert (wrong.rule, wrong.step) == ("ATOMIC", ExpectedStep("EVENT-TRANS", 0, 1, "Left"))


def test_a_skip_that_is_not_allowed() -> None:
    """[REPLAY] [SKIP]"""
    trace = drive(programs.lock_demo(urgent=True), 2).go(0, "Left").skip(1).env().trace()
    assert replay(trace).refused is None
    wrong = first_wrong(with_round(trace, 0, order=(1, 0)))
    assert (wrong.rule, wrong.step) == ("SKIP", ExpectedStep("SKIP", 0, 1))


def test_a_step_behind_a_fault() -> None:
    """[REPLAY] [FAULT]"""
    d = drive(programs.fault_demo(FaultKind.INDEX), 3).skip(0).go(1, "Slip")
    trace = d.trace()
    wrong = first_wrong(with_round(trace, 0, order=(0, 1, 2)))
    assert (wrong.rule, wrong.step) == ("FAULT", ExpectedStep("SKIP", 0, 2))


def test_a_round_behind_one_that_was_cut() -> None:
    """[REPLAY] [RECORDING]"""
    trace = drive(programs.late_violation(), 2).go(0, "Count").trace()
    last = trace.configurations[-1]
    longer = with_rounds(trace, lambda rounds: (*rounds, *rounds))
    wrong = first_wrong(replace(longer, configurations=(*trace.configurations, last)))
    assert wrong.step.round == 1


# --- answers ------------------------------------------------------------------------------------


def changed_answers(trace: Trace, number: int, change: Callable[[object], object]) -> Trace:
    answers = tuple(
        replace(a, value=change(a.value)) for a in trace.recording.rounds[number].answers
    )
    return with_round(trace, number, answers=answers)


def test_a_choice_out_of_its_range() -> None:
    """[REPLAY] [CHOOSE]"""
    trace = drive(programs.thermostat(), 2).round(None, None).round(None, None).trace()
    wrong = first_wrong(changed_answers(trace, 1, lambda value: Fraction(3)))
    assert (wrong.rule, wrong.step) == ("CHOOSE", ExpectedStep("ENV-TRANS", 1))


def test_a_choice_that_is_missing() -> None:
    """[REPLAY] [CHOOSE] [EXTERNAL]"""
    trace = drive(programs.thermostat(), 2).round(None, None).trace()
    wrong = first_wrong(with_round(trace, 0, answers=()))
    assert wrong.rule in ("CHOOSE", "EXTERNAL")
    assert wrong.step == ExpectedStep("ENV-TRANS", 0)


def test_an_answer_that_breaks_its_summary() -> None:
    """[REPLAY] [EXTERNAL]"""
    trace = drive(programs.external_planner(), 1).round("Ask").trace()
    wrong = first_wrong(changed_answers(trace, 0, lambda value: 0))
    assert (wrong.rule, wrong.step) == ("EXTERNAL", ExpectedStep("EVENT-TRANS", 0, 0, "Ask"))
    assert "meets its summary" in wrong.reason


def test_an_answer_to_another_question() -> None:
    """[REPLAY] [EXTERNAL]"""
    trace = drive(programs.external_planner(), 1).round("Ask").trace()
    answers = tuple(replace(a, arguments=(99,)) for a in trace.recording.rounds[0].answers)
    wrong = first_wrong(with_round(trace, 0, answers=answers))
    assert wrong.rule == "EXTERNAL"
    assert "other arguments" in wrong.reason


def test_a_function_that_changes_its_mind() -> None:
    """[REPLAY] [EXTERNAL]: of ``extern`` functions, not of fresh ones."""
    d = drive(programs.external_planner(), 1).round("Ask").round("Ask")
    trace = d.trace()
    above = [a for a in trace.recording.rounds[1].answers if a.function == "above"]
    assert len(above) == 1
    answers = tuple(
        replace(a, value=int(str(a.value)) + 1) if a.function == "above" else a
        for a in trace.recording.rounds[1].answers
    )
    wrong = first_wrong(with_round(trace, 1, answers=answers))
    assert (wrong.rule, wrong.step.round) == ("EXTERNAL", 1)
    assert "differently" in wrong.reason


def test_an_answer_that_is_no_number_is_the_same_answer() -> None:
    """[CONFIG] [EXTERNAL]: NaN, which equals nothing, is itself wherever runs are compared."""
    b = Build()
    b.external("near", [bound("x", 0, FLOAT)], bound("result", 1, FLOAT))
    huge, at = b.local("huge", FLOAT, 1e308), b.local("at", FLOAT, 0.0)
    b.event("Ask", TRUE, at.set(b.ask("near", huge * 10 - huge * 10)))
    system = dealt(b.program(), 1)

    def heard() -> Answer:
        none = float("nan")
        return Answer(Phase.PROG, 0, (1,), "near", (none,), float("nan"))

    rounds = tuple(Round((0,), (0,), answers=(heard(),)) for _ in range(2))
    trace = traced(NO_TEXT, system, Numbers.DOUBLE, Recording(Opening((0,)), rounds))
    none = trace.recording.rounds[0].answers[0].arguments
    assert replay(trace).refused is None
    same = replace(heard(), arguments=none), replace(heard(), arguments=none)
    again = tuple(replace(r, answers=(a,)) for r, a in zip(rounds, same, strict=True))
    assert replay(replace(trace, recording=Recording(Opening((0,)), again))).refused is None


def test_answers_that_nobody_asked_for_have_no_effect() -> None:
    """[RECORDING]"""
    trace = drive(programs.external_planner(), 1).round("Ask").trace()
    (first, *_) = trace.recording.rounds[0].answers
    more = (*trace.recording.rounds[0].answers, replace(first, phase=Phase.ENV))
    assert replay(with_round(trace, 0, answers=more)).refused is None


# --- starts and sensors -------------------------------------------------------------------------


def rover_trace() -> Trace:
    return drive(programs.rover(), 2).round(None, None).trace()


def test_a_start_that_is_missing() -> None:
    """[REPLAY] [INIT]"""
    trace = rover_trace()
    opening = replace(trace.recording.opening, starts=())
    recorded = Recording(opening, trace.recording.rounds)
    wrong = first_wrong(replace(trace, recording=recorded))
    assert (wrong.rule, wrong.step) == ("INIT", ExpectedStep("INIT", -1))


def test_a_start_that_is_assumed_away() -> None:
    """[REPLAY] [PROP-ASSUME]"""
    trace = rover_trace()
    starts = tuple(replace(start, value=0) for start in trace.recording.opening.starts)
    opening = replace(trace.recording.opening, starts=starts)
    made = Recording(opening, trace.recording.rounds)
    wrong = first_wrong(replace(trace, recording=made))
    assert (wrong.rule, wrong.step) == ("PROP-ASSUME", ExpectedStep("INIT", -1))
    assert wrong.reason.startswith("Apart does not hold")


def test_a_reading_that_is_missing() -> None:
    """[REPLAY] [ENV-FREE]"""
    wrong = first_wrong(with_round(rover_trace(), 0, readings=()))
    assert (wrong.rule, wrong.step) == ("ENV-FREE", ExpectedStep("ENV-TRANS", 0))


def test_a_reading_that_breaks_a_contract() -> None:
    """[REPLAY] [ENV-CONTRACT]"""
    trace = rover_trace()
    readings = tuple(
        replace(r, value=r.value if isinstance(r.value, bool) else 50)
        for r in trace.recording.rounds[0].readings
    )
    wrong = first_wrong(with_round(trace, 0, readings=readings))
    assert (wrong.rule, wrong.step) == ("ENV-CONTRACT", ExpectedStep("ENV-TRANS", 0))


# --- what was seen ------------------------------------------------------------------------------


def with_configuration(
    trace: Trace,
    number: int,
    change: Callable[[Configuration[Constant]], Configuration[Constant]],
) -> Trace:
    found = list(trace.configurations)
    found[number] = change(found[number])
    return replace(trace, configurations=tuple(found))


def test_a_configuration_that_is_another() -> None:
    """[REPLAY] [CONFIG]: named location by location, with what the rules give."""
    d = drive(programs.sum_of_ids(), 3).round(None, None, "Add").round(None, "Add", None)
    trace = d.trace()

    def poke(c: Configuration[Constant]) -> Configuration[Constant]:
        store = replace(c.store, allwrite=(Cell(True, 5),))
        robots = tuple(replace(r, copy=store) for r in c.robots)
        return replace(c, store=store, robots=robots)

    wrong = first_wrong(with_configuration(trace, 2, poke))
    assert (wrong.rule, wrong.step) == ("ENV-TRANS", ExpectedStep("ENV-TRANS", 1))
    shared = wrong.differences[0]
    assert (shared.robot, shared.name, shared.old, shared.new) == (None, "total", "3", "5")
    copies = [(c.robot, c.name) for c in wrong.differences[1:]]
    assert copies == [(i, "the copy of total") for i in range(3)]


def test_what_robots_ran_and_their_turns_are_compared() -> None:
    """[REPLAY] [CONFIG]"""
    trace = drive(programs.late_violation(), 2).round("Count", None).trace()

    def idle(c: Configuration[Constant]) -> Configuration[Constant]:
        return replace(c, robots=(replace(c.robots[0], ran=-1), c.robots[1]))

    (change,) = first_wrong(with_configuration(trace, 1, idle)).differences
    assert (change.robot, change.name, change.old, change.new) == (
        0,
        "the event run",
        "Count",
        "none",
    )
    counted = with_configuration(trace, 0, lambda c: replace(c, round=7))
    assert first_wrong(counted).differences[0].name == "the number of rounds"


def test_a_configuration_inside_a_round_is_compared() -> None:
    """[REPLAY]: the last one of a round that was cut."""
    trace = drive(programs.late_violation(), 2).go(1, "Count").trace()
    wrong = first_wrong(with_configuration(trace, 1, lambda c: trace.configurations[0]))
    assert wrong.step == ExpectedStep("EVENT-TRANS", 0, 1, "Count")
    assert ("n", "1", "0") in [(c.name, c.old, c.new) for c in wrong.differences]


def test_configurations_that_are_too_few() -> None:
    """[REPLAY]"""
    trace = drive(programs.late_violation(), 2).round(None, None).trace()
    assert first_wrong(replace(trace, configurations=trace.configurations[:1])).rule == "INIT"


def test_output_that_is_another() -> None:
    """[REPLAY] [OUTPUT]"""
    trace = drive(programs.sum_of_ids(), 2).round(None, "Add").trace()
    (said,) = trace.outputs
    other = replace(said, written=replace(said.written, values=(9,)))
    for outputs in ((other,), (replace(said, robot=0),), (), (said, said)):
        assert first_wrong(replace(trace, outputs=outputs)).rule == "OUTPUT"
    assert first_wrong(replace(trace, outputs=(other,))).step.robot == 1


# --- claims -------------------------------------------------------------------------------------


def test_a_violation_is_shown_by_its_trace() -> None:
    """[REPLAY] [PROP-INVARIANT]: and one that is merely claimed is refused."""
    _, trace = played(programs.late_violation(), First(), rounds=9)
    assert trace.violation == Violation(ViolationKind.PROPERTY, "Small", 2, 0)
    assert replay(trace).refused is None
    claimed = replace(
        drive(programs.late_violation(), 3).round(None, None, None).trace(),
        violation=trace.violation,
    )
    wrong = first_wrong(claimed)
    assert wrong.rule == "PROP-INVARIANT"
    unknown = replace(trace, violation=replace(trace.violation, name="Big"))
    assert first_wrong(unknown).rule == "PROP-INVARIANT"


def test_an_invariant_at_round_breaks_between_rounds_only() -> None:
    """[REPLAY] [PROP-ROUND]"""
    b = Build()
    n = b.local("n", INT, 0)
    b.event("Count", n.eq(0), n.set(1))
    b.invariant("Zero", forall(I, n.at(I).eq(0)), at_round=True)
    play, trace = played(b.program(), First(), robots=2)
    assert trace.violation == Violation(ViolationKind.PROPERTY, "Zero", 0, None)
    assert replay(trace).refused is None
    inside = drive(b.program(), 2).go(0, "Count").trace()
    assert first_wrong(replace(inside, violation=trace.violation)).rule == "PROP-ROUND"
    assert play.violation == trace.violation


def test_a_broken_contract_is_shown_by_its_trace() -> None:
    """[REPLAY] [PROP-CONTRACT]"""
    b = Build()
    x = b.sensor("x", INT, 0)
    b.module("Unit", [x.set(x + 1)], contracts=[contract("Low", [], [x.primed < 2])])
    b.event("Nothing", x > 9)
    _, trace = played(b.program(), First(), robots=2)
    assert trace.violation == Violation(ViolationKind.CONTRACT, "Low", 1, 0)
    assert replay(trace).refused is None
    early = drive(b.program(), 2).round(None, None).trace()
    assert first_wrong(replace(early, violation=trace.violation)).rule == "PROP-CONTRACT"


def test_a_lost_update_is_shown_by_its_trace() -> None:
    """[REPLAY] [LOST-UPDATE]"""
    lost = Violation(ViolationKind.LOST_UPDATE, "count", 0, 1)
    trace = drive(programs.counter_race(), 2).go(0, "Add").go(1, "Add").trace()
    assert replay(replace(trace, violation=lost)).refused is None
    alone = drive(programs.counter_race(), 2).go(0, "Add").skip(1).trace()
    assert first_wrong(replace(alone, violation=lost)).rule == "LOST-UPDATE"
    b = Build()
    count = b.allwrite("count", INT, 0)
    b.event("Set", TRUE, count.set(7))
    plain = drive(b.program(), 2).go(0, "Set").go(1, "Set").trace()
    assert first_wrong(replace(plain, violation=lost)).rule == "LOST-UPDATE"


def test_answers_to_properties_travel_with_the_trace() -> None:
    """[REPLAY] [EXTERNAL]: what a property asked of a function is part of the counterexample."""
    b = Build()
    n, good = bound("n", 0, INT), bound("result", 1, BOOL)
    b.external("lucky", [n], good)
    x = b.local("x", INT, 0)
    b.event("Count", TRUE, x.set(x + 1))
    b.invariant("Luck", forall(I, b.ask("lucky", x.at(I))), bound=1)
    _, trace = played(b.program(), First(), rounds=50, robots=2)
    assert trace.violation is not None
    assert replay(trace).refused is None
    silent = first_wrong(with_round(trace, -1, answers=()))
    assert (silent.rule, silent.reason[:22]) == ("EXTERNAL", "no answer of lucky was")


def test_an_answer_to_a_property_has_to_meet_its_summary() -> None:
    """[REPLAY] [EXTERNAL]"""
    b = Build()
    n, good = bound("n", 0, INT), bound("result", 1, BOOL)
    b.external("small", [n], good, ensures=[good.eq(n < 2)])
    x = b.local("x", INT, 0)
    b.event("Count", TRUE, x.set(x + 1))
    b.invariant("Small", forall(I, b.ask("small", x.at(I))), bound=1)
    _, trace = played(b.program(), First(), rounds=3, robots=1)
    assert trace.violation is not None
    assert replay(trace).refused is None
    early = drive(b.program(), 1).round("Count").trace()
    lie = Answer(Phase.CHECK, 0, (0, 0), "small", (1,), False)
    forged = replace(early, violation=replace(trace.violation, round=0))
    assert first_wrong(with_round(forged, -1, answers=(lie,))).rule == "EXTERNAL"


def test_summaries_about_all_values_are_taken_on_trust() -> None:
    """[REPLAY]: and the replay says so."""
    b = Build()
    n, good, p = bound("n", 0, INT), bound("result", 1, BOOL), bound("p", 2, INT)
    every = forall(p, good | p.eq(n), core.AllValues(INT))
    b.external("odd", [n], good, ensures=[every], bound=3)
    x = b.local("x", BOOL, False)
    b.event("Ask", TRUE, x.set(b.ask("odd", e(4, INT))))
    found = replay(drive(b.program(), 1).round("Ask").trace())
    assert (found.refused, found.trusted) == (None, ("odd",))


@given(seed=st.integers(0, 10**6))
@examples(60)
def test_of_two_runs_mixed_something_is_named(seed: int) -> None:
    """[REPLAY]: the recording of one run does not lead to the configurations of another."""
    program = programs.thermostat()
    system = dealt(program, 2)
    a, b = (
        played(program, AtRandom(Random(s)), system=system, rng=Random(s))[1] for s in (seed, 7)
    )
    mixed = replace(a, configurations=b.configurations, outputs=b.outputs)
    if len(mixed.configurations) != len(a.configurations) or mixed == a:
        return
    refused = replay(mixed).refused
    assert (refused is None) == (a.configurations == b.configurations)
    if refused is not None:
        at = refused.step.round + 1
        assert a.configurations[:at] == b.configurations[:at]
        assert a.configurations[at] != b.configurations[at]
