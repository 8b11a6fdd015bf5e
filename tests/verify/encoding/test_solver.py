"""The solver: questions, answers, models, and how large questions fall into cases."""

from __future__ import annotations

import time
from dataclasses import dataclass
from fractions import Fraction
from random import Random

import pytest
import z3

from koord.semantics.domain import Constant
from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import BOOL, FLOAT, INT, STRING, EnumType, OpaqueType, Type
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding import z3_builder
from koord.verify.encoding.solver import (
    LONGEST_S,
    LONGEST_UNLIMITED_S,
    Solver,
    SolverAnswer,
    cases,
    portable,
)
from koord.verify.encoding.terms import Term, Terms
from koord.verify.encoding.unknowns import Unknowns
from koord.verify.encoding.z3_builder import counted

NEVER = Deadline()


def solver() -> tuple[Terms, Unknowns, Solver]:
    d = Terms()
    unknowns = Unknowns(d, core.Program("empty", (), (), (), (), (), (), (), ()), 2)
    return d, unknowns, Solver(d, unknowns)


# --- questions ------------------------------------------------------------------------------------


def test_a_question_is_forgotten_and_a_requirement_is_not() -> None:
    d, _, s = solver()
    x = d.fresh("x", INT)
    assert s.check([d.binary(BinaryOp.LT, x, 0)], NEVER) is SolverAnswer.SAT
    assert s.check([d.binary(BinaryOp.LT, 0, x)], NEVER) is SolverAnswer.SAT
    s.add([d.binary(BinaryOp.LT, 0, x)])
    assert s.check([d.binary(BinaryOp.LT, x, 0)], NEVER) is SolverAnswer.UNSAT
    assert s.check([], NEVER) is SolverAnswer.SAT


def test_where_nothing_is_required_all_values_do() -> None:
    d, _, s = solver()
    x = d.fresh("x", INT)
    assert s.check([True], NEVER) is SolverAnswer.SAT
    assert isinstance(s.model().number(x), int)
    s.add([d.binary(BinaryOp.LT, x, 0), d.binary(BinaryOp.LT, 0, x)])
    assert s.check([True], NEVER) is SolverAnswer.UNSAT


def test_constants_are_questions_too() -> None:
    _, _, s = solver()
    assert s.check([True, True], NEVER) is SolverAnswer.SAT
    assert s.check([True, False], NEVER) is SolverAnswer.UNSAT
    s.add([True, False])
    assert s.check([], NEVER) is SolverAnswer.UNSAT


def test_constraints_of_fresh_terms_count_from_when_they_are_made() -> None:
    d, unknowns, s = solver()
    mode = unknowns.value("mode", EnumType("Mode", ("a", "b")))
    assert isinstance(mode, z3.ExprRef)
    assert s.check([d.binary(BinaryOp.EQ, mode, 1)], NEVER) is SolverAnswer.SAT
    assert s.check([d.binary(BinaryOp.EQ, mode, 2)], NEVER) is SolverAnswer.UNSAT
    late = unknowns.value("late", EnumType("Mode", ("a",)))
    assert s.check([d.binary(BinaryOp.NE, late, 0)], NEVER) is SolverAnswer.UNSAT


def hard(d: Terms) -> Term:
    """A question that takes long: a sum of three cubes."""
    x, y, z = (d.fresh(name, INT) for name in "xyz")
    return x * x * x + y * y * y + z * z * z == 114


def test_without_time_or_effort_the_answer_is_unknown() -> None:
    d, _, s = solver()
    assert s.check([d.fresh("x", BOOL)], Deadline.after(0)) is SolverAnswer.UNKNOWN
    assert s.check([d.fresh("x", BOOL)], NEVER, Effort(0)) is SolverAnswer.UNKNOWN
    started = time.monotonic()
    assert s.check([hard(d)], Deadline.after(0.3)) is SolverAnswer.UNKNOWN
    assert time.monotonic() - started < 20
    # What a question could not be told does not stick.
    assert s.check([d.fresh("x", BOOL)], NEVER) is SolverAnswer.SAT


def test_effort_is_used_up() -> None:
    d, _, s = solver()
    effort = Effort(100_000)
    assert s.check([hard(d)], NEVER, effort) is SolverAnswer.UNKNOWN
    assert effort.left < 100_000
    whole = Effort(10**9)
    assert s.check([hard(d)], NEVER, whole, at_most=100_000) is SolverAnswer.UNKNOWN
    assert whole.left > 10**8


def test_work_that_is_not_counted_ends_in_proportion_to_the_effort() -> None:
    """Products of unknowns keep Z3 busy without its saying so."""
    d, _, s = solver()
    told: dict[str, int] = {}

    class Idle(Stopped):
        def set(self, **settings: int) -> None:
            told.update(settings)

        def check(self, *literals: object) -> z3.CheckSatResult:
            clock[0] += told["timeout"] / 1000
            return super().check(*literals)

    clock = [100.0]
    effort = Effort.of_seconds(3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "monotonic", lambda: clock[0])
        patch.setattr(time, "process_time", lambda: clock[0])
        s._solver = Idle("canceled", work=40)
        assert s.check([d.fresh("x", BOOL)], NEVER, effort) is SolverAnswer.UNKNOWN
    assert told["timeout"] == 1_000 * LONGEST_S
    assert effort.left <= 0


def test_what_is_cut_short_by_the_work_of_others_is_asked_again_for_longer() -> None:
    """Z3 looks at the clock, and a process that shares its core has less time than that says."""
    d, _, s = solver()
    times: list[int] = []

    class Slow(Stopped):
        def set(self, **settings: int) -> None:
            times.append(settings["timeout"])

        def check(self, *literals: object) -> z3.CheckSatResult:
            clock[0] += times[-1] / 1000
            super().check(*literals)
            return z3.unknown if times[-1] < needed else z3.sat

        def model(self) -> None: ...

    clock = [100.0]
    needed = 7_000
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "monotonic", lambda: clock[0])
        patch.setattr(time, "process_time", lambda: clock[0] / 20)
        s._solver = Slow("timeout", work=40)
        asked = [d.fresh("x", BOOL)]
        assert s.check(asked, NEVER, Effort.of_seconds(0.1)) is SolverAnswer.SAT
        assert times == [1_000, 2_000, 4_000, 8_000]
        # What all may take ends it, whoever works.
        times.clear()
        late = Deadline(clock[0] + 1.5)
        assert s.check(asked, late, Effort.of_seconds(0.1)) is SolverAnswer.UNKNOWN
        assert times == [1_000, pytest.approx(500, abs=1)]
        # And a process that works all the time is not asked again.
        times.clear()
        patch.setattr(time, "process_time", lambda: clock[0])
        assert s.check(asked, NEVER, Effort.of_seconds(0.1)) is SolverAnswer.UNKNOWN
        assert times == [1_000]


def test_limits_of_a_question_are_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are given to Z3 where they are others than those of the last question."""
    given: list[dict[str, int]] = []
    limits = z3.Solver.set

    def noted(self: z3.Solver, *names: object, **values: int) -> None:
        given.append(values)
        limits(self, *names, **values)

    d, _, s = solver()
    s.add([d.fresh("x", BOOL)])
    monkeypatch.setattr(z3.Solver, "set", noted)
    for units in (10**9, 10**9, 50_000, 10**9):
        answer = s.check([d.fresh("x", BOOL)], NEVER, Effort(10**10), at_most=units)
        assert answer is SolverAnswer.SAT
    assert [limit["rlimit"] for limit in given] == [10**9, 50_000, 10**9]
    assert s.check([hard(d)], NEVER, Effort(10**9), at_most=50_000) is SolverAnswer.UNKNOWN


def test_without_a_deadline_none_is_left_from_before() -> None:
    d, _, s = solver()
    told: dict[str, object] = {}

    class Told(Stopped):
        def set(self, **settings: int) -> None:
            told.update(settings)

    s._solver = Told("timeout", work=40)
    s.check([d.fresh("x", BOOL)], Deadline.after(9))
    assert 8_000 < int(str(told["timeout"])) <= 9_000
    s.check([d.fresh("x", BOOL)], NEVER)
    assert told["timeout"] == pytest.approx(1_000 * LONGEST_UNLIMITED_S, abs=1_000)


@pytest.mark.parametrize("limit", [500, 1_000, 10_000, 50_000])
def test_want_of_effort_is_no_interruption(limit: int) -> None:
    """Z3 says "canceled" of a question that used up its effort, as it does on Ctrl-C."""
    d, _, s = solver()
    for _ in range(3):
        assert s.check([hard(d)], NEVER, Effort(10**9), at_most=limit) is SolverAnswer.UNKNOWN
    assert s.check([d.fresh("x", BOOL)], NEVER, Effort(10**6)) is SolverAnswer.SAT


@dataclass
class Stopped:
    """A solver that stops at once, for a reason, after so much work."""

    reason: str
    work: int
    done: int = 0

    def set(self, **settings: int) -> None: ...

    def add(self, *terms: object) -> None: ...

    def check(self, *literals: object) -> z3.CheckSatResult:
        self.done += self.work
        return z3.unknown

    def reason_unknown(self) -> str:
        return self.reason

    def statistics(self) -> Stopped:
        return self


@pytest.fixture(autouse=True)
def stopped_solvers_count_too(monkeypatch: pytest.MonkeyPatch) -> None:
    def counting(statistics: z3.Statistics | Stopped, name: str) -> int:
        return statistics.done if isinstance(statistics, Stopped) else counted(statistics, name)

    monkeypatch.setattr(z3_builder, "counted", counting)


def test_what_a_solver_counts_is_what_z3_says_of_it() -> None:
    context = z3.Context()
    for solver in (z3.Solver(ctx=context), z3.Fixedpoint(ctx=context)):
        x = z3.Int("x", context)
        for k in range(3):
            solver.add(z3.Or(x * x > k, x < -k))
            if isinstance(solver, z3.Solver):
                assert solver.check() == z3.sat
            statistics = solver.statistics()
            for name in ("rlimit count", "num allocs", "max memory"):  # the last is no integer
                assert counted(statistics, name) == int(statistics.get_key_value(name)) > 0
    assert counted(statistics, "no such thing") == 0


@pytest.mark.parametrize("reason", ["canceled", "interrupted", "interrupted from keyboard"])
def test_an_interruption_ends_the_question_and_is_passed_on(reason: str) -> None:
    """Ctrl-C while Z3 works: with effort left, or without a limit at all."""
    d, _, s = solver()
    s._solver = Stopped(reason, work=40)
    with pytest.raises(KeyboardInterrupt):
        s.check([d.fresh("x", BOOL)], NEVER)
    with pytest.raises(KeyboardInterrupt):
        s.check([d.fresh("x", BOOL)], Deadline.after(1000), Effort(100))


def test_what_else_stops_a_solver_is_unknown() -> None:
    d, _, s = solver()
    s._solver = Stopped("canceled", work=40)
    assert s.check([d.fresh("x", BOOL)], NEVER, Effort(40)) is SolverAnswer.UNKNOWN
    assert s.check([d.fresh("x", BOOL)], Deadline.after(0.04)) is SolverAnswer.UNKNOWN
    s._solver = Stopped("(incomplete (theory arithmetic))", work=40)
    assert s.check([d.fresh("x", BOOL)], NEVER) is SolverAnswer.UNKNOWN


def test_deadlines() -> None:
    assert NEVER.left_s() is None
    assert not NEVER.passed()
    assert Deadline.after(None).at is None
    assert Deadline.after(0).passed()
    soon = Deadline.after(100)
    assert soon.sooner(1000).at == soon.at
    earlier = soon.sooner(1)
    assert earlier.at is not None
    assert soon.at is not None
    assert earlier.at < soon.at
    assert NEVER.sooner(1).at is not None


# --- models ---------------------------------------------------------------------------------------


def told(value: Constant) -> Constant:
    """What a model says of a term that must be a constant of the text."""
    d, _, s = solver()
    kinds: dict[type, Type] = {bool: BOOL, int: INT, Fraction: FLOAT, str: STRING}
    type_ = kinds[type(value)]
    x = d.fresh("x", type_)
    s.add([d.binary(BinaryOp.EQ, x, value)])
    assert s.check([], NEVER) is SolverAnswer.SAT
    return s.model().scalar(x, type_)


@pytest.mark.parametrize("value", [True, False, 7, -3, 10**30, Fraction(-22, 7), "go", ""])
def test_models_are_read_as_pythons_own(value: Constant) -> None:
    found = told(value)
    assert found == value
    assert type(found) is type(value)


def test_a_string_that_is_none_of_the_texts_is_made_up() -> None:
    d, _, s = solver()
    x, y = d.fresh("x", STRING), d.fresh("y", STRING)
    s.add([d.binary(BinaryOp.NE, x, "a"), d.binary(BinaryOp.NE, x, y)])
    s.add([d.binary(BinaryOp.NE, y, "a")])
    assert s.check([], NEVER) is SolverAnswer.SAT
    texts = {s.model().scalar(t, STRING) for t in (x, y)}
    assert len(texts) == 2
    assert "a" not in texts


def test_opaque_values_have_names_and_equal_ones_the_same() -> None:
    d, _, s = solver()
    kind = OpaqueType("path")
    x, y, z = (d.fresh(name, kind) for name in "xyz")
    s.add([d.binary(BinaryOp.EQ, x, y), d.binary(BinaryOp.NE, x, z)])
    assert s.check([], NEVER) is SolverAnswer.SAT
    names = [s.model().scalar(t, kind) for t in (x, y, z)]
    assert names[0] == names[1] != names[2]


def test_a_root_is_rounded() -> None:
    """Irrational numbers are no values of the exact domain: the replay will tell."""
    d, _, s = solver()
    x = d.fresh("x", FLOAT)
    s.add([d.binary(BinaryOp.EQ, d.binary(BinaryOp.MUL, x, x), 2), d.binary(BinaryOp.LT, 0, x)])
    assert s.check([], NEVER) is SolverAnswer.SAT
    root = s.model().scalar(x, FLOAT)
    assert isinstance(root, Fraction)
    assert abs(root * root - 2) < Fraction(1, 10**9)


def test_what_a_model_leaves_open_has_some_value() -> None:
    d, _, s = solver()
    assert s.check([], NEVER) is SolverAnswer.SAT
    model = s.model()
    assert model.scalar(d.fresh("x", INT), INT) == 0
    assert model.truth(d.fresh("b", BOOL)) in (True, False)
    assert model.truth(True)


# --- cases ----------------------------------------------------------------------------------------


def formula(random: Random, d: Terms, atoms: list[z3.ExprRef], depth: int) -> Term:
    if depth == 0:
        return random.choice(atoms)
    op = random.choice([BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES, None])
    left = formula(random, d, atoms, depth - 1)
    if op is None:
        return d.unary(UnaryOp.NOT, left)
    return d.binary(op, left, formula(random, d, atoms, depth - 1))


@pytest.mark.parametrize("seed", range(60))
def test_cases_are_the_formula_taken_apart(seed: int) -> None:
    """One of them holds exactly if the formula does."""
    random, d = Random(seed), Terms()
    atoms = [d.fresh(f"b{k}", BOOL) for k in range(5)]
    whole = formula(random, d, atoms, 4)
    parts = cases(d, whole)
    s = z3.Solver(ctx=d.context)
    s.add(d.boolean(whole) != z3.Or(*(d.boolean(part) for part in parts)))
    assert s.check() == z3.unsat


def test_cases_of_z3s_own_implications_too() -> None:
    d = Terms()
    a, b, c = (z3.Bool(name, d.context) for name in "abc")
    whole = z3.Not(z3.Implies(a, z3.And(b, z3.Not(z3.Or(c, z3.Not(b))))))
    s = z3.Solver(ctx=d.context)
    s.add(whole != z3.Or(*(d.boolean(part) for part in cases(d, whole))))
    assert s.check() == z3.unsat
    assert len(cases(d, whole)) > 1


@pytest.mark.parametrize("depth", [3, 150])
def test_choices_inside_of_choices_are_cases_as_far_as_these_are_few(depth: int) -> None:
    """As an element of an array at an index that is not known: of a long one some stay together."""
    d = Terms()
    b = [z3.Bool(f"b{k}", d.context) for k in range(depth + 1)]
    whole = b[depth]
    for k in range(depth):
        at = z3.Int("at", d.context) == k
        whole = z3.Or(z3.And(at, b[k]), z3.And(z3.Not(at), whole))
    parts = cases(d, whole)
    assert len(parts) == min(depth, 101) + 1
    s = z3.Solver(ctx=d.context)
    s.add(whole != z3.Or(*(d.boolean(part) for part in parts)))
    assert s.check() == z3.unsat


@pytest.mark.parametrize("robots", [3, 3_000])
def test_cases_of_many_robots_take_no_stack(robots: int) -> None:
    d = Terms()
    everyone = z3.Bool("b0", d.context)
    for k in range(1, robots):
        everyone = z3.And(everyone, z3.Bool(f"b{k}", d.context))
    assert len(cases(d, z3.Not(everyone))) == robots


def test_cases_of_constants() -> None:
    d = Terms()
    assert cases(d, True) == [True]
    assert cases(d, False) == []


def test_a_quantifier_over_robots_falls_into_its_robots() -> None:
    d = Terms()
    each = [d.fresh(f"b{k}", BOOL) for k in range(4)]
    everyone: Term = True
    for one in each:
        everyone = d.binary(BinaryOp.AND, everyone, one)
    denied = d.unary(UnaryOp.NOT, everyone)
    assert len(cases(d, denied)) == 4


def test_scripts_declare_nothing_that_is_a_solver_s_own() -> None:
    """Names within other names, texts and comments of the kind stay."""
    script = '(declare-fun cos (Real) Real)\n(assert (= (cos x) |cos x| cosine "cos"))\n'
    named = "|cos of the program|"
    assert portable(script) == (
        f'(declare-fun {named} (Real) Real)\n(assert (= ({named} x) |cos x| cosine "cos"))\n'
    )
    undeclared = "(declare-fun near (Real) Real)\n(assert (= (cos x) (near x)))\n"
    assert portable(undeclared) == undeclared
