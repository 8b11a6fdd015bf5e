"""Sequences whose items are made when they are first asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar, overload

T = TypeVar("T")


class Lazily(Sequence[T]):
    """A sequence of ``count`` items, each made once, by its position.

    Of what large fleets have a copy of for each robot, such as generators of random numbers, most
    is never used.
    """

    def __init__(self, count: int, make: Callable[[int], T]) -> None:
        self._positions, self._make = range(count), make
        self._made: dict[int, T] = {}

    def __len__(self) -> int:
        return len(self._positions)

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> list[T]: ...

    def __getitem__(self, index: int | slice) -> T | list[T]:
        found = self._positions[index]
        if isinstance(found, range):
            return [self[position] for position in found]
        if found not in self._made:
            self._made[found] = self._make(found)
        return self._made[found]
