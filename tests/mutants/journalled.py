"""Seeded mistakes in what robots keep on their disks."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

SLOTS = "tests/runtime/test_slots.py"
JOURNAL = "tests/runtime/test_journal.py"

#: What a loss of power, a full disk or a worn one would make of journals.
JOURNALLED = (
    Mutant(
        "a journal's records need not be whole",
        "runtime.deploy.slots._frame_at",
        "_is_torn(slot, at, end) or _end(slot) < end",
        "False",
        (SLOTS,),
    ),
    Mutant(
        "a journal's damage is not seen",
        "runtime.deploy.slots._frame_at",
        "crc32(body) == checksum",
        "checksum >= 0",
        (SLOTS,),
    ),
    Mutant(
        "damage between two records of a journal is not seen",
        "runtime.deploy.slots._frame_at",
        "slot.startswith(tail, behind)",
        "slot.startswith(_END, behind)",
        (SLOTS,),
    ),
    Mutant(
        "what was begun and never told is added to, once it has a name",
        "runtime.deploy.slots.SlotFile._make",
        "self._is_named, self._is_told = not self._syncs, False",
        "self._is_named = not self._syncs",
        (SLOTS,),
    ),
    Mutant(
        "what is damaged was torn",
        "runtime.deploy.slots._is_torn",
        "not any(slot[at:after])",
        "at >= 0",
        (SLOTS,),
    ),
    Mutant(
        "nobody looks behind a hole",
        "runtime.deploy.slots._frames",
        "_FRAME.unpack(said)[1] > at",
        "_FRAME.unpack(said)[1] < 0",
        (SLOTS,),
    ),
    Mutant(
        "whatever stands behind a hole makes it damage",
        "runtime.deploy.slots._frames",
        "_FRAME.unpack(said)[1] > at",
        "_FRAME.unpack(said)[1] >= 0",
        (SLOTS,),
    ),
    Mutant(
        "a write that failed is left in the journal",
        "runtime.deploy.slots.SlotFile._mend",
        "self._torn_end > self._size",
        "self._torn_end < 0",
        (SLOTS,),
    ),
    Mutant(
        "what a sync has lost is not written again",
        "runtime.deploy.slots.SlotFile._mend",
        "self._is_lost and self._unsynced",
        "self._is_lost and not self._file",
        (SLOTS,),
    ),
    Mutant(
        "a slot that could not be begun may be taken for the one that counts",
        "runtime.deploy.slots.SlotFile._mend",
        "self._is_other_begun",
        "self._generation < 0",
        (SLOTS,),
    ),
    Mutant(
        "the slot that counts is blanked before the other one is on the disk",
        "runtime.deploy.slots.SlotFile.begin",
        "self._put(other, 0, data)\nself._sync(self._place(other), len(data))",
        "self._put(other, 0, data)",
        (SLOTS,),
    ),
    Mutant(
        "a slot is begun on what stood there",
        "runtime.deploy.slots.SlotFile._blank_other",
        "self._blank(1 - self._slot, 0, self._other_end)",
        "pass",
        (SLOTS,),
    ),
    Mutant(
        "a file is named before it is on the disk",
        "runtime.deploy.slots.SlotFile._make",
        "os.fsync(file)",
        "pass",
        (SLOTS, JOURNAL),
    ),
    Mutant(
        "a file that has grown may lose its name",
        "runtime.deploy.slots.SlotFile._name",
        "not self._is_named",
        "self._generation < 0",
        (SLOTS, JOURNAL),
    ),
    Mutant(
        "a journal is not on the disk",
        "runtime.deploy.slots.SlotFile._sync",
        "os.fdatasync(self._open)",
        "pass",
        (SLOTS, JOURNAL),
    ),
)
