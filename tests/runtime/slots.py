"""A disk that loses power: what may stand in a file of slots after any moment."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from random import Random

import pytest

from koord.runtime.deploy.slots import SECTOR_BYTES, SlotFile

#: So many of the ways in which sectors may be on the disk are looked at, at each moment.
_WAYS = 12


class File:
    """A file: what is surely on the disk, and of each sector what may be there instead."""

    def __init__(self, base: bytes) -> None:
        self.base = base
        self.now = bytearray(base)
        self.pending: dict[int, list[bytes]] = {}
        self.lost: dict[int, list[bytes]] = {}  #: of a sync that failed: no other brings it there

    def write(self, data: bytes, at: int) -> None:
        end = at + len(data)
        self.now[at:end] = data
        for sector in range(at // SECTOR_BYTES, -(-end // SECTOR_BYTES)):
            self.pending.setdefault(sector, self.lost.pop(sector, [])).append(self._sector(sector))

    def _sector(self, sector: int) -> bytes:
        return bytes(self.now[sector * SECTOR_BYTES : (sector + 1) * SECTOR_BYTES])

    def sync(self, *, fails: bool) -> None:
        if fails:
            self.lost.update(self.pending)
        else:
            base = bytearray(self.base)
            for sector in self.pending:
                base[sector * SECTOR_BYTES : (sector + 1) * SECTOR_BYTES] = self._sector(sector)
            self.base = bytes(base)
        self.pending.clear()

    def images(self, random: Random) -> Iterator[bytes]:
        """What may stand there after a loss of power."""
        unsure = {**self.lost, **self.pending}
        ways = [range(len(versions) + 1) for versions in unsure.values()]
        count = 1
        for way in ways:
            count *= len(way)
        chosen = (
            product(*ways)
            if count <= _WAYS
            else ([random.choice(way) for way in ways] for _ in range(_WAYS))
        )
        for versions in chosen:
            image = bytearray(self.base)
            for (sector, known), version in zip(unsure.items(), versions, strict=True):
                if version:
                    at = sector * SECTOR_BYTES
                    image[at : at + SECTOR_BYTES] = known[version - 1]
            yield bytes(image)


class Disk:
    """The disk below one file of slots, which may fail, and what may be read after a crash.

    ``possible`` is what the file may say: what was told to be there last, and all that was begun
    since. ``looked`` hears of each image with that, at each call that reaches the disk.
    """

    def __init__(self, path: Path, seed: int, looked: Callable[[bytes], None]) -> None:
        self.path = path
        self.random = Random(seed)
        self.failing = 0.0  #: how likely a call is to fail
        self.files: list[File] = []  #: under the name; the older one while the name may be lost
        self._fresh: bytes | None = None
        self._looked = looked
        self._real = {name: getattr(os, name) for name in ("pwrite", "fdatasync", "fsync")}
        self._replace = os.replace

    def patch(self, patch: pytest.MonkeyPatch) -> None:
        patch.setattr(os, "pwrite", self._pwrite)
        patch.setattr(os, "fdatasync", self._fdatasync)
        patch.setattr(os, "fsync", self._fsync)
        patch.setattr(os, "replace", self._named)

    def look(self) -> None:
        """Lose power, in all ways, and go on as if it had not been."""
        for file in self.files:
            for image in file.images(self.random):
                self._looked(image)

    def _fails(self) -> bool:
        return self.random.random() < self.failing

    def _is_ours(self, file: int) -> bool:
        with_name = self.path.exists() and self.path.stat().st_ino
        return os.fstat(file).st_ino == with_name

    def _pwrite(self, file: int, data: bytes, at: int) -> int:
        self.look()
        data = bytes(data)
        if self._fails():
            end = self.random.randrange(at, at + len(data)) // SECTOR_BYTES * SECTOR_BYTES
            data = data[: max(0, end - at)]
            if not data:
                raise OSError(errno.ENOSPC, "No space left on device")
        self._real["pwrite"](file, data, at)
        if self._is_ours(file):
            self.files[-1].write(data, at)
            self.look()
        return len(data)

    def _fdatasync(self, file: int) -> None:
        fails = self._fails()
        self.files[-1].sync(fails=fails)
        self.look()
        if fails:
            raise OSError(errno.EIO, "Input/output error")

    def _fsync(self, file: int) -> None:
        if self._fails():
            raise OSError(errno.EIO, "Input/output error")
        if stat.S_ISDIR(os.fstat(file).st_mode):
            del self.files[:-1]
        else:
            self._fresh = os.pread(file, os.fstat(file).st_size, 0)
        self.look()

    def _named(self, new: Path, path: Path) -> None:
        assert self._fresh == new.read_bytes(), "a file is named that is not on the disk"
        self._replace(new, path)
        self.files.append(File(self._fresh))
        self.look()


class Life:
    """A file of slots in use, and what may be read of it after a crash at any moment."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.disk = Disk(folder / "1.journal", seed, self._judge)
        self.possible: list[list[bytes]] = []
        self.images = 0
        self._crashed = folder / "crashed"
        self._crashed.mkdir()

    def _judge(self, image: bytes) -> None:
        self.images += 1
        path = self._crashed / "1.journal"
        path.write_bytes(image)
        found = SlotFile(path, syncs=False)
        bodies = found.read()
        found.close()
        assert bodies in self.possible

    def live(self, patch: pytest.MonkeyPatch, steps: int, failing: float) -> None:
        """Use the file, from what stands there."""
        disk, random = self.disk, self.disk.random
        file = SlotFile(disk.path, slot_bytes=4096)
        if disk.path.exists():
            disk.files = [File(disk.path.read_bytes())]
        held = file.read()
        assert (held or []) in (self.possible or [[]])
        self.possible = [] if held is None else [held]
        disk.failing = failing
        with patch.context() as patched:
            disk.patch(patched)
            for _ in range(steps):
                body = random.randbytes(random.choice((0, 9, 60, 600, 1500)))
                body = bytes(len(body)) if random.random() < 0.2 else body
                sync = random.random() < 0.6
                fresh = held is None or file.is_long
                then = [body] if fresh else [*(held or []), body]
                self.possible.append(then)
                try:
                    if fresh:
                        file.begin(body)
                    else:
                        file.add(body, sync=sync)
                except OSError:
                    continue
                held = then
                if fresh or sync:
                    self.possible = [then]
                disk.look()
        file.close()

    def crash(self) -> None:
        """Leave one of the ways in which the disk may be."""
        images = [image for file in self.disk.files for image in file.images(self.disk.random)]
        if images:
            self.disk.path.write_bytes(self.disk.random.choice(images))
