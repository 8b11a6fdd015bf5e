"""What engines say of the fewest rounds that break a claim, against the explicit search.

Of every engine: where a verdict says that no run with fewer rounds breaks its claim, the search
finds none; where nobody looked, the row and the JSON say so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from random import Random

import pytest

from koord.cli.verdicts import SOONER, said
from koord.verify.claims import ClaimKind
from koord.verify.engine_names import Engine
from koord.verify.engines.bits import abc
from koord.verify.verdicts import Outcome, Verdict
from tests.agreement.test_engines import Searched, searched
from tests.generators.staged import staged
from tests.verify.asking import Answers, ask, of_text

#: abc's PDR, where it is installed.
ABC = (Engine.ABC,) if abc.installed() else ()

#: Those that look for violations, and all of them in turn.
CHOICES = (Engine.SEARCH, Engine.BITS, *ABC, Engine.BMC, Engine.SPACER, None)

ROUNDS = 6


def told(answers: Answers) -> dict[str, object]:
    """By name of the claim, what is said of fewer rounds."""
    return {verdict.claim.name: verdict.fewest for verdict in answers.report.verdicts}


def assert_first(case: Searched, verdict: Verdict) -> None:
    """A violation comes no sooner than the search's, and not later where it says so."""
    assert verdict.counterexample is not None
    first = case.first.get(verdict.claim.name)
    where = (case.seed, verdict.engine, verdict.claim.name)
    if case.every or (case.depth is not None and verdict.counterexample.round <= case.depth):
        assert first is not None, where
        assert verdict.counterexample.round >= first, where
        assert verdict.counterexample.round == first or not verdict.fewest, where


def count_of(seeds: Iterable[int]) -> Counter[Engine | None]:
    """How many late violations each engine showed and called the first ones."""
    count: Counter[Engine | None] = Counter()
    for seed in seeds:
        case = searched(seed, staged(Random(seed)))
        if case is None or not any(2 < n <= ROUNDS for n in case.first.values()):
            continue
        for choice in CHOICES:
            answers = ask(case.system, rounds=ROUNDS, choice=choice)
            in_json = told(answers)
            for verdict in answers:
                assert in_json[verdict.claim.name] is verdict.fewest
                if (
                    verdict.outcome is not Outcome.VIOLATED
                    or verdict.claim.kind is ClaimKind.LIVENESS
                ):
                    assert not verdict.fewest
                    continue
                assert (SOONER in said(verdict)) is not verdict.fewest
                assert_first(case, verdict)
                assert verdict.counterexample is not None
                late = verdict.fewest and verdict.counterexample.round > 2
                count[choice] += late
    return count


@pytest.mark.slow
def test_the_fewest_rounds_are_the_fewest() -> None:
    count = count_of((8, 15, 20))
    assert all(count[choice] >= 3 for choice in CHOICES), count


@pytest.mark.slow
def test_the_fewest_rounds_are_the_fewest_of_many() -> None:
    count = count_of(range(60))
    assert all(count[choice] >= 15 for choice in CHOICES), count


LATE = """
local:
    int x = 0
Grow:
    eff: x = x + 1
invariant Few: x < {most}
"""


def test_spacer_says_so_where_it_does_not_look_at_all_earlier_rounds() -> None:
    near, far = (
        ask(of_text(LATE.format(most=most), 1), rounds=4, choice=Engine.SPACER)["Few"]
        for most in (9, 60)
    )
    assert (near.outcome, near.fewest, said(near)) == (
        Outcome.VIOLATED,
        True,
        "violated in round 9",
    )
    assert (far.outcome, far.fewest, said(far)) == (
        Outcome.VIOLATED,
        False,
        f"violated in round 60{SOONER}",
    )


def test_a_list_that_may_be_longer_may_break_a_claim_sooner() -> None:
    """A list of five breaks it in round 2, and lists of up to three are looked at."""
    text = """
using Sensor:
  sensors:
    int[] seen = []
local:
  int most = 0
Look:
  eff: most = len(Sensor.seen)
Count:
  eff: most = most + 1
invariant Few: most < 5
"""
    for choice in (Engine.BMC, Engine.BITS, *ABC, None):
        found = ask(of_text(text, 1), rounds=6, choice=choice)["Few"]
        assert found.outcome is Outcome.VIOLATED
        assert not found.fewest
        assert found.counterexample is not None
        assert found.counterexample.round > 2
