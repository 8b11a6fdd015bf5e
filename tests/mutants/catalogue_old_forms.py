"""Seeded mistakes in what is made of old forms of programs."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

_TESTS = ("tests/syntax/test_old_forms.py",)
_ACCEPTED = ("tests/syntax/test_accepted_forms.py",)

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
    Mutant(
        "a line that is joined moves the places behind it",
        "syntax.parsing.tokens.tokenise",
        'text.index("\\n", begin) + 1',
        "begin + 1",
        _ACCEPTED,
    ),
    Mutant(
        "numbers before a text are written one by one",
        "syntax.elaboration.operators.pieces",
        "len(found) > 1",
        "True",
        _ACCEPTED,
    ),
    Mutant(
        "a function that calls another one is found out before it",
        "syntax.elaboration.functions._infer_results",
        "len(left) == before",
        "True",
        _ACCEPTED,
    ),
    Mutant(
        "the answer of a function that a property asks is any at each call",
        "syntax.elaboration.calls._unknown",
        "body.where in LOGICAL",
        "False",
        _ACCEPTED,
    ),
    Mutant(
        "undeclared functions are declared without being asked for",
        "api.migrate.migrate",
        "one.edits and (stub or one.code != _STUBBED)",
        "one.edits",
        ("tests/api/test_migrate.py",),
    ),
    Mutant(
        "a task of robot 0 is free",
        "syntax.elaboration.places._is_assigned",
        "core.Const(0, INT, span=e.span)",
        "core.Const(1, INT, span=e.span)",
        ("tests/api/test_listings.py",),
    ),
    Mutant(
        "of two sections that are added one is lost",
        "syntax.edits.edited",
        "start >= done",
        "start > done or end > start",
        _TESTS,
    ),
    Mutant(
        "a call over several lines loses its comments",
        "syntax.elaboration.calls._on_one_line",
        "e.span.line == e.span.end_line",
        "True",
        _TESTS,
    ),
    Mutant(
        "whatever is wanted, a position becomes a path of itself",
        "syntax.elaboration.coercion.fit",
        "wanted == ListType(POS)",
        "True",
        ("tests/api/test_migrate.py",),
    ),
    Mutant(
        "a slip of the pen is declared",
        "syntax.elaboration.calls._is_another",
        "len(known) - len(name) > _SLIP",
        "len(known) > _SLIP",
        ("tests/api/test_migrate.py",),
    ),
    Mutant(
        "robots point where they pointed before",
        "runtime.deploy.ideal.IdealHost.read",
        "math.atan2(y - was_y, x - was_x)",
        "self.yaw_rad",
        ("tests/runtime/test_yaw.py",),
    ),
)
