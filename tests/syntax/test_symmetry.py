"""Robots that may change places: fewer states, and the same verdicts. [SYMMETRY]"""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.syntax.core import PropertyKind
from koord.syntax.system import System, dealt
from koord.verify.engines.explicit.property_checks import Exhausted, SearchReport
from koord.verify.engines.explicit.search import survey
from tests.loading import program_of

INVARIANTS = (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)
EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"

CLAIM = """\
allwrite:
    int owner = -1
local:
    bool holds = false
Claim:
    pre: owner == -1
    eff: atomic:
        owner = pid
        holds = true
Release:
    pre: holds
    eff: atomic:
        owner = -1
        holds = false
invariant Own: forall i: holds@i implies owner == i
"""


def system(text: str, robots: int) -> System:
    return dealt(program_of(text), robots)


def searched(of: System, *, symmetry: bool) -> SearchReport:
    invariants = [p for p in of.program.properties if p.kind in INVARIANTS]
    return survey(of, invariants, symmetry=symmetry)


def said(found: SearchReport) -> tuple[object, ...]:
    """The verdicts, without how many states they took."""
    assert isinstance(found.end, Exhausted)
    violated = sorted((v.claim.subject.value, v.claim.name, v.rounds) for v in found.violated)
    return (*violated, found.end.depth)


def test_a_claimed_resource_is_the_same_whoever_claims_it() -> None:
    """[SYMMETRY]: free or held is all there is to tell, however many robots there are."""
    for robots in (2, 4, 6):
        of = system(CLAIM, robots)
        with_it, without = searched(of, symmetry=True), searched(of, symmetry=False)
        assert said(with_it) == said(without)
        assert isinstance(with_it.end, Exhausted)
        assert isinstance(without.end, Exhausted)
        assert with_it.end.states == 2
        assert without.end.states == robots + 1


def test_robots_that_count_with_their_numbers_are_not_exchanged() -> None:
    """[SYMMETRY]: a pid that is added to a sum is a number."""
    text = (EXAMPLES / "sum_of_ids.krd").read_text(encoding="utf-8")
    of = system(text, 4)
    with_it, without = searched(of, symmetry=True), searched(of, symmetry=False)
    assert isinstance(with_it.end, Exhausted)
    assert isinstance(without.end, Exhausted)
    assert with_it.end.states == without.end.states


@pytest.mark.parametrize(
    "file", ["leader_elect.krd", "broken/leader_elect_early.krd", "broken/sum_of_ids_no_lock.krd"]
)
def test_verdicts_do_not_depend_on_it(file: str) -> None:
    """[SYMMETRY]"""
    of = system((EXAMPLES / file).read_text(encoding="utf-8"), 3)
    assert said(searched(of, symmetry=True)) == said(searched(of, symmetry=False))
