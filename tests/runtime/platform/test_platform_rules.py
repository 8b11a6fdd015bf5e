"""The rules of specs/platforms/ are cited in code and in tests, and no others are."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
SPEC = ROOT / "specs" / "platforms" / "README.md"

RULE = re.compile(r"^\*\*(P-[A-Z-]+?)\.\*\*", re.MULTILINE)
CITED = re.compile(r"\((P-[A-Z]+(?:-[A-Z]+)*)\)")

STATED = RULE.findall(SPEC.read_text(encoding="utf-8"))


@cache
def cited(*folders: str) -> frozenset[str]:
    paths: Iterable[Path] = (path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    texts = (path.read_text("utf-8") for path in paths if path.name != Path(__file__).name)
    return frozenset(rule for text in texts for rule in CITED.findall(text))


def test_rules_are_stated_once() -> None:
    assert len(STATED) >= 8
    assert len(STATED) == len(set(STATED))


@pytest.mark.parametrize("rule", STATED)
def test_a_rule_is_implemented_and_tested(rule: str) -> None:
    assert rule in cited("koord"), f"no code cites {rule}"
    assert rule in cited("tests/runtime/platform", "tests/cli"), f"no test cites {rule}"


def test_no_citation_dangles() -> None:
    assert cited("koord", "tests") <= set(STATED)
