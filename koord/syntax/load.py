"""Loading: parse a text, join it with files of properties, and elaborate it."""

from __future__ import annotations

import re

from koord.syntax import ast
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.elaboration import Elaborated, Settings, elaborate
from koord.syntax.elaboration.findings import DiagnosticLog
from koord.syntax.elaboration.recorder import Recorder
from koord.syntax.parsing.parser import parse
from koord.syntax.source import Source, Span

_DEFAULTS = Settings()

#: What a file of properties may hold.
_OF_PROPERTIES = (
    ast.Assume,
    ast.Invariant,
    ast.Eventually,
    ast.LeadsTo,
    ast.FunDef,
    ast.ParamDecl,
)


def load(
    source: Source,
    settings: Settings = _DEFAULTS,
    properties: tuple[Source, ...] = (),
    recorder: Recorder | None = None,
) -> Elaborated:
    """Load the core program of a text, joined with files of properties.

    Every error of every file is in ``diagnostics``; there is a program only if there are none. A
    ``recorder`` is told what names mean.
    """
    parsed = parse(source)
    diagnostics = list(parsed.diagnostics)
    sections = list(parsed.program.sections)
    lost = set(parsed.program.lost)
    for more in properties:
        part = parse(more)
        lost |= part.program.lost
        findings = DiagnosticLog()
        for section in part.program.sections:
            if isinstance(section, _OF_PROPERTIES):
                sections.append(section)
            else:
                _misplaced(findings, section)
                lost |= _words(more, section.span)
        diagnostics += part.diagnostics
        diagnostics += findings.in_order()
    program = ast.Program(tuple(sections), parsed.program.comments, span=parsed.program.span)
    elaborated = elaborate(program, settings, recorder)
    texts = {file.name: file for file in (source, *properties)}
    damaged = _has_errors(diagnostics)
    # a string without an end: what stood behind it is not known
    unended = {(d.span.file, d.span.line) for d in diagnostics if d.code == "K102"}
    independent = [
        found
        for found in elaborated.diagnostics
        if found.span.file not in texts or not _follows(found, lost, texts[found.span.file])
        if not (damaged and found.code in _WHOLE)
        if (found.span.file, found.span.line) not in unended
    ]
    files = {name: number for number, name in enumerate(texts)}
    together = sorted(
        (*diagnostics, *independent),
        key=lambda d: (files.get(d.span.file, -1), d.span.line, d.span.column),
    )
    kept = elaborated.program if not damaged else None
    return Elaborated(kept, tuple(together))


#: Findings that may only be there because a line with an error could not be read.
_FOLLOWING = frozenset({"K201", "K202", "K203", "K205", "K206", "K207", "K304", "K403"})
#: Findings about the whole of a text: what could not be read may be what they miss.
_WHOLE = frozenset({"K405", "K406"})
_WORD = re.compile(r"\w+")


def _words(source: Source, span: Span) -> set[str]:
    """The words on the lines of a section that is left out."""
    lines = range(span.line, span.end_line + 1)
    return {word for line in lines for word in _WORD.findall(source.line_text(line))}


def _follows(found: Diagnostic, lost: set[str], source: Source) -> bool:
    """Return whether a finding may be a mere consequence of an unreadable part."""
    if not lost or found.code not in _FOLLOWING:
        return False
    text = source.line_text(found.span.line)[found.span.column - 1 :]
    word = _WORD.match(text)
    return word is not None and word.group() in lost


def _misplaced(findings: DiagnosticLog, section: ast.Section) -> None:
    findings.error(
        "K232",
        section.span,
        "a file of properties does not declare this",
        "it holds assumptions, properties, params and the functions that they use",
    )


def _has_errors(diagnostics: list[Diagnostic]) -> bool:
    return any(diagnostic.severity is Severity.ERROR for diagnostic in diagnostics)
