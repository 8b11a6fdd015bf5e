"""Hovers: what is told about a place, in Markdown."""

from __future__ import annotations

import re

from msgspec import Struct

from koord.syntax.editing.lines import ends_in_text
from koord.syntax.editing.model import Occurrence, SemanticModel
from koord.syntax.editing.symbols import Symbol, SymbolKind
from koord.syntax.editing.words import WORDS, Word
from koord.syntax.elaboration.recorder import TypeSymbol
from koord.syntax.source import Source, Span
from koord.syntax.types import show

_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class Hover(Struct, frozen=True):
    """What is told about a place: Markdown, and the rule of ``specs/semantics`` behind it."""

    span: Span
    markdown: str
    rule: str = ""


#: What kinds of variables mean, beyond their names.
_HOMES = {
    SymbolKind.LOCAL: "of each robot; no other sees it",
    SymbolKind.ALLREAD: "one entry for each robot, which it alone writes",
    SymbolKind.ALLWRITE: "one for all robots; writes in one round may be lost outside of `atomic:`",
    SymbolKind.SENSOR: "read by the robot, set by its environment",
    SymbolKind.ACTUATOR: "written by the robot, read by its environment",
    SymbolKind.PARAM: "a constant of a run",
}


def hover(model: SemanticModel, line: int, column: int) -> Hover | None:
    """What is told about a place: a name, a word of the language, or an expression's type."""
    found = model.at(line, column)
    if found is not None:
        return _of_name(model, found)
    span, word = word_at(model.source, line, column)
    known = WORDS.get(word)
    if known is not None:
        return Hover(span, _of_word(word, known, _lock(model, span)), known.rule)
    symbol = model.named(word) if word else None
    if symbol is not None:  # on a line that cannot be read
        return Hover(span, _of_symbol(symbol))
    typed = model.type_at(line, column)
    if typed is not None:
        return Hover(typed[0], f"```koord\n{show(typed[1])}\n```")
    return None


def word_at(source: Source, line: int, column: int) -> tuple[Span, str]:
    """The word at a place, or directly before it; "" if there is none, or only a comment."""
    text = source.line_text(line)
    for match in _WORD.finditer(text):
        if match.start() < column <= match.end() + 1:
            if ends_in_text(text[: match.start()]):
                break
            span = Span(source.name, line, match.start() + 1, line, match.end() + 1)
            return span, match.group()
    return Span(source.name, line, column, line, column), ""


def _lock(model: SemanticModel, span: Span) -> str:
    """The lock class of an atomic block, if one begins at the place."""
    for place, locked in model.recorder.locked.items():
        if (place.file, place.line, place.column) == (span.file, span.line, span.column):
            names = ", ".join(f"`{name}`" for name in locked.variables) or "no variable"
            return f"Lock class {locked.index}: the blocks that write {names}"
    return ""


def _of_word(word: str, known: Word, more: str = "") -> str:
    rule = f"Rule `{known.rule}`" if known.rule else ""
    parts = [f"```koord\n{known.form}\n```", f"{known.meaning[:1].upper()}{known.meaning[1:]}."]
    return "\n\n".join([*parts, *filter(None, [more, rule])])


def _of_name(model: SemanticModel, found: Occurrence) -> Hover:
    symbol = found.symbol
    if symbol.kind is SymbolKind.WORD:
        known = WORDS.get(symbol.name)
        if known is not None:
            return Hover(found.span, _of_word(symbol.name, known), known.rule)
    meaning = model.recorder.meanings.get(found.span)
    if isinstance(meaning, TypeSymbol) and meaning.type is not None and not symbol.children:
        return Hover(found.span, f"```koord\n{show(meaning.type)}\n```")
    parts = [_of_symbol(symbol)]
    typed = model.recorder.types.get(found.span)
    if typed is not None and show(typed) not in symbol.code:
        parts.append(f"Here of type `{show(typed)}`")
    locks = _locked_by(model, symbol)
    if locks:
        parts.append(locks)
    contracts = _contracts(model, symbol)
    if contracts:
        parts.append(f"```koord\n{contracts}\n```")
    return Hover(found.span, "\n\n".join(parts))


def _of_symbol(symbol: Symbol) -> str:
    where = f" of `{symbol.owner}`" if symbol.owner else ""
    where += ", from the library" if symbol.in_library else ""
    code = symbol.code
    if symbol.kind in (SymbolKind.RECORD, SymbolKind.MODULE):
        code = "\n".join([code, *(f"    {child.code}" for child in symbol.children)])
    parts = [f"```koord\n{code}\n```", f"*{symbol.kind.value}{where}*"]
    if symbol.kind in _HOMES:
        parts[-1] += f": {_HOMES[symbol.kind]}"
    if symbol.story:
        parts.append(symbol.story)
    return "\n\n".join(parts)


def _locked_by(model: SemanticModel, symbol: Symbol) -> str:
    """The lock class whose blocks write a shared variable."""
    if symbol.kind is not SymbolKind.ALLWRITE:
        return ""
    for locked in model.recorder.locked.values():
        if symbol.name in locked.variables:
            return f"Written in blocks of lock class {locked.index}"
    return ""


def _contracts(model: SemanticModel, symbol: Symbol) -> str:
    """The contracts that speak of a port, as written."""
    if symbol.kind not in (SymbolKind.SENSOR, SymbolKind.ACTUATOR):
        return ""
    module = model.named(symbol.owner, SymbolKind.MODULE)
    contracts = () if module is None else module.children
    spoken = re.compile(rf"\b{re.escape(symbol.name)}\b")
    return "\n".join(
        child.code
        for child in contracts
        if child.kind is SymbolKind.CONTRACT and spoken.search(child.code)
    )
