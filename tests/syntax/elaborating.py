"""Short programs to core programs, for the tests of elaboration."""

from __future__ import annotations

from textwrap import dedent

from koord.syntax import core
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.elaboration import ParamValue, Settings
from koord.syntax.load import load
from koord.syntax.source import Source
from tests.generators.wellformed import complaints


def diagnostics(text: str, **params: ParamValue) -> tuple[Diagnostic, ...]:
    """What is told about a program."""
    return load(Source("app.krd", dedent(text)), Settings(params)).diagnostics


def program(text: str, **params: ParamValue) -> core.Program:
    """The core program of a text without errors; its types are checked once more."""
    loaded = load(Source("app.krd", dedent(text)), Settings(params))
    errors = [d for d in loaded.diagnostics if d.severity is Severity.ERROR]
    assert errors == []
    assert loaded.program is not None
    assert complaints(loaded.program) == []
    return loaded.program


def codes(text: str, **params: ParamValue) -> list[str]:
    """The codes of what is told, in the order of the text."""
    return [d.code for d in diagnostics(text, **params)]


def errors(text: str, **params: ParamValue) -> list[str]:
    """The codes of the errors, in the order of the text."""
    found = diagnostics(text, **params)
    return [d.code for d in found if d.severity is Severity.ERROR]


def only(text: str, **params: ParamValue) -> Diagnostic:
    """The one error of a program."""
    found = [d for d in diagnostics(text, **params) if d.severity is Severity.ERROR]
    assert len(found) == 1, found
    return found[0]


def effect(statements: str, declarations: str = "") -> core.Block:
    """The effect of an event, given the sections above it."""
    lines = "\n".join(f"    {line}" for line in dedent(statements).strip().splitlines())
    text = f"{dedent(declarations)}\nDo:\n  eff:\n{lines}\n"
    return program(text).agents[0].events[0].effect


def value(expression: str, declarations: str = "", type_: str = "int") -> core.Expr:
    """An expression as it is assigned to a local of the type."""
    above = f"{dedent(declarations)}\nlocal:\n  {type_} answer\n"
    (statement,) = effect(f"answer = {expression}", above)
    assert isinstance(statement, core.Assign)
    return statement.value
