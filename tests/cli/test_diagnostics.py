from __future__ import annotations

import io
import json
from importlib.resources import files

import pytest
from jsonschema import Draft202012Validator, ValidationError

from koord.api.results import diagnostics_dict
from koord.cli.diagnostics import DiagnosticReport, render, summary
from koord.cli.terminal import Style
from koord.syntax.diagnostics import Diagnostic, Note, Severity
from koord.syntax.source import NOWHERE, Source, Span, whole_file

SOURCE = Source("app.krd", "local:\n  int x\n  bool x\ngo:\n  eff: x = tsak\n")

TWICE = Diagnostic(
    "K201",
    Severity.ERROR,
    Span("app.krd", 3, 8, 3, 9),
    "`x` is declared twice",
    "rename one of them",
    (Note(Span("app.krd", 2, 7, 2, 8), "first declared here"),),
)
UNKNOWN = Diagnostic(
    "K204", Severity.ERROR, Span("app.krd", 5, 12, 5, 16), "`tsak` is not declared"
)
UNUSED = Diagnostic("K403", Severity.WARNING, Span("app.krd", 2, 7, 2, 8), "`x` is never read")
UNREADABLE = Diagnostic("K901", Severity.ERROR, whole_file("no.krd"), "cannot be read: gone")


def validator() -> Draft202012Validator:
    schema = json.loads(
        files("koord.api").joinpath("schemas/diagnostics.schema.json").read_text(encoding="utf-8")
    )
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def test_a_diagnostic_shows_place_line_carets_notes_and_cure() -> None:
    assert list(render(TWICE, {"app.krd": SOURCE})) == [
        "app.krd:3:8: error K201: `x` is declared twice",
        "  3 |   bool x",
        "    |        ^",
        "app.krd:2:7: note: first declared here",
        "  2 |   int x",
        "    |       ^",
        "  = help: rename one of them",
    ]


def test_a_file_as_a_whole_has_no_line() -> None:
    assert list(render(UNREADABLE, {})) == ["no.krd: error K901: cannot be read: gone"]


def test_a_place_without_a_text_has_no_excerpt() -> None:
    inside = Diagnostic("K205", Severity.ERROR, NOWHERE, "wrong")
    assert list(render(inside, {})) == ["koord: error K205: wrong"]


def test_an_argument_is_named_by_its_flag_and_what_is_no_file_is_no_argument() -> None:
    report, out = DiagnosticReport(), io.StringIO()
    given = Span("<robots>", 1, 1, 1, 2)
    report.add(Diagnostic("K932", Severity.ERROR, span, "wrong") for span in (NOWHERE, given))
    report.print(out, as_json=False)
    places = [line.split(" error")[0] for line in out.getvalue().splitlines()[:2]]
    assert places == ["koord:", "--robots:1:1:"]


def test_messages_of_several_lines_are_indented() -> None:
    several = Diagnostic("K205", Severity.ERROR, NOWHERE, "wrong:\nthis\nthat", "do\nundo")
    assert list(render(several, {})) == [
        "koord: error K205: wrong:",
        "    this",
        "    that",
        "  = help: do",
        "          undo",
    ]


def test_nothing_from_a_file_steers_the_terminal() -> None:
    hostile = Diagnostic(
        "K101", Severity.ERROR, Span("\x1b.krd", 1, 1, 1, 2), "unexpected '\x1b[2J'", "drop '\x07'"
    )
    shown = "".join(render(hostile, {"\x1b.krd": Source("\x1b.krd", "\x1b[2J")}))
    assert "\x1b" not in shown
    assert "\x07" not in shown


def test_colour() -> None:
    shown = "\n".join(render(UNUSED, {"app.krd": SOURCE}, Style(colour=True)))
    assert "\x1b[1;33mwarning K403\x1b[0m" in shown
    assert "\x1b[1;33m^\x1b[0m" in shown


def test_the_summary_counts() -> None:
    assert summary(2, 1) == "2 errors, 1 warning"
    assert summary(1, 0) == "1 error"
    assert summary(0, 2) == "2 warnings"
    assert summary(0, 0) == "no errors"


def test_a_report_is_in_the_order_of_the_text_and_ends_with_a_count() -> None:
    report = DiagnosticReport()
    report.add([UNKNOWN, UNUSED, TWICE], SOURCE)
    report.add([UNREADABLE])
    report.add([UNREADABLE])
    out = io.StringIO()
    report.print(out, as_json=False)
    lines = out.getvalue().splitlines()
    assert [line.split(": ")[1] for line in lines if line[:1].isalpha() and "K" in line] == [
        "warning K403",
        "error K201",
        "error K204",
        "error K901",
    ]
    assert lines[-1] == "3 errors, 1 warning"


def test_an_empty_report_says_nothing() -> None:
    out = io.StringIO()
    DiagnosticReport().print(out, as_json=False)
    assert out.getvalue() == ""


def test_strict_makes_warnings_errors() -> None:
    report = DiagnosticReport(strict=True)
    report.add([UNUSED], SOURCE)
    assert (report.errors, report.warnings) == (1, 0)


def test_json_is_what_the_schema_says() -> None:
    report = DiagnosticReport()
    report.add([UNKNOWN, UNUSED, TWICE, UNREADABLE], SOURCE)
    out = io.StringIO()
    report.print(out, as_json=True)
    shown = json.loads(out.getvalue())
    validator().validate(shown)
    assert (shown["errors"], shown["warnings"]) == (3, 1)
    by_code = {entry["code"]: entry for entry in shown["diagnostics"]}
    assert by_code["K204"]["span"] == {"line": 5, "column": 12, "end_line": 5, "end_column": 16}
    assert by_code["K201"]["notes"][0]["span"]["line"] == 2
    assert by_code["K901"]["span"] is None


def test_the_schema_refuses_what_is_not_documented() -> None:
    shown = diagnostics_dict([UNKNOWN])
    validator().validate(shown)
    with pytest.raises(ValidationError):
        validator().validate({**shown, "more": 1})
    with pytest.raises(ValidationError):
        validator().validate({**shown, "version": 2})
