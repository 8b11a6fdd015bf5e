"""What editors, notebooks and pages ask of a text: see :class:`Document`.

Nothing here knows a protocol of editors; ``koord/lsp`` does.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path

from msgspec import Struct

from koord.api.programs import CheckReport, Program, Text, Value, exact, source_of
from koord.syntax.diagnostics import Diagnostic as Diagnostic
from koord.syntax.diagnostics import Edit as Edit
from koord.syntax.diagnostics import KoordError as KoordError
from koord.syntax.diagnostics import Severity as Severity
from koord.syntax.editing.completion import Completion as Completion
from koord.syntax.editing.completion import Completions as Completions
from koord.syntax.editing.completion import completions
from koord.syntax.editing.cures import Cure as Cure
from koord.syntax.editing.cures import cures
from koord.syntax.editing.folding import Fold as Fold
from koord.syntax.editing.folding import folds
from koord.syntax.editing.highlighting import SemanticToken as SemanticToken
from koord.syntax.editing.highlighting import TokenKind as TokenKind
from koord.syntax.editing.highlighting import TokenModifier as TokenModifier
from koord.syntax.editing.highlighting import semantic_tokens
from koord.syntax.editing.hover import Hover as Hover
from koord.syntax.editing.hover import hover, word_at
from koord.syntax.editing.inlays import Inlay as Inlay
from koord.syntax.editing.inlays import inlays
from koord.syntax.editing.model import Occurrence, SemanticModel
from koord.syntax.editing.renaming import Renaming as Renaming
from koord.syntax.editing.renaming import renamable, renamed
from koord.syntax.editing.signatures import CallForm as CallForm
from koord.syntax.editing.signatures import SignatureHelp as SignatureHelp
from koord.syntax.editing.signatures import signature_help
from koord.syntax.editing.symbols import Symbol as Symbol
from koord.syntax.editing.symbols import SymbolKind as SymbolKind
from koord.syntax.editing.words import WORDS
from koord.syntax.elaboration.library import LIBRARY, library_path
from koord.syntax.elaboration.settings import Settings
from koord.syntax.source import Source as Source
from koord.syntax.source import Span as Span
from koord.syntax.source import is_whole_file as is_whole_file
from koord.syntax.source import normalise as normalise


class Target(Struct, frozen=True):
    """A place that a definition leads to.

    ``path`` is a file of the library or of the specification; it is empty for a file of the
    program, which the span names.
    """

    path: str
    span: Span


class Document:
    r"""A text as it is now, with or without mistakes: what its names mean, what could stand where.

    Places are lines and columns that count characters from 1, as in :class:`koord.Span`; what is
    told about them is found out once and kept. Threads may ask, one at a time. A program may have
    more files: of properties, and configurations that give values to its params. Places that are
    asked about are those of ``source``; references and renamings go through all files.

    >>> document = koord.document(koord.Source("a.krd", "local:\\n    int x = 0\\n"))
    >>> document.hover(2, 9).markdown.splitlines()[1]
    'local int x = 0'
    """

    def __init__(
        self,
        source: Source,
        settings: Settings,
        properties: tuple[Source, ...],
        shown: str = "",
        configurations: tuple[Source, ...] = (),
    ) -> None:
        self._model = SemanticModel(source, settings, properties, shown)
        self._configurations = configurations

    @property
    def source(self) -> Source:
        """The text that is asked about."""
        return self._model.source

    @property
    def files(self) -> tuple[Source, ...]:
        """All files: the program's own text, those of properties, configurations."""
        return (*self._model.files, *self._configurations)

    def take_configuration(self, source: Source) -> None:
        """Take a newer text of a configuration, which means nothing else for what is known."""
        self._configurations = tuple(
            source if one.name == source.name else one for one in self._configurations
        )

    @property
    def is_main(self) -> bool:
        """Whether the text that is asked about is the program's own."""
        return self._model.source is self._model.files[0]

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """What is wrong with it."""
        return self._model.diagnostics

    @property
    def program(self) -> Program | None:
        """The program; None if the text has errors, or states properties alone."""
        return self.report.program

    @property
    def report(self) -> CheckReport:
        """What :func:`koord.check` answers."""
        model = self._model
        program = None
        if model.program is not None:
            program = Program(
                model.files[0], model.program, model.settings, model.properties, model.diagnostics
            )
        return CheckReport(model.files[0], model.properties, model.diagnostics, program)

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        """What it declares, in order; parts are children."""
        return self._model.symbols

    def hover(self, line: int, column: int) -> Hover | None:
        """What is told about a place."""
        return hover(self._model, line, column)

    def definition(self, line: int, column: int) -> Target | None:
        """The place where the name there is declared: in the program, or in the library.

        Of a word of the language it is the rule that says what the word means, where the
        specification is at hand.
        """
        found = self._model.at(line, column)
        name_span = None if found is None else found.symbol.name_span
        if name_span is None:
            _, word = word_at(self.source, line, column)
            known = WORDS.get(word)
            return None if known is None else rule_target(known.rule)
        if name_span.file == LIBRARY:
            return Target(library_path(), name_span)
        return Target("", name_span)

    def references(self, line: int, column: int, *, declaration: bool = True) -> tuple[Span, ...]:
        """The places of all files where the symbol there is named, perhaps its declaration."""
        found = self._model.at(line, column)
        if found is None:
            return ()
        named = [
            each.span
            for each in self._model.occurrences_of(found.symbol)
            if declaration or not each.is_declaration
        ]
        return (*named, *self._configured(found.symbol))

    def renamable(self, line: int, column: int) -> Span | str:
        """The place of the name there; if it cannot be renamed, why."""
        found = renamable(self._model, line, column)
        return found.span if isinstance(found, Occurrence) else found

    def rename(self, line: int, column: int, name: str) -> Renaming:
        """The edits that give the symbol there another name, if it can have that."""
        found = renamed(self._model, line, column, name)
        here = None if found.refused else self._model.at(line, column)
        if here is None:
            return found
        more = tuple(Edit(span, name) for span in self._configured(here.symbol))
        return Renaming((*found.edits, *more))

    def _configured(self, symbol: Symbol) -> Iterator[Span]:
        """Where configurations give a value to a param of the program."""
        if self._configurations and symbol.kind is SymbolKind.PARAM and not symbol.in_library:
            from koord.api.param_places import param_place  # YAML, which browsers do not have

            for source in self._configurations:
                place = param_place(source, symbol.name)
                if place is not None:
                    yield place

    def completions(self, line: int, column: int) -> Completions:
        """What could stand at a place."""
        return completions(self._model, line, column)

    def signature_help(self, line: int, column: int) -> SignatureHelp | None:
        """The call around a place."""
        return signature_help(self._model, line, column)

    def semantic_tokens(self) -> tuple[SemanticToken, ...]:
        """The names of the text by what they mean, in order."""
        return tuple(semantic_tokens(self._model))

    def folds(self) -> tuple[Fold, ...]:
        """The lines that can be hidden."""
        return folds(self.source)

    def inlays(self) -> tuple[Inlay, ...]:
        """Types and lock classes to be shown between the words."""
        return inlays(self._model)

    def cures(self, diagnostic: Diagnostic) -> tuple[Cure, ...]:
        """The edits that mend what a diagnostic of the text tells of."""
        return cures(self._model, diagnostic)


def document(
    text: Text,
    *,
    params: Mapping[str, Value] | None = None,
    properties: tuple[Text, ...] = (),
    configurations: tuple[Text, ...] = (),
    shown: str = "",
) -> Document:
    """Read a text for an editor; the arguments are those of :func:`koord.check`.

    ``configurations`` give values to params, whose names are found there; ``shown`` is the name of
    the file that is asked about, if it is one of the properties. Raises :class:`koord.KoordError`
    only where a file cannot be read.

    >>> koord.document("task.krd").references(34, 9)
    """
    settings = Settings({name: exact(value) for name, value in (params or {}).items()})
    more = tuple(source_of(one) for one in properties)
    others = tuple(source_of(one) for one in configurations)
    return Document(source_of(text), settings, more, shown, others)


#: The specification of a source tree; wheels have none.
_RULES = Path(__file__).resolve().parents[2] / "specs" / "semantics"


def rule_target(rule: str) -> Target | None:
    """The place of a rule in the specification, if that is here."""
    return _rules().get(rule)


@lru_cache(maxsize=1)
def _rules() -> Mapping[str, Target]:
    found: dict[str, Target] = {}
    for path in sorted(_RULES.glob("[0-9]*.md")):
        for number, line in enumerate(path.read_text(encoding="utf-8").split("\n"), 1):
            heading = re.match(r"### \[([A-Z0-9-]+)\]", line)
            if heading is not None:
                span = Span(path.name, number, 1, number, len(line) + 1)
                found[heading[1]] = Target(os.fspath(path), span)
    return found
