"""Liveness by bits against liveness by search, on generated programs. [T-COUNT] [T-FAIR-CYCLE]

Lassos of bits are the shortest there are, but for those of maps: what lies behind the end of one
has to be as it was, too. The search's may be longer: it tells states apart by who ran last if any
property asks for that.
"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from koord.refinement.compiled_replay import rerun
from koord.refinement.generating.programs import system
from koord.syntax.system import System
from koord.syntax.types import MapType
from koord.syntax.walk import nodes
from koord.traces.trace import Numbers, traced
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy.liveness import settled
from koord.verify.strategy.table import LIVENESS
from koord.verify.verdicts import Bounds, Emptiness, Outcome
from tests.agreement.test_lassos import LIVELY, searched, with_liveness
from tests.sampling import blocks
from tests.semantics.driving import NO_TEXT


def compare(seed: int) -> Counter[str]:
    """What bits say of each property; never anything else than the search, if anything at all."""
    random = Random(seed)
    of = with_liveness(system(random, LIVELY), random)
    found = searched(of)
    if found is None:
        return Counter(["too large, or not finite"])
    said = settled(Slices(of), Bounds(8), LIVENESS[Engine.BITS], Deadline.after(None))
    for verdict in said.verdicts:
        if verdict.outcome is not Outcome.UNKNOWN:
            is_violated = verdict.claim.name in found.violated
            assert (verdict.outcome is Outcome.VIOLATED) is is_violated, (seed, verdict.claim.name)
        if verdict.counterexample is not None:
            lasso = verdict.counterexample.recording
            longest = len(found.violated[verdict.claim.name].rounds) + _has_maps(of)
            assert len(lasso.rounds) <= longest, (seed, verdict.claim.name)
            assert rerun(traced(NO_TEXT, of, Numbers.EXACT, lasso)) is None, seed
    # That no run is fair is seen by bits if that is quickly proved, and never where one is.
    unfair = [v for v in said.vacuities if v.what is Emptiness.ASSUMPTIONS]
    assert found.is_empty or not unfair, seed
    count = Counter(verdict.outcome.value for verdict in said.verdicts)
    count["no fair run"] += bool(unfair)
    return count


def _has_maps(of: System) -> bool:
    return any(isinstance(getattr(node, "type", None), MapType) for node in nodes(of.program))


@pytest.mark.parametrize("seeds", blocks(4, of=40, count=4))
def test_bits_say_what_the_search_says(seeds: range) -> None:
    count = sum((compare(seed) for seed in seeds), Counter[str]())
    assert count["holds"] >= len(seeds), count
    assert count["violated"] >= 3 * len(seeds) // 8, count
    assert count["unknown"] <= 3 * len(seeds) // 8, count


@pytest.mark.slow
@pytest.mark.parametrize("block", range(40))
def test_bits_say_what_the_search_says_of_many(block: int) -> None:
    seeds = range(20_000 + block * 50, 20_050 + block * 50)
    count = sum((compare(seed) for seed in seeds), Counter[str]())
    assert count["holds"] + count["violated"] > 70, count
