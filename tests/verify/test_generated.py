"""Every verdict on generated finite programs against all of their runs, one turn at a time.

The engines build rounds at once; :mod:`tests.verify.reference` tries all orders, events, skips and
answers by the sequential rules. [T-SNAPSHOT] [T-ONE-WINNER] [T-PREFIX] [T-COMMIT] [T-FAULT]
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cache
from random import Random

import pytest

from koord.refinement.generating.programs import system
from koord.semantics.every_number import NotFiniteError
from koord.syntax.system import System
from koord.verify.claims import ClaimKind, claims_of
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind
from koord.verify.engines.explicit.search import survey
from tests.generators.profiles import FINITE
from tests.sampling import sampled
from tests.verify.asking import Checked, bounded, inductive, name_of
from tests.verify.reference import Explored, Explorer, TooManyError

ROUNDS = 2


@dataclass(frozen=True)
class Compared:
    """A small system with all that can be seen of it through some rounds."""

    seed: int
    system: System
    seen: Explored
    checked: dict[str, int]  #: the round in which bounded model checking sees each claim broken


@cache
def compared(seed: int, rounds: int = ROUNDS) -> Compared | None:
    """The system of a seed; None if it is not small, or a loop in it has no known bound."""
    made = system(Random(seed), FINITE)
    try:
        seen = Explorer(made).explore(rounds)
        return Compared(seed, made, seen, sure(bounded(made, rounds=rounds), seed))
    except (TooManyError, NotFiniteError):
        return None


def sure(checked: Checked, seed: int) -> dict[str, int]:
    """What was checked to the end. The solver itself is let go: each holds many megabytes."""
    assert checked.bounded.reason == "", seed
    assert not checked.bounded.unreplayed, seed
    return checked.rounds


def some(first: int, last: int, rounds: int = ROUNDS) -> list[Compared]:
    return [c for seed in range(first, last) if (c := compared(seed, rounds)) is not None]


def violations_agree(cases: list[Compared]) -> Counter[str]:
    """BMC finds exactly what is there, each claim in the first round that breaks it."""
    count: Counter[str] = Counter()
    for case in cases:
        assert case.checked == case.seen.first, case.seed
        count["systems"] += 1
        kinds = {claim.name: claim.kind for claim in claims_of(case.system)}
        count.update(kinds[name].value for name in case.seen.first)
        count["inside"] += sum(r > 0 for r in case.seen.first.values())
    return count


def searches_agree(cases: list[Compared], rounds: int = ROUNDS) -> Counter[str]:
    """The explicit search finds the same."""
    count: Counter[str] = Counter()
    for case in cases:
        claims = claims_of(case.system)
        properties = [claim.stated for claim in claims if claim.stated is not None]
        limits = Limits(states=20_000, rounds=rounds)
        found = survey(case.system, properties, limits, subjects=frozenset(GoalKind))
        if isinstance(found.end, NotFinite):
            continue
        count["systems"] += 1
        assert {name_of(v.claim): v.rounds for v in found.violated} == case.seen.first, case.seed
        if isinstance(found.end, Exhausted):
            count["exhausted"] += 1
    return count


def proofs_agree(cases: list[Compared], depths: tuple[int, ...]) -> Counter[str]:
    """What induction proves breaks nowhere. Where all runs were seen, that is for ever."""
    count: Counter[str] = Counter()
    for case in cases:
        for depth in depths:
            proved, _ = inductive(case.system, depth=depth)
            assert not proved & set(case.seen.first), case.seed
            count["proved"] += len(proved)
            count["proved and all runs seen"] += len(proved) if case.seen.closed else 0
    return count


LAST = pytest.mark.parametrize("last", sampled(20, [110]))


@LAST
def test_bounded_model_checking_finds_what_is_there(last: int) -> None:
    count = violations_agree(some(0, last))
    assert count["systems"] >= 6 * last // 10
    assert count["inside"] >= last // 10
    assert last < 110 or all(
        count[kind.value] for kind in ClaimKind if kind is not ClaimKind.LIVENESS
    )


@LAST
def test_the_search_finds_the_same(last: int) -> None:
    count = searches_agree(some(0, last))
    assert count["systems"] >= 6 * last // 10
    assert count["exhausted"] >= 3 * last // 10


@pytest.mark.parametrize("last", sampled(20, [80]))
def test_what_is_proved_breaks_nowhere(last: int) -> None:
    count = proofs_agree(some(0, last), (1,))
    assert count["proved and all runs seen"] >= last // 4


@pytest.mark.slow
@pytest.mark.parametrize("block", range(9))
def test_many_generated_programs(block: int) -> None:
    cases = some(110 + 100 * block, 210 + 100 * block, rounds=3)
    searches_agree(cases, rounds=3)
    count = violations_agree(cases) + proofs_agree(cases, (1, 2, 3))
    assert count["systems"] >= 40
    assert count["proved and all runs seen"] >= 40
