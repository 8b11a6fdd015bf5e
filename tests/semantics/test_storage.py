"""Storage of as many robots as there may be: asked one at a time, and not twice for one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from koord.semantics.storage import Cell, Storage, remembering


def test_what_was_asked_last_is_not_worked_out_again() -> None:
    asked: list[int] = []

    def at(index: int) -> Storage[int]:
        asked.append(index)
        return Cell(True, index)

    once = remembering(at)
    first, other = 1000, 2000
    assert once(first) is once(first)
    assert once(other) == Cell(True, 2000)
    assert once(first) == Cell(True, 1000)
    assert asked == [1000, 2000, 1000]


def test_a_chain_of_branches_asks_each_link_once() -> None:
    """Both sides of a branch have most in common: without a memory it is 2^60 questions."""
    asked = 0

    def base(index: int) -> Storage[int]:
        nonlocal asked
        asked += 1
        return Cell(True, index)

    def both(before: Callable[[int], Storage[int]], index: int) -> Storage[int]:
        return before(index) if before(index) == Cell(True, 7) else Cell(True, 0)

    link = remembering(base)
    for _ in range(60):
        link = remembering(partial(both, link))
    assert link(7) == Cell(True, 7)
    assert asked == 1
