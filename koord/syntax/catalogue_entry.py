"""The shape of an entry of the catalogue of diagnostics."""

from __future__ import annotations

from inspect import cleandoc

from msgspec import Struct

from koord.syntax.diagnostics import Severity


class Entry(Struct, frozen=True):
    """What ``koord explain CODE`` tells: ``bad`` is a program that yields it, ``good`` one not."""

    code: str
    title: str
    severity: Severity
    story: str
    bad: str
    good: str


def error(code: str, title: str, story: str, bad: str, good: str) -> Entry:
    """The entry of an error; texts may be indented as the code around them."""
    return _entry(Severity.ERROR, code, title, story, bad, good)


def warning(code: str, title: str, story: str, bad: str, good: str) -> Entry:
    """The entry of a warning; texts may be indented as the code around them."""
    return _entry(Severity.WARNING, code, title, story, bad, good)


def _entry(severity: Severity, code: str, title: str, story: str, bad: str, good: str) -> Entry:
    bad, good = (f"{cleandoc(text)}\n" for text in (bad, good))
    return Entry(code, title, severity, cleandoc(story), bad, good)
