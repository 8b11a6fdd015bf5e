"""What published programs also write: joined lines, texts, functions without types or bodies."""

from __future__ import annotations

from fractions import Fraction

import pytest

from koord.syntax import core
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.types import FLOAT, INT, STRING
from tests.loading import program_of
from tests.syntax.elaborating import codes, diagnostics, effect, errors, only, program, value
from tests.syntax.reading import expression, told

# --- lines that are joined ------------------------------------------------------------------------


def test_a_line_that_ends_with_a_backslash_goes_on_below() -> None:
    """[OLD-LINE]"""
    joined = program("""
        local:
          int n = 1 + \\
                  2
        E:
          pre: n < 3 and \\
           n > 0 \\
               or n == 3
          eff:
            n = n + \\
          1
            n = n * 2
    """)
    plain = program("""
        local:
          int n = 1 + 2
        E:
          pre: n < 3 and n > 0 or n == 3
          eff:
            n = n + 1
            n = n * 2
    """)
    assert joined == plain


def test_places_behind_a_joined_line_are_those_of_the_text() -> None:
    assert told("E:\n  eff:\n    x = 1 + \\\n      = 2\n    y = = 3\n") == [
        ("K130", 4, 7),
        ("K130", 5, 9),
    ]


def test_a_backslash_elsewhere_is_no_sign_of_the_language() -> None:
    assert told("E:\n  eff: x = 1 \\ 2\n") == [("K101", 2, 14)]


# --- texts ----------------------------------------------------------------------------------------


def test_what_is_written_is_written_piece_by_piece() -> None:
    """``"s" + x`` says what ``"s" << x`` does. [OUTPUT]"""
    assert effect('stdout << "n = " + 1 + 2 << 3') == effect('stdout << "n = " << 1 << 2 << 3')
    assert effect('stdout << 1 + 2 + " n"') == effect('stdout << (1 + 2) << " n"')
    (written,) = effect('stdout << 1 + 2 + " n"')
    assert isinstance(written, core.Output)
    assert written.values == (core.Const(3, INT), core.Const(" n", STRING))


def test_texts_are_joined_elsewhere() -> None:
    """[E-TEXT]"""
    made = value('"n = " + 1', type_="string")
    assert isinstance(made, core.ExternalCall)
    assert (made.function, made.type) == ("joinedText", STRING)
    first, second = made.arguments
    assert first == core.Const("n = ", STRING)
    assert isinstance(second, core.ExternalCall)
    assert (second.function, second.arguments) == ("textOf", (core.Const(1, INT),))


def test_what_has_no_text_is_not_joined() -> None:
    above = "local:\n  string s\n  int[] list = []\nE:\n  eff: s = {}\n"
    assert errors(above.format('"a" + list')) == ["K229"]
    assert errors(above.format('"a" - "b"')) == ["K229"]


# --- angles ---------------------------------------------------------------------------------------


def test_pi_is_a_constant_unless_it_is_declared() -> None:
    assert value("pi", type_="float") == core.Const(Fraction("3.141592653589793"), FLOAT)
    assert errors("local:\n  int pi = 3\n  int n = 0\nE:\n  pre: n < pi\n  eff: n = pi\n") == []


@pytest.mark.parametrize("call", ["sin(1)", "cos(0.5)", "atan2(1, 2.5)"])
def test_functions_of_angles_are_external(call: str) -> None:
    assert isinstance(value(call, type_="float"), core.ExternalCall)


# --- results that are found out -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "result"),
    [
        ("return a", "int"),
        ("return a < 3", "bool"),
        ("if a > 0: return 1\n  return 0.5", "float"),
        ("return twice(a)", "int"),
        ("pos p = pos(0, a, 0)\n  return [p]", "pos[]"),
    ],
)
def test_the_type_of_a_result_is_that_of_what_is_returned(body: str, result: str) -> None:
    """[E-CALL]"""
    text = "def fun f(int a){}:\n  {}\ndef fun twice(int a){}:\n  return 2 * a\n"
    text += "local:\n  {} x\nE:\n  eff: x = f(3)\n"
    assert program_of(text.format("", body, "", result)) == program_of(
        text.format(f" -> {result}", body, " -> int", result)
    )


def test_what_a_function_returns_is_of_one_type() -> None:
    found = only("def fun f(int a):\n  if a > 0: return 1\n  return true\nE:\n  eff: stop\n")
    assert found.code == "K204"
    assert found.message == "the result is an `int`, but this is a `bool`"


def test_what_calls_itself_has_no_type() -> None:
    assert "K216" in errors("def fun f(int a):\n  return f(a - 1)\nE:\n  eff: stop\n")


def test_a_function_that_returns_nothing_is_none() -> None:
    assert errors("def fun f(int a):\n  int b = a\nE:\n  eff: stop\n") == ["K228"]


# --- functions that nobody declares ---------------------------------------------------------------

UNDECLARED = """\
local:
  int n = 0
  bool b = false
E:
  pre: ready(n, true)
  eff:
    if b: hello()
    n = weigh(n) + 1
    hello()
    b = ready(2, b)
invariant: forall i: safe(n@i)
"""


def missing(text: str) -> Diagnostic:
    (found,) = (d for d in diagnostics(text) if d.code == "K202")
    return found


def test_one_message_says_how_to_declare_them() -> None:
    found = missing(UNDECLARED)
    assert found.message == "there are no functions `ready`, `hello`, `weigh` and `safe`"
    assert found.hint == (
        "declare each, as in `def fun ready(int a1, bool a2) -> bool: extern fresh`; "
        "`koord migrate --stub` writes that"
    )
    assert [note.span.line for note in found.notes] == [7, 8, 11]


def test_its_edit_declares_them_at_the_end() -> None:
    (edit,) = missing(UNDECLARED).edits
    assert (edit.span.line, edit.span.column) == (12, 1)
    assert edit.text.splitlines()[2:] == [
        "def fun ready(int a1, bool a2) -> bool: extern fresh",
        "def fun hello() -> bool: extern fresh",
        "def fun weigh(int a1) -> int: extern fresh",
        "def fun safe(int a1) -> bool: extern",
    ]


def test_a_single_one_is_told_with_all_its_places() -> None:
    found = missing("E:\n  eff: hello()\nF:\n  eff: hello()")
    assert found.message == "there is no function `hello`; it stands in line 4 as well"
    assert found.edits[0].text.startswith("\n\n#")


def test_a_misspelt_name_is_told_by_itself() -> None:
    found = [d for d in diagnostics("E:\n  eff: hello()\n  pre: sqrtt(2) > 1\n") if d.edits]
    assert [d.message for d in found] == ["there is no function `hello`"]


def test_an_external_function_may_be_called_for_what_it_does() -> None:
    """Its answer is not looked at. [S-CALL]"""
    text = "def fun beep(int n) -> bool: extern fresh\nE:\n  eff: beep(pid)\n"
    made = program(text)
    (statement,) = made.agents[0].events[0].effect
    assert isinstance(statement, core.Assign)
    assert statement.place.variable.home is core.Home.BOUND
    assert isinstance(statement.value, core.ExternalCall)
    assert codes("def fun f(int n) -> int:\n  return n\nE:\n  eff: f(pid)\n") == ["K228"]


def test_a_position_prints_with_its_name() -> None:
    assert expression("(1, 2, 3) == p") == expression("pos(1, 2, 3) == p")
