"""Helpers of small arrays, held against NumPy's own and against the formulas written out."""

from __future__ import annotations

import numpy as np
import pytest

from koord.runtime.motion.arrays import bounded, lengths, products


@pytest.mark.parametrize("count", [1, 2, 7, 500])
def test_lengths_and_bounds_are_those_of_numpy_to_the_last_bit(count: int) -> None:
    draw = np.random.default_rng(count)
    vectors = draw.normal(0, 9, (count, 3))
    assert np.array_equal(lengths(vectors), np.linalg.norm(vectors, axis=1))
    assert np.array_equal(bounded(vectors, -1.0, 2.0), np.clip(vectors, -1.0, 2.0))
    low = draw.normal(0, 9, (count, 3))
    assert np.array_equal(bounded(vectors, low, low + 1), np.clip(vectors, low, low + 1))


@pytest.mark.parametrize("count", [1, 2, 7, 500])
def test_products_are_added_up_from_left_to_right(count: int) -> None:
    draw = np.random.default_rng(count)
    a, b = draw.normal(0, 9, (4, count)), draw.normal(0, 9, (3, count))
    found = products(((1, 0, 0), (-1, 3, 1), (1, 2, 2)), ((-1, 1, 2), (-1, 1, 1), (1, 0, 1))).of(
        a, b
    )
    first = a[0] * b[0] - a[3] * b[1] + a[2] * b[2]
    second = -(a[1] * b[2]) - a[1] * b[1] + a[0] * b[1]
    assert np.array_equal(found, [first, second])
