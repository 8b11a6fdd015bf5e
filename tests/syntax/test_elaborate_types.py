"""Types of expressions, what fits where, and what operators become."""

from __future__ import annotations

from fractions import Fraction
from textwrap import dedent

import pytest

from koord.syntax import core
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    POS,
    STRING,
    ArrayType,
    ListType,
    MapType,
    QueueType,
    RecordType,
)
from tests.syntax.elaborating import effect, errors, only, program, value

ABOVE = """
    def Cargo:
      float mass
      bool fragile = false
    allread:
      pos[] x
      pos[][] routes
    allwrite:
      Map<string, int> stock
      Queue<int> queue
      int grid[3]
"""


def test_int_becomes_float_and_nothing_else_changes() -> None:
    assert value("3", type_="float") == core.Const(Fraction(3), FLOAT)
    widened = value("pid", type_="float")
    assert widened == core.Unary(core.UnaryOp.WIDEN, core.Pid(INT), FLOAT)
    assert value("[1, 2]", type_="float[]") == core.MakeList(
        (core.Const(Fraction(1), FLOAT), core.Const(Fraction(2), FLOAT)), ListType(FLOAT)
    )
    assert value("[1, 2.5]", type_="float[]").type == ListType(FLOAT)


@pytest.mark.parametrize(
    ("expression", "type_"),
    [
        ("2.5", "int"),
        ("true", "int"),
        ("1", "bool"),
        ('"a"', "int"),
        ("[1, 2]", "int"),
        ("[1.5]", "int[]"),
        ("3", "int[]"),
        ("x", "pos"),
        ("routes", "pos[]"),
        ("stock", "int[]"),
        ("[1, 2]", "int[3]"),
        ("pos(1, 2, 3)", "Cargo"),
    ],
)
def test_what_does_not_fit(expression: str, type_: str) -> None:
    above = f"{dedent(ABOVE)}local:\n  {type_} answer\n"
    assert errors(f"{above}Go:\n  eff: answer = {expression}\n") == ["K204"]


def test_division_of_ints_stays_and_floats_are_exact() -> None:
    assert value("7 / 2") == core.Const(3, INT)
    assert value("-7 / 2") == core.Const(-4, INT)
    assert value("-7 % 2") == core.Const(1, INT)
    assert value("7 / 2.0", type_="float") == core.Const(Fraction(7, 2), FLOAT)
    assert value("7 / 2", type_="float") == core.Const(Fraction(3), FLOAT)
    assert isinstance(value("1 / 0"), core.Binary)


def test_orders_are_less_and_at_most() -> None:
    less = value("pid > 3", type_="bool")
    assert less == core.Binary(core.BinaryOp.LT, core.Const(3, INT), core.Pid(INT), BOOL)
    at_most = value("pid >= 3", type_="bool")
    assert at_most == core.Binary(core.BinaryOp.LE, core.Const(3, INT), core.Pid(INT), BOOL)


def test_constants_are_folded() -> None:
    assert value("1 + 2 * 3 - -4") == core.Const(11, INT)
    assert value("not (1 < 2) or false", type_="bool") == core.Const(False, BOOL)
    assert value("min(3, 1, 2) + max(1, 2) + abs(-3)") == core.Const(6, INT)
    assert value("clamp(9, 1, 3) + clamp(-9, 1, 3) + clamp(2, 1, 3)") == core.Const(6, INT)
    assert value("clamp(1, 2.5, 3)", type_="float") == core.Const(Fraction(5, 2), FLOAT)


def test_positions_are_added_by_the_library() -> None:
    made = program("""
        local:
          pos p = pos(1, 2, 3)
        Go:
          eff: p = (p + p - p) * 2 / 4 + 2 * -p
    """)
    assert {function.name for function in made.functions} == {
        "addedPos",
        "subtractedPos",
        "scaledPos",
        "dividedPos",
        "negatedPos",
    }


@pytest.mark.parametrize(
    "expression",
    [
        "true + 1",
        '"a" - "b"',
        "p * p",
        "p + 1",
        "1 / p",
        "p < p",
        "p == 1",
        "-true",
        "2.5 % 2",
        "grid + grid",
        "pid[0]",
        "length(3)",
        "max(true, 1)",
        "contains(3, 3)",
        "all(grid)",
    ],
)
def test_operations_that_do_not_apply(expression: str) -> None:
    above = f"{dedent(ABOVE)}local:\n  pos p\n  int answer\n"
    assert errors(f"{above}Go:\n  eff: answer = {expression}\n") == ["K229"]


def test_records_by_position_and_by_name() -> None:
    cargo = RecordType("Cargo", (("mass", FLOAT), ("fragile", BOOL)))
    expected = core.MakeRecord((core.Const(Fraction(2), FLOAT), core.Const(False, BOOL)), cargo)
    assert value("Cargo(2)", ABOVE, "Cargo") == expected
    assert value("Cargo(mass = 2)", ABOVE, "Cargo") == expected
    assert value("Cargo(fragile = false, mass = 2.0)", ABOVE, "Cargo") == expected


@pytest.mark.parametrize(
    ("expression", "code"),
    [
        ("Cargo()", "K218"),
        ("Cargo(fragile = true)", "K218"),
        ("Cargo(1, mass = 2)", "K218"),
        ("Cargo(1, true, 3)", "K217"),
        ("Cargo(weight = 2)", "K205"),
        ("Cargo(mass = true)", "K204"),
    ],
)
def test_records_made_wrongly(expression: str, code: str) -> None:
    above = f"{dedent(ABOVE)}local:\n  Cargo answer\n"
    assert errors(f"{above}Go:\n  eff: answer = {expression}\n") == [code]


def test_tasks_are_predefined_with_two_names_for_fields() -> None:
    above = """
        allwrite:
          Task[] list
    """
    one = effect("atomic: list[0].loc = list[0].target", above)[0]
    assert isinstance(one, core.Atomic)
    two = effect("atomic: list[0].target = list[0].loc", above)[0]
    assert one == two
    assert value("list[0].taskId + list[0].assignId", above) == value(
        "list[0].id + list[0].assignedTo", above
    )
    made = value("Task(loc = pos(0, 0, 0))", type_="Task")
    assert isinstance(made, core.MakeRecord)
    assert made.fields[1:] == (core.Const(False, BOOL), core.Const(-1, INT), core.Const(-1, INT))


def test_a_task_of_the_program_takes_the_place_of_the_librarys() -> None:
    made = program("""
        def Task:
          int number
          bool assigned = false
        local:
          Task[] mine = [Task(3), Task(4, true)]
          bool all_ = false
        Go:
          eff: all_ = allAssigned(mine)
    """)
    (function,) = made.functions
    assert function.parameters[0].type == ListType(
        RecordType("Task", (("number", INT), ("assigned", BOOL)))
    )


def test_maps_queues_and_arrays() -> None:
    assert value('stock["a"]', ABOVE) == value('stock["a"]', ABOVE)
    read = value('stock["a"]', ABOVE)
    assert isinstance(read, core.Read)
    assert read.place.steps == (core.KeyStep(core.Const("a", STRING), INT),)
    assert value("{}", type_="Map<int, pos>") == core.MakeMap((), MapType(INT, POS))
    assert value("{1: 2.5}", type_="Map<int, float>").type == MapType(INT, FLOAT)
    assert value("[]", type_="Queue<int>") == core.MakeList((), QueueType(INT))
    assert value("[1, 2]", type_="int[2]").type == ArrayType(INT, 2)
    assert value("length(grid)", ABOVE) == core.Const(3, INT)
    assert value("length(x)", ABOVE) == core.NumAgents(INT)
    assert value('contains(stock, "a")', ABOVE, "bool").type == BOOL
    assert only("local:\n  int n = length([])\nGo:\n  eff: n = 1\n").code == "K230"


def test_an_array_is_taken_where_a_list_is_wanted() -> None:
    made = program("""
        allread:
          pos[] x
        local:
          pos p
          pos[] seen
        Go:
          eff: p = midpoint(x)
               seen = x
    """)
    assign = made.agents[0].events[0].effect[1]
    assert isinstance(assign, core.Assign)
    assert assign.value.type == made.allread[0].variable.type


def test_long_chains_of_and_are_balanced() -> None:
    chain = " and ".join(f"pid != {number}" for number in range(150))
    expr = value(chain, type_="bool")
    assert _depth(expr) < 20
    deep = " + ".join(["pid"] * 150)
    assert errors(f"local:\n  int n = {deep}\nGo:\n  eff: n = 1\n") == ["K231"]


def _depth(expr: core.Expr) -> int:
    if isinstance(expr, core.Binary):
        return 1 + max(_depth(expr.left), _depth(expr.right))
    return 0


@pytest.mark.parametrize(
    ("declaration", "code"),
    [
        ("Cargoo c", "K203"),
        ("List c", "K203"),
        ("Map<int> c", "K203"),
        ("Map<int[], int> c", "K203"),
        ("int<pos> c", "K203"),
        ("int[2.5] c", "K227"),
        ("int[-1] c", "K227"),
        ("int[numAgents - 1] c", "K227"),
        ("stream c", "K238"),
    ],
)
def test_types_that_are_none(declaration: str, code: str) -> None:
    text = f"{dedent(ABOVE)}local:\n  {declaration}\n"
    assert errors(text) == [code]


def test_records_may_use_later_ones_and_not_themselves() -> None:
    made = program("""
        def Outer:
          Inner inner
        def Inner:
          int n
        local:
          Outer o
        Go:
          eff: o.inner.n = 3
    """)
    assert made.agents[0].locals[0].variable.type == RecordType(
        "Outer", (("inner", RecordType("Inner", (("n", INT),))),)
    )
    found = only("""
        def One:
          Two[] others
        def Two:
          One other
        local:
          One o
        Go:
          eff: o.others = []
    """)
    assert found.code == "K241"
    assert "`One` → `Two` → `One`" in found.message
