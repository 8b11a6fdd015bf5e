"""Stores: a folder of files that several processes use, and memory."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from koord.stores.folder import FileForm, FolderStore
from koord.stores.store import LayeredStore, MemoryStore
from koord.verify.cache.forms import digest

FORM = FileForm("verdict", b"koord-verdict-1", "json", 64 * 2**20, 4 * 2**20)

KEY, OTHER = digest("key"), digest("other")


def entry(folder: Path) -> Path:
    (found,) = folder.rglob("*.json")
    return found


def test_what_was_put_into_a_folder_is_found_by_others(tmp_path: Path) -> None:
    folder = tmp_path / "made" / "here"
    FolderStore(str(folder), FORM).put(KEY, b"data")
    assert FolderStore(str(folder), FORM).get(KEY) == b"data"
    assert FolderStore(str(folder), FORM).get(OTHER) is None
    assert stat.S_IMODE((folder / KEY[:2]).stat().st_mode) == 0o700


def changed(raw: bytes) -> bytes:
    return raw[:-1] + b"X"


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "a byte": changed,
    "cut": lambda raw: raw[: len(raw) // 2],
    "empty": lambda raw: b"",
    "more": lambda raw: raw + b" ",
    "another version": lambda raw: raw.replace(b"verdict-1", b"verdict-0"),
    "something else": lambda raw: b'{"alike": []}',
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_entry_is_removed_and_told_of(
    tmp_path: Path, damage: Callable[[bytes], bytes]
) -> None:
    notes: list[str] = []
    folder = FolderStore(str(tmp_path), FORM, note=notes.append)
    folder.put(KEY, b"data")
    path = entry(tmp_path)
    path.write_bytes(damage(path.read_bytes()))
    assert folder.get(KEY) is None
    assert not path.exists()
    assert notes == [f"a kept verdict is damaged, and was removed: {path}"]


def test_an_entry_in_the_place_of_another_is_none(tmp_path: Path) -> None:
    folder = FolderStore(str(tmp_path), FORM)
    folder.put(KEY, b"data")
    folder.put(OTHER, b"other")
    place = tmp_path / OTHER[:2] / f"{OTHER[2:]}.json"
    place.write_bytes((tmp_path / KEY[:2] / f"{KEY[2:]}.json").read_bytes())
    assert folder.get(OTHER) is None
    assert folder.get(KEY) == b"data"


def test_a_link_in_the_place_of_an_entry_is_not_followed(tmp_path: Path) -> None:
    folder = FolderStore(str(tmp_path / "cache"), FORM)
    folder.put(KEY, b"data")
    path = entry(tmp_path / "cache")
    target = tmp_path / "elsewhere"
    path.rename(target)
    path.symlink_to(target)
    assert folder.get(KEY) is None
    assert target.exists()
    assert not path.is_symlink()


def test_what_was_not_used_for_longest_is_left_out(tmp_path: Path) -> None:
    folder = FolderStore(str(tmp_path), FORM, limit=4_000)
    keys = [digest(str(number)) for number in range(6)]
    for number, key in enumerate(keys):
        folder.put(key, bytes(800))
        place = tmp_path / key[:2] / f"{key[2:]}.json"
        if place.exists():
            os.utime(place, ns=(number, number))
        if number == 3:
            assert folder.get(keys[0]) is not None  # used last of all
    there = [key for key in keys if FolderStore(str(tmp_path), FORM).get(key) is not None]
    assert keys[0] in there
    assert keys[1] not in there
    assert folder.use().size <= 4_000


def test_an_entry_beyond_the_limit_is_not_kept(tmp_path: Path) -> None:
    folder = FolderStore(str(tmp_path), FORM, limit=100)
    folder.put(KEY, bytes(200))
    assert folder.use().entries == 0


def test_clearing_leaves_other_files_alone(tmp_path: Path) -> None:
    folder = FolderStore(str(tmp_path), FORM)
    folder.put(KEY, b"data")
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / KEY[:2] / "notes.json").write_text("mine")
    (tmp_path / KEY[:2] / ".begun-abc").write_text("half of an entry")
    assert folder.clear().entries == 2
    assert folder.use().entries == 0
    left = sorted(path.name for path in tmp_path.rglob("*") if path.is_file())
    assert left == ["notes.json", "notes.txt"]


def test_a_folder_that_cannot_be_written_costs_a_note(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    notes: list[str] = []
    folder = FolderStore(str(tmp_path / "file"), FORM, note=notes.append)
    folder.put(KEY, b"data")
    folder.put(OTHER, b"data")
    assert folder.get(KEY) is None
    assert len(notes) == 1
    assert "verdicts are not kept" in notes[0]


def test_many_at_once_read_whole_entries_or_none(tmp_path: Path) -> None:
    texts = {bytes([65 + k]) * (500 + k) for k in range(8)}

    def work(data: bytes) -> bool:
        folder = FolderStore(str(tmp_path), FORM, limit=20_000)
        for _ in range(30):
            folder.put(KEY, data)
            if (found := folder.get(KEY)) is not None and found not in texts:
                return False
        return True

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(work, texts))
    assert FolderStore(str(tmp_path), FORM).get(KEY) in texts


def test_memory_keeps_what_was_used_last() -> None:
    memory = MemoryStore(limit=10)
    memory.put("a", b"1234")
    memory.put("b", b"1234")
    assert memory.get("a") == b"1234"
    memory.put("c", b"1234")
    assert memory.get("b") is None
    assert memory.get("a") == b"1234"
    memory.put("a", b"12")
    memory.put("d", b"1234")
    assert [key for key in "abcd" if memory.get(key)] == ["a", "c", "d"]


def test_memory_before_a_folder_is_filled_from_it(tmp_path: Path) -> None:
    FolderStore(str(tmp_path), FORM).put(KEY, b"data")
    layered = LayeredStore(MemoryStore(), FolderStore(str(tmp_path), FORM))
    assert layered.get(KEY) == b"data"
    entry(tmp_path).unlink()
    assert layered.get(KEY) == b"data"
    layered.drop(KEY)
    assert layered.get(KEY) is None
