"""What the rechecker confirms of generated programs, against an explicit search of their runs."""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.refinement.generating.programs import system
from koord.semantics.every_number import NotFiniteError
from koord.verify.claims import claims_of
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind
from koord.verify.engines.explicit.search import survey
from tests.generators.profiles import FINITE
from tests.recheck.proving import Settler, confirmed, settled
from tests.sampling import sampled
from tests.verify.asking import name_of

pytest.importorskip("cvc5")


def compared(first: int, last: int, how: Settler = settled) -> Counter[str]:
    """Nothing that the search breaks is confirmed, be it for these robots or for any number."""
    count: Counter[str] = Counter()
    for seed in range(first, last):
        made = system(Random(seed), FINITE)
        properties = [c.stated for c in claims_of(made) if c.stated is not None]
        limits = Limits(states=3_000, rounds=6)
        try:
            found = survey(made, properties, limits, subjects=frozenset(GoalKind))
        except NotFiniteError:
            continue
        if isinstance(found.end, NotFinite):
            continue
        names = confirmed(made, how)
        if names is None:
            count["not rechecked"] += 1
            continue
        broken = {name_of(violation.claim) for violation in found.violated}
        assert not names & broken, seed
        count["systems"] += 1
        count["broken"] += len(broken)
        count["confirmed"] += len(names)
        count["exhausted"] += isinstance(found.end, Exhausted)
    return count


@pytest.mark.parametrize("last", sampled(8, [80]))
def test_nothing_is_confirmed_that_a_search_breaks(last: int) -> None:
    count = compared(0, last)
    assert count["systems"] >= last // 3
    assert count["broken"] >= last // 3
    assert count["confirmed"] >= last // 2


@pytest.mark.slow
@pytest.mark.parametrize("block", range(6))
def test_nothing_is_confirmed_that_a_search_breaks_in_many(block: int) -> None:
    assert compared(80 + 400 * block, 480 + 400 * block)["systems"] >= 100
