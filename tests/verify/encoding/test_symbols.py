"""What is left open becomes terms: of every value that there may be, and of no others."""

from __future__ import annotations

import pytest
import z3

from koord.semantics.oracle import Phase
from koord.semantics.storage import Cell, Storage, Tree, held, same_storage, unset
from koord.semantics.values import Rec, Seq, Table, equal, lookup
from koord.syntax import core
from koord.syntax.analysis.footprint import WriteExtent
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.system import dealt
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    STRING,
    ArrayType,
    EnumType,
    ListType,
    MapType,
    RecordType,
    Robots,
    Type,
)
from koord.verify.effort import Deadline
from koord.verify.encoding.solver import Solver, SolverAnswer
from koord.verify.encoding.symbols import SymbolicInputs
from koord.verify.encoding.terms import Term, Terms
from koord.verify.encoding.unknowns import LIST_CAPACITY, Symbolic, Unknowns
from tests.semantics.building import TRUE, Build, I, bound, forall, lst
from tests.verify.asking import bounded

PAIR = RecordType("Pair", (("a", INT), ("b", BOOL)))
MODE = EnumType("Mode", ("x", "y", "z"))
EMPTY = core.Program("empty", (), (), (), (), (), (), (), ())


class Asking:
    """Unknowns, and a solver that knows their constraints."""

    def __init__(self, program: core.Program = EMPTY, robots: int = 2) -> None:
        self.d = Terms()
        self.unknowns = Unknowns(self.d, program, robots)
        self.solver = Solver(self.d, self.unknowns)

    def can(self, *conditions: Term) -> bool:
        return self.solver.check(conditions, Deadline.after(30)) is SolverAnswer.SAT

    def is_(self, value: Symbolic, other: Symbolic) -> Term:
        return equal(self.d, value, other)


# --- values ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("type_", "values"),
    [
        (INT, (-5, 0, 7)),
        (BOOL, (True, False)),
        (MODE, (0, 1, 2)),
        (PAIR, (Rec((3, True)), Rec((-1, False)))),
        (ArrayType(INT, 2), (Seq(2, (5, 6)),)),
        (ArrayType(BOOL, Robots.ALL), (Seq(3, (True, False, True)),)),
        (ListType(INT), (Seq(0, ()), Seq(2, (4, 4)), Seq(3, (1, 2, 3)))),
        (MapType(INT, BOOL), (Table(0, ()), Table(2, ((1, True), (2, False))))),
    ],
    ids=str,
)
def test_every_value_is_one_of_those_that_a_term_stands_for(
    type_: Type, values: tuple[Symbolic, ...]
) -> None:
    a = Asking(robots=3)
    for value in values:
        assert a.can(a.is_(a.unknowns.value("x", type_), value)), value


def test_an_enumeration_has_no_other_members() -> None:
    a = Asking()
    mode = a.unknowns.value("mode", MODE)
    assert not a.can(a.is_(mode, 3))
    assert not a.can(a.is_(mode, -1))


def test_a_map_has_each_key_once() -> None:
    """[E-MAP] [VALUE]"""
    a = Asking()
    names = a.unknowns.value("names", MapType(INT, INT))
    assert isinstance(names, Table)
    (first, _), (second, _), *_ = names.entries
    two = a.d.binary(BinaryOp.EQ, names.length, 2)
    assert a.can(two)
    assert not a.can(two, a.is_(first, second))
    found, value = lookup(a.d, names, 4)
    assert value is not None
    assert a.can(found, a.is_(value, 9), two)


def test_lists_end_somewhere_and_it_is_told() -> None:
    a = Asking()
    fixed = a.unknowns.value("fixed", ListType(INT), length=5)
    assert isinstance(fixed, Seq)
    assert (fixed.length, len(fixed.items)) == (5, 5)
    assert a.unknowns.limits == []
    path = a.unknowns.value("path", ListType(INT))
    assert isinstance(path, Seq)
    assert not a.can(a.d.binary(BinaryOp.LT, LIST_CAPACITY, path.length))
    assert not a.can(a.d.binary(BinaryOp.LT, path.length, 0))
    assert any("path" in limit for limit in a.unknowns.limits)


# --- storage for induction ------------------------------------------------------------------------


def test_storage_that_nobody_writes_stays() -> None:
    a = Asking()
    before = unset(a.d, PAIR, 2)
    assert a.unknowns.storage("x", PAIR, before, WriteExtent.NEVER) is before


def test_storage_that_somebody_writes_is_anything() -> None:
    """[ATOM]: an atom that was set stays set; one that was not may be."""
    a = Asking()
    before: Storage[Term] = Tree((held(a.d, 5), Cell(False, False)))
    after = a.unknowns.storage("x", PAIR, before, WriteExtent.WHOLE)
    assert isinstance(after, Tree)
    first, second = after.parts
    assert isinstance(first, Cell)
    assert isinstance(second, Cell)
    assert first.is_set is True
    assert a.can(a.is_(first.value, 7))
    assert a.can(second.is_set)
    assert a.can(a.d.unary(UnaryOp.NOT, second.is_set))


def test_a_list_of_which_elements_are_written_keeps_its_length() -> None:
    a = Asking()
    before = held(a.d, Seq(4, (1, 2, 3, 4)))
    after = a.unknowns.storage("x", ListType(INT), before, WriteExtent.PARTS)
    assert isinstance(after, Cell)
    assert isinstance(after.value, Seq)
    assert after.value.length == 4
    assert a.can(same_storage(a.d, after, held(a.d, Seq(4, (9, 9, 9, 9)))))
    assert a.unknowns.limits == []
    whole = a.unknowns.storage("y", ListType(INT), before, WriteExtent.WHOLE)
    assert isinstance(whole, Cell)
    assert a.can(same_storage(a.d, whole, held(a.d, Seq(1, (7,)))))
    assert a.unknowns.limits != []


# --- external functions ---------------------------------------------------------------------------


def external(result: Type, *parameters: Type, fresh: bool = False) -> core.External:
    b = Build()
    names = [bound(f"p{k}", k, t) for k, t in enumerate(parameters)]
    b.external("f", names, bound("result", len(parameters), result), fresh=fresh)
    return b.program().externals[0]


@pytest.mark.parametrize("result", [INT, BOOL, PAIR, ListType(INT)], ids=str)
@pytest.mark.parametrize(
    "parameter", [INT, STRING, PAIR, ListType(INT), MapType(INT, INT)], ids=str
)
def test_equal_questions_get_equal_answers(result: Type, parameter: Type) -> None:
    """[EXTERNAL]: for parameters and results of every shape."""
    a = Asking()
    f = external(result, parameter)
    questions = [a.unknowns.value(name, parameter) for name in ("p", "q")]
    answers = [a.unknowns.function(f, (question,), "f") for question in questions]
    agree, differ = a.is_(*answers), a.d.unary(UnaryOp.NOT, a.is_(*answers))
    same = a.is_(*questions)
    assert a.can(same, agree)
    assert a.can(differ)
    assert not a.can(same, differ)


def test_lists_of_known_and_of_unknown_length_are_one_question() -> None:
    """[EXTERNAL] [E-EQUAL]"""
    a = Asking()
    f = external(INT, ListType(INT))
    known = Seq(2, (4, 5))
    some = a.unknowns.value("some", ListType(INT))
    answers = [a.unknowns.function(f, (question,), "f") for question in (known, some, Seq(0, ()))]
    differ = a.d.unary(UnaryOp.NOT, a.is_(answers[0], answers[1]))
    assert not a.can(a.is_(known, some), differ)
    assert a.can(differ)


def test_an_answer_is_of_its_type() -> None:
    a = Asking()
    answer = a.unknowns.function(external(MODE, INT), (3,), "f")
    assert not a.can(a.is_(answer, 3))
    assert a.can(a.is_(answer, 2))


def test_a_summary_about_other_questions_holds_of_all() -> None:
    """[EXTERNAL]: symmetry, say, of questions that nobody asked in both orders."""
    b = Build()
    p, q, result = bound("p", 0, INT), bound("q", 1, INT), bound("result", 2, BOOL)
    b.external("near", [p, q], result)
    b.externals.clear()
    again = core.ExternalCall("near", (q.expr, p.expr), BOOL, 1)
    parameters = (p.place.variable, q.place.variable)
    kind = core.ExternalKind.FUNCTION
    promise = core.Binary(BinaryOp.EQ, result.expr, again, BOOL)
    near = core.External("near", parameters, result.place.variable, kind, (), (promise,), 3)
    b.externals.append(near)
    a = Asking(b.program())
    assert a.unknowns.vouches_for(near)
    one = a.unknowns.function(near, (1, 2), "near")
    other = a.unknowns.function(near, (2, 1), "near")
    assert isinstance(one, z3.ExprRef)
    assert isinstance(other, z3.ExprRef)
    assert not a.can(one, a.d.unary(UnaryOp.NOT, other))
    assert a.can(one, other)


def test_a_summary_about_one_answer_is_left_to_the_asker() -> None:
    """A function that meets it for all arguments at once is hard to come by, and not needed."""
    b = Build()
    n, up = bound("n", 0, INT), bound("result", 1, INT)
    b.external("above", [n], up, requires=[n >= 0], ensures=[up > n])
    a = Asking(b.program())
    assert not a.unknowns.vouches_for(b.externals[0])
    x = b.local("x", INT, 0)
    b.event("Go", TRUE, x.set(b.ask("above", x)))
    b.invariant("Low", forall(I, x.at(I) < 3))
    assert bounded(b.program(), robots=1, rounds=2).rounds == {"Low": 1}


def test_fresh_functions_answer_anew_each_time_and_each_place_once() -> None:
    """[EXTERNAL] [RECORDING]: the same key in one turn is the same question."""
    a = Asking()
    f = external(INT, INT, fresh=True)
    inputs = SymbolicInputs(a.unknowns, "0")
    oracle = inputs.oracle(Phase.PROG, 0)
    one, again = oracle.external(f, (1,), (3,)), oracle.external(f, (1,), (3,))
    other = oracle.external(f, (2,), (3,))
    assert one is again
    assert a.can(a.d.unary(UnaryOp.NOT, a.is_(one, other)))
    elsewhere = inputs.oracle(Phase.PROG, 1).external(f, (1,), (3,))
    assert a.can(a.d.unary(UnaryOp.NOT, a.is_(one, elsewhere)))
    assert len(inputs.answers) == 3


def test_starts_and_readings_are_noted_for_the_recording() -> None:
    """[INIT] [ENV-FREE]"""
    b = Build()
    b.local("x", INT, core.Start.ARBITRARY)
    b.allread("y", FLOAT, core.Start.ARBITRARY)
    b.allwrite("z", ListType(INT), core.Start.ARBITRARY)
    b.sensor("heat", INT)
    b.module()
    b.local("w", ListType(INT), lst(INT))
    system = dealt(b.program(), 2)
    a = Asking(b.program())
    inputs = SymbolicInputs(a.unknowns, "init")
    for declaration in (*system.program.agents[0].locals[:1], *system.program.allread):
        for robot in range(2):
            inputs.start(declaration, robot)
    inputs.start(system.program.allwrite[0], None)
    homes = [(home.value, robot) for home, _, robot, _ in inputs.starts]
    assert homes == [("local", 0), ("local", 1), ("allread", 0), ("allread", 1), ("allwrite", None)]
    reading = inputs.sensor(1, system.program.agents[0].ports[0])
    assert inputs.readings == [(1, 0, reading)]
    # Of the entry of an allread variable, not of the whole.
    assert all(isinstance(value, z3.ExprRef) for _, _, _, value in inputs.starts[:4])
