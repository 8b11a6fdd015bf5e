"""What is printed reads back as the same tree, and prints as the same text."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from pathlib import Path
from textwrap import dedent
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st

import koord
from koord.syntax import ast
from koord.syntax.parsing.parser import parse
from koord.syntax.printing.conditions import rows
from koord.syntax.printing.program import format_source, print_expr, print_program, print_type
from koord.syntax.source import Source
from tests import strategies
from tests.sampling import examples
from tests.syntax.reading import expression, program, section

ROOT = Path(koord.__file__).parents[1]
TEXTS = [
    *sorted(ROOT.glob("specs/examples/**/*.krd")),
    ROOT / "koord" / "syntax" / "prelude.krd",
]


def formatted(text: str) -> str:
    """The text in the one layout; laying it out again changes nothing, and no comment is lost."""
    source = Source("t", text)
    once = format_source(source)
    assert once.diagnostics == ()
    again = parse(Source("t", once.text))
    before = parse(source).program
    assert again.diagnostics == ()
    assert again.program == before
    assert Counter(c.text for c in again.program.comments) == Counter(
        c.text for c in before.comments
    )
    assert format_source(Source("t", once.text)).text == once.text
    return once.text


# --- properties ---------------------------------------------------------------------------------


@examples(300)
@given(strategies.programs())
def test_a_printed_program_reads_back_as_itself(tree: ast.Program) -> None:
    text = print_program(tree)
    parsed = parse(Source("t", text))
    assert parsed.diagnostics == ()
    assert parsed.program == tree
    assert print_program(parsed.program) == text


@examples(300)
@given(strategies.expressions(5))
def test_a_printed_expression_reads_back_as_itself(tree: ast.Expr) -> None:
    assert expression(print_expr(tree)) == tree


@examples(200)
@given(strategies.types(4))
def test_a_printed_type_reads_back_as_itself(tree: ast.TypeExpr) -> None:
    assert program(f"param {print_type(tree)} x") == ast.Program(
        (ast.ParamDecl(ast.VarDecl(tree, ast.Ident("x"))),)
    )


@examples(300)
@given(strategies.expressions(5), st.integers(1, 60))
def test_a_condition_in_rows_reads_back_as_itself(tree: ast.Expr, room: int) -> None:
    text = "\n".join(f"  {row.text}" for row in rows(tree, room))
    assert section(f"invariant:\n{text}\n") == ast.Invariant(None, False, tree)


@examples(200)
@given(strategies.programs(), st.integers(20, 60))
def test_programs_on_narrow_pages_read_back_as_themselves(tree: ast.Program, width: int) -> None:
    with patch("koord.syntax.printing.statements.WIDTH", width):
        text = formatted(print_program(tree))
    assert program(text) == tree


@examples(200)
@given(strategies.programs(), st.sampled_from([30, 100]), st.data())
def test_comments_and_blank_lines_anywhere_are_kept(
    tree: ast.Program, width: int, data: st.DataObject
) -> None:
    with patch("koord.syntax.printing.statements.WIDTH", width):
        _with_comments(tree, data)


def _with_comments(tree: ast.Program, data: st.DataObject) -> None:
    lines = print_program(tree).splitlines()
    for number in range(data.draw(st.integers(0, 5))):
        at = data.draw(st.integers(0, len(lines)))
        kind = data.draw(st.integers(0, 2))
        if kind == 0:
            lines.insert(at, " " * data.draw(st.integers(0, 12)) + f"# own {number}")
        elif kind == 1:
            lines.insert(at, "")
        elif at < len(lines) and lines[at] and "#" not in lines[at]:
            lines[at] += f" // beside {number}"
    formatted("\n".join(lines))


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_the_examples_keep_their_trees_and_comments(path: Path) -> None:
    formatted(path.read_text(encoding="utf-8"))


# --- conditions of several lines ----------------------------------------------------------------

A, B, C = ("alpha" * 7, "bravo" * 7, "gamma" * 7)


@pytest.mark.parametrize(
    ("condition", "laid_out"),
    [
        (f"{A} and x", f"invariant X: {A} and x\n"),
        (f"{A} and {B}", f"invariant X: {A} and {B}\n"),
        (f"f({A}, {B}, {C})", f"invariant X:\n    f({A}, {B}, {C})\n"),
        (f"{A} and {B} and {C}", f"invariant X:\n    {A}\n    {B}\n    {C}\n"),
        (f"{A} or {B} or {C}", f"invariant X:\n    {A} or {B}\n        or {C}\n"),
        (
            f"{A} implies {B} or {C} or {A}",
            f"invariant X:\n    {A}\n        implies {B} or {C}\n            or {A}\n",
        ),
        (
            f"forall i: {A} and {B} and {C} implies x",
            f"invariant X:\n    forall i: {A} and {B}\n            and {C}\n        implies x\n",
        ),
        (
            f"not ({A} or {B} or x and (forall i: {C}))",
            f"invariant X:\n    not ({A} or {B}\n        or x and forall i: {C})\n",
        ),
        (
            f"(forall i: {A} or {B}) implies {C}",
            f"invariant X:\n    (forall i: {A} or {B})\n        implies {C}\n",
        ),
    ],
)
def test_long_conditions_are_broken_before_their_operators(condition: str, laid_out: str) -> None:
    assert formatted(f"invariant X: {condition}\n") == laid_out


@pytest.mark.parametrize("word", ["assume", "assume N", "invariant at round", "eventually"])
def test_every_property_may_have_several_lines(word: str) -> None:
    text = f"{word}:\n    {A} or {B}\n        or {C}\n"
    assert formatted(f"{word}: {A} or {B} or {C}\n") == text


def test_what_leads_to_something_may_have_several_lines() -> None:
    assert formatted(f"eventually: {A} or {B} leadsto {C}\n") == (
        f"eventually:\n    {A} or {B}\n    leadsto {C}\n"
    )


def test_guards_and_contracts_may_have_several_lines() -> None:
    assert formatted(f"E:\n  pre: {A} and {B} and {C}\n  eff: stop\n") == (
        f"E:\n    pre:\n        {A}\n        {B}\n        {C}\n    eff: stop\n"
    )
    text = f"def fun f(int a) -> int: extern\n    ensures:\n        {A}\n            or {B}\n"
    with patch("koord.syntax.printing.statements.WIDTH", 60):
        assert formatted(f"def fun f(int a) -> int: extern\n  ensures: {A} or {B}\n") == text


def test_the_assumptions_of_a_list_stay_several() -> None:
    text = f"assume:\n    {A} or {B}\n        or {C}\n    x\n"
    assert formatted(text) == text


def test_comments_stay_with_their_rows() -> None:
    text = (
        f"invariant X:  # the head\n    {A} or {B}  # first\n"
        f"    # before the second\n        or {C}  # second\n\n# behind\ninvariant: y\n"
    )
    assert formatted(text) == text
    assert formatted(f"invariant: {A} or {B} or {C} # all\n") == (
        f"invariant:\n    {A} or {B}\n        or {C}  # all\n"
    )


# --- expressions --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("((x))", "x"),
        ("(x + y) + z", "x + y + z"),
        ("x + (y + z)", "x + (y + z)"),
        ("x - (y - z)", "x - (y - z)"),
        ("(x * y) + (z / x)", "x * y + z / x"),
        ("(x + y) * z", "(x + y) * z"),
        ("-(x)", "-x"),
        ("-(-x)", "-(-x)"),
        ("(-x) * y", "-x * y"),
        ("-(x * y)", "-(x * y)"),
        ("x - (-y)", "x - -y"),
        ("not (x and y)", "not (x and y)"),
        ("not (x == y)", "not x == y"),
        ("(not x) == y", "(not x) == y"),
        ("x == (not y)", "x == (not y)"),
        ("not (not x)", "not not x"),
        ("(x < y) == (y < z)", "(x < y) == (y < z)"),
        ("(x and y) or z", "x and y or z"),
        ("x and (y or z)", "x and (y or z)"),
        ("(x or y) implies (y implies z)", "x or y implies y implies z"),
        ("(x implies y) implies z", "(x implies y) implies z"),
        ("x implies (forall i: y)", "x implies forall i: y"),
        ("(forall i: x) implies y", "(forall i: x) implies y"),
        ("(x and (forall i: y)) or z", "x and (forall i: y) or z"),
        ("x == (forall i: y)", "x == (forall i: y)"),
        ("[(forall i: x), y]", "[forall i: x, y]"),
        ("(x + y).f", "(x + y).f"),
        ("(-x)[1]", "(-x)[1]"),
        ("(x.f)[1]", "x.f[1]"),
        ("x@(i)", "x@i"),
        ("x@(i + 1)", "x@(i + 1)"),
        ("x@(f(i))", "x@(f(i))"),
        ("x && !y || z", "x and not y or z"),
        ("x ≠ y and x ≤ z", "x != y and x <= z"),
        ("forall i,j:x", "forall i, j: x"),
        ("forall k=0,n:x", "forall k in 0, n: x"),
        ("{x:1,y:2}", "{x: 1, y: 2}"),
        ("Task(loc=x)", "Task(loc = x)"),
        ("True", "true"),
        ('"a\\"\\n"', '"a\\"\\n"'),
    ],
)
def test_the_fewest_parentheses(text: str, printed: str) -> None:
    assert print_expr(expression(text)) == printed
    assert expression(printed) == expression(text)


@pytest.mark.parametrize(
    ("value", "printed"),
    [
        (Fraction(0), "0.0"),
        (Fraction(5, 2), "2.5"),
        (Fraction(1, 1000), "0.001"),
        (Fraction(100), "100.0"),
        (Fraction(1, 10**9), "1e-9"),
        (Fraction(123, 10**12), "1.23e-10"),
        (Fraction(10**30), "1e30"),
        (Fraction(12345, 1), "12345.0"),
    ],
)
def test_decimals_are_short_and_exact(value: Fraction, printed: str) -> None:
    assert print_expr(ast.FloatLit(value)) == printed
    assert expression(printed) == ast.FloatLit(value)


@pytest.mark.parametrize(
    "number",
    ["1e399", "11e398", "1e-399", "0.01e-397", f"{'9' * 400}.0", f"0.{'0' * 300}{'7' * 99}", "0e7"],
)
def test_numbers_as_large_or_small_as_may_be_stay_so(number: str) -> None:
    formatted(f"param float x = {number}\n")


@pytest.mark.parametrize(
    "number", ["1e400", "11e399", "1e-400", "0.1e-399", "9" * 401, "0e99999", f"{'0' * 5000}1"]
)
def test_numbers_beyond_are_refused(number: str) -> None:
    found = parse(Source("t", f"param float x = {number}\n")).diagnostics
    assert [d.code for d in found] == ["K103"]


@pytest.mark.parametrize("op", [ast.BinaryOp.ADD, ast.BinaryOp.IMPLIES])
def test_long_chains_print_without_recursion(op: ast.BinaryOp) -> None:
    x: ast.Expr = ast.Name("x")
    chain = x
    for _ in range(5000):
        right = op is ast.BinaryOp.IMPLIES
        chain = ast.Binary(op, x, chain) if right else ast.Binary(op, chain, x)
    assert print_expr(chain) == f" {op.value} ".join(["x"] * 5001)


# --- layout -------------------------------------------------------------------------------------


def lay_out(text: str) -> str:
    return formatted(dedent(text).lstrip("\n"))


def test_one_layout_for_everything() -> None:
    assert lay_out(
        """
        using Motion:
          actuators:
            pos[] path
          sensors:
              pos psn
        local: int x = 0
        enum Mode: a,
          b
        allread:
          int  y[Nsys]
        def f(int a) -> int: extern fresh
          ensures: result>0
            result<9


        urgent Go:
          eff: if x==1: stop
            else: atomic:
              for i = 0,3:
                x=x+i
          pre: x>0
            x<9
        assume: x == 0
          true
        """
    ) == dedent(
        """\
        using Motion:
            sensors:
                pos psn
            actuators:
                pos[] path
        local:
            int x = 0
        enum Mode: a, b
        allread:
            int[Nsys] y
        def fun f(int a) -> int: extern fresh
            ensures:
                result > 0
                result < 9

        urgent Go:
            pre: x > 0 and x < 9
            eff:
                if x == 1: stop
                else: atomic:
                    for i = 0, 3:
                        x = x + i
        assume:
            x == 0
            true
        """
    )


def test_comments_stay_with_what_they_are_about() -> None:
    text = """\
    # the head of the file

    # about x
    local:  # locals
        int x  # about x

        # about y
        int y
        # at the end of the locals

    # about Go
    Go:
        # about pre
        pre: x == 1  # one
        eff:  # effect
            # first
            if x == 1:  # condition
                x = 2
                # at the end of then
            # before else
            else:  # otherwise
                # first of else
                x = 3
            # at the end of eff
        # at the end of Go
    # the end
    """
    assert lay_out(text) == dedent(text)


def test_comments_move_with_what_they_are_about() -> None:
    assert lay_out(
        """
        using M:
          # about actuators
          actuators:
            int a  # a
            # the last actuator
          # about sensors
          sensors:  # s
            int b
        E:
          # about eff
          eff: if x: stop  # why
            # about else
            else: y = 1
          # about pre
          pre: (x and
            # between
            y)  # y
        """
    ) == dedent(
        """\
        using M:
            # about sensors
            sensors:  # s
                int b
            # about actuators
            actuators:
                int a  # a
                # the last actuator
        E:
            # about pre
            # between
            pre: x and y  # y
            # about eff
            eff:
                if x: stop  # why
                # about else
                else: y = 1
        """
    )


def test_a_short_block_stays_where_it_stood() -> None:
    text = """\
    init: x = 1
    using M:
        sensors:
            int x
        environment: x = x + 1
    def fun f(int a) -> int: return a
    Go:
        pre: x == 1
        eff: atomic: for i = 0, 3: x = i  # all
    Stop:
        eff:
            for t in list: atomic:
                x = 1
                # last
                y = 1
            if x == 1: x = 2
            elif x == 2: atomic:
                # why
                x = 3
            else: for i = 0, 3:
                if x == 1: stop
                else:
                    x = 2
    """
    assert lay_out(text) == dedent(text)


def test_blank_lines_are_kept_one_at_most() -> None:
    assert lay_out(
        """


        local:

          int x



          int y
        E:

          eff:
            x = 1


            y = 2

            if x == 1:

              stop

            else:
              stop


        """
    ) == dedent(
        """\
        local:
            int x

            int y
        E:
            eff:
                x = 1

                y = 2

                if x == 1:
                    stop
                else:
                    stop
        """
    )


def test_trees_without_places_have_a_blank_line_between_long_sections() -> None:
    x = ast.Ident("x")
    stop = ast.Event(x, False, None, (ast.Stop(),))
    use = ast.Using(x, (), (), None, ())
    assert print_program(ast.Program((use, use, stop, stop, use))) == dedent(
        """\
        using x
        using x

        x:
            eff:
                stop

        x:
            eff:
                stop

        using x
        """
    )


def test_only_comments() -> None:
    assert lay_out("\n\n# one\n\n\n  # two\n") == "# one\n\n# two\n"
    assert format_source(Source("t", "\n\n")).text == ""


def test_a_text_with_mistakes_is_left_alone() -> None:
    text = "local:\n  int   x =\n"
    found = format_source(Source("t", text))
    assert found.text == text
    assert [d.code for d in found.diagnostics] == ["K130"]
