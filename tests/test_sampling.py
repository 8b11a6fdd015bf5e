"""The sample of slow tests leaves out what is there, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sampling import PEERS, TOO_LONG, WAITING, one_of_each, waits


def test_what_the_sample_leaves_out_are_tests() -> None:
    texts = [path.read_text("utf-8") for path in Path(__file__).parent.rglob("test_*.py")]
    assert [test for test in TOO_LONG if not any(f"def {test}(" in text for text in texts)] == []


def test_the_files_that_wait_are_there() -> None:
    folder = Path(__file__).parent
    assert [one for one in WAITING if not (folder / one).is_file()] == []
    assert waits(folder / WAITING[0])
    assert not waits(Path(__file__))


def test_they_are_asked_for_as_they_are_looked_for() -> None:
    makefile = (Path(__file__).parents[1] / "Makefile").read_text("utf-8")
    assert f'-m "{PEERS}" --one-of-each' in makefile


#: Tests with their cases, each with its marks, and what the sample has of them.
_CASES = {
    "test_all[1]": ("slow",),
    "test_all[2]": ("slow",),
    "test_smaller[1]": ("slow",),
    "test_smaller[2]": ("slow", "sample"),
    "test_mixed[1]": (),
    "test_mixed[2]": ("slow",),
    "test_another_kind[1]": (),
    "test_another_kind[2]": ("slow",),
    "test_another_kind[3]": ("slow", "sample"),
    "test_quick": (),
    "test_the_text_is_typed[1]": ("slow",),
    "test_the_sequential_rules_agree_on_many[3]": ("slow",),
}
_SAMPLE = ["test_all[1]", "test_smaller[2]", "test_another_kind[3]"]


def test_the_sample_has_each_test_that_would_not_run_otherwise(
    request: pytest.FixtureRequest,
) -> None:
    made = []
    for name, marks in _CASES.items():
        one = pytest.Function.from_parent(request.node.parent, name=name, callobj=lambda: None)
        for mark in marks:
            one.add_marker(mark)
        made.append(one)
    assert [one.name for one in one_of_each(made)] == _SAMPLE
