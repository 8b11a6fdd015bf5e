"""The rules and invariants of specs/protocol/ are cited in code and in tests, and no others are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.rules import Rules

RULE = re.compile(r"^\*\*(R-[A-Z-]+)\.\*\*", re.MULTILINE)
CLAIM = re.compile(r"^\| (I-[A-Z-]+) \|", re.MULTILINE)
CITED = re.compile(r"\b([RI]-[A-Z]+(?:-[A-Z]+)*)\b")
RULES = Rules("protocol", (RULE, CLAIM), CITED, Path(__file__).name)


def test_rules_are_stated_once() -> None:
    rules = RULES.stated
    assert len(rules) > 20
    assert sorted(rules) == sorted(set(rules))


@pytest.mark.parametrize("rule", RULES.stated)
def test_a_rule_is_implemented_and_tested(rule: str) -> None:
    assert rule in RULES.cited("koord/runtime"), f"nothing in koord/runtime cites {rule}"
    assert rule in RULES.cited("tests/runtime"), f"no test cites {rule}"


def test_no_citation_dangles() -> None:
    assert (RULES.cited("koord/runtime") | RULES.cited("tests/runtime")) - set(
        RULES.stated
    ) == frozenset()


def test_the_text_refers_to_rules_that_it_states() -> None:
    assert set(RULES.mentioned) <= set(RULES.stated)
