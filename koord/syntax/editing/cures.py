"""Cures: edits that mend what a diagnostic tells of, each tried before it is offered."""

from __future__ import annotations

import re
from collections.abc import Iterator
from difflib import get_close_matches

from msgspec import Struct

from koord.syntax.diagnostics import Diagnostic, Edit, Severity
from koord.syntax.editing.model import SemanticModel
from koord.syntax.edits import edited
from koord.syntax.source import Source, Span, is_whole_file


class Cure(Struct, frozen=True):
    """A way to mend a mistake, as edits of the text that are made together."""

    title: str
    edits: tuple[Edit, ...]


def cures(model: SemanticModel, found: Diagnostic) -> tuple[Cure, ...]:
    """The cures of a diagnostic: its own edits, and what its hint says to write.

    A hint is written for people. What it says is tried, and offered if the mistake is gone then and
    no other has come.
    """
    if found.edits:
        title = found.hint or "Do what the message says"
        return (Cure(_capital(title), found.edits),)
    if found.hint is None or is_whole_file(found.span) or found.span.file != model.source.name:
        return ()
    before = _told(model.diagnostics)
    for title, edits in _proposals(model.source, found):
        after = _told(model.reloaded(edited(model.source, edits)).diagnostics)
        if len(after) < len(before) and not set(after) - set(before):
            return (Cure(title, edits),)
    return ()


def _told(diagnostics: tuple[Diagnostic, ...]) -> list[tuple[str, str]]:
    """The errors; warnings may come to light once these are gone. Of a warning, all of them."""
    errors = [d for d in diagnostics if d.severity is Severity.ERROR]
    return [(d.code, d.message) for d in errors or diagnostics]


def _proposals(source: Source, found: Diagnostic) -> Iterator[tuple[str, tuple[Edit, ...]]]:
    hint, span = found.hint or "", found.span
    pieces = [piece.removesuffix(":") for piece in re.findall(r"`([^`…]+)`", hint)]
    if by := re.match(r"(in|de)dent it (?:by|with) (\d+) spaces?", hint):
        yield _capital(hint), _indented(source, span, by[1], int(by[2]))
        return
    for piece in pieces:
        if hint.startswith("begin the program with"):
            top = Span(source.name, 1, 1, 1, 1)
            yield f"Begin the program with `{piece}`", (Edit(top, f"{piece}\n"),)
        elif span.line == span.end_line:
            if hint.startswith("did you mean") and (word := _misspelt(source, span, piece)):
                yield f"Write `{piece}`", (Edit(word, piece),)
            yield f"Write `{piece}`", (Edit(span, piece),)
            if piece.startswith((":", "=")) or hint.startswith("end it with"):
                yield f"Write `{piece}`", (Edit(span.end, piece),)
    if hint.startswith("leave it out") and span.line == span.end_line:
        yield "Leave it out", (Edit(span, ""),)


def _misspelt(source: Source, span: Span, piece: str) -> Span | None:
    """The word of a longer place that is most like another one."""
    text = source.line_text(span.line)[span.column - 1 : span.end_column - 1]
    words = {match.group(): match.start() for match in re.finditer(r"\w+", text)}
    near = get_close_matches(piece, words, n=1)
    if not near or near[0] == text:
        return None
    start = span.column + words[near[0]]
    return Span(source.name, span.line, start, span.line, start + len(near[0]))


def _indented(source: Source, span: Span, way: str, by: int) -> tuple[Edit, ...]:
    """Move a line with its block: by so many spaces outwards, or to so many from the margin."""
    text = source.line_text(span.line)
    margin = len(text) - len(text.lstrip())
    wanted = margin - by if way == "de" else by
    edits: list[Edit] = []
    number = span.line
    while True:
        line = source.line_text(number)
        depth = len(line) - len(line.lstrip())
        if number > span.line and (not line.strip() or depth <= margin):
            break
        start = Span(source.name, number, 1, number, depth + 1)
        edits.append(Edit(start, " " * max(0, depth - margin + wanted)))
        number += 1
    return tuple(edits)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
