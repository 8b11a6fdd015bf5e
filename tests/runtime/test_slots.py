"""Files of two slots: any sector may be missing after a loss of power, and no bit may flip."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from random import Random
from typing import Any

import pytest

from koord.runtime.deploy.slots import BLOCK_BYTES, SECTOR_BYTES, DamagedError, SlotFile
from tests.runtime.slots import Life
from tests.sampling import first


@pytest.mark.parametrize("failing", [0.0, 0.05])
@pytest.mark.parametrize("seed", first(2, range(200)))
def test_whenever_power_is_lost_what_was_told_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int, failing: float
) -> None:
    """(R-SAVE) Torn and reordered writes, full disks, syncs that fail; and the same once more."""
    life = Life(tmp_path, seed)
    for _ in range(3):
        life.live(monkeypatch, steps=25, failing=failing)
        life.crash()
    assert life.images > 500


def written(path: Path) -> list[bytes]:
    """Write some frames, all of them synced; return them."""
    file = SlotFile(path, slot_bytes=BLOCK_BYTES)
    bodies = [b"begun", b"one", bytes(700), b"two" * 99, b"the last"]
    file.begin(bodies[0])
    for body in bodies[1:]:
        file.add(body)
    file.close()
    return bodies


@pytest.mark.parametrize("seed", first(60, range(4000)))
def test_no_bit_may_flip(tmp_path: Path, seed: int) -> None:
    """(R-SAVE) Not even one that nobody reads, between two records."""
    path, random = tmp_path / "1.journal", Random(seed)
    written(path)
    data = bytearray(path.read_bytes())
    end = BLOCK_BYTES + len(bytes(data[BLOCK_BYTES : 2 * BLOCK_BYTES]).rstrip(b"\0"))
    at = random.choice([*range(32), *range(BLOCK_BYTES, end)])
    data[at] ^= 1 << random.randrange(8)
    path.write_bytes(data)
    with pytest.raises(DamagedError):
        SlotFile(path).read()


def test_a_hole_before_what_knows_of_it_is_damage(tmp_path: Path) -> None:
    """A disk that has lost what it said was there: nobody may forget what he has told."""
    path = tmp_path / "1.journal"
    written(path)
    data = path.read_bytes()
    hole = BLOCK_BYTES + SECTOR_BYTES  # in the midst of the third frame
    path.write_bytes(data[:hole] + bytes(SECTOR_BYTES) + data[hole + SECTOR_BYTES :])
    with pytest.raises(DamagedError, match="is missing"):
        SlotFile(path).read()


@pytest.mark.parametrize("call", ["fdatasync", "pwrite"])
def test_a_slot_that_could_not_be_begun_counts_for_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """It may stand on the disk all the same, and what was told since does not."""
    file = SlotFile(tmp_path / "1.journal", slot_bytes=BLOCK_BYTES)
    file.begin(b"begun")
    real = getattr(os, call)

    def failing(number: int, *arguments: Any) -> None:
        real(number, *arguments)
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(os, call, failing)
        with pytest.raises(OSError, match="Input"):
            file.begin(b"never begun")
    file.add(b"told")
    file.close()
    again = SlotFile(tmp_path / "1.journal")
    assert again.read() == [b"begun", b"told"]
    again.begin(b"begun")
    again.close()
    assert SlotFile(tmp_path / "1.journal").read() == [b"begun"]


def test_the_folder_names_the_file_before_anything_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = SlotFile(tmp_path / "1.journal", slot_bytes=BLOCK_BYTES)
    file.begin(b"begun")
    real, folders = os.fsync, list[bool]()

    def failing(number: int) -> None:
        if stat.S_ISDIR(os.fstat(number).st_mode):
            folders.append(len(folders) > 0)
            if not folders[-1]:
                raise OSError(errno.EIO, "Input/output error")
        real(number)

    monkeypatch.setattr(os, "fsync", failing)
    with pytest.raises(OSError, match="Input"):
        file.add(os.urandom(6000))
    with pytest.raises(OSError, match="Input"):  # whether it stands there nobody knows
        file.add(b"told")
    assert file.is_long
    file.begin(b"begun")
    assert folders == [False, True]
    file.add(b"told")
    assert len(folders) == 2
    file.close()
    assert SlotFile(tmp_path / "1.journal").read() == [b"begun", b"told"]


def test_what_was_never_told_to_be_there_is_begun_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new file was not named, then it was, and what was to stand in its place could not be."""
    path = tmp_path / "1.journal"
    file = SlotFile(path, slot_bytes=BLOCK_BYTES)
    file.begin(b"begun")
    file.add(b"told")

    def failing(number: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patch:
        real = os.fsync
        folder = os.stat(tmp_path).st_ino
        patch.setattr(
            os, "fsync", lambda n: failing(n) if os.fstat(n).st_ino == folder else real(n)
        )
        with pytest.raises(OSError, match="Input"):
            file.begin(bytes(2000))  # too long for the file that there is
    with monkeypatch.context() as patch:
        patch.setattr(os, "fdatasync", failing)
        with pytest.raises(OSError, match="Input"):
            file.begin(b"begun again")
    assert file.is_long
    with pytest.raises(OSError, match="Input"):  # it would follow what nobody was told of
        file.add(b"told")
    file.begin(b"begun again")
    file.add(b"told")
    file.close()
    assert SlotFile(path).read() == [b"begun again", b"told"]


def test_what_is_written_stays_within_the_file(tmp_path: Path) -> None:
    """No sync has to write where the file is: its size and its blocks stay the same."""
    path = tmp_path / "1.journal"
    file = SlotFile(path, slot_bytes=1 << 14)
    file.begin(b"begun")
    before = (path.stat().st_size, path.stat().st_blocks, path.stat().st_ino)
    for k in range(200):
        if file.is_long:
            file.begin(b"begun")
        file.add(b"%d" % k * 100)
    assert (path.stat().st_size, path.stat().st_blocks, path.stat().st_ino) == before
    file.close()


def test_what_has_no_room_makes_the_slots_longer(tmp_path: Path) -> None:
    file = SlotFile(tmp_path / "1.journal", slot_bytes=BLOCK_BYTES)
    file.begin(b"begun")
    bodies = [os.urandom(size) for size in (3000, 3000, 20_000)]
    for body in bodies:
        file.add(body)
    file.begin(long := os.urandom(50_000))
    file.add(b"after")
    file.close()
    assert SlotFile(tmp_path / "1.journal").read() == [long, b"after"]


def test_what_the_disk_is_given_is_counted_in_blocks(tmp_path: Path) -> None:
    """Cards wear by whole blocks."""
    file = SlotFile(tmp_path / "1.journal")
    file.begin(b"begun")
    before = file.written
    file.add(b"a vow")
    assert file.written - before == BLOCK_BYTES
    file.add(b"a commit", sync=False)
    assert file.written - before == BLOCK_BYTES
    file.add(b"a vow")
    assert file.written - before == 2 * BLOCK_BYTES
    local = SlotFile(tmp_path / "2.journal", syncs=False)
    local.begin(b"begun")
    before = local.written
    local.add(b"a vow")
    assert local.written - before == 32
