"""The model of a text: every name in it with what it means, found by one elaboration."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from functools import cached_property

from msgspec import Struct

from koord.syntax import ast, core
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.editing.symbols import (
    Symbol,
    SymbolKind,
    declared,
    library_symbols,
    with_children,
)
from koord.syntax.elaboration import Elaborated
from koord.syntax.elaboration.recorder import (
    EventSymbol,
    FieldSymbol,
    KindSymbol,
    Meaning,
    ModuleSymbol,
    OwnName,
    Recorder,
    TypeSymbol,
)
from koord.syntax.elaboration.settings import Settings
from koord.syntax.elaboration.symbols import BoundSymbol, Role, Signature
from koord.syntax.load import load
from koord.syntax.source import Source, Span
from koord.syntax.types import Type, show

_DEFAULTS = Settings()


class Occurrence(Struct, frozen=True):
    """A place where a name stands, and the symbol that it means."""

    span: Span
    symbol: Symbol
    is_declaration: bool


class SemanticModel:
    """What is known about a text, with or without mistakes.

    ``program`` is its core program, None if it has errors. Places are those of :class:`Span`: lines
    and columns count characters from 1. ``source`` is the file that is asked about: the program's
    own, or the one of its files of properties that is ``shown``.
    """

    def __init__(
        self,
        source: Source,
        settings: Settings = _DEFAULTS,
        properties: tuple[Source, ...] = (),
        shown: str = "",
    ) -> None:
        self.files = (source, *properties)
        self.source = next((file for file in self.files if file.name == shown), source)
        self.settings = settings
        self.properties = properties
        self.recorder = Recorder()
        found = load(source, settings, properties, self.recorder)
        self.program: core.Program | None = found.program
        self.diagnostics: tuple[Diagnostic, ...] = found.diagnostics

    def replaced(self, texts: Mapping[str, str]) -> SemanticModel:
        """The model with other texts of some files, by their names."""
        source, *properties = (Source(f.name, texts.get(f.name, f.text)) for f in self.files)
        return SemanticModel(source, self.settings, tuple(properties), self.source.name)

    def reloaded(self, text: str, recorder: Recorder | None = None) -> Elaborated:
        """What comes of another text of the file that is asked about."""
        here = Source(self.source.name, text)
        source, *properties = (here if f.name == here.name else f for f in self.files)
        return load(source, self.settings, tuple(properties), recorder)

    @cached_property
    def symbols(self) -> tuple[Symbol, ...]:
        """What the text declares, in order; parts are children."""
        return self._symbols[self.source.name]

    @cached_property
    def _symbols(self) -> Mapping[str, tuple[Symbol, ...]]:
        """What the files of the program declare, by their names."""
        program = self.recorder.program
        sections = () if program is None else program.sections
        found = {}
        for number, file in enumerate(self.files):
            comments = program.comments if program is not None and not number else ()
            own = tuple(one for one in sections if one.span.file == file.name)
            found[file.name] = declared(ast.Program(own, comments), file)
        return found

    @cached_property
    def occurrences(self) -> tuple[Occurrence, ...]:
        """Every name with a meaning, in the order of the text; none overlaps another."""
        return tuple(self._occurrences(self.source))

    @cached_property
    def all_occurrences(self) -> tuple[Occurrence, ...]:
        """Those of every file of the program, file by file."""
        return tuple(one for file in self.files for one in self._occurrences(file))

    def _occurrences(self, file: Source) -> Iterator[Occurrence]:
        found: dict[tuple[int, int], Occurrence] = {}
        for symbol in with_children(self._symbols[file.name]):
            if symbol.name_span is not None and _is_name(symbol.name_span, file):
                place = (symbol.name_span.line, symbol.name_span.column)
                found[place] = Occurrence(symbol.name_span, symbol, True)
        for span, meaning in self.recorder.meanings.items():
            if span.file != file.name or (span.line, span.column) in found:
                continue
            if not _is_name(span, file):
                continue
            known = self.symbol_of(meaning)
            if known is not None:
                found[span.line, span.column] = Occurrence(span, known, known.name_span == span)
        return (found[place] for place in sorted(found))

    @cached_property
    def _places(self) -> list[tuple[int, int]]:
        return [(each.span.line, each.span.column) for each in self.occurrences]

    def at(self, line: int, column: int) -> Occurrence | None:
        """The name at a place, or directly before it."""
        position = bisect_right(self._places, (line, column))
        for found in reversed(self.occurrences[max(0, position - 1) : position]):
            span = found.span
            if span.line == line and span.column <= column <= span.end_column:
                return found
        return None

    def occurrences_of(self, symbol: Symbol) -> Iterator[Occurrence]:
        """Every place of the program where a symbol is named, its declaration included."""
        key = identity(symbol)
        return (each for each in self.all_occurrences if identity(each.symbol) == key)

    def type_at(self, line: int, column: int) -> tuple[Span, Type] | None:
        """The smallest expression around a place, and its type."""
        best: tuple[Span, Type] | None = None
        for span, type_ in self.recorder.types.items():
            here = span.file == self.source.name and _covers(span, line, column)
            if here and (best is None or _within(span, best[0])):
                best = (span, type_)
        return best

    @cached_property
    def _declared(self) -> dict[tuple[str, int, int], Symbol]:
        own = (self._symbols[file.name] for file in (self.source, *self.files))
        symbols = (each for some in (*own, library_symbols()) for each in with_children(some))
        return {
            (span.file, span.line, span.column): symbol
            for symbol in symbols
            if (span := symbol.name_span) is not None
        }

    def declared_at(self, span: Span) -> Symbol | None:
        """The symbol whose declared name stands at a place, of the text or of the library."""
        return self._declared.get((span.file, span.line, span.column))

    def named(self, name: str, *kinds: SymbolKind) -> Symbol | None:
        """The first symbol of a name, of the text or else of the library."""
        for symbol in self._declared.values():
            if symbol.name == name and (not kinds or symbol.kind in kinds):
                return symbol
        return None

    def symbol_of(self, meaning: Meaning) -> Symbol | None:
        """The symbol that a name means; None for a name with a mistake in its declaration."""
        match meaning:
            case OwnName(name=name):
                return Symbol(name, SymbolKind.WORD, name)
            case TypeSymbol(name=name, type=type_):
                found = self.named(name, SymbolKind.RECORD, SymbolKind.ENUM)
                code = name if type_ is None else show(type_)
                return found or Symbol(name, SymbolKind.TYPE, code)
            case ModuleSymbol(name=name):
                return self.named(name, SymbolKind.MODULE)
            case EventSymbol(name=name):
                return self.named(name, SymbolKind.EVENT)
            case KindSymbol(name=name):
                return self.named(name, SymbolKind.ROBOTS)
            case FieldSymbol():
                return self._field(meaning)
            case Signature(definition=definition):
                return self.declared_at(definition.name.span)
            case BoundSymbol(role=Role.RESULT):
                return Symbol("result", SymbolKind.WORD, "result")
            case BoundSymbol(declared=name, variable=variable):
                known = self.declared_at(name.span)
                if known is not None:
                    return known
                code = name.name
                if variable is not None:
                    code = f"{show(variable.type)} {code}"
                role = meaning.role.value
                return Symbol(name.name, SymbolKind.BOUND, code, name.span, story=role)
            case _:
                return self.declared_at(meaning.declared.span)

    def _field(self, meaning: FieldSymbol) -> Symbol:
        record, (name, type_) = meaning.record, meaning.record.fields[meaning.position]
        owner = self.named(record.name, SymbolKind.RECORD)
        for child in () if owner is None else owner.children:
            if child.name == name:
                return child
        return Symbol(name, SymbolKind.FIELD, f"{show(type_)} {name}", owner=record.name)


def identity(symbol: Symbol) -> tuple[object, ...]:
    """What makes two symbols the same: the place of the declaration, or else the name."""
    if symbol.name_span is not None:
        span = symbol.name_span
        return span.file, span.line, span.column
    return symbol.kind, symbol.owner, symbol.name


def _is_name(span: Span, file: Source) -> bool:
    """Return whether a place holds a name: some nodes have the places of others."""
    if span.line != span.end_line:
        return False
    text = file.line_text(span.line)
    return text[span.column - 1 : span.end_column - 1].isidentifier()


def _covers(span: Span, line: int, column: int) -> bool:
    return (span.line, span.column) <= (line, column) < (span.end_line, span.end_column)


def _within(inner: Span, outer: Span) -> bool:
    return (inner.line, inner.column) >= (outer.line, outer.column) and (
        inner.end_line,
        inner.end_column,
    ) <= (outer.end_line, outer.end_column)
