"""The folder of the user's cache, and the machine code that is kept in it.

A file is written beside its place and moved there, has a checksum, and is believed only if it and
the folder are this user's and nobody else may write to them: what is loaded from there runs.
"""

from __future__ import annotations

import os
import re
import stat
import sys
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from msgspec import Struct

#: The variable of the environment that names the folder; ``off``: no machine code is kept.
VARIABLE = "KOORD_CACHE"

_OFF = "off"

#: So much machine code is kept, in bytes; where there is more, so much of it is left over.
_MOST, _LEFT = 64 * 2**20, 0.75

#: The first bytes of each file, with the version of what is behind them.
_MAGIC = b"koord-machine-1 "

_NAME = re.compile(r"[0-9a-f]{64}\.code")
_BEGUN = ".begun-"


class MachineFiles(Struct, frozen=True):
    """How much machine code there is in a folder: the number of files, and their bytes."""

    files: int
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


def machine_folder() -> MachineFolder | None:
    """The folder with kept machine code; None if none is kept."""
    if os.environ.get(VARIABLE, "").strip().lower() == _OFF or not hasattr(os, "memfd_create"):
        return None
    try:
        return MachineFolder(os.path.join(usual_folder(), "machine"))
    except RuntimeError:  # nobody's home
        return None


class MachineFolder:
    """Machine code in a folder, by keys of 64 hexadecimal digits."""

    def __init__(self, path: str) -> None:
        self.path = path

    def get(self, key: str) -> bytes | None:
        """What is kept under a key, if it can be believed."""
        if not self._is_ours():
            return None
        path = self._place(key)
        try:
            raw = _read(path)
        except (OSError, ValueError):
            return None
        data = _checked(raw, key)
        with suppress(OSError):
            if data is None:
                os.unlink(path)
            else:
                os.utime(path)  # it was used now
        return data

    def has(self, key: str) -> bool:
        """Return whether there is a file for a key."""
        return os.path.exists(self._place(key))

    def put(self, key: str, data: bytes) -> bool:
        """Keep data under a key; return whether that can be."""
        try:
            os.makedirs(self.path, mode=0o700, exist_ok=True)
            if not self._is_ours():
                return False
            import tempfile

            number, begun = tempfile.mkstemp(prefix=_BEGUN, dir=self.path)
            try:
                with open(number, "wb") as file:
                    file.write(_MAGIC + _checksum(data, key) + data)
                os.replace(begun, self._place(key))
            except BaseException:
                with suppress(OSError):
                    os.unlink(begun)
                raise
        except OSError:
            return False
        self._shrink()
        return True

    def use(self) -> MachineFiles:
        """How much is in it."""
        sizes = [found.st_size for _, found in self._files()]
        return MachineFiles(len(sizes), sum(sizes))

    def clear(self) -> MachineFiles:
        """Remove all machine code; tell how much there was. Other files stay."""
        used = self.use()
        for path, _ in list(self._files()):
            with suppress(OSError):
                os.unlink(path)
        with suppress(OSError):
            os.rmdir(self.path)
        return used

    def _place(self, key: str) -> str:
        return os.path.join(self.path, f"{key}.code")

    def _is_ours(self) -> bool:
        try:
            return _is_ours(os.stat(self.path))
        except OSError:
            return False

    def _shrink(self) -> None:
        files = sorted(self._files(), key=lambda file: file[1].st_mtime_ns)
        size = sum(found.st_size for _, found in files)
        if size <= _MOST:
            return
        for path, found in files:
            if size <= _LEFT * _MOST:
                break
            with suppress(OSError):
                os.unlink(path)
            size -= found.st_size

    def _files(self) -> Iterator[tuple[str, os.stat_result]]:
        """All files of machine code, and those that were begun and never moved to their place."""
        try:
            with os.scandir(self.path) as listed:
                found = [f for f in listed if _NAME.fullmatch(f.name) or f.name.startswith(_BEGUN)]
        except OSError:
            return
        for file in found:
            with suppress(OSError):
                told = file.stat(follow_symlinks=False)
                if stat.S_ISREG(told.st_mode):
                    yield file.path, told


def _is_ours(found: os.stat_result) -> bool:
    """Whether a file is this user's, and nobody else may write to it."""
    return found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _read(path: str) -> bytes:
    """The bytes of a file. Raises OSError, and ValueError if it is no file of ours."""
    with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
        found = os.fstat(file.fileno())
        if not (stat.S_ISREG(found.st_mode) and _is_ours(found) and found.st_size <= _MOST):
            raise ValueError("this is no machine code of ours")
        return file.read()


def _checksum(data: bytes, key: str) -> bytes:
    return sha256(key.encode("ascii") + data).digest()


def _checked(raw: bytes, key: str) -> bytes | None:
    """The data of a file; None if it was not written for this key, or changed since."""
    begin = len(_MAGIC) + 32
    data = raw[begin:]
    return data if raw[:begin] == _MAGIC + _checksum(data, key) else None
