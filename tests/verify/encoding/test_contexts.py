"""Contexts of Z3 that nobody needs make room for others, where work is done for another process."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from weakref import WeakSet

import pytest
import z3

from koord.verify.encoding import contexts


class Knot:
    """Something that refers to itself, with a context."""

    def __init__(self) -> None:
        self.itself = self
        self.context = contexts.new_context(z3.Context)


class Bare:
    """What is no context of Z3."""


@pytest.fixture(autouse=True)
def uncollected() -> Iterator[None]:
    """Let nothing be collected unless somebody asks for it."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()
    gc.collect()


def made(monkeypatch: pytest.MonkeyPatch, depth: int) -> int:
    """How many more contexts there are at most, where eight are made and each is left."""
    monkeypatch.setattr(contexts, "depth", lambda: depth)
    before, most = len(contexts._there), 0
    for _ in range(8):
        Knot()
        most = max(most, len(contexts._there) - before)
    return most


@pytest.mark.slow
def test_there_are_few_contexts_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert made(monkeypatch, 1) <= 5


def test_four_are_made_before_it_is_looked_for_what_nobody_needs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """To look takes longer than to make the third one, which is the last in most proofs."""
    looks: list[int] = []
    kept = list[Bare]()
    monkeypatch.setattr(contexts, "depth", lambda: 1)
    monkeypatch.setattr(contexts, "_there", WeakSet())
    monkeypatch.setattr(contexts, "_made_since", 0)
    monkeypatch.setattr(contexts, "_ahead", [])
    monkeypatch.setattr(contexts, "_maker", None)
    monkeypatch.setattr(gc, "collect", lambda: looks.append(len(kept)))
    for _ in range(9):
        kept.append(contexts.new_context(Bare))
    assert looks == [4, 8]


@pytest.mark.slow
def test_what_belongs_to_others_is_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    assert made(monkeypatch, 0) == 8


@pytest.mark.slow
def test_contexts_that_are_needed_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contexts, "depth", lambda: 1)
    kept = [Knot() for _ in range(6)]
    assert len({id(each.context) for each in kept}) == 6
    assert {each.context for each in kept} <= set(contexts._there)


def test_processes_that_are_forked_have_what_was_made_ahead(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(contexts, "_ahead", [])
    monkeypatch.setattr(contexts, "_maker", None)
    contexts.make_ahead()
    assert contexts._ahead == []  # nobody needed one so far
    first = contexts.new_context(z3.Context)
    contexts.make_ahead()
    contexts.make_ahead()
    ahead = list(contexts._ahead)
    assert len(ahead) == 2
    taken = [contexts.new_context(z3.Context) for _ in range(3)]
    assert {id(each) for each in taken[:2]} == {id(each) for each in ahead}
    assert len({id(each) for each in (first, *taken)}) == 4


def test_what_was_made_ahead_is_for_who_makes_it_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contexts, "_ahead", [])
    monkeypatch.setattr(contexts, "_maker", None)
    contexts.new_context(z3.Context)
    contexts.make_ahead()
    assert isinstance(contexts.new_context(Bare), Bare)
