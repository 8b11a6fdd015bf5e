"""Machine code of what is measured at each tick: to the last bit what NumPy computes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from koord.runtime.motion.arrays import Floats
from koord.sim.gauge_kernel import CompiledGoing
from koord.sim.separation import FEW, Going, nearest

COUNTS = (1, 2, 3, 10, FEW, FEW + 1, 150)


def agree(ticks: list[Floats]) -> None:
    """Both measure the same, to the last bit."""
    one, other = Going(ticks[0]), CompiledGoing(ticks[0])
    for here in ticks[1:]:
        with np.errstate(all="ignore"):
            found, also = one.tick(here), other.tick(here)
        assert repr(found) == repr(also)  # NaN is not equal to itself
        assert np.array_equal(one.ways_m, other.ways_m, equal_nan=True)
        assert other.last is here


@given(
    st.sampled_from(COUNTS),
    st.sampled_from((0.0, 0.02, 0.3, 5.0)),
    st.sampled_from((None, 0, 1, 3)),
    st.sampled_from((0.2, 9.0)),
    st.integers(0, 1 << 32),
)
def test_both_measure_the_same(
    count: int, step_m: float, digits: int | None, wide_m: float, seed: int
) -> None:
    """With places on grids, where several pairs are equally near, and in crowds."""
    draw = np.random.default_rng(seed)
    here, ticks = draw.uniform(-wide_m, wide_m, (count, 3)), []
    for _ in range(12):
        ticks.append(here if digits is None else np.round(here, digits))
        here = here + draw.normal(0.0, step_m, (count, 3))
    agree(ticks)


@pytest.mark.parametrize("count", [5, FEW + 6])
@pytest.mark.parametrize("odd", [math.nan, math.inf, -math.inf, 1e200, -0.0, 5e-324])
def test_odd_places_are_no_difference(count: int, odd: float) -> None:
    ticks = [np.random.default_rng(k).uniform(-9, 9, (count, 3)) for k in range(4)]
    ticks[2][3, 1] = ticks[2][1, 0] = odd
    if count > FEW and not math.isfinite(odd):
        ticks = ticks[:1] + ticks[2:3]  # who is near to a robot that is nowhere cannot be listed
    agree(ticks)


def test_who_comes_from_afar_is_seen() -> None:
    """Robots that were listed are not nearest for ever."""
    rest = np.array([(4.0 * (k % 10), 4.0 * (k // 10), 0.0) for k in range(100)])
    ticks = []
    for k in range(60):
        here = rest.copy()
        here[99] += (rest[0] - rest[99]) * (k / 60)
        ticks.append(here)
    agree(ticks)
    going, pairs = CompiledGoing(ticks[0]), set()
    for here in ticks:
        found = going.tick(here)
        assert found == nearest(here)
        assert found is not None
        pairs.add((found.one, found.other))
    assert len(pairs) > 5
