"""Seeded mistakes in the rules and in the verifier: each must make a test fail.

`python -m tests.mutants` prints a table of all. A survivor means that a test is missing.
"""

from __future__ import annotations

from collections import Counter

import pytest
from msgspec.structs import replace

from tests.mutants.catalogue import MUTANTS
from tests.mutants.caught import caught
from tests.mutants.harness import known_to, tried, untouched
from tests.mutants.mutant import ROOT, Mutant
from tests.mutants.patterns import unbound_names
from tests.mutants.quick import QUICK
from tests.sampling import but_slow

BY_NAME = {mutant.name: mutant for mutant in MUTANTS}

BY_MODULE: dict[str, list[Mutant]] = {}
for each in MUTANTS:
    BY_MODULE.setdefault(each.module, []).append(each)


def test_names_are_unique_and_mistakes_are_many() -> None:
    assert [name for name, n in Counter(m.name for m in MUTANTS).items() if n > 1] == []
    folders = Counter(m.place.partition(".")[0] for m in MUTANTS)
    assert folders["semantics"] >= 20
    assert folders["verify"] >= 20
    assert folders["runtime"] >= 90


@pytest.mark.parametrize("module", BY_MODULE)
def test_every_mistake_can_be_made(module: str) -> None:
    """What it replaces stands in its function once, and what it makes is Python."""
    for mutant in BY_MODULE[module]:
        tree = mutant.tree()
        compile(tree, mutant.place, "exec")
        assert mutant.tests, mutant.name
        # A name that nobody knows would be noticed by anything that runs.
        assert unbound_names(tree) == set(), mutant.name


#: Every fifth is tried by default.
SLOW = [name for at, name in enumerate(sorted(QUICK)) if at % 5]


@pytest.mark.parametrize("name", but_slow(SLOW, sorted(QUICK)))
def test_some_mistakes_are_caught_by_the_test_for_them(name: str) -> None:
    assert known_to(replace(BY_NAME[name], tests=(caught()[name],))), f"not noticed: {name}"


def test_what_noticed_a_mistake_is_a_test_that_there_is() -> None:
    for name, test in caught().items():
        assert name in BY_NAME
        file, _, function = test.partition("[")[0].partition("::")
        assert f"def {function}(" in (ROOT / file).read_text("utf-8"), test


def test_those_are_of_all_kinds() -> None:
    folders = Counter(BY_NAME[name].place.partition(".")[0] for name in QUICK)
    assert folders["semantics"] >= 10
    assert folders["verify"] >= 10


@pytest.mark.slow
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: m.name)
def test_every_mistake_is_caught(mutant: Mutant) -> None:
    assert tried(mutant).caught_by, f"no test notices: {mutant.name}"


@pytest.mark.slow
def test_the_tests_pass_without_mistakes() -> None:
    assert untouched(MUTANTS) == ""
