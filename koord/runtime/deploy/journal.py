"""Journals: what a robot keeps on disk, so that a crash loses nothing it has told. (R-SAVE)

A journal is a file of records, each with its length and a checksum, to which records are only
added. Now and then, and after a snapshot, it is replaced whole by a checkpoint. The last record
may be cut short, by a crash in mid-write: nothing was told of it. Any other damage makes the whole
journal unusable, for what is missing may have been told.
"""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import msgspec
from msgspec import Struct

from koord.runtime.encoding import decoder, encode
from koord.runtime.proposals import INIT_ROUND, Plain, Proposal
from koord.runtime.protocol.committing import after_entry
from koord.runtime.protocol.messages import (
    FIRST_INCARNATION,
    GENESIS,
    Held,
    LastRun,
    LogEntry,
    Tentative,
    digest,
)
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import Durable

#: The first bytes of a journal: a name and a version.
_NAME = b"koord journal 2\n"

#: A journal that has grown by so many bytes since its last checkpoint gets another.
CHECKPOINT_BYTES = 1 << 20

#: Attributes in the order of the program's locals and ports, each plain.
Attributes = tuple[Plain, ...]


class Record(Struct, frozen=True, array_like=True, tag=True, forbid_unknown_fields=True):
    """A record of a journal: the array of its fields, the name of its class first."""


class Entered(Record, frozen=True):
    """The first record: the robot entered a run. ``nonces`` are the roll, if it was on it."""

    run: bytes
    pid: int
    fingerprint: str
    incarnation: int
    nonces: tuple[bytes, ...] = ()


class Start(Record, frozen=True):
    """The robot's process was started, for so many times. (R-START)"""

    number: int


class Vow(Record, frozen=True):
    """What messages may speak of: incarnation, promise and tentative entry. (R-SAVE)"""

    incarnation: int
    promised: int
    tentative: Tentative | None


class Page(Record, frozen=True):
    """The robot itself before its last proposal.

    It had acted on all rounds before ``round``; ``turns`` environment turns are still to come.
    ``buffers`` are the attributes after each attempt of its last proposal, by event.
    """

    round: int
    status: int
    turns: int
    attributes: Attributes
    position: tuple[float, float, float]
    proposal: Proposal | None
    buffers: tuple[tuple[int | None, Attributes], ...]


class Committed(Record, frozen=True):
    """A committed entry; None: the tentative one of the last vow. (R-COMMIT)"""

    entry: LogEntry | None


class Checkpoint(Record, frozen=True):
    """The agreed state before a round; ``store`` is as in snapshots. (R-SNAPSHOT)

    A robot that is ``mute`` has lost its locals.
    """

    round: int
    chain: bytes
    roster: tuple[int, ...]
    last_ran: tuple[LastRun | None, ...]
    store: bytes
    ended: bool
    mute: bool


AnyRecord = Entered | Start | Vow | Page | Committed | Checkpoint

_DECODER = decoder(AnyRecord)


class Recollection(Struct):
    """What a journal says. ``entries`` were committed after the checkpoint, or after INIT."""

    entered: Entered
    starts: int = 0
    vow: Vow | None = None
    page: Page | None = None
    checkpoint: Checkpoint | None = None
    entries: list[LogEntry] = msgspec.field(default_factory=list)

    @property
    def round(self) -> int:
        """The first round that is not known to be committed."""
        begun = INIT_ROUND if self.checkpoint is None else self.checkpoint.round
        return begun + len(self.entries)

    def durable(self, setup: Setup) -> Durable:
        """The state of the protocol. (R-RESUME)"""
        at, robots = self.checkpoint, setup.robots
        chain = GENESIS if at is None else at.chain
        roster = (FIRST_INCARNATION,) * robots if at is None else at.roster
        last_ran: tuple[LastRun | None, ...] = (None,) * robots if at is None else at.last_ran
        incarnation, promised, tentative = self.entered.incarnation, 0, None
        if self.vow is not None:
            incarnation, promised = self.vow.incarnation, self.vow.promised
        log = []
        for entry in self.entries:
            chain = digest(entry)
            roster, last_ran = after_entry(roster, last_ran, entry)
            log.append(Held(promised, entry, chain))
        if self.vow is not None and self.vow.tentative is not None:
            told = self.vow.tentative
            if told.entry.round == self.round and told.entry.previous == chain:
                tentative = Held(told.epoch, told.entry, digest(told.entry))
        proposal = self.page.proposal if self.page is not None else None
        mine = proposal if proposal is not None and proposal.round == self.round else None
        faulted = any(entry.decision.fault is not None for entry in self.entries[-1:])
        ended = faulted or self.round == setup.rounds or (at is not None and at.ended)
        return Durable(
            incarnation,
            promised,
            self.round,
            chain,
            roster,
            last_ran,
            tentative,
            tuple(log[-setup.kept :]),
            mine,
            ended,
        )


class DamagedError(Exception):
    """Raised for a journal that cannot be used; the message says why."""


class InUseError(Exception):
    """Raised for a journal that another process writes."""


class Journal:
    """The journal file of one robot. Adding to it raises OSError.

    Without ``syncs`` it outlasts processes, but no loss of power: enough where all robots are
    processes of one machine, which forgets what they have done with it.
    """

    def __init__(self, path: Path, *, syncs: bool = True) -> None:
        self.path = path
        self._syncs = syncs
        self._file: int | None = None
        self._size = 0  #: of what is known to be whole
        self._is_torn = False  #: an attempt to add has left something behind it
        self._checkpoint_at = 0

    @property
    def is_long(self) -> bool:
        """True if a checkpoint would make it shorter by much."""
        return self._size - self._checkpoint_at > CHECKPOINT_BYTES

    def read(self) -> Recollection | None:
        """Read the journal; None if there is none. Raises DamagedError, InUseError, OSError."""
        try:
            file = os.open(self.path, os.O_RDWR | os.O_CLOEXEC)
        except FileNotFoundError:
            return None
        try:
            _lock(file, self.path)
            data = _whole(file)
            recollection, size = _recollected(data)
        except BaseException:
            os.close(file)
            raise
        self._file, self._size, self._is_torn = file, size, True
        return recollection

    def begin(self, *records: AnyRecord) -> None:
        """Begin the journal anew with these records, which are on the disk then."""
        data = _NAME + b"".join(map(_encoded, records))
        new = self.path.with_suffix(".new")
        file = os.open(new, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        try:
            _lock(file, self.path)
            _write(file, data, 0)
            if self._syncs:
                os.fsync(file)
            os.replace(new, self.path)
            if self._syncs:
                _sync_folder(self.path.parent)
        except BaseException:
            os.close(file)
            with suppress(OSError):
                new.unlink(missing_ok=True)
            raise
        self.close()
        self._file, self._size, self._checkpoint_at = file, len(data), len(data)

    def add(self, *records: AnyRecord, sync: bool = True) -> None:
        """Add records; with ``sync`` they and all before are on the disk then.

        What fails is as if it had not been begun, and may be tried again.
        """
        assert self._file is not None
        data = b"".join(map(_encoded, records))
        torn, self._is_torn = self._is_torn, True
        if torn:
            os.ftruncate(self._file, self._size)
        _write(self._file, data, self._size)
        if sync and self._syncs:
            os.fdatasync(self._file)
        self._size += len(data)
        self._is_torn = False

    def set_aside(self) -> None:
        """Keep the journal under another name: it is of a run that this robot is not in."""
        self.close()
        with suppress(FileNotFoundError):
            os.replace(self.path, self.path.with_suffix(".old"))

    def forget(self) -> None:
        """Remove the journal: the run is over."""
        self.close()
        with suppress(OSError):
            self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the file. Another process may use it then."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


def _lock(file: int, path: Path) -> None:
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
    """Write all of ``data`` at a place."""
    view = memoryview(data)
    while view:
        done = os.pwrite(file, view, at)
        view, at = view[done:], at + done


def _sync_folder(folder: Path) -> None:
    """Make a new name in a folder outlast a loss of power."""
    file = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(file)
    finally:
        os.close(file)


_LENGTH = 4
_HEAD = 2 * _LENGTH


def _encoded(record: AnyRecord) -> bytes:
    body = encode(record)
    size = len(body).to_bytes(_LENGTH, "big")
    return size + crc32(size + body).to_bytes(_LENGTH, "big") + body


def _recollected(data: bytes) -> tuple[Recollection, int]:
    """Read records; return what they say and where the last whole one ends."""
    if not data.startswith(_NAME):
        raise DamagedError("it does not begin as a journal")
    at, found = len(_NAME), None
    while True:
        record = _record_at(data, at)
        if record is None:
            break
        one, at = record
        if found is None:
            if not isinstance(one, Entered):
                raise DamagedError("its first record is not that of a run")
            found = Recollection(one)
        else:
            _recollect(found, one)
    if found is None:
        raise DamagedError("it has no whole record")
    return found, at


def _record_at(data: bytes, at: int) -> tuple[Any, int] | None:
    """The record at a place, and where it ends; None if it was cut short, or is not there."""
    head = data[at : at + _HEAD]
    if len(head) < _HEAD or (not any(head) and not any(data[at:])):
        return None  # a file may be longer than what was written to it before a loss of power
    size = int.from_bytes(data[at : at + _LENGTH], "big")
    body = data[at + _HEAD : at + _HEAD + size]
    if len(body) < size:
        return None
    if crc32(data[at : at + _LENGTH] + body) != int.from_bytes(
        data[at + _LENGTH : at + _HEAD], "big"
    ):
        raise DamagedError(f"the record at byte {at} is damaged")
    try:
        return _DECODER.decode(body), at + _HEAD + size
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise DamagedError(f"the record at byte {at} is none: {error}") from None


def _recollect(found: Recollection, record: AnyRecord) -> None:
    match record:
        case Start(number=number):
            found.starts = number
        case Vow():
            found.vow = record
        case Page():
            found.page = record
        case Checkpoint():
            found.checkpoint = record
            found.entries.clear()
        case Committed(entry=entry):
            told = found.vow.tentative if found.vow is not None else None
            entry = entry if entry is not None or told is None else told.entry
            if entry is None or entry.round != found.round:
                raise DamagedError("its rounds do not follow one another")
            found.entries.append(entry)
        case Entered():
            raise DamagedError("it is of two runs")
