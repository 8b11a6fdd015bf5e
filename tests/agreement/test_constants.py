"""Constants in, constants out: on known scalars terms compute what the exact domain does."""

from __future__ import annotations

import pytest

from koord.verify.encoding.terms import Terms
from tests.agreement.triples import exact_steps, steps, triple
from tests.sampling import blocks


@pytest.mark.parametrize("seeds", blocks(30, of=250, count=8))
def test_the_sequential_rules_agree(seeds: range) -> None:
    faults = 0
    for seed in seeds:
        t = triple(seed)
        exact = exact_steps(t)
        # Comparing what they look like tells 1, True and Fraction(1) apart, which are equal.
        assert repr(list(steps(Terms(), t))) == repr(exact), f"seed {seed}"
        faults += any(step.configuration.fault is not None for step in exact)
    assert len(seeds) // 20 < faults < len(seeds) * 3 // 4


@pytest.mark.slow
@pytest.mark.parametrize("block", range(8))
def test_the_sequential_rules_agree_on_many(block: int) -> None:
    for seed in range(100_000 + block * 2_500, 102_500 + block * 2_500):
        t = triple(seed)
        assert repr(list(steps(Terms(), t))) == repr(exact_steps(t)), f"seed {seed}"
