"""Text to tree: ``parse``."""

from __future__ import annotations

from msgspec import Struct

from koord.syntax import ast
from koord.syntax.collector import uncollected
from koord.syntax.diagnostics import Diagnostic
from koord.syntax.parsing.layout import lay_out
from koord.syntax.parsing.lines import LinePart
from koord.syntax.parsing.reader import LineReader
from koord.syntax.parsing.report import ErrorLog
from koord.syntax.parsing.sections import sections
from koord.syntax.parsing.tokens import TokenText, tokenise
from koord.syntax.source import Source

#: A longer text is not read.
MAX_CHARACTERS = 1_000_000


class Parsed(Struct, frozen=True):
    """What could be read of a text, and what was wrong with it."""

    program: ast.Program
    diagnostics: tuple[Diagnostic, ...]


def parse(source: Source) -> Parsed:
    """Read a program (or a file of properties).

    Never raises on any text: what cannot be read is told and left out, and the rest is there.
    """
    with uncollected():
        return _parse(source)


def _parse(source: Source) -> Parsed:
    report = ErrorLog()
    if len(source.text) > MAX_CHARACTERS:
        report.error(
            "K106",
            source.span(0, 0),
            f"this file has {len(source.text):,} characters, more than {MAX_CHARACTERS:,}",
            "is it a program? If so, take it apart",
        )
        text = TokenText([], (), tabs=False)
    else:
        text = tokenise(source, report)
    reader = LineReader(report)
    tree = sections(reader, lay_out(text, report))
    for line in text.lines:
        if line.tokens[0].line in report.damaged:
            reader.lose(LinePart(line.tokens))
    program = ast.Program(
        tree,
        text.comments,
        tuple(reader.heads),
        frozenset(reader.lost),
        span=source.span(0, len(source.text)),
    )
    return Parsed(program, report.in_order())
