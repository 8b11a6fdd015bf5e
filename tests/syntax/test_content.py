"""Nodes are equal by what they say, and unequal if they are not."""

from __future__ import annotations

from operator import eq, ne

import pytest
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.source import Source, Span
from koord.syntax.types import BOOL

HERE = core.Const(True, BOOL, span=Span("a.krd", 1, 1, 1, 5))


def test_places_do_not_count() -> None:
    there = replace(HERE, span=Span("b.krd", 2, 1, 2, 5))
    assert eq(HERE, there)
    assert not ne(HERE, there)
    assert hash(HERE) == hash(there)


@pytest.mark.parametrize("other", [replace(HERE, value=False), Source("a.krd", "true")])
def test_what_is_said_counts(other: object) -> None:
    assert ne(HERE, other)
    assert not eq(HERE, other)
