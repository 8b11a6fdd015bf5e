"""Items of lazy sequences are made once, and only if somebody wants them."""

from __future__ import annotations

import pytest

from koord.runtime.lazily import Lazily


def test_what_is_asked_for_is_made_once() -> None:
    made: list[int] = []

    def square(position: int) -> int:
        made.append(position)
        return position * position

    squares = Lazily(5, square)
    assert len(squares) == 5
    assert made == []
    assert (squares[3], squares[-2], squares[3]) == (9, 9, 9)
    assert made == [3]
    assert squares[2:4] == [4, 9]
    assert list(squares) == [0, 1, 4, 9, 16]
    assert sorted(made) == [0, 1, 2, 3, 4]
    with pytest.raises(IndexError):
        squares[5]
