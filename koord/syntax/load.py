"""From text to core program: read, join with files of properties, elaborate."""

from __future__ import annotations

import re
from collections.abc import Iterable

from koord.syntax import ast
from koord.syntax.diagnostics import Diagnostic, Severity
from koord.syntax.elaborate import Elaborated, Settings, elaborate
from koord.syntax.elaborate.findings import Findings
from koord.syntax.parser import parse
from koord.syntax.source import Source

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
    source: Source, settings: Settings = _DEFAULTS, properties: tuple[Source, ...] = ()
) -> Elaborated:
    """The core program of a text, joined with files of properties.

    Every error of every file is in ``diagnostics``; there is a program only if there are none.
    """
    parsed = parse(source)
    diagnostics = list(parsed.diagnostics)
    sections = list(parsed.program.sections)
    for more in properties:
        part = parse(more)
        findings = Findings()
        for section in part.program.sections:
            if isinstance(section, _OF_PROPERTIES):
                sections.append(section)
            else:
                _misplaced(findings, section)
        diagnostics += part.diagnostics
        diagnostics += findings.in_order()
    program = ast.Program(tuple(sections), parsed.program.comments, span=parsed.program.span)
    elaborated = elaborate(program, settings)
    texts = {file.name: file for file in (source, *properties)}
    lost = {name: lost_words(file, diagnostics) for name, file in texts.items()}
    independent = [
        found
        for found in elaborated.diagnostics
        if found.span.file not in texts
        or not follows(found, lost[found.span.file], texts[found.span.file])
    ]
    files = {name: number for number, name in enumerate(texts)}
    together = sorted(
        (*diagnostics, *independent),
        key=lambda d: (files.get(d.span.file, -1), d.span.line, d.span.column),
    )
    kept = elaborated.program if not _has_errors(diagnostics) else None
    return Elaborated(kept, tuple(together))


#: Findings that may only be there because a line with an error could not be read.
_FOLLOWING = frozenset({"K201", "K202", "K203", "K205", "K206", "K207", "K304", "K403"})
#: Errors of indentation, which are mended: nothing is lost.
_MENDED = frozenset({"K110", "K111"})
#: So many lines of a block that could not be read are looked at.
_BLOCK = 200
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def lost_words(source: Source, diagnostics: Iterable[Diagnostic]) -> frozenset[str]:
    """The words on lines that could not be read, and in the blocks below them."""
    words: set[str] = set()
    for diagnostic in diagnostics:
        if diagnostic.span.file != source.name or diagnostic.code in _MENDED:
            continue
        line = diagnostic.span.line
        text = source.line_text(line)
        indent = len(text) - len(text.lstrip())
        for _ in range(_BLOCK):
            words.update(_WORD.findall(text))
            line += 1
            text = source.line_text(line)
            if not text.strip() or len(text) - len(text.lstrip()) <= indent:
                break
    return frozenset(words)


def follows(found: Diagnostic, lost: frozenset[str], source: Source) -> bool:
    """Whether what was found may be a mere consequence of lines that could not be read."""
    if not lost or found.code not in _FOLLOWING:
        return False
    text = source.line_text(found.span.line)[found.span.column - 1 :]
    word = _WORD.match(text)
    return word is not None and word.group() in lost


def _misplaced(findings: Findings, section: ast.Section) -> None:
    findings.error(
        "K232",
        section.span,
        "a file of properties does not declare this",
        "it holds assumptions, properties, params and the functions that they use",
    )


def _has_errors(diagnostics: list[Diagnostic]) -> bool:
    return any(diagnostic.severity is Severity.ERROR for diagnostic in diagnostics)
