"""The rules of specs/platforms/ are cited in code and in tests, and no others are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.rules import Rules

RULE = re.compile(r"^\*\*([PMCB]-[A-Z-]+?)\.\*\*", re.MULTILINE)
CITED = re.compile(r"\(([PMCB]-[A-Z]+(?:-[A-Z]+)*)\)")
RULES = Rules("platforms", (RULE,), CITED, Path(__file__).name)


def test_rules_are_stated_once() -> None:
    assert len(RULES.stated) >= 8
    assert len(RULES.stated) == len(set(RULES.stated))


@pytest.mark.parametrize("rule", RULES.stated)
def test_a_rule_is_implemented_and_tested(rule: str) -> None:
    assert rule in RULES.cited("koord"), f"no code cites {rule}"
    assert rule in RULES.cited("tests/runtime", "tests/cli", "tests/sim"), f"no test cites {rule}"


def test_no_citation_dangles() -> None:
    assert RULES.cited("koord", "tests") <= set(RULES.stated)
