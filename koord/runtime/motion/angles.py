"""Functions of angles by polynomials: the same numbers on every processor.

What NumPy has for them differs from one kind of processor to the next in the last bit. These are
sums, products, quotients and roots, which do not; so they are also the same where they are machine
code, on lanes of numbers: arguments are arrays, or what has the operators of arithmetic and
``sqrt``. They are exact to a few units in the last place of 1, for angles up to a million radians.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

#: Arrays of doubles, or lanes of them; these have no common type.
Numbers = Any

#: A number that is added to this and taken away again is rounded to a whole one.
_WHOLE = 1.5 * 2.0**52

#: π in parts, of which few bits are used, so that small multiples are exact.
_PI = (3.141592651605606, 1.9841871583270443e-09, 1.034036596358821e-18)

#: Terms of the series, from the last to the first.
_SINE = [(-1) ** k / math.factorial(2 * k + 1) for k in range(11, 0, -1)]
_COSINE = [(-1) ** k / math.factorial(2 * k) for k in range(11, 0, -1)]
_ARC = [(-1) ** k / (2 * k + 1) for k in range(12, 0, -1)]

#: So often an angle is halved before its series is added up.
_HALVINGS = 3


def sine_cosine(angle: Numbers) -> tuple[Numbers, Numbers]:
    """The sines and cosines of angles."""
    turns = (angle * (1 / math.pi) + _WHOLE) - _WHOLE
    rest = ((angle - turns * _PI[0]) - turns * _PI[1]) - turns * _PI[2]
    # -1 after an odd number of half-turns, else 1.
    half = turns * 0.5
    odd = half - ((half + _WHOLE) - _WHOLE)
    sign = 1.0 - 8.0 * (odd * odd)
    square = rest * rest
    sine, cosine = square * _SINE[0], square * _COSINE[0]
    for one, other in zip(_SINE[1:], _COSINE[1:], strict=True):
        sine, cosine = square * (sine + one), square * (cosine + other)
    return sign * (rest + rest * sine), sign * (1.0 + cosine)


def tangent(angle: Numbers) -> Numbers:
    """The tangents of angles."""
    sine, cosine = sine_cosine(angle)
    return sine / cosine


def arc_tangent(slope: Numbers) -> Numbers:
    """The angles in (-π/2, π/2) with these tangents."""
    for _ in range(_HALVINGS):
        slope = slope / (1.0 + root(1.0 + slope * slope))
    square = slope * slope
    series = square * _ARC[0]
    for one in _ARC[1:]:
        series = square * (series + one)
    return float(2**_HALVINGS) * (slope + slope * series)


def unwound(angle: Numbers) -> Numbers:
    """Angles of these directions in [-π, π]."""
    turns = (angle * (0.5 / math.pi) + _WHOLE) - _WHOLE
    return ((angle - turns * (2 * _PI[0])) - turns * (2 * _PI[1])) - turns * (2 * _PI[2])


def lesser(one: Numbers, other: Numbers) -> Numbers:
    """The lesser of two numbers each."""
    return np.minimum(one, other) if isinstance(one, np.ndarray) else one.lesser(other)


def greater(one: Numbers, other: Numbers) -> Numbers:
    """The greater of two numbers each."""
    return np.maximum(one, other) if isinstance(one, np.ndarray) else one.greater(other)


def root(square: Numbers) -> Numbers:
    """The square roots of numbers."""
    return np.sqrt(square) if isinstance(square, np.ndarray) else square.sqrt()
