"""What users see is what was frozen, but for what was meant to change.

Where it is meant: `python -m tests.golden`, and read the differences.
"""

from __future__ import annotations

from itertools import islice

import pytest

from tests.golden.kept import FOLDER, difference, file_of, kept
from tests.golden.scenarios import QUICK, Scenario, scenarios
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
