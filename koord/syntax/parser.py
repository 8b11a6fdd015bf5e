"""Text to tree: ``parse``."""

from __future__ import annotations

from dataclasses import dataclass

from koord.syntax import ast
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.layout import lay_out
from koord.syntax.parser_reader import Reader
from koord.syntax.parser_sections import sections
from koord.syntax.report import Report
from koord.syntax.source import Source
from koord.syntax.tokens import tokenise


@dataclass(frozen=True, slots=True)
class Parsed:
    """What could be read of a text, and what was wrong with it."""

    program: ast.Program
    diagnostics: tuple[Diagnostic, ...]


def parse(source: Source) -> Parsed:
    """Read a program (or a file of properties).

    Never raises on any text: what cannot be read is told and left out, and the rest is there.
    """
    report = Report()
    lines, comments = tokenise(source, report)
    parts = lay_out(lines, report)
    tree = sections(Reader(report), parts)
    span = source.span(0, len(source.text))
    return Parsed(ast.Program(tree, comments, span=span), report.in_order())
