"""Where the robots of this machine are found: a file of each process of `koord deploy`. (O-HERE)

It has the order key, and so its user alone can read it.
"""

from __future__ import annotations

import os
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
from msgspec import Struct

from koord.runtime.orders.lines import Reach

#: Files of processes that were killed are removed if they are older than this.
_OLD_S = 60.0

#: Raised when the form of these files changes: others are not read.
_VERSION = 1


class Access(Struct, frozen=True):
    """All that is needed to tell robots something."""

    key: bytes
    encrypts: bool
    reach: Reach
    is_whole: bool = False  #: these are all robots of their configuration


class Running(Struct, frozen=True):
    """What a process of `koord deploy` leaves of the robots that it runs."""

    version: int
    configuration: str  #: its file, as an absolute path
    process: int
    begun: str  #: when that process was started, as the system counts; empty: it does not say
    access: Access

    @property
    def is_alive(self) -> bool:
        """True if its process is there, and no other one of its number."""
        try:
            os.kill(self.process, 0)
        except ProcessLookupError:
            return False
        except OSError:
            return False  # somebody else's by now
        return _begun(self.process) == self.begun


def _begun(process: int) -> str:
    """When a process was started: field 22 of its ``stat`` in Linux (proc(5))."""
    try:
        text = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    return text.rpartition(")")[2].split()[19]


def folder() -> Path:
    """The folder of these files, of this user alone; it need not be there."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        return Path(runtime) / "koord"
    return Path(tempfile.gettempdir()) / f"koord-{os.getuid() if hasattr(os, 'getuid') else 'user'}"


@contextmanager
def left(configuration: str, access: Access, where: Path | None = None) -> Iterator[Path | None]:
    """Leave a file within the context; None if the machine has no place for it."""
    process = os.getpid()
    _tidy(folder() if where is None else where)
    begun, path_of = _begun(process), os.path.abspath(configuration)
    made = Running(_VERSION, path_of, process, begun, access)
    path = _written(folder() if where is None else where, msgspec.json.encode(made))
    try:
        yield path
    finally:
        if path is not None and os.getpid() == process:
            path.unlink(missing_ok=True)
            with suppress(OSError):  # others may have left something
                path.parent.rmdir()


def _tidy(where: Path) -> None:
    """Remove old files of processes that were killed, which could not do so."""
    for path, run in found(None, where):
        with suppress(OSError):
            if not run.is_alive and time.time() - path.stat().st_mtime > _OLD_S:
                path.unlink()


def _written(where: Path, data: bytes) -> Path | None:
    try:
        where.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _is_ours(where):
            return None
        number, name = tempfile.mkstemp(".run", f"{os.getpid()}-", where)  # of mode 600
        with os.fdopen(number, "wb") as file:
            file.write(data)
    except OSError:
        return None
    return Path(name)


def _is_ours(path: Path) -> bool:
    """Return whether a folder or file is this user's, and nobody else can write or read it."""
    if os.name != "posix":
        return True
    status = path.lstat()
    mine = status.st_uid == os.getuid() and not stat.S_ISLNK(status.st_mode)
    return mine and not status.st_mode & 0o077


def found(configuration: str | None, where: Path | None = None) -> list[tuple[Path, Running]]:
    """The files that processes have left, of one configuration or all (None)."""
    place = folder() if where is None else where
    wanted = None if configuration is None else os.path.abspath(configuration)
    runs: list[tuple[Path, Running]] = []
    with suppress(OSError):
        if not _is_ours(place):
            return []
        for path in sorted(place.glob("*.run")):
            run = _read(path)
            if run is not None and wanted in (None, run.configuration):
                runs.append((path, run))
    return runs


def _read(path: Path) -> Running | None:
    try:
        if not _is_ours(path):
            return None
        run = msgspec.json.decode(path.read_bytes(), type=Running)
    except (OSError, msgspec.MsgspecError):
        return None
    return run if run.version == _VERSION else None
