"""Renaming: the edits that give a symbol another name, or why there are none."""

from __future__ import annotations

import re

from msgspec import Struct

from koord.syntax.diagnostics import Edit, Severity
from koord.syntax.editing.model import Occurrence, SemanticModel, identity
from koord.syntax.editing.symbols import SymbolKind
from koord.syntax.edits import edited
from koord.syntax.elaboration.library import PORT_ALIASES
from koord.syntax.vocabulary import KEYWORDS, OWN_NAMES

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class Renaming(Struct, frozen=True):
    """The edits of a renaming, in the files that their places name; none, and why, if refused."""

    edits: tuple[Edit, ...] = ()
    refused: str = ""


def renamable(model: SemanticModel, line: int, column: int) -> Occurrence | str:
    """The name at a place, if it can be renamed; otherwise why it cannot."""
    found = model.at(line, column)
    if found is None:
        return "there is no name here"
    symbol = found.symbol
    if symbol.name_span is None:
        return f"`{symbol.name}` is the language's own name"
    if symbol.in_library:
        return f"`{symbol.name}` is a name of the library"
    if symbol.kind is SymbolKind.MODULE or symbol.owner in PORT_ALIASES:
        return f"`{symbol.name}` is a name that drivers and worlds know"
    return found


def renamed(model: SemanticModel, line: int, column: int, name: str) -> Renaming:
    """Rename the symbol at a place wherever it is named.

    Refused where the new name is no name, or would mean something else in some place: the text that
    comes out has the same names, with the same meanings, and no further mistake.
    """
    found = renamable(model, line, column)
    if isinstance(found, str):
        return Renaming(refused=found)
    if not _NAME.fullmatch(name):
        return Renaming(refused=f"`{name}` is no name: it has letters, digits and `_`")
    if name in KEYWORDS or name in OWN_NAMES:
        return Renaming(refused=f"`{name}` is a word of the language")
    edits = tuple(Edit(each.span, name) for each in model.occurrences_of(found.symbol))
    after = model.replaced(
        {
            file.name: edited(file, (one for one in edits if one.span.file == file.name))
            for file in model.files
        }
    )
    if _errors(after) > _errors(model):
        return Renaming(refused=f"`{name}` cannot stand in some of these places, or is taken")
    if _shape(after) != _shape(model):
        return Renaming(refused=f"`{name}` means something else in some of these places")
    return Renaming(edits)


def _errors(model: SemanticModel) -> int:
    return sum(one.severity is Severity.ERROR for one in model.diagnostics)


def _shape(model: SemanticModel) -> list[object]:
    """Which names mean the same, whatever they are: the number of the first one of each symbol."""
    first: dict[tuple[object, ...], int] = {}
    shape: list[object] = []
    for number, each in enumerate(model.all_occurrences):
        known = first.setdefault(identity(each.symbol), number)
        outside = None if each.symbol.name_span is not None else identity(each.symbol)
        shape.append((known, each.is_declaration, outside))
    return shape
