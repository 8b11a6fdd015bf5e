"""Journals: what a robot keeps on disk, so that a crash loses nothing it has told. (R-SAVE)

A journal is a file of records, to which records are only added. Now and then, and after a
snapshot, it is begun anew with a checkpoint, in the other one of its two slots
(:mod:`koord.runtime.deploy.slots`). What a crash has cut short is as if it had not been begun:
nothing was told of it. Any other damage makes the whole journal unusable, for what is missing may
have been told.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import msgspec
from msgspec import Struct

from koord.runtime.deploy.slots import SLOT_BYTES, SlotFile
from koord.runtime.deploy.slots import DamagedError as DamagedError
from koord.runtime.deploy.slots import InUseError as InUseError
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

_DECODER = decoder(list[AnyRecord])


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


class Journal:
    """The journal file of one robot. Adding to it raises OSError.

    Without ``syncs`` it outlasts processes, but no loss of power: enough where all robots are
    processes of one machine, which forgets what they have done with it.
    """

    def __init__(self, path: Path, *, syncs: bool = True, slot_bytes: int = SLOT_BYTES) -> None:
        self.path = path
        self._file = SlotFile(path, syncs=syncs, slot_bytes=slot_bytes)

    @property
    def is_long(self) -> bool:
        """True if it is time for a checkpoint."""
        return self._file.is_long

    @property
    def written(self) -> int:
        """The bytes that the disk was given: in whole blocks, as cards are written, if it syncs."""
        return self._file.written

    def read(self) -> Recollection | None:
        """Read the journal; None if there is none. Raises DamagedError, InUseError, OSError."""
        bodies = self._file.read()
        if bodies is None:
            return None
        try:
            return _recollected(bodies)
        except BaseException:
            self.close()
            raise

    def begin(self, *records: AnyRecord) -> None:
        """Begin the journal anew with these records, which are on the disk then."""
        self._file.begin(encode(records))

    def add(self, *records: AnyRecord, sync: bool = True) -> None:
        """Add records; with ``sync`` they and all before are on the disk then.

        What fails is as if it had not been begun, and may be tried again.
        """
        self._file.add(encode(records), sync=sync)

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
        self._file.close()


def _recollected(bodies: list[bytes]) -> Recollection:
    """What records say. Raises DamagedError."""
    found = None
    for body in bodies:
        try:
            records = _DECODER.decode(body)
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            raise DamagedError(f"it has a record that is none: {error}") from None
        for one in records:
            if found is not None:
                _recollect(found, one)
            elif isinstance(one, Entered):
                found = Recollection(one)
            else:
                raise DamagedError("its first record is not that of a run")
    if found is None:
        raise DamagedError("it has no whole record")
    return found


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
