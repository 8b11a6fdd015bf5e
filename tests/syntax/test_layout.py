"""Which line belongs to which block, and what is said where nobody can know."""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.syntax import ast
from koord.syntax.parsing.parser import parse
from koord.syntax.source import Source, normalise
from tests.syntax.reading import codes, effect, program, read, section, told

LISTING = Path(__file__).parent / "golden" / "task_as_printed.krd"

X1, X2, X3 = (ast.Assign(ast.Name("x"), ast.IntLit(value)) for value in (1, 2, 3))
A, B = ast.Name("a"), ast.Name("b")


def event(text: str) -> ast.Block:
    found = section(text)
    assert isinstance(found, ast.Event)
    return found.eff


# --- bodies -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "E:\n  eff:\n    x = 1\n    x = 2\n",
        "E:\n  eff: x = 1\n       x = 2\n",
        "E:\n  eff: x = 1\n    x = 2\n",
        "E:\n eff: x = 1\n          x = 2\n",
        "E: eff: x = 1\n  x = 2\n",
        "E:\n  eff:\n\n    x = 1\n  # between\n\n    x = 2\n",
        "E:\n  eff:\n    x = 1\n    x = 2",
    ],
)
def test_a_body_begins_on_the_line_or_below_and_is_one_block(text: str) -> None:
    assert event(text) == (X1, X2)


def test_several_blocks_open_on_one_line() -> None:
    assert effect("if a: x = 1\nelse: atomic: if b: x = 2") == (
        ast.If(((A, (X1,)),), (ast.Atomic((ast.If(((B, (X2,)),), None),)),)),
    )


def test_lines_below_go_on_with_the_last_open_block() -> None:
    assert effect("if a: atomic:\n  x = 1\n  x = 2\nx = 3") == (
        ast.If(((A, (ast.Atomic((X1, X2)),)),), None),
        X3,
    )


@pytest.mark.parametrize("indent", [3, 4, 6, 7])
def test_else_of_an_if_that_began_on_the_line_of_its_eff(indent: int) -> None:
    text = f"E:\n  eff: if a: x = 1\n{' ' * indent}else: x = 2\n{' ' * indent}x = 3\n"
    assert event(text) == (ast.If(((A, (X1,)),), (X2,)), X3)


def test_elif_there_as_well() -> None:
    text = "E:\n  eff: if a: x = 1\n    elif b: x = 2\n    else: x = 3\n"
    assert event(text) == (ast.If(((A, (X1,)), (B, (X2,))), (X3,)),)


@pytest.mark.parametrize("indent", [3, 4, 6, 7])
def test_else_of_an_if_that_began_there_with_its_body_below(indent: int) -> None:
    text = f"E:\n  eff: if a:\n         x = 1\n{' ' * indent}else: x = 2\n"
    assert event(text) == (ast.If(((A, (X1,)),), (X2,)),)
    assert event(f"{text}{' ' * indent}x = 3\n") == (ast.If(((A, (X1,)),), (X2,)), X3)


def test_a_statement_below_the_if_goes_on_with_the_effect() -> None:
    text = "E:\n  eff: if a:\n         x = 1\n       x = 2\n"
    assert event(text) == (ast.If(((A, (X1,)),), None), X2)
    text = "E:\n  eff: if a: x = 1\n             x = 2\n       else: x = 3\n"
    assert event(text) == (ast.If(((A, (X1, X2)),), (X3,)),)


def test_statements_between_the_head_and_the_if_are_told() -> None:
    text = "E:\n  eff: if a:\n         x = 1\n    x = 2\n"
    assert told(text) == [("K111", 4, 5)]
    text = "E:\n  eff: if a: if b:\n         x = 1\n    else: x = 2\n"
    assert told(text) == [("K111", 4, 5)]


def test_an_else_at_the_level_of_eff_is_outside_of_it() -> None:
    text = "E:\n  eff: if a: x = 1\n  else: x = 2\n"
    found = read(text).diagnostics
    assert [(d.code, d.hint) for d in found] == [("K141", "indent it deeper than the `eff:`")]


@pytest.mark.parametrize(("indent", "inner"), [(7, False), (13, True), (20, True)])
def test_of_two_bodies_on_a_line_the_column_decides(indent: int, inner: bool) -> None:
    found = event(f"E:\n  eff: if a: x = 1\n{' ' * indent}x = 2\n")
    assert found == (
        (ast.If(((A, (X1, X2)),), None),) if inner else (ast.If(((A, (X1,)),), None), X2)
    )


@pytest.mark.parametrize("indent", [3, 6, 8, 12])
@pytest.mark.parametrize("line", ["x = 2", "if b: x = 2"])
def test_a_line_that_may_belong_to_two_bodies_is_told(line: str, indent: int) -> None:
    text = f"E:\n  eff: if a: x = 1\n{' ' * indent}{line}\n"
    assert told(text) == [("K112", 3, indent + 1)]


@pytest.mark.parametrize("indent", [1, 2, 3, 5, 8])
def test_eff_goes_on_with_the_event_wherever_it_stands(indent: int) -> None:
    found = section(f"E: pre: a\n{' ' * indent}eff: x = 1\n")
    assert found == section("E:\n  pre: a\n  eff: x = 1\n")


def test_an_else_that_may_belong_to_two_ifs_is_told() -> None:
    assert told("E:\n  eff: if a: if b: x = 1\n    else: x = 2\n") == [("K112", 3, 5)]
    inner = event("E:\n  eff: if a: if b: x = 1\n             else: x = 2\n")
    assert inner == (ast.If(((A, (ast.If(((B, (X1,)),), (X2,)),)),), None),)


def test_blocks_close_where_the_indentation_goes_back() -> None:
    assert effect("if a:\n  if b:\n      x = 1\n  x = 2\nx = 3") == (
        ast.If(((A, (ast.If(((B, (X1,)),), None), X2)),), None),
        X3,
    )


# --- lines --------------------------------------------------------------------------------------


def test_a_line_goes_on_inside_brackets_at_any_indentation() -> None:
    assert effect("x = f(a,\n# why\n\n        b)\nx = [\na\n]\nx = 3") == (
        ast.Assign(
            ast.Name("x"), ast.Call(ast.Ident("f"), (ast.Argument(None, A), ast.Argument(None, B)))
        ),
        ast.Assign(ast.Name("x"), ast.ListLit((A,))),
        X3,
    )


@pytest.mark.parametrize(
    "text",
    [
        "invariant I: a and\n  b\n",
        "invariant I: a\n  and b\n",
        "invariant I:\n  a and\n  b\n",
        "invariant I:\n  a\n  and b\n",
        "invariant I:\n  a\n    and\n      b\n",
        "invariant I:\n  a\n  b\n",
        "invariant I: (a\nand b)\n",
    ],
)
def test_properties_go_on_over_lines(text: str) -> None:
    assert section(text) == ast.Invariant(ast.Ident("I"), False, ast.Binary(ast.BinaryOp.AND, A, B))


def test_a_quantifier_goes_on_below_its_colon() -> None:
    text = "invariant:\n  forall i:\n    exists k in 0, 3:\n    a\n"
    binders = (ast.Binder((ast.Ident("k"),), low=ast.IntLit(0), high=ast.IntLit(3)),)
    inner = ast.Quantified(ast.Quantifier.EXISTS, binders, A)
    outer = ast.Quantified(ast.Quantifier.FORALL, (ast.Binder((ast.Ident("i"),)),), inner)
    assert section(text) == ast.Invariant(None, False, outer)


def test_the_lines_of_assume_are_one_assumption_each() -> None:
    assert program("assume N: a\n  b and\n    a\n  b\n").sections == (
        ast.Assume(ast.Ident("N"), A),
        ast.Assume(ast.Ident("N"), ast.Binary(ast.BinaryOp.AND, B, A)),
        ast.Assume(ast.Ident("N"), B),
    )


def test_statements_go_on_only_inside_brackets() -> None:
    parsed = read("E:\n  eff:\n    x = a +\n      b\n    x = a\n       + b\n")
    assert [(d.code, d.span.line) for d in parsed.diagnostics] == [("K119", 4), ("K119", 6)]
    (event_,) = parsed.program.sections
    assert isinstance(event_, ast.Event)
    assert event_.eff == (ast.Assign(ast.Name("x"), ast.Binary(ast.BinaryOp.ADD, A, B)),) * 2


def test_a_line_that_begins_with_minus_is_one_of_its_own() -> None:
    minus = ast.Unary(ast.UnaryOp.NEG, A)
    assert program("assume: b\n  -a\n  b -\n  a\n").sections == (
        ast.Assume(None, B),
        ast.Assume(None, minus),
        ast.Assume(None, ast.Binary(ast.BinaryOp.SUB, B, A)),
    )


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_line_ends_and_marks_of_all_systems(ends: str) -> None:
    text = "\ufefflocal:\n  int x\nE:\n  eff: x = 1"
    expected = program("local:\n  int x\nE:\n  eff: x = 1\n")
    parsed = parse(Source("t", normalise(text.replace("\n", ends))))
    assert parsed.diagnostics == ()
    assert parsed.program == expected


@pytest.mark.parametrize("text", ["", "\n\n", "  \n", "# only\n  // comments", "   "])
def test_empty_texts(text: str) -> None:
    parsed = read(text)
    assert (parsed.program.sections, parsed.diagnostics) == ((), ())


# --- mistakes -----------------------------------------------------------------------------------


def test_a_line_too_deep_is_told_once_and_read_at_its_level() -> None:
    text = (
        "E:\n  eff:\n    x = 1\n      x = 2\n      if a:\n        x = 3\n      x = 1\n    x = 2\n"
    )
    parsed = read(text)
    assert [(d.code, d.span.line, d.span.column, d.hint) for d in parsed.diagnostics] == [
        ("K110", 4, 7, "indent it with 4 spaces")
    ]
    (found,) = parsed.program.sections
    assert isinstance(found, ast.Event)
    assert found.eff == (X1, X2, ast.If(((A, (X3,)),), None), X1, X2)


def test_a_file_that_is_indented_as_a_whole() -> None:
    parsed = parse(Source("t", "  local:\n    int x\n  E:\n    eff: x = 1\n"))
    assert [(d.code, d.hint) for d in parsed.diagnostics] == [
        ("K110", "begin it at the left margin")
    ]
    assert len(parsed.program.sections) == 2


@pytest.mark.parametrize("rest", ["    x = 3\n", "     x = 3\n", "        x = 3\n"])
def test_an_indentation_of_no_block_is_told_once(rest: str) -> None:
    text = f"E:\n  eff:\n    if a:\n        x = 1\n     x = 2\n{rest}"
    assert told(text) == [("K111", 5, 6)]


def test_else_at_an_indentation_of_no_block_keeps_its_if() -> None:
    text = "E:\n  eff:\n    if a:\n        x = 1\n      else:\n        x = 2\n"
    parsed = read(text)
    assert [d.code for d in parsed.diagnostics] == ["K111"]
    (found,) = parsed.program.sections
    assert isinstance(found, ast.Event)
    assert found.eff == (ast.If(((A, (X1,)),), (X2,)),)


def test_tabs_are_told_once_and_nothing_else_is_said_of_the_indentation() -> None:
    text = "local:\n\tint x\nE:\n\teff:\n\t  x = 1\n\t\tx = 2\n"
    parsed = parse(Source("t", text))
    assert [(d.code, d.span.line, d.span.column) for d in parsed.diagnostics] == [("K105", 2, 1)]
    assert "4 more lines" not in parsed.diagnostics[0].message
    assert "3 more lines" in parsed.diagnostics[0].message
    assert len(parsed.program.sections) == 2


def test_tabs_elsewhere_are_spaces() -> None:
    assert codes("local:\n  int\tx\t= 3\t# three\n\t\n") == []


@pytest.mark.parametrize(
    ("text", "sections"),
    [
        ("E:\npre: a\neff: x = 1\nF:\n  eff: x = 2\n", 2),
        ("local:\nint x\nint y\nE:\n  eff: x = 1\n", 2),
        ("using M:\nsensors:\n  int x\nE:\n  eff: x = 1\n", 2),
    ],
)
def test_a_body_at_the_level_of_its_head_is_told_once(text: str, sections: int) -> None:
    parsed = read(text)
    assert [(d.code, d.span.line) for d in parsed.diagnostics] == [("K113", 2)]
    assert len(parsed.program.sections) == sections


# --- the listing in the paper -------------------------------------------------------------------


def test_the_listing_has_one_mistake_of_layout_and_is_one_block() -> None:
    parsed = parse(Source("task.krd", LISTING.read_text(encoding="utf-8")))
    (mistake,) = parsed.diagnostics
    assert (mistake.code, mistake.span.line, mistake.span.column) == ("K110", 25, 13)
    assert mistake.hint == "indent it with 10 spaces"
    assign, complete = parsed.program.sections[-2:]
    assert isinstance(assign, ast.Event)
    assert isinstance(complete, ast.Event)
    (choice,) = assign.eff
    assert isinstance(choice, ast.If)
    assert choice.arms[0][1] == (ast.Stop(),)
    assert choice.otherwise is not None
    (atomic,) = choice.otherwise
    assert isinstance(atomic, ast.Atomic)
    (loop,) = atomic.body
    assert isinstance(loop, ast.ForRange)
    (free,) = loop.body
    assert isinstance(free, ast.If)
    assert [type(s) for s in free.arms[0][1]] == [ast.Assign, ast.Assign, ast.If]
    assert [type(s) for s in complete.eff] == [ast.Assign, ast.Assign]


def test_the_listing_mended_is_read_without_a_word() -> None:
    lines = LISTING.read_text(encoding="utf-8").splitlines()
    lines[24:36] = [line.removeprefix("  ") for line in lines[24:36]]
    mended = parse(Source("task.krd", "\n".join(lines)))
    as_printed = parse(Source("task.krd", LISTING.read_text(encoding="utf-8")))
    assert mended.diagnostics == ()
    assert mended.program == as_printed.program
