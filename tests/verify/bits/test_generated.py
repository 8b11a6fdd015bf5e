"""The engine on bits against the explicit search, on generated finite programs.

They share the semantics' turns. All else is different: one lists states, the other has a circuit, a
SAT solver and IC3.
"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.refinement.generating.profiles import FINITE, SYMMETRIC, Profile
from koord.refinement.generating.programs import system
from koord.semantics.search.engine import survey
from koord.semantics.search.findings import Exhausted, Subject
from koord.semantics.search.finite import NotFinite
from koord.semantics.search.limits import Limits
from koord.verify.verdicts import Engine, Outcome
from tests.agreement.test_engines import NAMES
from tests.verify.bits.asking import on_bits

ROUNDS = 2


def compare(seed: int, profile: Profile) -> Counter[str]:
    """How often the engine said what, where the search knows better."""
    of = system(Random(seed), profile)
    limits = Limits(states=2_000, rounds=12)
    found = survey(of, of.program.properties, limits, subjects=frozenset(Subject))
    if isinstance(found.end, NotFinite):
        return Counter(["not finite"])
    every = isinstance(found.end, Exhausted)
    depth = found.end.depth
    first = {NAMES[v.claim.subject].format(v.claim.name): v.rounds for v in found.violated}
    ledger = on_bits(of, ROUNDS)
    count = Counter(["systems"])
    for claim in ledger.claims:
        verdict = ledger.verdict(claim)
        where = (seed, claim.name, verdict)
        breaks = first.get(claim.name)
        match verdict.outcome:
            case Outcome.VIOLATED:
                assert verdict.counterexample is not None
                if verdict.counterexample.round <= depth:
                    assert breaks == verdict.counterexample.round, where
                count["violated"] += 1
            case Outcome.HOLDS if verdict.rounds is None:
                assert breaks is None, where
                count["holds, and all runs seen" if every else "holds"] += 1
                count["by bits"] += verdict.engine is Engine.BITS
            case Outcome.HOLDS:
                assert verdict.rounds is not None
                assert breaks is None or breaks > verdict.rounds, where
                count["holds for some rounds"] += 1
            case Outcome.UNKNOWN:
                count["unknown"] += 1
                count[verdict.reason.split("(")[0][:60]] += 1
                assert breaks is None or verdict.rounds is None or breaks > verdict.rounds, where
    return count


def many(seeds: range, profile: Profile) -> Counter[str]:
    count: Counter[str] = Counter()
    for seed in seeds:
        count += compare(seed, profile)
    return count


@pytest.mark.parametrize("block", range(4))
def test_it_agrees_with_the_search(block: int) -> None:
    profile = SYMMETRIC if block == 3 else FINITE
    count = many(range(7_000 + block * 80, 7_080 + block * 80), profile)
    assert count["systems"] >= 50, count
    assert count["unknown"] <= count.total() // 20, count
    assert count["violated"] >= 10, count
    assert count["holds, and all runs seen"] >= 20, count


@pytest.mark.slow
@pytest.mark.parametrize("profile", [FINITE, SYMMETRIC], ids=["finite", "symmetric"])
@pytest.mark.parametrize("block", range(5))
def test_it_agrees_with_the_search_on_many(profile: Profile, block: int) -> None:
    count = many(range(50_000 + block * 200, 50_200 + block * 200), profile)
    assert count["systems"] >= 100, count
