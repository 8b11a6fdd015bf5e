"""Long families of cases, of which a default run takes a few and `make slow` takes all."""

from __future__ import annotations

from collections.abc import Iterable

import pytest


def first(count: int, cases: Iterable[object]) -> list[object]:
    """The cases of a test, each one argument or a tuple of them; those after ``count`` are slow."""
    rows = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [
        pytest.param(*row, marks=[pytest.mark.slow] if at >= count else [])
        for at, row in enumerate(rows)
    ]
