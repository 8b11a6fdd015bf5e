"""A storage in a folder: a file for each key, with a checksum, and a limit for all together.

Several processes may use it at once. A file is written beside its place and moved there, so that
nobody reads half of one; what one process removes, another one finds out anew. Files that are
damaged, or that this storage did not write, are never believed: in the place of an entry they are
removed, elsewhere they are left alone.
"""

from __future__ import annotations

import os
import re
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from msgspec import Struct

#: So much is kept in a folder, in bytes, where nothing else is said.
FOLDER_LIMIT = 64 * 2**20

#: Where the limit is reached, so much of it is left over, so that not each entry costs a look at
#: all of them.
_LEFT = 0.75

#: An entry that is larger is none.
_LARGEST = 4 * 2**20

#: The first word of each file, with the version of what is behind it.
_MAGIC = b"koord-verdict-1"

_NAME = re.compile(r"[0-9a-f]{62}\.json")
_BEGUN = ".begun-"


class FolderUse(Struct, frozen=True):
    """What is in a folder: the number of entries, and their bytes."""

    entries: int
    size: int


class _Entry(Struct, frozen=True):
    path: str
    size: int
    used_ns: int


class Folder:
    """A storage in a folder, which is made when something is put there.

    ``note`` is told of entries that are removed because they are damaged, and once if nothing can
    be written.
    """

    def __init__(
        self,
        path: str,
        limit: int = FOLDER_LIMIT,
        note: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.path, self.limit, self._note = path, limit, note
        self._size: int | None = None  #: as far as it is known, once something was put there
        self._is_readonly = False

    def get(self, key: str) -> bytes | None:
        path = self._place(key)
        try:
            raw = _read(path)
        except FileNotFoundError:
            return None
        except (OSError, ValueError):
            self._remove(path)
            return None
        data = _checked(raw, key)
        if data is None:
            self._remove(path)
            return None
        with suppress(OSError):
            os.utime(path)  # it was used now
        return data

    def put(self, key: str, data: bytes) -> None:
        if self._is_readonly or len(data) > min(_LARGEST, self.limit):
            return
        path = self._place(key)
        raw = b" ".join((_MAGIC, _checksum(data, key), data))
        try:
            os.makedirs(os.path.dirname(path), mode=0o700, exist_ok=True)
            _write(path, raw)
        except OSError as error:
            self._is_readonly = True
            self._note(f"verdicts are not kept in {self.path}: {error.strerror}")
            return
        self._size = self._used() if self._size is None else self._size + len(raw)
        if self._size > self.limit:
            self._size = self._shrunk(int(_LEFT * self.limit))

    def drop(self, key: str) -> None:
        self._remove(self._place(key))

    def use(self) -> FolderUse:
        """How much is in it."""
        entries = list(self._entries())
        return FolderUse(len(entries), sum(entry.size for entry in entries))

    def clear(self) -> FolderUse:
        """Remove all entries; tell how much there was. Other files stay."""
        entries = list(self._entries())
        for entry in entries:
            with suppress(OSError):
                os.unlink(entry.path)
        with suppress(OSError):
            for name in os.listdir(self.path):
                with suppress(OSError):
                    os.rmdir(os.path.join(self.path, name))
            os.rmdir(self.path)
        self._size = None
        return FolderUse(len(entries), sum(entry.size for entry in entries))

    def _place(self, key: str) -> str:
        return os.path.join(self.path, key[:2], f"{key[2:]}.json")

    def _remove(self, path: str) -> None:
        with suppress(OSError):
            os.unlink(path)
            self._note(f"a kept verdict is damaged, and was removed: {path}")

    def _used(self) -> int:
        return sum(entry.size for entry in self._entries())

    def _shrunk(self, limit: int) -> int:
        """Remove the entries that were not used for longest, down to a limit; what is left."""
        entries = sorted(self._entries(), key=lambda entry: entry.used_ns)
        size = sum(entry.size for entry in entries)
        for entry in entries:
            if size <= limit:
                break
            with suppress(OSError):  # another process has removed it
                os.unlink(entry.path)
            size -= entry.size
        return size

    def _entries(self) -> Iterator[_Entry]:
        """All entries, and what was begun and never moved to its place."""
        for part in _listed(self.path):
            if len(part.name) != 2 or not part.is_dir(follow_symlinks=False):
                continue
            for file in _listed(part.path):
                if _NAME.fullmatch(file.name) or file.name.startswith(_BEGUN):
                    with suppress(OSError):
                        found = file.stat(follow_symlinks=False)
                        if stat.S_ISREG(found.st_mode):
                            yield _Entry(file.path, found.st_size, found.st_mtime_ns)


def _listed(path: str) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(path) as found:
            return list(found)
    except OSError:
        return []


def _read(path: str) -> bytes:
    """The bytes of an entry. Raises OSError, and ValueError if it is no file of ours."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    with open(os.open(path, flags | getattr(os, "O_BINARY", 0)), "rb") as file:
        found = os.fstat(file.fileno())
        is_ours = not hasattr(os, "getuid") or found.st_uid == os.getuid()
        if not (stat.S_ISREG(found.st_mode) and is_ours and found.st_size <= 2 * _LARGEST):
            raise ValueError("this is no entry")
        return file.read()


def _write(path: str, raw: bytes) -> None:
    folder = os.path.dirname(path)
    number, begun = tempfile.mkstemp(prefix=_BEGUN, dir=folder)
    try:
        with open(number, "wb") as file:
            file.write(raw)
        os.replace(begun, path)
    except BaseException:
        with suppress(OSError):
            Path(begun).unlink()
        raise


def _checksum(data: bytes, key: str) -> bytes:
    return sha256(key.encode("ascii") + data).hexdigest().encode("ascii")


def _checked(raw: bytes, key: str) -> bytes | None:
    """The data of a file; None if it was not written for this key, or changed since."""
    magic, _, rest = raw.partition(b" ")
    checksum, _, data = rest.partition(b" ")
    if magic != _MAGIC or checksum != _checksum(data, key):
        return None
    return data
