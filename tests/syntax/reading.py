"""What the tests of reading share: texts to trees and to what is told of them."""

from __future__ import annotations

from textwrap import dedent

from koord.syntax import ast
from koord.syntax.parsing.parser import Parsed, parse
from koord.syntax.source import Source, normalise

_BEFORE = "E:\n  eff:\n"


def read(text: str) -> Parsed:
    """The text, indented as the code around it, read."""
    return parse(Source("t.krd", normalise(dedent(text).lstrip("\n"))))


def program(text: str) -> ast.Program:
    """The tree of a text without mistakes."""
    parsed = read(text)
    assert parsed.diagnostics == ()
    return parsed.program


def section(text: str) -> ast.Section:
    """The only section of a text without mistakes."""
    (found,) = program(text).sections
    return found


def effect(lines: str) -> ast.Block:
    """The statements of an event, from lines without mistakes."""
    event = section(_BEFORE + _indented(lines))
    assert isinstance(event, ast.Event)
    return event.eff


def statement(line: str) -> ast.Stmt:
    """The only statement of a line without mistakes."""
    (found,) = effect(line)
    return found


def expression(text: str) -> ast.Expr:
    """The expression that a text without mistakes is."""
    found = section(f"invariant: {text}\n")
    assert isinstance(found, ast.Invariant)
    return found.condition


def told(text: str) -> list[tuple[str, int, int]]:
    """Code, line and column of everything that is wrong with a text."""
    return [(d.code, d.span.line, d.span.column) for d in read(text).diagnostics]


def told_in_effect(lines: str) -> list[tuple[str, int, int]]:
    """The same for lines of an event; lines and columns count in ``lines``."""
    return [(code, line - 2, column - 4) for code, line, column in told(_BEFORE + _indented(lines))]


def codes(text: str) -> list[str]:
    """The codes of everything that is wrong with a text."""
    return [code for code, _, _ in told(text)]


def _indented(lines: str) -> str:
    text = dedent(lines).strip("\n")
    return "".join(f"    {line}\n" if line else "\n" for line in text.split("\n"))
