"""Programs are brought over to today's forms, mean what they did, and stay as they are then."""

from __future__ import annotations

from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

import koord
from koord.syntax.diagnostics import Severity
from koord.syntax.load import load
from koord.syntax.source import Source
from tests.loading import example_files
from tests.syntax.test_old_forms import FORMS


def migrated(text: str) -> koord.Migration:
    return koord.migrate(Source("old.krd", text))


@pytest.mark.parametrize(("was", "now"), FORMS.values(), ids=FORMS)
def test_old_forms_are_brought_over_with_their_comments(was: str, now: str) -> None:
    found = migrated(was)
    assert found.text == now
    assert found.changed
    assert found.errors == ()
    assert [step.code for step in found.steps] == ["K407"] * len(found.steps)


@pytest.mark.parametrize(("was", "now"), FORMS.values(), ids=FORMS)
def test_a_migrated_program_means_the_same_and_stays(was: str, now: str) -> None:
    """The law behind the command: elaborate(migrate(t)) = elaborate(t). [OLD-FORM]"""
    once = migrated(was)
    assert load(once.migrated).program == load(once.source).program
    again = migrated(once.text)
    assert (again.text, again.steps) == (once.text, ())


@pytest.mark.parametrize("path", example_files(), ids=lambda path: path.stem)
def test_programs_of_today_stay_as_they_are(path: Path) -> None:
    found = koord.migrate(path)
    assert not found.changed
    assert found.steps == ()


def test_what_is_left_is_told_of_the_text_that_comes_out() -> None:
    found = migrated("local\n  int n = numBots\nE:\n  pre (n < 3);\n  eff: n = tsak\n")
    assert found.text == "local:\n  int n = numAgents\nE:\n  pre: (n < 3)\n  eff: n = tsak\n"
    assert [(d.code, d.span.line) for d in found.errors] == [("K201", 5)]
    assert [d.severity for d in found.left] == [Severity.ERROR]


def test_what_an_edit_brings_to_light_is_brought_over_too() -> None:
    """Of two old forms one hides the other, where a line could not be read before."""
    found = migrated(
        "allread:\n  ItemPosition x\nE:\n  eff: x[pid] = midpoint(getNeighbors(pid))\n"
    )
    assert "  pos[] x\n" in found.text
    assert "getNeighbors(pid, x)" in found.text


def test_the_verdict_is_the_same_before_and_after() -> None:
    text = "allwrite\n  int n = 0\nE:\n  pre (n < numBots);\n  eff: n = n + 1\ninvariant: n < 2\n"
    found = migrated(text)
    before, after = (
        [(found.name, found.outcome) for found in koord.verify(source, robots=2, rounds=3).verdicts]
        for source in (found.source, found.migrated)
    )
    assert before == after
    assert len({outcome for _, outcome in before}) > 1  # some hold, and some do not


def test_a_migration_as_data_follows_its_schema() -> None:
    found = migrated(FORMS["guard as a statement"][0])
    document = {"version": 1, "files": [found.to_dict()]}
    Draft202012Validator(koord.schema("migration")).validate(document)
    (step,) = document["files"][0]["steps"]  # type: ignore[index]
    assert [edit["text"] for edit in step["edits"]] == [":", ""]
    assert "1 old forms" in repr(found)
    assert "old.krd" in found._repr_html_()


UNDECLARED = "local:\n  int n = 0\nE:\n  pre: ready(n)\n  eff: n = weigh(n)\n       hello()\n"


def test_functions_that_nobody_declares_are_left_to_people() -> None:
    found = migrated(UNDECLARED)
    assert not found.changed
    assert [d.code for d in found.errors] == ["K202"]


def test_with_stubs_they_are_declared() -> None:
    found = koord.migrate(Source("old.krd", UNDECLARED), stub=True)
    assert found.text.startswith(UNDECLARED)
    assert found.errors == ()
    assert "def fun hello() -> bool: extern fresh\n" in found.text
    again = koord.migrate(found.migrated, stub=True)
    assert not again.changed


@pytest.mark.parametrize(
    ("value", "assumed"),
    [
        ("3", "Heater.heat == 3"),
        ("-2.50", "Heater.heat == -2.5"),
        ("[-1.0, 4]", "-1.0 <= Heater.heat and Heater.heat <= 4"),
    ],
)
def test_a_sensor_that_init_sets_starts_as_is_assumed(value: str, assumed: str) -> None:
    """[OLD-START]"""
    text = "using Heater:\n  sensors: float heat\ninit:\n  Heater.heat = {}  # warm\n"
    text += "E:\n  eff: stop\n"
    found = migrated(text.format(value))
    expected = text.replace("Heater.heat = {}", "pass") + f"\nassume: {assumed}\n"
    assert (found.text, found.errors) == (expected, ())
    assert not koord.migrate(found.migrated).changed


def test_where_a_sensor_starts_is_left_to_people_if_it_is_no_number() -> None:
    text = "using Heater:\n  sensors: float heat\ninit: heat = pid\nE:\n  eff: stop\n"
    found = migrated(text)
    assert not found.changed
    assert [d.code for d in found.errors] == ["K213"]


def test_several_sections_may_be_added_at_the_end() -> None:
    text = "using Heater:\n  sensors: int heat\ninit: heat = 1\nE:\n  eff: hello()"
    found = koord.migrate(Source("old.krd", text), stub=True)
    assert found.errors == ()
    assert "\nassume: heat == 1\n" in found.text
    assert "\ndef fun hello() -> bool: extern fresh\n" in found.text


def test_a_position_in_the_place_of_a_path_is_the_path_of_who_stays() -> None:
    """[OLD-PATH]"""
    text = "allread:\n  pos[][] ways\nlocal:\n  pos here = pos(0, 0, 0)\n"
    text += "E:\n  eff: ways[pid] = here  # for now\n"
    found = migrated(text)
    assert found.errors == ()
    assert found.text == text.replace("= here", "= [here]")
    assert [d.code for d in koord.check(Source("old.krd", text)).errors] == ["K204"]
    for wanted, value in (("int[]", "pos(0, 0, 0)"), ("pos[]", "3")):
        other = migrated(f"local:\n  {wanted} n = []\nE:\n  eff: n = {value}\n")
        assert not other.changed
        assert [d.code for d in other.errors] == ["K204"]


def test_who_writes_the_beginning_of_a_name_means_another_function() -> None:
    text = "local:\n  pos[] way = []\nE:\n  eff: way = {}(pos(0, 0, 0))\n"
    found = koord.migrate(Source("old.krd", text.format("getPath")), stub=True)
    assert found.errors == ()
    assert found.steps[0].hint is not None
    assert found.steps[0].hint.startswith("did you mean `getPathFromTask`? Else declare it:")
    slip = koord.migrate(Source("old.krd", text.format("getPathFromTas")), stub=True)
    assert not slip.changed
    assert [d.code for d in slip.errors] == ["K202"]
