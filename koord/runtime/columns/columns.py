"""The state of a fleet as columns: what machine code reads of robots and of what they share.

Columns follow the robots, which stay what they are: whoever looks at a robot sees its attributes.
They are told what has changed. A value that machine code cannot have (one that is not set, a NaN,
an integer of more than 64 bits) is not *known* there, and who reads it is in doubt.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from koord.runtime.columns.effects import Deed
from koord.runtime.compile.machine.layout import KNOWN, Column, Layout, Leaf
from koord.runtime.compile.machine.made import HEAD_WORDS, Effect
from koord.runtime.engine import Measured
from koord.runtime.motion.arrays import Floats, Ints
from koord.runtime.proposals import Write
from koord.runtime.robot import Robot
from koord.syntax.core import Home

_LEAST, _GREATEST = -(2**63), 2**63 - 1


class Columns:
    """The columns of a fleet; :attr:`state` are the numbers that machine code is given of them."""

    def __init__(self, layout: Layout, kinds: Sequence[int], delta_s: float) -> None:
        count = len(kinds)
        self._kinds = tuple(kinds)
        self.words: Ints = np.zeros((layout.rows, count), np.int64)
        self.flags: NDArray[np.uint8] = np.zeros((layout.rows, count), np.uint8)
        self._cells: Ints = np.zeros(layout.cells, np.int64)
        self._cell_flags: NDArray[np.uint8] = np.zeros(layout.cells, np.uint8)
        self._floats: Floats = self.words.view(np.float64)
        self._cell_floats: Floats = self._cells.view(np.float64)
        arrays = (self.words, self.flags, self._cells, self._cell_flags)
        bits = int(np.array([delta_s]).view(np.int64)[0])
        self.state = (*(array.ctypes.data for array in arrays), count, bits)
        known = layout.columns.values()
        self._own = [[c for c in known if c.kind == kind] for kind in range(max(kinds) + 1)]
        self._entries = {c.name: c for c in known if c.home is Home.ALLREAD}
        self._of_effect: dict[int, tuple[Ints, Ints]] = {}
        self._shared = {c.name: c for c in known if c.home is Home.ALLWRITE}

    def seen(self, column: Column, leaf: int, robot: int) -> tuple[int, int]:
        """The word of a leaf as machine code sees it, and its flags."""
        at = column.first + leaf
        if column.home is Home.ALLWRITE:
            return int(self._cells[at]), int(self._cell_flags[at])
        return int(self.words[at, robot]), int(self.flags[at, robot])

    # --- what has changed -------------------------------------------------------------------------

    def take_all(self, robots: Iterable[Robot], values: Mapping[str, Any]) -> None:
        """Take over everything: of all robots, and of the values that they share."""
        of_kinds: list[list[Robot]] = [[] for _ in self._own]
        for robot in robots:
            of_kinds[self._kinds[robot.pid]].append(robot)
        for columns, of_kind in zip(self._own, of_kinds, strict=True):
            pids = [robot.pid for robot in of_kind]
            for column in columns:
                name = column.name
                self._put_all(column, pids, [vars(robot)[name] for robot in of_kind])
        for name, column in self._entries.items():
            self._put_all(column, range(len(values[name])), values[name])
        for name in self._shared:
            self._take_shared(name, values)

    def take(self, robot: Robot, names: Container[str] | None = None) -> None:
        """Take over a robot's own variables and ports: all, or those with these ``names``."""
        held, pid = vars(robot), robot.pid
        for column in self._own[self._kinds[pid]]:
            if names is None or column.name in names:
                self._put(column, pid, held[column.name])

    def take_deed(self, effect: Effect, deed: Deed, kept: list[int]) -> None:
        """Take over what machine code has written of robots' own, of the rows that are kept."""
        rows, places = self._places(effect)
        if not kept or not len(rows):
            return
        pids = np.array([deed.pids[row] for row in kept], np.int64)
        self.words[rows[:, None], pids] = deed.words[kept][:, places].T
        self.flags[rows[:, None], pids] = deed.flags[kept][:, places].T & KNOWN

    def _places(self, effect: Effect) -> tuple[Ints, Ints]:
        """The rows that an event may write, and where they stand in its words."""
        known = self._of_effect.get(id(effect))
        if known is None:
            rows: list[int] = []
            places: list[int] = []
            first = HEAD_WORDS
            for column in effect.columns:
                count = len(column.leaves)
                if column.home is not Home.ALLWRITE:
                    rows += range(column.first, column.first + count)
                    places += range(first, first + count)
                first += count
            known = np.array(rows, np.int64), np.array(places, np.int64)
            self._of_effect[id(effect)] = known
        return known

    def take_writes(
        self,
        writes: Iterable[Write],
        names: Sequence[str],
        values: Mapping[str, Any],
        known: Container[int],
    ) -> None:
        """Take over what writes to shared variables have led to; ``names`` are these by number.

        Of robots whose deeds are taken over, entries are ``known``.
        """
        whole = set()
        for write in writes:
            name = names[write.variable]
            if name in self._shared:
                whole.add(name)
            elif name in self._entries and write.path[0] not in known:
                pid = write.path[0]
                assert isinstance(pid, int)
                self._put(self._entries[name], pid, values[name][pid])
        for name in whole:
            self._take_shared(name, values)

    def measure(self, measured: Iterable[Measured]) -> None:
        """Take over what sensors read: what robots have then, to the sign of a zero."""
        for one in measured:
            if not len(one.robots):
                continue
            kind = self._kinds[one.robots[0]]
            for column in self._own[kind]:
                if column.name == one.name:
                    self._measure(column, one)

    def sensed(self, kind: int, name: str) -> tuple[int, int] | None:
        """Where the words of a sensor of floats begin, of all robots, and how many rows they are.

        None if it has other parts; no rows if nobody reads it.
        """
        for column in self._own[kind]:
            if column.name == name:
                is_plain = set(column.leaves) == {Leaf.FLOAT} and len(column.leaves) <= 3
                where = self.words[column.first :].ctypes.data, len(column.leaves)
                return where if is_plain else None
        return self.words.ctypes.data, 0

    def heard(self, kind: int, name: str) -> tuple[int, int] | None:
        """Where the words of a Boolean sensor begin, of all robots, and how many rows they are.

        None if it has other parts; no rows if nobody reads it.
        """
        for column in self._own[kind]:
            if column.name == name:
                where = self.words[column.first :].ctypes.data, len(column.leaves)
                return where if tuple(column.leaves) == (Leaf.BOOL,) else None
        return self.words.ctypes.data, 0

    def know(self, kind: int, name: str) -> None:
        """Take note that a sensor is known of all robots."""
        for column in self._own[kind]:
            if column.name == name:
                self.flags[column.first : column.first + len(column.leaves)] = KNOWN

    def _measure(self, column: Column, one: Measured) -> None:
        rows = one.values[:, None] if one.values.ndim == 1 else one.values
        width = len(column.leaves)
        # All robots are in order.
        robots: Any = slice(None) if len(one.robots) == len(self._kinds) else one.robots
        if column.leaves == (Leaf.FLOAT,) * width and not np.isnan(rows).any():
            at = slice(column.first, column.first + width)
            self._floats[at, robots] = rows[:, :width].T
            self.flags[at, robots] = KNOWN
            return
        for number, leaf in enumerate(column.leaves):
            row, values = column.first + number, rows[:, number]
            if leaf is Leaf.FLOAT:
                self._floats[row, robots] = values
                self.flags[row, robots] = np.where(np.isnan(values), 0, KNOWN)
            else:
                self.words[row, robots] = values
                self.flags[row, robots] = KNOWN

    def _put_all(self, column: Column, pids: Sequence[int], values: Sequence[Any]) -> None:
        """Take over a variable of several robots: at once where machine code can have all of it."""
        parts = [*zip(*map(column.flatten, values), strict=True)]
        if not all(map(_are_known, column.leaves, parts)):
            for pid, value in zip(pids, values, strict=True):
                self._put(column, pid, value)
            return
        where = np.array(pids, np.int64)
        for row, (leaf, of_all) in enumerate(zip(column.leaves, parts, strict=False), column.first):
            words = self._floats if leaf is Leaf.FLOAT else self.words
            words[row, where] = of_all
            self.flags[row, where] = KNOWN

    def _put(self, column: Column, pid: int, value: Any) -> None:
        row = column.first
        for leaf, part in zip(column.leaves, column.flatten(value), strict=True):
            if _is_known(leaf, part):
                if leaf is Leaf.FLOAT:
                    self._floats[row, pid] = part
                else:
                    self.words[row, pid] = part
                self.flags[row, pid] = KNOWN
            else:
                self.flags[row, pid] = 0
            row += 1

    def _take_shared(self, name: str, values: Mapping[str, Any]) -> None:
        column = self._shared[name]
        cell = column.first
        for leaf, part in zip(column.leaves, column.flatten(values[name]), strict=True):
            known = _is_known(leaf, part)
            if known and leaf is Leaf.FLOAT:
                self._cell_floats[cell] = part
            elif known:
                self._cells[cell] = part
            self._cell_flags[cell] = KNOWN if known else 0
            cell += 1


def _are_known(leaf: Leaf, parts: Sequence[Any]) -> bool:
    """Whether machine code can have a leaf of all robots."""
    if None in parts:
        return False
    match leaf:
        case Leaf.INT:
            return bool(min(parts) >= _LEAST and max(parts) <= _GREATEST)
        case Leaf.FLOAT:
            return not any(map(math.isnan, parts))
        case Leaf.BOOL:
            return True


def _is_known(leaf: Leaf, part: float | None) -> bool:
    """Whether machine code can have a leaf: it is set, no NaN, and has at most 64 bits."""
    if part is None:
        return False
    if leaf is Leaf.INT:
        return _LEAST <= part <= _GREATEST
    return leaf is Leaf.BOOL or not math.isnan(part)
