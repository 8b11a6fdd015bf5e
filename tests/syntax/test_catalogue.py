"""Each code has a story, and each story's examples are true."""

from __future__ import annotations

import re
from fractions import Fraction
from pathlib import Path

import pytest

import koord
from koord.syntax.catalogue import Story, entries, of_programs
from koord.syntax.diagnostics import Severity
from koord.syntax.elaboration import Elaborated, Settings
from koord.syntax.load import load
from koord.syntax.source import Source

_CODE = re.compile(r'"(K[0-9]{3})"')
_TIMES = re.compile(r"(\d+) times")
_SET = re.compile(r"--set (\w+)=(\w+)")

ENTRIES = list(of_programs().values())


def codes_in_the_source() -> set[str]:
    found: set[str] = set()
    for path in Path(koord.__file__).parent.rglob("*.py"):
        found.update(_CODE.findall(path.read_text(encoding="utf-8")))
    return found


def loaded(text: str) -> Elaborated:
    """The example, used as its first line says."""
    often = _TIMES.search(text.partition("\n")[0])
    text *= int(often.group(1)) if often else 1
    chosen = _SET.search(text.partition("\n")[0])
    params: dict[str, int | str] = {}
    if chosen:
        name, value = chosen.groups()
        params[name] = int(value) if value.isdigit() else value
    example = Source("example.krd", text)
    if "lists 3 tasks" in text:
        return load(example, Settings(tasks=((Fraction(1), Fraction(2), Fraction(0)),) * 3))
    if "--with" in text.partition("\n")[0]:
        app = Source("app.krd", "Go:\n  eff: stop\n")
        return load(app, Settings(params), (example,))
    return load(example, Settings(params))


def test_each_code_has_a_story() -> None:
    assert codes_in_the_source() - entries().keys() == set()


def test_each_story_is_of_a_code_that_can_come() -> None:
    assert entries().keys() - codes_in_the_source() == set()


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.code)
def test_the_bad_example_yields_its_code(entry: Story) -> None:
    found = {d.code: d.severity for d in loaded(entry.bad).diagnostics}
    assert found.get(entry.code) is entry.severity, found


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.code)
def test_the_bad_example_shows_one_mistake(entry: Story) -> None:
    errors = {d.code for d in loaded(entry.bad).diagnostics if d.severity is Severity.ERROR}
    assert errors <= {entry.code}


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.code)
def test_the_good_example_is_right(entry: Story) -> None:
    elaborated = loaded(entry.good)
    assert [d for d in elaborated.diagnostics if d.severity is Severity.ERROR] == []
    assert entry.code not in {d.code for d in elaborated.diagnostics}
    assert elaborated.program is not None


@pytest.mark.parametrize("code", entries())
def test_stories_are_told_properly(code: str) -> None:
    entry = entries()[code]
    assert (Path(koord.__file__).parent / "syntax" / "catalogue" / f"{code}.md").is_file()
    assert entry.title == entry.title.strip()
    assert not entry.title.endswith(".")
    assert len(entry.title) <= 80
    assert entry.story.strip().endswith((".", ")"))
    warns = code[1] == "4" or code in ("K936", "K938", "K945", "K949", "K952", "K954")
    assert entry.severity is (Severity.WARNING if warns else Severity.ERROR)
    assert bool(entry.bad) == bool(entry.good) == (code[1] != "9")


def test_a_story_of_another_form_is_refused() -> None:
    with pytest.raises(ValueError, match="no entry of the catalogue: # K204"):
        Story.read("# K204\n\nA story.\n")
