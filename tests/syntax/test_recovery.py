"""Every mistake is told once, where it is and with its cure; the rest of the program is read."""

from __future__ import annotations

import pytest

from koord.syntax import ast
from koord.syntax.parsing.report import MAX_ERRORS
from tests.syntax.reading import effect, read, section, told, told_in_effect

#: Lines of an event, and what is told of them: code, line, column.
IN_EVENTS = [
    ("if x = 3: stop", [("K132", 1, 6)]),
    ("if x == 3 stop", [("K114", 1, 11)]),
    ("if x == 3\n  stop\nx = 1", [("K114", 1, 10)]),
    ("if x = 3\n  stop", [("K132", 1, 6)]),
    ("if : stop", [("K130", 1, 4)]),
    ("if x:\ny = 3", [("K113", 1, 1)]),
    ("else: stop", [("K116", 1, 1)]),
    ("elseif x: stop", [("K116", 1, 1)]),
    (
        "if a: x = 1\nelse if b:\n  x = 2\nelseif c: x = 3\nelse: x = 4",
        [("K133", 2, 1), ("K133", 4, 1)],
    ),
    ("if x: stop else: y = 3", [("K117", 1, 12)]),
    ("if a: x = 1\nelse b: x = 2", [("K130", 2, 6)]),
    ("if a: x = 1\nelse x = 2", [("K114", 2, 6)]),
    ("atomic x = 1", [("K114", 1, 8)]),
    ("while x < 3:\n  x = 3", [("K133", 1, 1)]),
    ("for i in 0, n: x = 1", [("K139", 1, 7)]),
    ("for int i = 0, n:\n  x = 1", [("K139", 1, 5)]),
    ("for (i = 0; i < n; i++):\n  x = 1", [("K139", 1, 5)]),
    ("for i = 0 to n: x = 1", [("K139", 1, 11)]),
    ("for i = 3: stop", [("K139", 1, 10)]),
    ("for i = 0, n\n  x = 1", [("K114", 1, 13)]),
    ("x = 3 y = 4", [("K135", 1, 7)]),
    ("stop x", [("K135", 1, 6)]),
    ("x += 3", [("K133", 1, 3)]),
    ("x == 3", [("K132", 1, 3)]),
    ("x = y = 3", [("K132", 1, 7)]),
    ("x + 3", [("K136", 1, 1)]),
    ("x", [("K136", 1, 1)]),
    ("f(x) = 3", [("K136", 1, 1)]),
    ("x@i = 3", [("K136", 1, 1)]),
    ("x[] = 3", [("K130", 1, 3)]),
    ("x =", [("K130", 1, 4)]),
    ("x = not", [("K130", 1, 8)]),
    ("x = f(a,, b)", [("K130", 1, 9)]),
    ("x.3 = 4", [("K130", 1, 3)]),
    ("x = {a: 3, b}", [("K130", 1, 13)]),
    ("x = 'abc'", [("K130", 1, 5)]),
    ("x = forall i x", [("K130", 1, 15)]),
    ("x = a b", [("K135", 1, 7)]),
    ("x = a & b | c", [("K133", 1, 7), ("K133", 1, 11)]),
    ("x = a -> b", [("K133", 1, 7)]),
    ("x = a => b", [("K133", 1, 7)]),
    ("x := 3", [("K133", 1, 3)]),
    ("x = a AND b", [("K133", 1, 7)]),
    ("x = a ∧ ¬b", [("K133", 1, 7), ("K133", 1, 9)]),
    ("x = a < b < c", [("K134", 1, 11)]),
    ("x = 1;\ny = 2; z = 3", [("K133", 1, 6), ("K133", 2, 6)]),
    ("local = 3", [("K131", 1, 1)]),
    ("int init = 3", [("K131", 1, 5)]),
    ("x = pre + 1", [("K131", 1, 5)]),
    ("int a, b", [("K137", 1, 6)]),
    ('x = "abc\ny = 3', [("K102", 1, 5)]),
    ('x = "abc\\', [("K102", 1, 5)]),
    ('if x == "abc: y = 3', [("K102", 1, 9)]),
    (r'x = "a\qc"', [("K104", 1, 7)]),
    ("x = 3abc", [("K103", 1, 5)]),
    ("x = .5", [("K103", 1, 5)]),
    ("x = 1. + y", [("K103", 1, 6)]),
    ("x = 1e999", [("K103", 1, 5)]),
    ("x = é + 3", [("K101", 1, 5)]),
    ("x = $y$", [("K101", 1, 5), ("K101", 1, 7)]),
    ("x = “a”", [("K101", 1, 5), ("K101", 1, 7)]),
    ("x = (a\ny = 3", [("K120", 1, 5)]),
    ("x = f(a, (b\nx = 3\ny = 4", [("K120", 1, 10)]),
    ("x = f(a,\n      b\ny = 3", [("K120", 1, 6)]),
    ("x = (a\ny = (b\nz = 3", [("K120", 1, 5), ("K120", 2, 5)]),
    ("if (x == 3:\n  stop\ny = 3", [("K120", 1, 4)]),
    ("x = f(a]\ny = 3", [("K121", 1, 8)]),
    ("x = [f(a]\ny = 3", [("K120", 1, 7)]),
    ("x = a)\ny = 3", [("K122", 1, 6)]),
    ("x = 1:\n  y = 2", [("K115", 1, 6)]),
    ("x = 1\neff: y = 2", [("K141", 2, 1)]),
    ("requires: x", [("K141", 1, 1)]),
]


@pytest.mark.parametrize(("lines", "expected"), IN_EVENTS, ids=[text for text, _ in IN_EVENTS])
def test_mistakes_in_statements(lines: str, expected: list[tuple[str, int, int]]) -> None:
    assert told_in_effect(lines) == expected


#: Whole texts, and what is told of them.
IN_SECTIONS = [
    ("int x = 3\nint y = 3", [("K141", 1, 1)]),
    ("x = 3\nif x: stop", [("K141", 1, 1)]),
    ("pre: x", [("K141", 1, 1)]),
    ("forall i: x@i", [("K141", 1, 1)]),
    ("local\n  int x", [("K407", 1, 6)]),
    ("local int x", [("K407", 1, 7)]),
    ("local:\n  x = 3", [("K139", 2, 3)]),
    ("local:\n  int", [("K139", 2, 3)]),
    ("local:\n  int 3", [("K130", 2, 7)]),
    ("local:\n  x: int", [("K115", 2, 4)]),
    ("local:\n  int y =", [("K130", 2, 10)]),
    ("local:\n  pos[] path, route", [("K137", 2, 13)]),
    ("local:\n  int local", [("K131", 2, 7)]),
    ("local:\n  int z = 3 4", [("K130", 2, 13)]),
    ("Assign\n  pre: x\n  eff: y = 3", [("K407", 1, 7)]),
    ("Assign:\n  x = 3\n  y = 4", [("K141", 2, 3)]),
    ("Assign:\n  pre: x", [("K143", 1, 1)]),
    ("Assign:", [("K113", 1, 1)]),
    ("stop:\n  eff: stop", [("K131", 1, 1)]),
    ("urgent:\n  eff: stop", [("K130", 1, 7)]),
    ("urgent stop:\n  eff: stop", [("K131", 1, 8)]),
    ("event Assign:\n  eff: stop", [("K141", 1, 1)]),
    ("E:\n  pre: x\n  pre: y\n  eff: x = 3", [("K142", 3, 3)]),
    ("E:\n  pre x\n  eff x = 3", [("K407", 2, 7), ("K407", 3, 7)]),
    ("E:\n  eff: x = 3\n  local:\n    int x", [("K141", 3, 3)]),
    ("using Motion\n  sensors:\n    int x", [("K407", 1, 13)]),
    ("using Motion:\n  int x", [("K141", 2, 3)]),
    ("using Motion:\n  sensors\n    int x", [("K407", 2, 10)]),
    ("using:\n  sensors:\n    int x", [("K130", 1, 6)]),
    ("using M:\n  environment: x = 1\n  environment: y = 1", [("K142", 3, 3)]),
    ("sensors:\n  int x", [("K141", 1, 1)]),
    ("contract K:\n  requires: x", [("K141", 1, 1)]),
    ("def Task\n  int x", [("K407", 1, 9)]),
    ("def Task:", [("K113", 1, 1)]),
    ("def fun f(a, b) -> int:\n  return a", [("K139", 1, 11)]),
    ("def fun f(int a -> int:\n  return a", [("K120", 1, 10)]),
    ("def fun f(int a) int:\n  return a", [("K130", 1, 18)]),
    ("def fun f(int a) -> int\n  return a", [("K407", 1, 24)]),
    ("def fun f(int a):\n  ensures: a", [("K141", 2, 3)]),
    ("def fun f(int a): extern\n  a > 0", [("K141", 2, 3)]),
    ("invariant x > 3", [("K114", 1, 11)]),
    ("invariant Foo\n  x > 3", [("K407", 1, 14)]),
    ("invariant Foo: x = 3", [("K132", 1, 18)]),
    ("invariant: forall 3: x", [("K138", 1, 19)]),
    ("invariant:\n  x +", [("K130", 2, 6)]),
    ("eventually:\n  a\n  b", [("K135", 3, 3)]),
    ("enum Mode: a b", [("K130", 1, 14)]),
    ("enum Mode a, b", [("K114", 1, 11)]),
    ("param n = 4", [("K139", 1, 7)]),
    ("agent A:\n  agent B:\n    init: x = 1", [("K141", 2, 3)]),
]


@pytest.mark.parametrize(("text", "expected"), IN_SECTIONS, ids=[text for text, _ in IN_SECTIONS])
def test_mistakes_in_sections(text: str, expected: list[tuple[str, int, int]]) -> None:
    assert told(text) == expected
    assert told(text + "\nF:\n  eff: x = = 1\n")[-1:] == [("K130", text.count("\n") + 3, 12)]


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("if x = 3: stop", "if x == 3: stop"),
        ("if x == 3 stop", "if x == 3: stop"),
        ("if x == 3\n  stop", "if x == 3: stop"),
        ("if (x == 3:\n  stop", "if x == 3: stop"),
        ("if x: stop else: y = 3", "if x: stop\nelse: y = 3"),
        (
            "if a: x = 1\nelse if b: x = 2\nelseif c: stop",
            "if a: x = 1\nelif b: x = 2\nelif c: stop",
        ),
        ("if x:\n  stop\nelse y = 1", "if x:\n  stop\nelse: y = 1"),
        ("atomic x = 1\n  y = 2", "atomic:\n  x = 1\n  y = 2"),
        ("for i in 0, n: stop", "for i = 0, n: stop"),
        ("for int i = 0, n: stop", "for i = 0, n: stop"),
        ("for i = 0 to n: stop", "for i = 0, n: stop"),
        ("x += y - 1", "x = x + (y - 1)"),
        ("x -= 1", "x = x - 1"),
        ("x == 3", "x = 3"),
        ("x = 1; y = 2;", "x = 1\ny = 2"),
        ("x = a & b", "x = a and b"),
        ("x = a AND b", "x = a and b"),
        ("x = a ∧ ¬b", "x = a and not b"),
        ("x = .5 + 1.", "x = 0.5 + 1.0"),
        ("x = f(a]", "x = f(a)"),
        ("x = f([a)\ny = 3", "x = f([a])\ny = 3"),
        ("x = f(a\ny = 3", "x = f(a)\ny = 3"),
        ("x = a)", "x = a"),
        ("x = 3 y = 4", "x = 3"),
        ("int a, b", "int a\nint b"),
        ('x = "a', 'x = ""'),
    ],
)
def test_what_was_most_likely_meant_is_read(wrong: str, right: str) -> None:
    parsed = read("E:\n  eff:\n" + "".join(f"    {line}\n" for line in wrong.split("\n")))
    assert parsed.diagnostics != ()
    (event,) = parsed.program.sections
    assert isinstance(event, ast.Event)
    assert event.eff == effect(right)


def test_a_declaration_keeps_its_name_without_its_value() -> None:
    parsed = read("local:\n  int x = = 3\n  int y\n")
    assert [d.code for d in parsed.diagnostics] == ["K130"]
    assert parsed.program.sections == (section("local:\n  int x\n  int y\n"),)


def test_statements_of_an_event_without_eff_are_its_effect() -> None:
    parsed = read("E:\n  pre: x\n  y = 1\n  stop\n")
    assert [d.code for d in parsed.diagnostics] == ["K141"]
    assert parsed.program.sections == (section("E:\n  pre: x\n  eff:\n    y = 1\n    stop\n"),)


def test_names_in_what_could_not_be_read_are_remembered() -> None:
    parsed = read(
        """
        local:
          int a 3
          int
        E:
          eff:
            x = f(b +)
            y = 1
        record R:
          int c
        """
    )
    assert parsed.program.lost >= {"f", "b", "x", "R", "c"}
    assert "y" not in parsed.program.lost


def test_all_mistakes_of_a_file_are_told_in_one_run() -> None:
    text = "".join(f"{lines}\n" for lines, _ in IN_SECTIONS[2:30])
    found = {code for code, _, _ in told(text)}
    assert found >= {code for _, expected in IN_SECTIONS[4:30] for code, _, _ in expected}


def test_after_many_mistakes_the_rest_is_not_told() -> None:
    parsed = read("E:\n  eff:\n" + "    x = = 1\n" * (MAX_ERRORS + 50))
    assert len(parsed.diagnostics) == MAX_ERRORS
    assert [d.span.line for d in parsed.diagnostics] == list(range(3, MAX_ERRORS + 3))
    (note,) = parsed.diagnostics[-1].notes
    assert str(MAX_ERRORS) in note.message


# --- what is said -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lines", "message", "hint"),
    [
        ("if x = 3: stop", "`=` assigns; `==` compares", "write `==`"),
        ("x = f(a b)", "`,` or an operator is missing before `b`", None),
        ("x = f(a:", "`(` is not closed on its line or below", "write the `)` that belongs to it"),
        ("x = (a,)", "a value is expected here, but found `)`", None),
        ("x = [a,]", "a value is expected here, but found `]`", None),
        ("x = f(y", "`(` is not closed on its line or below", "write the `)` that belongs to it"),
        ("x =", "a value is expected here, but the line ends", None),
        (
            "x = 1 +",
            "a value is expected here, but the line ends",
            "write what stands behind `+`; an expression goes on below if it is in brackets",
        ),
        ("x.", "a name is expected here, but the line ends", None),
        ("for x in y", "`:` is missing behind `y`", "write `:`"),
        (
            "init = 3",
            "`init` is a keyword and cannot be used as a name",
            "choose another name, such as `init_`",
        ),
        ("x += 1", "`+=` is not a sign of the language", "write `x = x + …`"),
        ("x = .5", "a number begins with a digit", "write `0.5`"),
        ("x[] = 1", "an index is missing between `[` and `]`", None),
    ],
)
def test_messages_speak_of_the_language(lines: str, message: str, hint: str | None) -> None:
    body = "      stop\n" if lines.startswith("for") else ""
    (found,) = read(f"E:\n  eff:\n    {lines}\n{body}").diagnostics
    assert (found.message, found.hint) == (message, hint)


def test_a_bracket_closed_by_another_kind_points_at_both() -> None:
    (found,) = read("E:\n  eff: x = f(a]\n").diagnostics
    assert (found.span.column, found.span.end_column) == (15, 16)
    (note,) = found.notes
    assert (note.span.column, note.message) == (13, "`(` opens here")


def test_no_message_names_a_terminal_of_the_grammar() -> None:
    terminals = {"NAME", "LPAR", "RPAR", "LSQB", "OPERATOR", "ASSIGN", "COLON", "INT", "MINUS"}
    for lines, _ in IN_EVENTS:
        text = "E:\n  eff:\n" + "".join(f"    {line}\n" for line in lines.split("\n"))
        for found in read(text).diagnostics:
            said = found.message + (found.hint or "")
            assert not terminals & set(said.replace("`", " ").split()), said


@pytest.mark.parametrize(
    ("text", "cure"),
    [
        ("locl:\n  int x\n", "did you mean `local`?"),
        ("allredd:\n  int[] x\n", "did you mean `allread`?"),
        ("invarient A: x > 0\n", "did you mean `invariant`?"),
        ("invarient: x > 0\n", "did you mean `invariant`?"),
        ("assum: x > 0\n", "did you mean `assume`?"),
        ("E:\n  pree: x > 0\n  eff: stop\n", "did you mean `pre:`?"),
        ("E:\n  guard: x > 0\n  eff: stop\n", "did you mean `pre:`?"),
        ("E:\n  pre: x > 0\n  effect: stop\n", "did you mean `eff:`?"),
        ("using M:\n  sensor:\n    int x\n", "did you mean `sensors`?"),
    ],
)
def test_misspelt_words_of_the_language(text: str, cure: str) -> None:
    found = read(text).diagnostics
    assert [(d.code, d.hint) for d in found] == [("K141", cure)]


def test_events_may_be_called_almost_like_sections() -> None:
    assert read("Init:\n  pre: x\n  eff: stop\nLocals:\n  eff: stop\n").diagnostics == ()


def test_a_range_of_another_language() -> None:
    found = read("E:\n  eff:\n    for i in 0..3: x = i\n").diagnostics
    assert [d.code for d in found] == ["K133"]
