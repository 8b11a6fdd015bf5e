"""What users see is what was frozen, but for what was meant to change.

Where it is meant: `python -m tests.golden`, and read the differences.
"""

from __future__ import annotations

import json
from itertools import islice

import pytest

from koord.cli.exits import Exit
from tests.golden.described import described, mistakes
from tests.golden.kept import FOLDER, difference, file_of, kept
from tests.golden.scenarios import QUICK, Command, Scenario, scenarios
from tests.golden.transcript import SURROUNDINGS, transcript

#: How many lines of a difference are shown.
SHOWN = 60


def _cases() -> list[object]:
    return [
        pytest.param(each, id=each.name, marks=[pytest.mark.slow] if each.slow else [])
        for each in scenarios()
    ]


@pytest.mark.parametrize("scenario", _cases())
def test_users_see_what_was_frozen(scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in SURROUNDINGS.items():
        monkeypatch.setenv(name, value)
    lines = list(islice(difference(kept(scenario), transcript(scenario)), SHOWN))
    assert not lines, "\n".join(lines)


def test_each_scenario_is_kept_and_nothing_else() -> None:
    assert {file.name for file in FOLDER.iterdir()} == {file_of(each).name for each in scenarios()}


def test_the_quick_scenarios_exist() -> None:
    assert {each.name for each in scenarios() if not each.slow} >= QUICK


def test_what_no_schema_describes_is_noticed() -> None:
    printed = json.dumps({"version": 1, "reports": [{}]})
    ((name, document),) = described(Command(("verify", "a.krd", "--json")), printed, Exit.OK)
    assert name == "verdicts"
    assert any("'claims' is a required property" in each for each in mistakes(name, document))
    ((name, document),) = described(Command(("verify", "a.krd", "--json")), "{}", Exit.BAD_INPUT)
    assert name == "diagnostics"
    assert list(mistakes(name, document))
