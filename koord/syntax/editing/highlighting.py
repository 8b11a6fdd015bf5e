"""Semantic tokens: the names of a text by what they mean, which no grammar of words can tell."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from msgspec import Struct

from koord.syntax.editing.model import SemanticModel
from koord.syntax.editing.symbols import Symbol, SymbolKind
from koord.syntax.source import Span
from koord.syntax.vocabulary import FUNCTIONS


class TokenKind(Enum):
    """The kinds of tokens, by the names that editors know."""

    NAMESPACE = "namespace"
    TYPE = "type"
    CLASS = "class"
    ENUM = "enum"
    STRUCT = "struct"
    PARAMETER = "parameter"
    VARIABLE = "variable"
    PROPERTY = "property"
    ENUM_MEMBER = "enumMember"
    EVENT = "event"
    FUNCTION = "function"
    KEYWORD = "keyword"


class TokenModifier(Enum):
    """What is told of a token beyond its kind."""

    DECLARATION = "declaration"
    READONLY = "readonly"
    DEFAULT_LIBRARY = "defaultLibrary"
    SHARED = "shared"  #: other robots see the variable


class SemanticToken(Struct, frozen=True):
    """A name by what it means."""

    span: Span
    kind: TokenKind
    modifiers: tuple[TokenModifier, ...] = ()


_KINDS = {
    SymbolKind.LOCAL: TokenKind.VARIABLE,
    SymbolKind.ALLREAD: TokenKind.VARIABLE,
    SymbolKind.ALLWRITE: TokenKind.VARIABLE,
    SymbolKind.PARAM: TokenKind.VARIABLE,
    SymbolKind.SENSOR: TokenKind.PROPERTY,
    SymbolKind.ACTUATOR: TokenKind.PROPERTY,
    SymbolKind.RECORD: TokenKind.STRUCT,
    SymbolKind.FIELD: TokenKind.PROPERTY,
    SymbolKind.ENUM: TokenKind.ENUM,
    SymbolKind.MEMBER: TokenKind.ENUM_MEMBER,
    SymbolKind.FUNCTION: TokenKind.FUNCTION,
    SymbolKind.EXTERNAL: TokenKind.FUNCTION,
    SymbolKind.PARAMETER: TokenKind.PARAMETER,
    SymbolKind.BOUND: TokenKind.PARAMETER,
    SymbolKind.MODULE: TokenKind.NAMESPACE,
    SymbolKind.CONTRACT: TokenKind.EVENT,
    SymbolKind.EVENT: TokenKind.EVENT,
    SymbolKind.ROBOTS: TokenKind.CLASS,
    SymbolKind.ASSUMPTION: TokenKind.EVENT,
    SymbolKind.INVARIANT: TokenKind.EVENT,
    SymbolKind.EVENTUALLY: TokenKind.EVENT,
    SymbolKind.TYPE: TokenKind.TYPE,
    SymbolKind.WORD: TokenKind.KEYWORD,
}

_READONLY = frozenset({SymbolKind.PARAM, SymbolKind.SENSOR, SymbolKind.MEMBER, SymbolKind.BOUND})
_SHARED = frozenset({SymbolKind.ALLREAD, SymbolKind.ALLWRITE})


def semantic_tokens(model: SemanticModel) -> Iterator[SemanticToken]:
    """The names of a text in order; none overlaps another."""
    for each in model.occurrences:
        symbol = each.symbol
        kind = _KINDS[symbol.kind]
        if symbol.kind is SymbolKind.WORD and symbol.name in FUNCTIONS:
            kind = TokenKind.FUNCTION
        yield SemanticToken(each.span, kind, tuple(_modifiers(symbol, each.is_declaration)))


def _modifiers(symbol: Symbol, is_declaration: bool) -> Iterator[TokenModifier]:
    if is_declaration:
        yield TokenModifier.DECLARATION
    if symbol.kind in _READONLY:
        yield TokenModifier.READONLY
    if symbol.name_span is None or symbol.in_library:
        yield TokenModifier.DEFAULT_LIBRARY
    if symbol.kind in _SHARED:
        yield TokenModifier.SHARED
