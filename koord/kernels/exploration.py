"""A search by machine code: tables of packed states that grow as they fill. [CONFIG]"""

from __future__ import annotations

import ctypes
import sys
from array import array
from collections.abc import Sequence
from mmap import MAP_ANONYMOUS, MAP_PRIVATE, mmap
from typing import Literal

from koord.kernels import context as fields
from koord.kernels.context import CONTEXT_WORDS
from koord.kernels.entering import MOST_WAITING
from koord.kernels.rounds import Rounds
from koord.kernels.terms import NoKernelError

#: The first size of the tables. Twice as many states fit in as are looked at before they grow.
_FIRST_ENTRIES = 1 << 16

#: Numbers of states are 32 bits wide.
_MOST_ENTRIES = 1 << 31

#: So many middles of rounds are remembered. Those that are forgotten are worked out once more.
_MOST_MIDDLES = 1 << 24

#: So much is done before machine code comes back: states entered, and ends of program turns.
_WORK = 1 << 17

#: Signed integers of so many bits, as arrays call them.
_TYPES = {8: "b", 16: "h", 32: "i"}

_BYTES_PER_ENTRY = 4

#: The bytes of numbers, by what :mod:`array` calls them.
_FORMS = {"I": 4, "q": 8, "Q": 8}


class OutOfRoomError(Exception):
    """Raised where tables would take more memory than they may."""


class Block:
    """Zeroed memory, which the system gives when it is touched."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.memory = mmap(-1, max(size, 1), MAP_PRIVATE | MAP_ANONYMOUS)
        self.address = ctypes.addressof(ctypes.c_char.from_buffer(self.memory))

    @staticmethod
    def of(held: bytes | bytearray) -> Block:
        """A block with some bytes."""
        made = Block(len(held))
        made.memory[: len(held)] = bytes(held)
        return made

    def view(self, form: Literal["I", "q", "Q"]) -> memoryview[int]:
        """The block as numbers of a form that :mod:`array` names; it does not change its size."""
        whole = self.size // _FORMS[form] * _FORMS[form]
        return memoryview(self.memory)[:whole].cast(form)

    def grown(self, size: int) -> Block:
        """A block with the same beginning and room for more."""
        made = Block(size)
        ctypes.memmove(made.address, self.address, min(size, self.size))
        return made


class Exploration:
    """The states that a search has seen, in tables of at most ``most_bytes``.

    ``found`` says of each goal where it was met first. It is -1 where it was not; else twice the
    number of a state that shows it, or, if it is in the round behind a state, one more than that.
    """

    #: So many words the context has.
    words = CONTEXT_WORDS

    def __init__(self, rounds: Rounds, most_bytes: int | None = None) -> None:
        self._rounds = rounds
        self._bytes = rounds.cells.state_bytes
        self._most_bytes = most_bytes
        self._context = (ctypes.c_int64 * self.words)()
        self._address = ctypes.addressof(self._context)
        count = rounds.goals.count
        self.found = (ctypes.c_int64 * count)(*[-1] * count)
        self._states = self._middles = self._before = Block(0)
        self._table = self._middle_table = Block(0)
        self._put(fields.FOUND, ctypes.addressof(self.found))
        self._waiting = Block(MOST_WAITING * self._bytes)
        self._put(fields.WAITING, self._waiting.address)
        self._grow_states(_FIRST_ENTRIES)
        self._forget_middles(_FIRST_ENTRIES)

    def _put(self, field: int, value: int) -> None:
        self._context[field] = value

    # --- tables ---------------------------------------------------------------------------------

    def _grow_states(self, entries: int) -> None:
        room = entries // 4 * 3
        self._make_room(entries, room * (self._bytes + _BYTES_PER_ENTRY))
        self._states = self._states.grown(room * self._bytes)
        self._before = self._before.grown(room * _BYTES_PER_ENTRY)
        self._table = Block(entries * _BYTES_PER_ENTRY)
        self._rounds.rehash(self._states.address, self.states, self._table.address, entries - 1)
        self._put(fields.STATES, self._states.address)
        self._put(fields.BEFORE, self._before.address)
        self._put(fields.TABLE, self._table.address)
        self._put(fields.TABLE_MASK, entries - 1)
        self._put(fields.STATE_MOST, entries // 2)
        self._put(fields.STATE_ROOM, room)

    def _forget_middles(self, entries: int) -> None:
        """Begin anew with middles: who forgets one works it out again."""
        room = entries // 4 * 3
        self._make_room(entries, room * self._bytes)
        self._middles = Block(room * self._bytes)
        self._middle_table = Block(entries * _BYTES_PER_ENTRY)
        self._put(fields.MIDDLES, self._middles.address)
        self._put(fields.MIDDLE_TABLE, self._middle_table.address)
        self._put(fields.MIDDLE_MASK, entries - 1)
        self._put(fields.MIDDLE_COUNT, 0)
        self._put(fields.MIDDLE_MOST, entries // 2)
        self._put(fields.MIDDLE_ROOM, room)

    def _make_room(self, entries: int, size: int) -> None:
        """Raise OutOfRoomError if a table may not grow to some entries and bytes of contents."""
        new = size + entries * _BYTES_PER_ENTRY
        if self._most_bytes is not None and self.table_bytes + new > self._most_bytes:
            raise OutOfRoomError
        if entries > _MOST_ENTRIES:
            raise NoKernelError("there are too many states to number")

    @property
    def table_bytes(self) -> int:
        """The bytes of all tables."""
        tables = (self._states, self._before, self._table, self._middles, self._middle_table)
        return sum(table.size for table in tables)

    @property
    def _middle_entries(self) -> int:
        return self._middle_table.size // _BYTES_PER_ENTRY

    # --- searching ------------------------------------------------------------------------------

    @property
    def states(self) -> int:
        """So many states were seen."""
        return int(self._context[fields.STATE_COUNT])

    @property
    def work(self) -> int:
        """So many states were entered and ends of program turns looked at, equal ones each time."""
        return int(self._context[fields.WORK])

    def enter(self, numbers: Sequence[int]) -> int:
        """Put a start into the table: its number, or -1 if it is there already."""
        if self.states >= self._context[fields.STATE_MOST]:
            self._grow_states(2 * self._table.size // _BYTES_PER_ENTRY)
        packed = self._packed(numbers)
        return self._rounds.enter(self._address, packed.address)

    def lookup(self, numbers: Sequence[int]) -> int:
        """The number of a state that stands for itself, or -1."""
        packed = self._packed(numbers)
        return self._rounds.lookup(self._address, packed.address)

    def expand(self, first: int, end: int) -> int:
        """Look at all rounds from some states, and grow; return which state is next.

        It comes back after some work, with a few states looked at. Raises NoKernelError where
        machine code cannot go on, and OutOfRoomError where there is no more memory.
        """
        self._put(fields.WORK_MOST, self.work + _WORK)
        following = self._rounds.expand(self._address, first, end)
        match int(self._context[fields.LEFT]):
            case 0:
                pass
            case fields.LEFT_TOO_LARGE:
                raise NoKernelError("an integer is too large")
            case fields.LEFT_TOO_MANY:
                raise NoKernelError("a state has too many successors")
            case _:
                return self._once_more()
        if self.states >= self._context[fields.STATE_MOST]:
            self._grow_states(2 * self._table.size // _BYTES_PER_ENTRY)
        if self._context[fields.MIDDLE_COUNT] >= self._context[fields.MIDDLE_MOST]:
            self._forget_middles(min(2 * self._middle_entries, _MOST_MIDDLES))
        return following

    def _once_more(self) -> int:
        """Grow, and look at the state again whose successors had no room.

        Middles whose environments have not had all their turns are forgotten with the others.
        """
        self._put(fields.LEFT, 0)
        if self.states >= self._context[fields.STATE_ROOM]:
            self._grow_states(2 * self._table.size // _BYTES_PER_ENTRY)
        full = self._context[fields.MIDDLE_COUNT] >= self._context[fields.MIDDLE_ROOM]
        entries = self._middle_entries
        if full and entries >= _MOST_MIDDLES:
            raise NoKernelError("a state has too many successors")
        self._forget_middles(2 * entries if full else entries)
        return int(self._context[fields.CURRENT])

    # --- states ---------------------------------------------------------------------------------

    def _packed(self, numbers: Sequence[int]) -> _Packed:
        """A state of the numbers in its cells. Raises NoKernelError if one does not fit."""
        cells = self._rounds.cells
        try:
            held = array(_TYPES[cells.bits], numbers)
        except OverflowError:
            raise NoKernelError("an integer is too large") from None
        return _Packed(held.tobytes().ljust(self._bytes, b"\0"))

    def _unpacked(self, state: bytes) -> list[int]:
        cells = self._rounds.cells
        return array(_TYPES[cells.bits], state[: len(cells.layout.cells) * cells.size]).tolist()

    def numbers(self, state: int) -> list[int]:
        """The numbers in the cells of a state that was seen."""
        first = state * self._bytes
        return self._unpacked(self._states.memory[first : first + self._bytes])

    def canonical(self, numbers: Sequence[int]) -> tuple[list[int], tuple[int, ...]]:
        """The state that stands for one, and the places that all names have in it."""
        state, out = self._packed(numbers), _Packed(bytes(self._bytes))
        names = (ctypes.c_int64 * self._rounds.layout.names)()
        self._rounds.canonical(state.address, out.address, ctypes.addressof(names))
        return self._unpacked(out.held.raw), tuple(names)

    def path(self, state: int, starts: int) -> list[int]:
        """The states on the way from a start to one; the first ``starts`` states are starts."""
        path = [state]
        while path[-1] >= starts:
            first = path[-1] * _BYTES_PER_ENTRY
            entry = self._before.memory[first : first + _BYTES_PER_ENTRY]
            path.append(int.from_bytes(entry, sys.byteorder))
        return path[::-1]


class _Packed:
    """A packed state outside of the tables."""

    def __init__(self, state: bytes) -> None:
        self.held = ctypes.create_string_buffer(state, len(state))
        self.address = ctypes.addressof(self.held)
