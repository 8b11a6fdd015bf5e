"""A store in a folder: a file for each key, with a checksum, and a limit for all together.

Several processes may use it at once. A file is written beside its place and moved there, so that
nobody reads half of one; what one process removes, another one finds out anew. Files that are
damaged, or that this store did not write, are never believed: in the place of an entry they are
removed, elsewhere they are left alone.
"""

from __future__ import annotations

import os
import re
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from msgspec import Struct

#: The variable of the environment that names the folder of the user's cache; ``off``: no machine
#: code is kept.
VARIABLE = "KOORD_CACHE"

_OFF = "off"

#: Where the limit is reached, so much of it is left over, so that not each entry costs a look at
#: all of them.
_LEFT = 0.75

_BEGUN = ".begun-"


class FileForm(Struct, frozen=True):
    """What the files of a folder are."""

    what: str  #: as people call one of them: ``verdict``
    magic: bytes  #: the first word of each, with the version of what is behind it
    suffix: str
    limit: int  #: so much is kept in a folder, in bytes, where nothing else is said
    largest: int  #: an entry that is larger is none
    is_run: bool = False  #: then only what nobody but this user may write is believed


class FolderUse(Struct, frozen=True):
    """What is in a folder: the number of entries, and their bytes."""

    entries: int
    size: int


def usual_folder() -> str:
    """The folder of the user's cache: ``KOORD_CACHE``, else where the platform has caches."""
    stated = os.environ.get(VARIABLE, "").strip()
    if stated:
        return os.path.abspath(os.path.expanduser(stated))
    home = Path.home()
    if sys.platform == "win32":
        found = os.environ.get("LOCALAPPDATA", "") or str(home / "AppData" / "Local")
        return os.path.join(found, "koord", "cache")
    if sys.platform == "darwin":
        return str(home / "Library" / "Caches" / "koord")
    found = os.environ.get("XDG_CACHE_HOME", "")
    # By that standard a relative path counts as none.
    return os.path.join(found if os.path.isabs(found) else home / ".cache", "koord")


def is_switched_off() -> bool:
    """Whether nothing is to be kept of what is made without being asked for."""
    return os.environ.get(VARIABLE, "").strip().lower() == _OFF


class _Entry(Struct, frozen=True):
    path: str
    size: int
    used_ns: int


class FolderStore:
    """A store in a folder, which is made when something is put there. Keys are hexadecimal.

    ``note`` is told of entries that are removed because they are damaged, and once if nothing can
    be written.
    """

    def __init__(
        self,
        path: str,
        form: FileForm,
        limit: int | None = None,
        note: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.path, self.limit = path, form.limit if limit is None else limit
        self._form, self._note = form, note
        self._name = re.compile(rf"[0-9a-f]+\.{form.suffix}")
        self._size: int | None = None  #: as far as it is known, once something was put there
        self._is_readonly = False

    def get(self, key: str) -> bytes | None:
        path = self._place(key)
        if not self._is_trusted(path):
            return None
        try:
            data = self._checked(self._read(path), key)
        except FileNotFoundError:
            return None
        except (OSError, ValueError):
            data = None
        if data is None:
            self._remove(path)
            return None
        with suppress(OSError):
            os.utime(path)  # it was used now
        return data

    def has(self, key: str) -> bool:
        """Return whether there is a file for a key; it may turn out that it is damaged."""
        return os.path.exists(self._place(key))

    def put(self, key: str, data: bytes) -> bool:
        if self._is_readonly or len(data) > min(self._form.largest, self.limit):
            return False
        path = self._place(key)
        raw = b" ".join((self._form.magic, _checksum(data, key), data))
        try:
            for folder in (self.path, os.path.dirname(path)):
                os.makedirs(folder, mode=0o700, exist_ok=True)
            if not self._is_trusted(path):
                return False
            _write(path, raw)
        except OSError as error:
            self._is_readonly = True
            self._note(f"{self._form.what}s are not kept in {self.path}: {error.strerror}")
            return False
        self._size = self._used() if self._size is None else self._size + len(raw)
        if self._size > self.limit:
            self._size = self._shrunk(int(_LEFT * self.limit))
        return True

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
        return os.path.join(self.path, key[:2], f"{key[2:]}.{self._form.suffix}")

    def _is_trusted(self, path: str) -> bool:
        """Whether nobody else may have put a file there, where it would be run."""
        if not self._form.is_run:
            return True
        try:
            return all(_is_ours(os.stat(each)) for each in (self.path, os.path.dirname(path)))
        except OSError:
            return False

    def _remove(self, path: str) -> None:
        with suppress(OSError):
            os.unlink(path)
            self._note(f"a kept {self._form.what} is damaged, and was removed: {path}")

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
                if self._name.fullmatch(file.name) or file.name.startswith(_BEGUN):
                    with suppress(OSError):
                        found = file.stat(follow_symlinks=False)
                        if stat.S_ISREG(found.st_mode):
                            yield _Entry(file.path, found.st_size, found.st_mtime_ns)

    def _read(self, path: str) -> bytes:
        """The bytes of an entry. Raises OSError, and ValueError if it is no file of ours."""
        flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        with open(os.open(path, flags | getattr(os, "O_BINARY", 0)), "rb") as file:
            found = os.fstat(file.fileno())
            is_ours = _is_ours(found) if self._form.is_run else _is_owned(found)
            is_small = found.st_size <= self._form.largest + _HEAD_LIMIT
            if not (stat.S_ISREG(found.st_mode) and is_ours and is_small):
                raise ValueError("this is no entry")
            return file.read()

    def _checked(self, raw: bytes, key: str) -> bytes | None:
        """The data of a file; None if it was not written for this key, or changed since."""
        magic, _, rest = raw.partition(b" ")
        checksum, _, data = rest.partition(b" ")
        if magic != self._form.magic or checksum != _checksum(data, key):
            return None
        return data


#: More than what is before the data of a file, in bytes.
_HEAD_LIMIT = 256


def _is_owned(found: os.stat_result) -> bool:
    return not hasattr(os, "geteuid") or found.st_uid == os.geteuid()


def _is_ours(found: os.stat_result) -> bool:
    """Whether a file is this user's, and nobody else may write to it."""
    return _is_owned(found) and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _listed(path: str) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(path) as found:
            return list(found)
    except OSError:
        return []


def _write(path: str, raw: bytes) -> None:
    import tempfile  # by who has something to keep alone

    number, begun = tempfile.mkstemp(prefix=_BEGUN, dir=os.path.dirname(path))
    try:
        with open(number, "wb") as file:
            file.write(raw)
        os.replace(begun, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(begun)
        raise


def _checksum(data: bytes, key: str) -> bytes:
    return sha256(key.encode("ascii") + data).hexdigest().encode("ascii")
