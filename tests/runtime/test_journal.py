"""Journals: records on disk, cut short by crashes, and damaged."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from random import Random

import pytest

from koord.runtime.deploy.journal import (
    AnyRecord,
    Checkpoint,
    Committed,
    DamagedError,
    Entered,
    InUseError,
    Journal,
    Page,
    Recollection,
    Start,
    Vow,
)
from koord.runtime.exploration.world import proposal_of
from koord.runtime.proposals import Attempt, Decision, Proposal, Write
from koord.runtime.protocol.messages import GENESIS, Admission, LogEntry, Tentative, digest
from koord.runtime.protocol.setup import Setup, Timing, decided
from tests.sampling import first

ROBOTS = 3
SETUP = Setup(ROBOTS, Timing.zero())
ENTERED = Entered(bytes(16), 1, "program", 0, (b"a" * 16, b"b" * 16))


def entries(many: int) -> list[LogEntry]:
    """Rounds as they are committed, one on the other."""
    made: list[LogEntry] = []
    for round_ in range(-1, many - 1):
        decision: Decision = decided(round_, [proposal_of(i, round_) for i in range(ROBOTS)])
        made.append(LogEntry(decision, digest(made[-1]) if made else GENESIS))
    return made


def page(round_: int) -> Page:
    proposal = Proposal(1, round_, (Attempt(1, (Write(0, (1,), (2**70, "x", None)),), (0,)),), True)
    attributes = (1, 2.5, (True, None), "text", -(2**80))
    return Page(round_, 0, 1, attributes, (1.0, 2.0, 3.0), proposal, ((1, attributes),))


def page_of(size: int) -> Page:
    return Page(0, 0, 0, ("x" * size,), (0.0, 0.0, 0.0), None, ())


def reread(journal: Journal) -> Recollection:
    journal.close()
    again = Journal(journal.path)
    kept = again.read()
    again.close()
    assert kept is not None
    return kept


def begun(folder: Path, *records: AnyRecord) -> Journal:
    journal = Journal(folder / "1.journal")
    assert journal.read() is None
    journal.begin(ENTERED, Start(1), *records)
    return journal


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """(R-SAVE)"""
    init, zeroth = entries(2)
    vow = Vow(0, 4, Tentative(4, zeroth))
    journal = begun(tmp_path, page(0), Vow(0, 3, Tentative(3, init)), Committed(None), vow)
    kept = reread(journal)
    assert (kept.entered, kept.starts, kept.vow, kept.page) == (ENTERED, 1, vow, page(0))
    assert kept.entries == [init]
    state = kept.durable(SETUP)
    assert (state.round, state.chain, state.promised) == (0, digest(init), 4)
    assert state.tentative is not None
    assert (state.tentative.entry, state.tentative.epoch) == (zeroth, 4)
    assert state.mine == page(0).proposal
    assert [held.entry for held in state.log] == [init]


@pytest.mark.skipif(os.name != "posix", reason="permissions are those of POSIX")
def test_a_journal_is_its_owner_s_alone(tmp_path: Path) -> None:
    begun(tmp_path).close()
    (path,) = [one for one in tmp_path.iterdir() if one.is_file()]
    assert path.stat().st_mode & 0o777 == 0o600


def test_entries_that_were_not_held_before_are_written_whole(tmp_path: Path) -> None:
    made = entries(4)
    kept = reread(begun(tmp_path, *map(Committed, made)))
    assert kept.entries == made
    assert kept.durable(SETUP).round == 3
    assert kept.durable(SETUP).mine is None


def test_a_tentative_entry_that_was_committed_since_is_none(tmp_path: Path) -> None:
    init, zeroth = entries(2)
    vow = Vow(0, 3, Tentative(3, init))
    state = reread(begun(tmp_path, vow, Committed(None), Committed(zeroth))).durable(SETUP)
    assert (state.tentative, state.round) == (None, 1)


def test_a_checkpoint_stands_for_all_before_it(tmp_path: Path) -> None:
    """(R-SNAPSHOT)"""
    made = entries(7)
    roster = (0, 5, 0)
    at = Checkpoint(4, digest(made[4]), roster, (None,) * 3, b"store", False, False)
    kept = reread(begun(tmp_path, *map(Committed, made[:2]), at, Committed(made[5])))
    assert (kept.checkpoint, kept.entries) == (at, [made[5]])
    state = kept.durable(SETUP)
    assert (state.round, state.chain, state.roster) == (5, digest(made[5]), roster)


def test_admissions_and_the_end_are_worked_out(tmp_path: Path) -> None:
    (init,) = entries(1)
    admitting = LogEntry(init.decision, init.previous, (Admission(2, 9),))
    kept = reread(begun(tmp_path, Committed(admitting)))
    assert kept.durable(SETUP).roster == (0, 0, 9)
    assert not kept.durable(SETUP).ended
    assert kept.durable(Setup(ROBOTS, Timing.zero(), rounds=0)).ended


def test_rounds_that_do_not_follow_one_another_are_damage(tmp_path: Path) -> None:
    made = entries(3)
    journal = begun(tmp_path, Committed(made[0]), Committed(made[2]))
    with pytest.raises(DamagedError, match="follow"):
        reread(journal)


# --- crashes --------------------------------------------------------------------------------------


def test_what_was_cut_short_is_written_over(tmp_path: Path) -> None:
    """What is whole counts: nothing was told of the rest (``test_slots.py``)."""
    journal = begun(tmp_path)
    made = entries(3)
    journal.add(Committed(made[0]))
    before = journal.path.read_bytes()
    journal.add(Committed(made[1]))
    end = len(before.rstrip(b"\0"))
    journal.path.write_bytes(journal.path.read_bytes()[: end + 20].ljust(len(before), b"\0"))
    journal.close()
    again = Journal(journal.path)
    assert again.read() is not None
    again.add(Start(2))
    kept = reread(again)
    assert (kept.starts, len(kept.entries)) == (2, 1)


@pytest.mark.parametrize("seed", first(8, range(300)))
def test_no_bit_may_flip(tmp_path: Path, seed: int) -> None:
    random = Random(seed)
    made = entries(3)
    journal = begun(tmp_path, *map(Committed, made), page(2))
    data = bytearray(journal.path.read_bytes())
    journal.close()
    at = random.randrange(len(data.rstrip(b"\0")))
    data[at] ^= 1 << random.randrange(8)
    journal.path.write_bytes(data)
    try:
        kept = Journal(journal.path).read()
    except DamagedError:
        return
    assert kept is not None
    assert (kept.entered, kept.entries, kept.page) == (ENTERED, made, page(2))


@pytest.mark.parametrize(
    "damage", [b"", b"\x93", b"koord journal 2\n", b"koord journal 3\n", bytes(100)]
)
def test_what_is_no_journal_is_damage(tmp_path: Path, damage: bytes) -> None:
    journal = Journal(tmp_path / "0.journal")
    journal.path.write_bytes(damage)
    with pytest.raises(DamagedError):
        journal.read()


# --- disks that are full --------------------------------------------------------------------------


def test_what_does_not_fit_is_written_when_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A write that fails in the middle is as if it had not been begun. (R-SAVE)"""
    journal = begun(tmp_path)
    made = entries(2)
    journal.add(Committed(made[0]))
    real = os.pwrite

    def half(file: int, data: bytes, at: int) -> int:
        if len(data) > 4:
            return real(file, data[:4], at)
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", half)
        with pytest.raises(OSError, match="space"):
            journal.add(Committed(made[1]))
    journal.add(Committed(made[1]))
    assert reread(journal).entries == made


def test_a_checkpoint_that_does_not_fit_leaves_the_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = begun(tmp_path, Committed(entries(1)[0]))

    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fdatasync", full)
        with pytest.raises(OSError, match="space"):
            journal.begin(ENTERED, Start(1))
    journal.add(Start(2))
    kept = reread(journal)
    assert (kept.starts, len(kept.entries)) == (2, 1)
    again = Journal(journal.path)
    assert again.read() is not None
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="space"):
            again.begin(ENTERED, Start(1), page_of(1 << 20))
    assert len(reread(again).entries) == 1
    assert [one.name for one in tmp_path.iterdir()] == ["1.journal"]


def test_what_is_told_is_on_the_disk_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """(R-SAVE)"""
    synced: list[str] = []
    for name in ("fsync", "fdatasync"):
        monkeypatch.setattr(os, name, lambda file, name=name: synced.append(name))
    journal = begun(tmp_path)
    assert synced == ["fsync", "fsync"]  # the file, and the folder that names it
    journal.add(Start(2))
    assert synced[2:] == ["fdatasync"]
    journal.add(Committed(entries(1)[0]), sync=False)
    assert len(synced) == 3


def test_processes_of_one_machine_need_no_sync(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who kills one of them leaves what it has written; a loss of power ends what they did too."""
    journal = Journal(tmp_path / "1.journal", syncs=False)
    with monkeypatch.context() as patch:
        for name in ("fsync", "fdatasync"):
            patch.setattr(os, name, lambda file: pytest.fail("is synced"))
        for start in range(1, 4):
            journal.begin(ENTERED, Start(start))
            journal.add(Start(start + 1))
    assert reread(journal).starts == 4


# --- one process a journal ------------------------------------------------------------------------


def test_two_processes_do_not_write_one_journal(tmp_path: Path) -> None:
    """(R-NAME)"""
    journal = begun(tmp_path)
    with pytest.raises(InUseError):
        Journal(journal.path).read()
    journal.close()
    assert Journal(journal.path).read() is not None


def test_a_journal_that_is_set_aside_can_be_taken_up_by_hand(tmp_path: Path) -> None:
    """(R-LATE)"""
    journal = begun(tmp_path, Committed(entries(1)[0]))
    journal.set_aside()
    assert Journal(journal.path).read() is None
    aside = Journal(journal.path.with_suffix(".old")).read()
    assert aside is not None
    assert len(aside.entries) == 1
    begun(tmp_path).forget()
    assert [one.name for one in tmp_path.iterdir()] == ["1.old"]
