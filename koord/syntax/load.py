"""From text to core program: read, join with files of properties, elaborate."""

from __future__ import annotations

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
    files = {name.name: number for number, name in enumerate((source, *properties))}
    together = sorted(
        (*diagnostics, *elaborated.diagnostics),
        key=lambda d: (files.get(d.span.file, -1), d.span.line, d.span.column),
    )
    kept = elaborated.program if not _has_errors(diagnostics) else None
    return Elaborated(kept, tuple(together))


def _misplaced(findings: Findings, section: ast.Section) -> None:
    findings.error(
        "K232",
        section.span,
        "a file of properties does not declare this",
        "it holds assumptions, properties, params and the functions that they use",
    )


def _has_errors(diagnostics: list[Diagnostic]) -> bool:
    return any(diagnostic.severity is Severity.ERROR for diagnostic in diagnostics)
