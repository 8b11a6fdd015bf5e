"""Seeded mistakes in what is made of old forms of programs."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

_TESTS = ("tests/syntax/test_old_forms.py",)

OLD_FORMS = (
    Mutant(
        "an old name that a program uses twice is replaced once",
        "syntax.elaboration.findings.DiagnosticLog.old",
        "self._edits.setdefault(key, {})",
        "self._edits.setdefault((form, span), {})",
        _TESTS,
    ),
    Mutant(
        "edits that overlap are both made",
        "syntax.edits.edited",
        "start >= done",
        "True",
        _TESTS,
    ),
    Mutant(
        "the first of several arrays has the positions of neighbours",
        "syntax.elaboration.calls._of_positions",
        "len(places) > 1",
        "False",
        _TESTS,
    ),
    Mutant(
        "a missing colon of a statement is an old form",
        "syntax.parsing.reader.LineReader.body",
        "part.first not in _STATEMENTS",
        "True",
        _TESTS,
    ),
)
