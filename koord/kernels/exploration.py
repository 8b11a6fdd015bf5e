"""A search by machine code: tables of packed states that grow as they fill. [CONFIG]"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from koord.kernels import rounds as fields
from koord.kernels.rounds import CONTEXT_WORDS, LEFT_TOO_LARGE, Rounds
from koord.kernels.terms import NoKernelError

#: The first size of the tables. Twice as many states fit in as are looked at before they grow.
_FIRST_ENTRIES = 1 << 20

#: Numbers of states are 32 bits wide.
_MOST_ENTRIES = 1 << 31

Array = np.ndarray[tuple[int], np.dtype[np.int64]]

_TYPES = {8: np.int8, 16: np.int16, 32: np.int32}


class Exploration:
    """The states that a search has seen. ``found`` says of each goal where it was met first.

    It is -1 where it was not; else twice the number of a state that shows it, or, if it is in the
    round behind a state, one more than that.
    """

    def __init__(self, rounds: Rounds) -> None:
        self._rounds = rounds
        self._bytes = rounds.cells.state_bytes
        self._context = np.zeros(CONTEXT_WORDS, dtype=np.int64)
        self.found = np.full(rounds.goals.count, -1, dtype=np.int64)
        self._states = np.zeros(0, dtype=np.uint8)
        self._middles = np.zeros(0, dtype=np.uint8)
        self._before = np.zeros(0, dtype=np.uint32)
        self._table = np.zeros(0, dtype=np.uint32)
        self._middle_table = np.zeros(0, dtype=np.uint32)
        self._put(fields.FOUND, self.found.ctypes.data)
        self._grow_states(_FIRST_ENTRIES)
        self._grow_middles(_FIRST_ENTRIES)

    def _put(self, field: int, value: int) -> None:
        self._context[field] = value

    # --- tables ---------------------------------------------------------------------------------

    def _grow_states(self, entries: int) -> None:
        room = entries // 4 * 3
        self._states = _grown(self._states, room * self._bytes)
        self._before = _grown(self._before, room)
        self._table = self._filled(self._states, self.states, entries)
        self._put(fields.STATES, self._states.ctypes.data)
        self._put(fields.BEFORE, self._before.ctypes.data)
        self._put(fields.TABLE, self._table.ctypes.data)
        self._put(fields.TABLE_MASK, entries - 1)
        self._put(fields.STATE_MOST, entries // 2)
        self._put(fields.STATE_ROOM, room)

    def _grow_middles(self, entries: int) -> None:
        room = entries // 4 * 3
        count = int(self._context[fields.MIDDLE_COUNT])
        self._middles = _grown(self._middles, room * self._bytes)
        self._middle_table = self._filled(self._middles, count, entries)
        self._put(fields.MIDDLES, self._middles.ctypes.data)
        self._put(fields.MIDDLE_TABLE, self._middle_table.ctypes.data)
        self._put(fields.MIDDLE_MASK, entries - 1)
        self._put(fields.MIDDLE_MOST, entries // 2)
        self._put(fields.MIDDLE_ROOM, room)

    def _filled(
        self, states: np.ndarray[tuple[int], np.dtype[np.uint8]], count: int, entries: int
    ) -> np.ndarray[tuple[int], np.dtype[np.uint32]]:
        if entries > _MOST_ENTRIES:
            raise NoKernelError("there are too many states to number")
        table = np.zeros(entries, dtype=np.uint32)
        if count:
            self._rounds.rehash(states.ctypes.data, count, table.ctypes.data, entries - 1)
        return table

    # --- searching ------------------------------------------------------------------------------

    @property
    def states(self) -> int:
        """So many states were seen."""
        return int(self._context[fields.STATE_COUNT])

    @property
    def middles(self) -> int:
        """So many ends of program turns were worked out, equal ones each time."""
        return int(self._context[fields.ROUNDS])

    def enter(self, numbers: Sequence[int]) -> int:
        """Put a start into the table: its number, or -1 if it is there already."""
        packed = self.packed(numbers)
        return self._rounds.enter(self._context.ctypes.data, packed.ctypes.data)

    def expand(self, first: int, end: int) -> int:
        """Look at all rounds from some states, and grow; return which state is next.

        Raises NoKernelError where machine code cannot go on.
        """
        following = self._rounds.expand(self._context.ctypes.data, first, end)
        left = int(self._context[fields.LEFT])
        if left:
            too_large = left == LEFT_TOO_LARGE
            raise NoKernelError("an integer is too large" if too_large else "a table is full")
        if self._context[fields.STATE_COUNT] >= self._context[fields.STATE_MOST]:
            self._grow_states(2 * len(self._table))
        if self._context[fields.MIDDLE_COUNT] >= self._context[fields.MIDDLE_MOST]:
            self._grow_middles(2 * len(self._middle_table))
        return following

    # --- states ---------------------------------------------------------------------------------

    def packed(self, numbers: Sequence[int]) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
        """A state of the numbers in its cells. Raises NoKernelError if one does not fit."""
        type_ = _TYPES[self._rounds.cells.bits]
        most = 1 << (self._rounds.cells.bits - 1)
        if any(not -most <= number < most for number in numbers):
            raise NoKernelError("an integer is too large")
        state = np.zeros(self._bytes, dtype=np.uint8)
        cells = np.array(numbers, dtype=type_).view(np.uint8)
        state[: len(cells)] = cells
        return state

    def numbers(self, state: int) -> list[int]:
        """The numbers in the cells of a state that was seen."""
        return self._unpacked(self._states[state * self._bytes : (state + 1) * self._bytes])

    def _unpacked(self, state: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> list[int]:
        cells = self._rounds.cells
        used = state[: len(cells.layout.cells) * cells.size].copy()
        return [int(number) for number in used.view(_TYPES[cells.bits])]

    def canonical(self, numbers: Sequence[int]) -> tuple[list[int], tuple[int, ...]]:
        """The state that stands for one, and the numbers that robots have in it."""
        state, out = self.packed(numbers), np.zeros(self._bytes, dtype=np.uint8)
        names = np.zeros(len(self._rounds.layout.robots), dtype=np.int64)
        self._rounds.canonical(state.ctypes.data, out.ctypes.data, names.ctypes.data)
        return self._unpacked(out), tuple(int(name) for name in names)

    def path(self, state: int, starts: int) -> list[int]:
        """The states on the way from a start to one; the first ``starts`` states are starts."""
        path = [state]
        while path[-1] >= starts:
            path.append(int(self._before[path[-1]]))
        return path[::-1]


def _grown(array: np.ndarray, size: int) -> np.ndarray:
    """An array with room for more; what is behind the old part is left untouched."""
    grown = np.empty(size, dtype=array.dtype)
    grown[: len(array)] = array
    return grown
