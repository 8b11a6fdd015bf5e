"""Rows of JSON: they say what an encoder of one object after the other says."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from koord.sim.files.rows import Pattern, hole, texts, to_parts

NUMBERS = st.floats(width=32) | st.floats(-1_200, 11_000, width=32)


def said(found: Any) -> Any:
    """What texts say, by an encoder of JSON."""
    return json.loads(b"[" + b",".join(found.astype("V").tolist()) + b"]")


@given(arrays(np.float32, st.integers(1, 20), elements=NUMBERS))
@example(np.array([0.0625, -0.0625, 0.1875, -0.0, 999.9995, -999.9995, 9999.9995], np.float32))
@example(np.array([np.nan, 1.0], np.float32))
@example(np.array([-1000.0, 10_000.0, np.inf], np.float32))
def test_numbers_are_rounded_as_python_rounds(values: Any) -> None:
    expected = [round(v, 3) if np.isfinite(v) else None for v in values.tolist()]
    assert said(to_parts(values)) == expected


def test_ties_go_to_the_even_thousandth() -> None:
    ties = (np.arange(-8_000, 8_000) / 16).astype(np.float32)
    assert said(to_parts(ties)) == [round(v, 3) for v in ties.tolist()]


@given(st.lists(st.tuples(st.text(), st.integers(), NUMBERS), min_size=1, max_size=8))
def test_rows_are_objects(found: list[tuple[str, int, float]]) -> None:
    pattern = Pattern({"name": hole("name"), "of": [hole("number"), {"x": hole("x"), "y": "{}"}]})
    names, numbers, xs = zip(*found, strict=True)
    rows = pattern.filled(
        name=texts(json.dumps(name).encode() for name in names),
        number=texts(str(number).encode() for number in numbers),
        x=to_parts(np.array(xs, np.float32)),
    )
    told = [
        {"name": name, "of": [number, {"x": round(x, 3) if np.isfinite(x) else None, "y": "{}"}]}
        for name, number, x in found
    ]
    count = len(found)
    assert json.loads(b"[" + rows.between(0, count) + b"]") == told
    assert json.loads(b"[" + rows.between(count - 1, count) + b"]") == told[-1:]
    for k in range(count):
        assert rows.between(k, k) == b""


def test_a_text_that_looks_like_a_hole_is_none() -> None:
    """What is filled in is not looked at again."""
    rows = Pattern({"a": hole("a"), "b": hole("b")}).filled(a=texts([b'"@b"']), b=texts([b"1"]))
    assert json.loads(rows.between(0, 1)) == {"a": "@b", "b": 1}
