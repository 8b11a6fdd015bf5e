"""What machine code made of an event of several robots: nothing has happened yet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from koord.runtime.compile.machine.layout import WRITTEN, Column, Leaf
from koord.runtime.compile.machine.made import HEAD_WORDS, IN_DOUBT, Effect
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.proposals import Attempt, StopRequests, Write
from koord.runtime.robot import Robot
from koord.runtime.shapes import Array, Record, Shape, to_plain
from koord.syntax.core import Home

_NOTHING = StopRequests.NOTHING


class Deed(Struct):
    """An event of several robots, with what it writes: rows are robots.

    ``changes`` are the new values of their own variables, ``words`` and ``flags`` those of all
    columns of the event, behind its head.
    """

    event: int
    pids: list[int]
    attempts: list[Attempt]
    changes: list[dict[str, Any]]
    words: Ints
    flags: NDArray[np.uint8]


class WrittenRows(NamedTuple):
    """What machine code has written of an event: a row of words, and of flags, for each robot."""

    pids: list[int]
    words: Ints
    flags: NDArray[np.uint8]


class EventCode:
    """The machine code of an event, with the memory that it writes to.

    ``columns`` are what it may write, each with the shape of what one robot has of it, and its
    number among the shared variables.
    """

    def __init__(self, effect: Effect, columns: Sequence[tuple[Column, Shape, int]]) -> None:
        self.effect, self._columns = effect, tuple(columns)
        self._room = 0
        self._reserve(8)

    def _reserve(self, room: int) -> None:
        each = self.effect.words
        self._room = room
        self._pids: Ints = np.zeros(room, np.int64)
        self._words: Ints = np.zeros((room, each), np.int64)
        self._flags: NDArray[np.uint8] = np.zeros((room, each), np.uint8)
        self._verdicts: NDArray[np.uint8] = np.zeros(room, np.uint8)
        arrays = (self._words, self._flags, self._verdicts)
        self._from = self._pids.ctypes.data
        self._to = [array.ctypes.data for array in arrays]

    def run(self, state: tuple[int, ...], pids: list[int]) -> tuple[WrittenRows, list[int]]:
        """Run the event of some robots on a state; also the robots that it is in doubt of."""
        count = len(pids)
        if count > self._room:
            self._reserve(2 * count)
        self._pids[:count] = pids
        self.effect.run(*state, self._from, count, *self._to)
        words, flags = self._words[:count], self._flags[:count]
        doubtful = self._verdicts[:count] == IN_DOUBT
        in_doubt: list[int] = []
        if doubtful.any():
            in_doubt = self._pids[:count][doubtful].tolist()
            pids = self._pids[:count][~doubtful].tolist()
            words, flags = words[~doubtful], flags[~doubtful]
        else:
            words, flags = words.copy(), flags.copy()
        return WrittenRows(pids, words, flags), in_doubt

    def deed(self, event: int, rows: WrittenRows, robots: Sequence[Robot]) -> Deed:
        """What robots did, by what code has written."""
        pids, words, flags = rows
        deed = Deed(event, pids, [], [{} for _ in pids], words, flags)
        writes: list[list[Write]] = [[] for _ in pids]
        first = HEAD_WORDS
        for column, shape, number in self._columns:
            self._gather(deed, column, shape, number, first, writes, robots)
            first += len(column.leaves)
        deed.attempts = [
            Attempt(
                event,
                tuple(of_robot),
                _bits(locks) if locks else (),
                StopRequests(asked) if asked else _NOTHING,
            )
            for of_robot, (locks, asked) in zip(writes, words[:, :HEAD_WORDS].tolist(), strict=True)
        ]
        return deed

    def _gather(
        self,
        deed: Deed,
        column: Column,
        shape: Shape,
        number: int,
        first: int,
        writes: list[list[Write]],
        robots: Sequence[Robot],
    ) -> None:
        """Gather what robots have written of a variable: as a whole, or leaf by leaf."""
        name, end = column.name, first + len(column.leaves)
        is_written: Bools = (deed.flags[:, first:end] & WRITTEN) != 0
        values = _values(column, shape, deed.words[:, first:end])
        whole: Bools = np.logical_and.reduce(is_written, axis=1)
        some: Bools = np.logical_or.reduce(is_written, axis=1)
        is_whole, is_any = whole.tolist(), some.tolist()
        by_entry = column.home is Home.ALLREAD
        is_own = column.home in (Home.LOCAL, Home.PORT)
        for k, (pid, value) in enumerate(zip(deed.pids, values, strict=True)):
            if not is_any[k]:
                continue
            if is_own and is_whole[k]:
                deed.changes[k][name] = value
            elif is_own:
                old = column.flatten(vars(robots[pid])[name])
                new = column.flatten(value)
                marks = is_written[k].tolist()
                parts = [n if mark else o for n, o, mark in zip(new, old, marks, strict=True)]
                deed.changes[k][name] = _made(shape, iter(parts))
            else:
                path = (pid,) if by_entry else ()
                if is_whole[k]:
                    writes[k].append(Write(number, path, to_plain(shape, value)))
                    continue
                leaves = zip(
                    _paths(shape), column.flatten(value), is_written[k].tolist(), strict=True
                )
                writes[k] += [
                    Write(number, (*path, *below), leaf) for below, leaf, mark in leaves if mark
                ]


def _values(column: Column, shape: Shape, words: Ints) -> list[Any]:
    """The values of a variable, a row of leaves for each."""
    floats: Floats = words.view(np.float64)
    leaves: list[list[Any]] = [
        floats[:, k].tolist()
        if leaf is Leaf.FLOAT
        else (words[:, k] != 0).tolist()
        if leaf is Leaf.BOOL
        else words[:, k].tolist()
        for k, leaf in enumerate(column.leaves)
    ]
    match shape:
        case Record(make=make) if shape.types is not None:
            return list(map(tuple.__new__, repeat(make), zip(*leaves, strict=True)))
        case Record() | Array():
            return [_made(shape, iter(row)) for row in zip(*leaves, strict=True)]
        case _:
            return leaves[0]


def _bits(word: int) -> tuple[int, ...]:
    return tuple(k for k in range(word.bit_length()) if word >> k & 1)


def _paths(shape: Shape) -> Iterator[tuple[int, ...]]:
    """The paths to the leaves of a shape."""
    match shape:
        case Record(fields=parts):
            for number, part in enumerate(parts):
                yield from ((number, *below) for below in _paths(part))
        case Array(element=element, size=size):
            for number in range(size):
                yield from ((number, *below) for below in _paths(element))
        case _:
            yield ()


def _made(shape: Shape, leaves: Iterator[Any]) -> Any:
    """The value of some leaves."""
    match shape:
        case Record(make=make, fields=parts):
            return tuple.__new__(make, [_made(part, leaves) for part in parts])
        case Array(element=element, size=size):
            return tuple([_made(element, leaves) for _ in range(size)])
        case _:
            return next(leaves)
