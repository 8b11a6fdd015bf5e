"""The rules and invariants of specs/guardian/ are cited in code and in tests, and no others are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from koord.runtime.configuration.forms import SafetyForm
from koord.runtime.configuration.safety import LIMIT_NAMES
from koord.runtime.guardian.invariants import INVARIANTS
from koord.runtime.guardian.limits import EstopAction, usual
from koord.runtime.motion.bodies import VEHICLES
from tests.rules import Rules

RULE = re.compile(r"^(?:\| )?\*\*(G-[A-Z-]+?)\.?\*\*", re.MULTILINE)
INVARIANT = re.compile(r"^\| (S-[A-Z-]+) \|", re.MULTILINE)
LIMIT = re.compile(r"^\| `([a-z_]+)` \|[^|]*\|[^|]*\| ([^|]*?) ?\| ([^|]*?) ?\|$", re.MULTILINE)
CITED = re.compile(r"\b([GS]-[A-Z]+(?:-[A-Z]+)*)\b")
RULES = Rules("guardian", (RULE, INVARIANT), CITED, Path(__file__).name)


def test_rules_are_stated_once() -> None:
    rules = RULES.stated
    assert len(rules) > 30
    assert sorted(rules) == sorted(set(rules))


@pytest.mark.parametrize("rule", RULES.stated)
def test_a_rule_is_implemented_and_tested(rule: str) -> None:
    assert rule in RULES.cited("koord/runtime/guardian"), f"nothing in the guardian cites {rule}"
    assert rule in RULES.cited("tests/runtime/guardian"), f"no test cites {rule}"


def test_no_citation_dangles() -> None:
    found = RULES.cited("koord/runtime/guardian") | RULES.cited("tests/runtime/guardian")
    assert found <= set(RULES.stated)


def test_the_text_refers_to_rules_that_it_states() -> None:
    assert set(RULES.mentioned) <= set(RULES.stated)


def test_the_limits_are_those_of_the_code() -> None:
    """Names and defaults, to three digits."""
    told = {row[0]: row[1:] for row in LIMIT.findall(RULES.text)}
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
    assert list(INVARIANTS) == [one for one in RULES.stated if one.startswith("S-")]
