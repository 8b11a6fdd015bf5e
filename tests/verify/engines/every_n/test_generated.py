"""Generated programs: what is proved for every number of robots, no search for 1 to 4 refutes.

[T-EVERY-N] [T-SNAPSHOT] [T-ONE-WINNER] [T-PREFIX] [T-COMMIT]
"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.refinement.generating.programs import system
from koord.semantics.every_number import NotFiniteError
from koord.syntax.system import System, dealt
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engines.every_n.proving import prove
from koord.verify.engines.every_n.questions import SPARING
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind
from koord.verify.engines.explicit.search import survey
from tests.generators.profiles import FINITE
from tests.sampling import sampled
from tests.verify.asking import name_of

ROBOTS = (1, 2, 3, 4)


def proved(made: System) -> set[str]:
    """The claims that are proved for every number of robots."""
    two = dealt(made.program, 2, made.delta_s)
    found = prove(two, claims_of(two), Deadline(), Effort.of_seconds(SPARING.seconds), SPARING)
    return {claim.name for claim in found.proved}


def broken(made: System, robots: int) -> tuple[set[str], bool] | None:
    """The claims that a search sees broken, and whether it saw everything; None: not finite."""
    some = dealt(made.program, robots, made.delta_s)
    properties = [claim.stated for claim in claims_of(some) if claim.stated is not None]
    limits = Limits(states=1_000 if robots < 3 else 200, rounds=4)
    try:
        found = survey(some, properties, limits, subjects=frozenset(GoalKind))
    except NotFiniteError:
        return None
    if isinstance(found.end, NotFinite):
        return None
    return {name_of(v.claim) for v in found.violated}, isinstance(found.end, Exhausted)


def agreed(first: int, last: int) -> Counter[str]:
    count: Counter[str] = Counter()
    for seed in range(first, last):
        made = system(Random(seed), FINITE)
        names = proved(made)
        count["systems"] += 1
        count["proved"] += len(names)
        for robots in ROBOTS if names else ():
            seen = broken(made, robots)
            if seen is not None:
                bad, everything = seen
                assert not bad & names, (seed, robots)
                count["compared"] += 1
                count["all runs seen"] += everything
    return count


@pytest.mark.parametrize("last", sampled(8, [70]))
def test_what_is_proved_for_every_number_is_refuted_for_none(last: int) -> None:
    count = agreed(0, last)
    assert count["systems"] == last
    assert count["proved"] >= last // 4
    assert count["compared"] >= last // 2
    assert count["all runs seen"] >= last // 3


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_many_generated_programs(block: int) -> None:
    agreed(70 + 113 * block, 183 + 113 * block)
