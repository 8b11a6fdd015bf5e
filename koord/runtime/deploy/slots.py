"""A file of two slots, which is written in place: what a journal is kept in.

    head 4096 | slot | slot        slot: generation 16 | frame | frame | … | zeros

The file gets its size when it is made, so that what is written later changes nothing but its
blocks: neither its size nor where its blocks are has to be written with each of them. A slot is
begun whole by one frame, while the other one still stands; of two that are whole the later
generation counts. Behind the last frame there are only zeros, always.

A loss of power may keep any of the sectors that were written since the last sync from the disk, in
any order, and each of them is there as a whole or not at all. A frame of which a sector is missing
therefore has zeros there, to the end of that sector, where what was written has none (bodies are
masked): it was *torn*, nobody was told of it, and what was written after it cannot have been synced
either. Anything else that is not as it was written is
damage: so is a hole before a frame that knows of later bytes on the disk (``known``).
"""

from __future__ import annotations

import errno
import fcntl
import os
from contextlib import suppress
from hashlib import shake_128
from pathlib import Path
from struct import Struct as Layout
from zlib import crc32

#: The first bytes of a journal: a name and a version.
NAME = b"koord journal 3\n"
_OTHERS = b"koord journal "

#: The least that disks write as a whole, and what they are given at once.
SECTOR_BYTES, BLOCK_BYTES = 512, 4096

#: A slot of a new file, if what it begins with does not need more.
SLOT_BYTES = 1 << 19

#: A new slot is so many times as long as what it begins with.
_SPARE = 4

_HEAD = Layout("!16sQII")  #: name, bytes of a slot, checksum, nothing
_BEGUN = Layout("!QII")  #: of a slot: generation, checksum, nothing
_FRAME = Layout("!IIII")  #: bytes of the body, known, checksum of the body, checksum of this
_END = b"\xff"  #: stands behind each body: what was cut short ends in zeros
_ALIGNED = 16  #: so that no head of a frame lies in two sectors
_MASK = shake_128(NAME).digest(1 << 13)  #: has no sector of zeros, from whatever place on


class DamagedError(Exception):
    """Raised for a journal that cannot be used; the message says why."""


class InUseError(Exception):
    """Raised for a journal that another process writes."""


class SlotFile:
    """A file of frames, of which the last that is whole is where it ends.

    Methods raise OSError. What fails is as if it had not been begun, and may be tried again.
    Without ``syncs`` the file outlasts processes, but no loss of power.
    """

    def __init__(self, path: Path, *, syncs: bool = True, slot_bytes: int = SLOT_BYTES) -> None:
        self.path = path
        self.written = 0  #: bytes that the disk was given, in whole blocks if it is synced
        self._syncs = syncs
        self._slot_bytes = slot_bytes
        self._file: int | None = None
        self._slot = 0  #: the one that counts
        self._generation = 0
        self._size = 0  #: of what is whole in it
        self._synced = 0  #: of that, what is known to be on the disk
        self._unsynced = b""  #: and the rest
        self._torn_end = 0  #: to there may be something else than zeros behind what is whole
        self._is_lost = False  #: a sync failed: the kernel may have forgotten what is unsynced
        self._other_end = 0  #: to there the other slot may be something else than zeros
        self._is_other_begun = False  #: and may even be taken for the one that counts
        self._is_named = True  #: the folder is known to name this file
        self._is_told = True  #: what it holds was told to be there: a begin that failed was not

    @property
    def is_long(self) -> bool:
        """True if it is time to begin anew: it is half full, or holds what nobody was told of."""
        return not self._is_told or 2 * self._size > self._slot_bytes

    # --- reading --------------------------------------------------------------------------------

    def read(self) -> list[bytes] | None:
        """Read all frames; None if there is no file. Raises DamagedError, InUseError, OSError."""
        try:
            file = os.open(self.path, os.O_RDWR | os.O_CLOEXEC)
        except FileNotFoundError:
            return None
        try:
            lock(file, self.path)
            bodies = self._read(_whole(file))
            if self._syncs:  # what was read need not be on the disk yet
                os.fdatasync(file)
        except BaseException:
            os.close(file)
            raise
        self._file = file
        return bodies

    def _read(self, data: bytes) -> list[bytes]:
        self._slot_bytes = _slot_bytes(data)
        data = data.ljust(BLOCK_BYTES + 2 * self._slot_bytes, b"\0")
        slots = [data[at : at + self._slot_bytes] for at in map(self._place, (0, 1))]
        generations = [_generation(slot) for slot in slots]
        begun = max((g, k) for k, g in enumerate(generations))
        if begun[0] == 0:
            raise DamagedError("it has no whole record")
        self._generation, self._slot = begun
        bodies, size = _frames(slots[self._slot], self._generation)
        self._stands(size)
        self._torn_end = _end(slots[self._slot])
        self._other_end, self._is_other_begun = _end(slots[1 - self._slot]), False
        return bodies

    # --- writing --------------------------------------------------------------------------------

    def begin(self, body: bytes) -> None:
        """Let this stand for all that was written before."""
        generation = self._generation + 1
        data = _begun(generation) + _framed(body, generation, 0)
        if self._file is None or _SPARE * len(data) > self._slot_bytes:
            self._make(data, generation, max(self._slot_bytes, _blocks(_SPARE * len(data))))
            return
        self._blank_other()
        other, end = 1 - self._slot, max(self._size, self._torn_end)
        self._other_end, self._is_other_begun = len(data), True  # until all is well
        self._put(other, 0, data)
        self._sync(self._place(other), len(data))
        self._slot, self._generation = other, generation
        self._stands(len(data))
        self._other_end, self._is_other_begun, self._is_told = end, False, True
        with suppress(OSError):  # it is tried again before the slot is used again
            self._blank_other()

    def add(self, body: bytes, *, sync: bool = True) -> None:
        """Add a frame; with ``sync`` it and all before are on the disk then."""
        assert self._file is not None
        if not self._is_told:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        data = _framed(body, self._generation, self._synced)
        if self._size + len(data) > self._slot_bytes:
            self._grow(data)
            return
        self._mend()
        self._torn_end = self._size + len(data)
        self._put(self._slot, self._size, data)
        if not self._syncs:
            self.written += len(data)
        elif not sync:
            self._unsynced += data
        else:
            self._sync(self._place(self._slot) + self._synced, len(self._unsynced) + len(data))
            self._is_lost = False
            self._synced, self._unsynced = self._torn_end, b""
        self._size = self._torn_end

    def _mend(self) -> None:
        """Let the slot be as it is to be, after something has failed or was torn."""
        if self._is_other_begun:
            self._blank_other()
        if self._is_lost and self._unsynced:
            self._put(self._slot, self._synced, self._unsynced)
        if self._torn_end > self._size:
            self._blank(self._slot, self._size, self._torn_end)
            self._torn_end = self._size

    def _blank_other(self) -> None:
        if self._other_end:
            self._blank(1 - self._slot, 0, self._other_end)
            self._other_end, self._is_other_begun = 0, False

    def _grow(self, data: bytes) -> None:
        """Make a file with longer slots, for a frame that has no room."""
        held = os.pread(self._open, self._size, self._place(self._slot))
        self._make(held + data, self._generation, _blocks(2 * (len(held) + len(data))))

    def _make(self, data: bytes, generation: int, slot_bytes: int) -> None:
        """Make the file anew with such slots, and this in the first."""
        size = BLOCK_BYTES + 2 * slot_bytes
        whole = _head(slot_bytes).ljust(BLOCK_BYTES, b"\0") + data
        new = self.path.with_suffix(".new")
        file = os.open(new, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        try:
            lock(file, self.path)
            _write(file, whole.ljust(size, b"\0") if self._syncs else whole, 0)
            if self._syncs:
                os.fsync(file)
            else:
                os.ftruncate(file, size)
            os.replace(new, self.path)
        except BaseException:
            os.close(file)
            with suppress(OSError):
                new.unlink(missing_ok=True)
            raise
        self.close()
        self.written += size if self._syncs else len(whole)
        self._file, self._slot_bytes, self._slot, self._generation = file, slot_bytes, 0, generation
        self._stands(len(data))
        self._other_end, self._is_other_begun = 0, False
        self._is_named, self._is_told = not self._syncs, False
        self._name()
        self._is_told = True

    def close(self) -> None:
        """Close the file. Another process may use it then."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    # --- inside ---------------------------------------------------------------------------------

    @property
    def _open(self) -> int:
        assert self._file is not None
        return self._file

    def _place(self, slot: int) -> int:
        return BLOCK_BYTES + slot * self._slot_bytes

    def _stands(self, size: int) -> None:
        """Note that the slot holds so much, which is on the disk if anything is."""
        self._size = self._torn_end = size
        self._synced = size if self._syncs else 0
        self._unsynced, self._is_lost = b"", False

    def _put(self, slot: int, at: int, data: bytes) -> None:
        _write(self._open, data, self._place(slot) + at)

    def _blank(self, slot: int, at: int, end: int) -> None:
        """Let there be zeros, on the disk before anything else is written."""
        self._put(slot, at, bytes(end - at))
        self._sync(self._place(slot) + at, end - at)

    def _sync(self, at: int, size: int) -> None:
        """Let what was written be on the disk; ``size`` bytes from a place on were."""
        if not self._syncs:
            self.written += size
            return
        self._name()
        try:
            os.fdatasync(self._open)
        except OSError:
            self._is_lost = True
            raise
        self.written += _blocks(at + size) - at // BLOCK_BYTES * BLOCK_BYTES

    def _name(self) -> None:
        """Let the folder name the file on the disk, too."""
        if not self._is_named:
            _sync_folder(self.path.parent)
            self._is_named = True


def lock(file: int, path: Path) -> None:
    """Keep other processes from a file. Raises InUseError."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InUseError(str(path)) from None


def _whole(file: int) -> bytes:
    parts = []
    while part := os.read(file, 1 << 20):
        parts.append(part)
    return b"".join(parts)


def _write(file: int, data: bytes, at: int) -> None:
    """Write all of ``data`` at a place, at once: in two parts a sector could get the first alone.

    Files take all that there is room for.
    """
    if os.pwrite(file, data, at) != len(data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _sync_folder(folder: Path) -> None:
    """Make a new name in a folder outlast a loss of power."""
    file = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def _blocks(size: int) -> int:
    """So many bytes, up to the end of a block."""
    return -(-size // BLOCK_BYTES) * BLOCK_BYTES


# --- bytes ----------------------------------------------------------------------------------------


def _head(slot_bytes: int) -> bytes:
    said = _HEAD.pack(NAME, slot_bytes, 0, 0)[: -2 * 4]
    return said + crc32(said).to_bytes(4, "big") + bytes(4)


def _slot_bytes(data: bytes) -> int:
    """The bytes of a slot, of the whole file. Raises DamagedError."""
    if not data.startswith(NAME):
        is_other = data.startswith(_OTHERS)
        raise DamagedError(
            "it is of another koord" if is_other else "it does not begin as a journal"
        )
    if len(data) < _HEAD.size or data[: _HEAD.size] != _head(_HEAD.unpack_from(data)[1]):
        raise DamagedError("its head is damaged")
    slot_bytes: int = _HEAD.unpack_from(data)[1]
    return slot_bytes


def _begun(generation: int) -> bytes:
    said = generation.to_bytes(8, "big")
    return said + crc32(said).to_bytes(4, "big") + bytes(4)


def _framed(body: bytes, generation: int, known: int) -> bytes:
    """A frame, which says that ``known`` bytes of its slot were on the disk before."""
    said = _FRAME.pack(len(body), known, crc32(body), 0)[:-4]
    whole = said + _checked(said, generation) + _masked(body) + _END
    return whole + bytes(-len(whole) % _ALIGNED)


def _masked(body: bytes) -> bytes:
    """The body as no sector of it is all zeros, whatever it says; and back."""
    size = len(body)
    mask = _MASK[:size] if size <= len(_MASK) else (_MASK * (size // len(_MASK) + 1))[:size]
    return (int.from_bytes(body) ^ int.from_bytes(mask)).to_bytes(size)


def _checked(said: bytes, generation: int) -> bytes:
    return crc32(said, generation & 0xFFFFFFFF).to_bytes(4, "big")


def _generation(slot: bytes) -> int:
    """The generation of a slot; 0 if it was not begun, or not to the end. Raises DamagedError."""
    said = slot[: _BEGUN.size]
    generation: int = _BEGUN.unpack(said)[0]
    if not generation or said != _begun(generation):
        if _is_torn(slot, 0, _BEGUN.size):
            return 0
        raise DamagedError("a slot does not begin as one")
    return 0 if _frame_at(slot, _BEGUN.size, generation) is None else generation


def _frames(slot: bytes, generation: int) -> tuple[list[bytes], int]:
    """The frames of a slot, and where the last of them ends. Raises DamagedError."""
    bodies, at = [], _BEGUN.size
    while (frame := _frame_at(slot, at, generation)) is not None:
        bodies.append(frame[0])
        at = frame[1]
    if _end(slot) > at:  # as after a loss of power
        for place in range(at + _ALIGNED, len(slot) - _FRAME.size, _ALIGNED):
            said = slot[place : place + _FRAME.size]
            if said[-4:] == _checked(said[:-4], generation) and _FRAME.unpack(said)[1] > at:
                raise DamagedError(f"what stood at byte {at} of its slot is missing")
    return bodies, at


def _frame_at(slot: bytes, at: int, generation: int) -> tuple[bytes, int] | None:
    """The body of the frame at a place, and where it ends; None if it was torn, or is not there.

    Raises DamagedError.
    """
    start = at + _FRAME.size
    said = slot[at:start]
    if len(said) < _FRAME.size:
        return None
    if said[-4:] != _checked(said[:-4], generation):
        if _is_torn(slot, at, start) or _end(slot) <= start:
            return None
        raise DamagedError(f"the record at byte {at} of its slot is damaged")
    size, _, checksum, _ = _FRAME.unpack(said)
    end = start + size + len(_END)
    tail = _END + bytes(-end % _ALIGNED)
    behind = end - len(_END)
    body = _masked(slot[start:behind])
    if crc32(body) == checksum and slot.startswith(tail, behind):
        return body, behind + len(tail)
    if end <= len(slot) and (_is_torn(slot, at, end) or _end(slot) < end):
        return None
    raise DamagedError(f"the record at byte {at} of its slot is damaged")


def _end(slot: bytes) -> int:
    """Where the zeros behind all that was written begin."""
    return len(slot.rstrip(b"\0"))


def _is_torn(slot: bytes, at: int, end: int) -> bool:
    """Return whether one of the sectors from ``at`` to ``end`` cannot have been written."""
    while at < end:
        after = at - at % SECTOR_BYTES + SECTOR_BYTES
        if not any(slot[at:after]):
            return True
        at = after
    return False
