"""Folds: the blocks of a text by their indentation, which mistakes do not disturb."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from koord.syntax.source import Source


class Fold(Struct, frozen=True):
    """Lines that can be hidden behind the first, which stays; both ends count from 1."""

    first: int
    last: int
    is_comment: bool = False


def folds(source: Source) -> tuple[Fold, ...]:
    """The folds of a text in the order of their first lines."""
    lines = source.text.split("\n")
    found = [*_comments(lines), *_blocks(lines)]
    return tuple(sorted(found, key=lambda fold: (fold.first, -fold.last)))


def _blocks(lines: list[str]) -> Iterator[Fold]:
    """A line and the deeper ones below it; empty lines at the end of a block are not of it."""
    open_: list[tuple[int, int]] = []  # indentation, number of the line
    last = 0  # the last line that is neither empty nor a comment
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if not text or text.startswith(("#", "//")):
            continue
        indent = len(line) - len(line.lstrip())
        while open_ and open_[-1][0] >= indent:
            _, first = open_.pop()
            if last > first:
                yield Fold(first, last)
        open_.append((indent, number))
        last = number
    while open_:
        _, first = open_.pop()
        if last > first:
            yield Fold(first, last)


def _comments(lines: list[str]) -> Iterator[Fold]:
    first = 0
    for number, line in enumerate([*lines, ""], 1):
        if line.strip().startswith(("#", "//")):
            first = first or number
        elif first:
            if number - 1 > first:
                yield Fold(first, number - 1, is_comment=True)
            first = 0
