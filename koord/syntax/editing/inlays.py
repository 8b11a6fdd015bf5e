"""Inlay hints: types that are found out, and lock classes, shown between the words."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from koord.syntax import ast
from koord.syntax.editing.model import SemanticModel
from koord.syntax.elaboration.symbols import BoundSymbol, Role
from koord.syntax.types import INT, show


class Inlay(Struct, frozen=True):
    """A text shown in front of a character that is not in the program."""

    line: int
    column: int
    text: str


def inlays(model: SemanticModel) -> tuple[Inlay, ...]:
    """The hints of a text, in order."""
    found = {*_bound(model), *_results(model), *_locks(model)}
    return tuple(sorted(found, key=lambda hint: (hint.line, hint.column)))


def _bound(model: SemanticModel) -> Iterator[Inlay]:
    """The types of elements that loops and quantifiers go through; numbers are plain to see."""
    for each in model.occurrences:
        meaning = model.recorder.meanings.get(each.span)
        if not isinstance(meaning, BoundSymbol) or not each.is_declaration:
            continue
        if meaning.role not in (Role.ELEMENT, Role.QUANTIFIED) or meaning.variable is None:
            continue
        before = model.source.line_text(each.span.line)[: each.span.column - 1].rstrip()
        type_ = meaning.variable.type
        written = meaning.role is Role.QUANTIFIED and before.endswith(show(type_))
        if (type_ != INT or meaning.role is Role.ELEMENT) and not written:
            yield Inlay(each.span.line, each.span.end_column, f": {show(type_)}")


def _results(model: SemanticModel) -> Iterator[Inlay]:
    """The types of results that are not declared."""
    for own in model.recorder.functions.own.values():
        definition = own.definition
        if definition.result is not None or own.result is None:
            continue
        if isinstance(definition.body, ast.External):
            continue
        line = model.source.line_text(definition.span.line)
        end = line.find(")", definition.name.span.end_column - 1)
        if definition.span.file == model.source.name and end >= 0:
            yield Inlay(definition.span.line, end + 2, f" -> {show(own.result)}")


def _locks(model: SemanticModel) -> Iterator[Inlay]:
    for span, locked in model.recorder.locked.items():
        if span.file == model.source.name and locked.variables:
            text = f" locks {', '.join(locked.variables)}"
            yield Inlay(span.line, span.column + len("atomic"), text)
