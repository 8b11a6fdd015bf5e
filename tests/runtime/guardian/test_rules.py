"""The rules and invariants of specs/guardian/ are cited in code and in tests, and no others are."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from koord.runtime.configuration.forms import SafetyForm
from koord.runtime.configuration.safety import LIMIT_NAMES
from koord.runtime.guardian.invariants import INVARIANTS
from koord.runtime.guardian.limits import EstopAction, usual
from koord.runtime.motion.bodies import VEHICLES

ROOT = Path(__file__).parents[3]
SPEC = ROOT / "specs" / "guardian" / "README.md"

RULE = re.compile(r"^(?:\| )?\*\*(G-[A-Z-]+?)\.?\*\*", re.MULTILINE)
INVARIANT = re.compile(r"^\| (S-[A-Z-]+) \|", re.MULTILINE)
LIMIT = re.compile(r"^\| `([a-z_]+)` \|[^|]*\|[^|]*\| ([^|]*?) ?\| ([^|]*?) ?\|$", re.MULTILINE)
CITED = re.compile(r"\b([GS]-[A-Z]+(?:-[A-Z]+)*)\b")


def stated() -> tuple[str, ...]:
    text = SPEC.read_text(encoding="utf-8")
    return (*RULE.findall(text), *INVARIANT.findall(text))


@cache
def cited(folder: str) -> frozenset[str]:
    texts = (
        path.read_text(encoding="utf-8")
        for path in (ROOT / folder).rglob("*.py")
        if path.name != Path(__file__).name
    )
    return frozenset(rule for text in texts for rule in CITED.findall(text))


def test_rules_are_stated_once() -> None:
    rules = stated()
    assert len(rules) > 30
    assert sorted(rules) == sorted(set(rules))


@pytest.mark.parametrize("rule", stated())
def test_a_rule_is_implemented_and_tested(rule: str) -> None:
    assert rule in cited("koord/runtime/guardian"), f"nothing in the guardian cites {rule}"
    assert rule in cited("tests/runtime/guardian"), f"no test cites {rule}"


def test_no_citation_dangles() -> None:
    assert (cited("koord/runtime/guardian") | cited("tests/runtime/guardian")) <= set(stated())


def test_the_text_refers_to_rules_that_it_states() -> None:
    assert set(CITED.findall(SPEC.read_text(encoding="utf-8"))) <= set(stated())


def test_the_limits_are_those_of_the_code() -> None:
    """Names and defaults, to three digits."""
    text = SPEC.read_text(encoding="utf-8")
    told = {row[0]: row[1:] for row in LIMIT.findall(text)}
    assert list(told) == list(SafetyForm.__struct_fields__)
    for at, vehicle in enumerate(("CAR", "QUAD")):
        limits = usual(VEHICLES[vehicle].body)
        for name, values in told.items():
            value = getattr(limits, LIMIT_NAMES.get(name, name))
            if isinstance(value, EstopAction):
                assert values[at] == value.value
            else:
                assert values[at] == ("" if value is None else f"{value:.3g}"), name


def test_the_invariants_are_those_of_the_code() -> None:
    assert list(INVARIANTS) == [one for one in stated() if one.startswith("S-")]
