"""Signature help: the functions that a call may mean, and the argument that is being written."""

from __future__ import annotations

from msgspec import Struct

from koord.syntax.editing.lines import code_of
from koord.syntax.editing.model import SemanticModel
from koord.syntax.editing.symbols import (
    Symbol,
    SymbolKind,
    library_symbols,
    with_children,
)
from koord.syntax.editing.words import WORDS
from koord.syntax.source import Source

#: So many lines before a place may belong to its call.
_MOST_LINES = 20


class CallForm(Struct, frozen=True):
    """One way to call a function: how it is written, its parameters, the comment beside it."""

    label: str
    parameters: tuple[str, ...]
    story: str = ""


class SignatureHelp(Struct, frozen=True):
    """The ways to call a function, and the number of the argument at the cursor, from 0."""

    forms: tuple[CallForm, ...]
    argument: int

    @property
    def active(self) -> int:
        """The first form that has so many arguments."""
        for number, form in enumerate(self.forms):
            if self.argument < len(form.parameters):
                return number
        return 0


def signature_help(model: SemanticModel, line: int, column: int) -> SignatureHelp | None:
    """The call around a place; None if it is in none, or in one of nothing known."""
    found = _call(model.source, line, column)
    if found is None:
        return None
    name, argument, is_method = found
    forms = tuple(_forms(model, name))
    if not forms:
        return None
    return SignatureHelp(forms, argument + (1 if is_method else 0))


def _call(source: Source, line: int, column: int) -> tuple[str, int, bool] | None:
    """The name of the innermost open call before a place, and how many commas are in it.

    With it, whether it is written behind a dot, so that the first argument stands before it.
    """
    first = max(1, line - _MOST_LINES)
    text = "\n".join(
        [
            *(code_of(source.line_text(number)) for number in range(first, line)),
            code_of(source.line_text(line)[: column - 1]),
        ]
    )
    depth = commas = 0
    for at in range(len(text) - 1, -1, -1):
        sign = text[at]
        if sign in ")]}":
            depth += 1
        elif sign in "([{":
            if depth:
                depth -= 1
                continue
            name = _name_before(text, at)
            if sign == "(" and name:
                before = text[: at - len(name)].rstrip() if at >= len(name) else ""
                return name, commas, before.endswith(".")
            commas = 0  # of another bracket, which is an argument itself
        elif sign == "," and not depth:
            commas += 1
        elif sign == ":" and not depth:
            return None
    return None


def _name_before(text: str, at: int) -> str:
    end = at
    while at > 0 and (text[at - 1].isalnum() or text[at - 1] == "_"):
        at -= 1
    return text[at:end]


def _forms(model: SemanticModel, name: str) -> list[CallForm]:
    own = [
        symbol
        for symbol in with_children(model.symbols)
        if symbol.name == name
        and symbol.kind in (SymbolKind.FUNCTION, SymbolKind.EXTERNAL, SymbolKind.RECORD)
    ]
    found = own or [
        symbol
        for symbol in library_symbols()
        if symbol.name == name and symbol.kind is not SymbolKind.MODULE
    ]
    if found:
        return [_form(symbol) for symbol in found]
    known = WORDS.get(name)
    if known is None or "(" not in known.form:
        return []
    return [_written(form.strip(), known.meaning) for form in known.form.split("|")]


def _form(symbol: Symbol) -> CallForm:
    parameters = tuple(child.code for child in symbol.children)
    result = symbol.code.split("\n")[0].partition("->")[2].partition(":")[0].strip()
    answer = f" -> {result}" if result else ""
    return CallForm(f"{symbol.name}({', '.join(parameters)}){answer}", parameters, symbol.story)


def _written(form: str, story: str) -> CallForm:
    inside = form.partition("(")[2].rpartition(")")[0]
    parameters = tuple(part.strip() for part in inside.split(",") if part.strip())
    return CallForm(form, parameters, story)
