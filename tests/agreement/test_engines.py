"""Explicit search and bounded model checking, which share the semantics' turns and no more."""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.refinement.generating.profiles import FINITE, SYMMETRIC, Profile
from koord.refinement.generating.programs import system
from koord.semantics.machine import NotFiniteError
from koord.semantics.search.engine import survey
from koord.semantics.search.findings import OutOfBounds, Subject
from koord.semantics.search.finite import NotFinite
from koord.semantics.search.limits import Limits
from koord.verify.claims import ClaimKind, claims_of
from tests.verify.asking import bounded

ROUNDS = 2

NAMES = {
    Subject.PROPERTY: "{}",
    Subject.FAULT: "no fault",
    Subject.CONTRACT: "contract {}",
    Subject.LOST_UPDATE: "no lost update of {}",
}


def compare(seed: int, profile: Profile) -> str:
    of = system(Random(seed), profile)
    limits = Limits(states=1_000, rounds=ROUNDS)
    found = survey(of, of.program.properties, limits, subjects=frozenset(Subject))
    if isinstance(found.end, NotFinite):
        return "not finite"
    if isinstance(found.end, OutOfBounds) and "rounds" not in found.end.reason:
        return "too large"
    try:
        checked = bounded(of, rounds=ROUNDS)
    except NotFiniteError:
        return "a loop without a bound"
    assert checked.bounded.reason == "", seed
    assert not checked.bounded.unreplayed, seed
    by_search = {NAMES[v.claim.subject].format(v.claim.name): v.rounds for v in found.violated}
    assert by_search == checked.rounds, seed
    kinds = {claim.name: claim.kind for claim in claims_of(of)}
    assert set(by_search) <= set(kinds)
    faulted = ClaimKind.FAULT in {kinds[name] for name in by_search}
    return "faults" if faulted else "violated" if by_search else "holds"


@pytest.mark.parametrize("block", range(5))
def test_search_and_bmc_agree(block: int) -> None:
    seeds = range(3_000 + block * 60, 3_060 + block * 60)
    profile = SYMMETRIC if block == 4 else FINITE
    count = Counter(compare(seed, profile) for seed in seeds)
    assert count["holds"] + count["violated"] + count["faults"] >= 40, count
    assert count["holds"] >= 5, count


@pytest.mark.slow
@pytest.mark.parametrize("profile", [FINITE, SYMMETRIC], ids=["finite", "symmetric"])
def test_search_and_bmc_agree_on_many(profile: Profile) -> None:
    for seed in range(40_000, 41_000):
        compare(seed, profile)
