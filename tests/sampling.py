"""Long families of cases, of which a default run takes a few and `make slow` takes all."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import pytest
from hypothesis import settings


def first(count: int, cases: Iterable[object]) -> list[object]:
    """The cases of a test, each one argument or a tuple of them; those after ``count`` are slow."""
    rows = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [
        pytest.param(*row, marks=[pytest.mark.slow] if at >= count else [])
        for at, row in enumerate(rows)
    ]


def but_slow(slow: Collection[object], cases: Iterable[object]) -> list[object]:
    """The cases of a test, of which those are slow whose first argument is in ``slow``."""
    rows = [case if isinstance(case, tuple) else (case,) for case in cases]
    assert {row[0] for row in rows} >= set(slow)
    return [pytest.param(*row, marks=[pytest.mark.slow] if row[0] in slow else []) for row in rows]


def sampled(sample: object, cases: Iterable[object]) -> list[object]:
    """A small case that stands for a family in a default run, and the family, which is slow."""
    return [*first(1, [sample]), *first(0, cases)]


def blocks(few: int, *, of: int, count: int, start: int = 0) -> list[object]:
    """Seeds of a family: so many blocks of a size, and for a default run the ``few`` first ones."""
    all_of_them = (range(start + of * n, start + of * (n + 1)) for n in range(count))
    return sampled(range(start, start + few), all_of_them)


def examples(count: int) -> settings:
    """So many examples of what hypothesis makes in `make slow`, and a fifth of them by default."""
    return settings(max_examples=max(3, count * settings().max_examples // 100))
