"""Array types and small array operations. Lengths are metres, angles radians, times seconds.

And what is asked of small arrays thousands of times a second, without what NumPy's own functions
for it find out first.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]


def lengths(vectors: Floats) -> Floats:
    """The lengths of vectors ``(n, 3)``, bit-identical to ``np.linalg.norm``."""
    square = vectors * vectors
    found: Floats = np.sqrt(square[:, 0] + square[:, 1] + square[:, 2])
    return found


class Products(Struct, frozen=True):
    """Sums of products of rows of two arrays, as in cross products and quaternion products.

    Of each row of the answer, and of each product in it: its sign, and whose rows are multiplied.
    Arrays have a row for each row of the answer.
    """

    signs: Floats
    ones: Ints
    others: Ints

    def of(self, one: Floats, other: Floats) -> Floats:
        """The sums, shape ``(rows, n)``, each added up from left to right."""
        parts = one.take(self.ones, 0)
        parts *= other.take(self.others, 0)
        parts *= self.signs
        found: Floats = parts[:, 0] + parts[:, 1]
        for k in range(2, parts.shape[1]):
            found += parts[:, k]
        return found


def products(*rows: tuple[tuple[int, int, int], ...]) -> Products:
    """Make products from triples ``(sign, row of one, row of the other)``."""
    signs, ones, others = np.moveaxis(np.array(rows), 2, 0)
    return Products(signs.astype(np.float64)[..., None], ones, others)


def bounded(values: Floats, low: Floats | float, high: Floats | float) -> Floats:
    """Clip values to bounds, as ``np.clip``."""
    found: Floats = np.minimum(np.maximum(values, low), high)
    return found
