"""What a trace holds of a run, and where configurations differ."""

from __future__ import annotations

import math
from fractions import Fraction
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.sampling.policies import AtRandom, First
from koord.semantics.domain import Constant
from koord.semantics.recordings import Concrete, Recording, Round, execute
from koord.semantics.storage import Cell, Storage, Tree
from koord.semantics.values import Rec, Seq, Table, identical
from koord.syntax import core
from koord.syntax.faults import FaultKind
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.syntax.types import BOOL, FLOAT, INT, POS, STRING, ListType, MapType, Type
from koord.traces.changes import changes, differences
from koord.traces.names import Names, distinct
from koord.traces.rendering import show_storage, show_value
from koord.traces.trace import BEFORE_ROUNDS, Numbers, Tracer, assembled, digest, traced
from tests.sampling import examples
from tests.semantics import programs
from tests.semantics.building import PID, TRUE, Build, lst, output, pos, rec
from tests.semantics.driving import NO_TEXT, drive, played
from tests.semantics.strategies import types, values


def test_a_trace_has_the_configurations_between_rounds() -> None:
    """[TRACE]: one before each round, and the one where the run ended."""
    play, trace = played(programs.sum_of_ids(), First(), rounds=3)
    assert [c.round for c in trace.configurations] == [0, 1, 2, 3]
    assert trace.configurations[-1] == play.run.configuration
    assert len(trace.recording.rounds) == 3
    assert trace.violation is None


def test_a_run_that_ends_inside_a_round() -> None:
    """[TRACE] [RECORDING]: the round is cut, and the last configuration lies in it."""
    play, trace = played(programs.counter_race(), AtRandom(Random(2)), rounds=9)
    last = trace.recording.rounds[-1]
    assert play.violation is not None
    assert play.violation.name == "Counted"
    assert last.cut
    assert len(trace.configurations) == len(trace.recording.rounds) + 1
    assert trace.configurations[-1].round == len(trace.recording.rounds) - 1


def test_output_is_kept_with_round_and_robot() -> None:
    """[TRACE] [OUTPUT]"""
    d = drive(programs.sum_of_ids(), 2).round("Add", None).round(None, "Add")
    outputs = d.trace().outputs
    assert [(o.round, o.robot, o.written.values) for o in outputs] == [(0, 0, (0,)), (1, 1, (1,))]


def test_output_of_init_belongs_to_no_round() -> None:
    """[TRACE] [INIT]"""
    b = Build()
    b.init(output(PID))
    b.event("Nothing", TRUE)
    outputs = drive(b.program(), 2, order=(1, 0)).trace().outputs
    assert [(o.round, o.robot, o.written.values) for o in outputs] == [
        (BEFORE_ROUNDS, None, (1,)),
        (BEFORE_ROUNDS, None, (0,)),
    ]


def test_steps_at_hand_and_steps_made_anew_give_one_trace() -> None:
    """[RECORDING]: a recording determines its run."""
    program = programs.thermostat()
    system = dealt(program, 3)
    _, trace = played(program, AtRandom(Random(8)), rng=Random(8))
    steps = list(execute(trace.numbers.domain, system, trace.recording))
    assert assembled(NO_TEXT, system, Numbers.EXACT, trace.recording, steps) == trace
    tracer = Tracer()
    for step in steps:
        tracer.add(step)
    assert tracer.trace(NO_TEXT, system, Numbers.EXACT, trace.recording) == trace


def test_a_last_round_in_which_nobody_moved() -> None:
    """[RECORDING]: it ends where it began."""
    trace = drive(programs.late_violation(), 2).round("Count", None).trace()
    rounds = (*trace.recording.rounds, Round((), (None, None), cut=True))
    recording = Recording(trace.recording.opening, rounds)
    longer = traced(NO_TEXT, trace.system, Numbers.EXACT, recording)
    assert longer.configurations == (*trace.configurations, trace.configurations[-1])


def test_nothing_is_left_in_unset_atoms_behind_a_fault() -> None:
    """[TRACE] [FAULT]"""
    b = Build()
    xs = b.local("xs", ListType(INT))
    b.event("Slip", TRUE, xs[0].set(5))
    d = drive(b.program(), 1).go(0, "Slip")
    assert d.configuration.fault is not None
    assert d.configuration.fault.kind is FaultKind.UNSET
    empty: Cell[Constant] = Cell(False, Seq(0, ()))
    assert d.configuration.robots[0].locals == (empty,)
    assert d.trace().configurations[-1] == d.configuration


def test_the_digest_is_that_of_the_text() -> None:
    """[TRACE]"""
    empty = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
    assert digest(Source("a", "")) == digest(Source("b", "")) == empty
    assert digest(Source("a", " ")) != empty


# --- names --------------------------------------------------------------------------------------


def test_names_are_told_apart() -> None:
    """[TRACE]"""
    assert distinct(["i", "x", "i", "i#2", "i"]) == ["i", "x", "i#2", "i#2#2", "i#3"]
    names = Names(dealt(programs.two_kinds(), 3))
    assert [n.name for n in names.of(1).ports] == ["Rotor.up"]
    assert names.of(2).events == ("Drive",)


# --- changes ------------------------------------------------------------------------------------


def test_changes_are_told_location_by_location() -> None:
    """[LOCATION]: the smallest that differs; positions and lists of another length as a whole."""
    b = Build()
    task = programs.TASK
    tasks = b.allwrite("tasks", ListType(task), lst(task, rec(task, pos(0, 0), False, 0)))
    where, xs = b.local("where", POS, pos(0, 0)), b.local("xs", ListType(INT), lst(INT, 1, 2))
    later, ys = b.local("later", POS), b.local("ys", ListType(INT), lst(INT))
    b.event(
        "Go",
        TRUE,
        tasks[0].field("id").set(7),
        where.field("x").set(1),
        xs[1].set(5),
        later.set(pos(1, 1)),
        ys.append(3),
    )
    d = drive(b.program(), 1)
    before = d.configuration
    found = list(changes(d.names, before, d.go(0, "Go").configuration))
    assert [(c.robot, c.name, c.old, c.new) for c in found] == [
        (None, "tasks[0].id", "0", "7"),
        (0, "where", "(0, 0, 0)", "(1, 0, 0)"),
        (0, "xs[1]", "2", "5"),
        (0, "later", "unset", "(1, 1, 0)"),
        (0, "ys", "[]", "[3]"),
    ]
    assert list(changes(d.names, before, before)) == []


def test_a_difference_is_seen_even_where_it_is_small() -> None:
    """[REPLAY]: numbers that look alike when rounded are shown exactly."""
    b = Build()
    x = b.local("x", FLOAT, 0)
    b.event("A", TRUE, x.set(1 / 3))
    b.event("B", TRUE, x.set(1 / 3 + 2**-40))
    a = drive(b.program(), 1).go(0, "A").configuration
    other = drive(b.program(), 1).go(0, "B").configuration
    (found, _) = differences(Names(dealt(b.program(), 1)), a, other)
    assert found.name == "x"
    assert found.old != found.new
    assert "/" in found.old


def test_keys_in_another_order_are_a_difference() -> None:
    """[CONFIG]: equal maps need not be identical."""
    one: Concrete = Table(2, ((1, 5), (2, 6)))
    other: Concrete = Table(2, ((2, 6), (1, 5)))
    same: Concrete = Table(2, ((1, 5), (2, 6)))
    assert not identical(one, other)
    assert identical(one, same)


def test_not_a_number_is_itself() -> None:
    """[CONFIG]"""
    assert identical(math.nan, float("nan"))
    assert identical(Rec((1, math.nan)), Rec((1, math.nan)))
    assert not identical(math.nan, 0.0)
    assert identical(0.0, -0.0)


@given(data=st.data(), type_=types, numbers=st.sampled_from(Numbers))
@examples(150)
def test_identical_is_equal_but_for_the_order_of_keys(
    data: st.DataObject, type_: Type, numbers: Numbers
) -> None:
    """[CONFIG]"""
    a, b = data.draw(values(type_, numbers)), data.draw(values(type_, numbers))
    assert identical(a, a)
    assert identical(a, b) == (a == b)


@pytest.mark.parametrize("program", programs.RUNNING, ids=lambda p: p.name)
def test_configurations_differ_where_runs_do(program: core.Program) -> None:
    """[REPLAY] [CONFIG]: no difference with itself, and one wherever two are not equal."""
    _, trace = played(program, AtRandom(Random(1)), rounds=4)
    names = Names(trace.system)
    for a in trace.configurations:
        assert not list(differences(names, a, a))
        for b in trace.configurations:
            assert (a == b) == (not list(differences(names, a, b)))


# --- values in words ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "type_", "shown"),
    [
        (7, INT, "7"),
        (-(10**40), INT, "-(about 40 digits)"),
        (2**3000, INT, "(about 904 digits)"),
        (0.5, FLOAT, "0.5"),
        (0.1 + 0.2, FLOAT, "≈0.3"),
        (3.0, FLOAT, "3"),
        (math.inf, FLOAT, "inf"),
        (True, BOOL, "true"),
        ("a b", STRING, '"a b"'),
        (1, programs.MODE, "pick"),
        (Rec((1, 2, 3)), POS, "(1, 2, 3)"),
        (Seq(2, (4, 5)), ListType(INT), "[4, 5]"),
        (Table(1, (("a", 2),)), MapType(STRING, INT), '{"a": 2}'),
    ],
)
def test_values_are_shown_as_a_program_would_write_them(
    value: object, type_: Type, shown: str
) -> None:
    """[VALUE]"""
    assert show_value(value, type_) == shown  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("1/3", "1/3"),
        ("-7/2", "-3.5"),
        ("1/1000000", "0.000001"),
        ("1/10000000", "≈1e-07"),
        ("448043/6400", "≈70.0067"),
        ("1/1024", "≈0.000977"),
        ("-1/30000", "≈-3.33e-05"),
        ("100000000000000000000000000000000000001/7", "100000000000000000000000000000000000001/7"),
    ],
)
def test_exact_numbers_are_shown_exactly_where_that_is_short(text: str, shown: str) -> None:
    """[DOMAIN]: ``≈`` says that a number was rounded."""
    found = show_value(Fraction(text), FLOAT)
    assert found == shown or found.endswith("digits)/7")


def test_parts_that_hold_nothing_are_shown_as_unset() -> None:
    """[ATOM]"""
    hole: Storage[Constant] = Cell(False, 0)
    one: Storage[Constant] = Cell(True, 1)
    assert show_storage(Tree((hole, hole, hole)), POS) == "unset"
    assert show_storage(Tree((one, hole, hole)), POS) == "(1, unset, unset)"
