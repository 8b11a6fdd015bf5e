"""Progress of every number of robots against search, on generated programs. [T-PROGRESS]"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest
from msgspec.structs import replace

from koord.refinement.generating.programs import system
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy.liveness import settled
from koord.verify.strategy.table import LIVENESS
from koord.verify.verdicts import Bounds, Outcome
from tests.agreement.test_lassos import LIVELY, searched, with_liveness
from tests.sampling import blocks


def compare(seed: int) -> Counter[str]:
    """What progress says of each property: of all that it proves, the search violates nothing."""
    random = Random(seed)
    of = with_liveness(system(random, LIVELY), random)
    count: Counter[str] = Counter()
    said = settled(Slices(of), Bounds(8), LIVENESS[Engine.EVERY_N], Deadline.after(None))
    held = {v.claim.name for v in said.verdicts if v.outcome is Outcome.HOLDS}
    assert all(v.outcome is not Outcome.VIOLATED for v in said.verdicts), seed
    for kinds in (of.kinds, of.kinds[:1], (*of.kinds, of.kinds[0])):
        found = searched(replace(of, kinds=kinds)) if held or kinds == of.kinds else None
        if found is not None:
            assert not held & found.violated.keys(), (seed, kinds)
            count["violated"] += len(found.violated) if kinds == of.kinds else 0
            count["compared"] += len(held)
    count["holds"] = len(held)
    return count


@pytest.mark.parametrize("seeds", blocks(2, of=40, count=4))
def test_progress_is_never_said_where_search_finds_a_lasso(seeds: range) -> None:
    count = sum((compare(seed) for seed in seeds), Counter[str]())
    assert count["compared"] > 0
