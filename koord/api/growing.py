"""Growing files: written while a run goes on, and replaced by whole ones at its end.

They are there if the process is killed, up to the last second of the wall; when the run is kept as
a whole they are removed.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Protocol

from koord.api.files import check_folder
from koord.syntax.diagnostics import refusal
from koord.syntax.source import visible

#: What is new is kept so often.
PERIOD_S = 1.0


class GrowingFile(Protocol):
    """A file that grows, and has to be closed."""

    def grow(self) -> None:
        """Write the new part."""

    def close(self) -> None:
        """Close the file."""


class Growing:
    """The growing files of one run: :meth:`add` them, and :meth:`grow` them while it goes on."""

    def __init__(self, period_s: float | None = None) -> None:
        self._period_s = PERIOD_S if period_s is None else period_s
        self._files: list[Callable[[], None]] = []
        self._paths: list[str] = []
        self._has_grown = False
        self._next_s = 0.0
        self._stack = ExitStack()

    def __enter__(self) -> Growing:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with self._stack:
            if kind is None:
                self._next_s = 0.0
                self.grow()
        if isinstance(error, Exception) and not self._has_grown:
            for path in self._paths:  # the run was refused before it began
                remove_part(path)

    def add(self, path: str, begun: Callable[[BinaryIO], Callable[[], None]]) -> None:
        """Add a growing file beside ``path``, if that is to be a file.

        ``begun`` writes its beginning, and gives what writes behind it. Raises KoordError.
        """
        if os.path.exists(path) and not os.path.isfile(path):
            return
        try:
            file = Path(part_of(path)).open("wb")  # noqa: SIM115
            self._paths.append(path)
            self._files.append(begun(self._stack.enter_context(file)))
            file.flush()
        except OSError as error:
            raise _unwritable(error) from None

    def add_own(self, path: str, begun: Callable[[Path], GrowingFile]) -> None:
        """As :meth:`add`, for files or folders that manage themselves. Raises KoordError."""
        here = Path(part_of(path))
        try:
            if here.exists():  # that of a run that was killed
                if here.is_dir():
                    check_folder(str(here))
                remove_part(path)
            self._paths.append(path)
            part = begun(here)
        except OSError as error:
            raise _unwritable(error) from None
        self._stack.callback(part.close)
        self._files.append(part.grow)

    def grow(self) -> None:
        """Write the new parts, if it is time. Raises KoordError."""
        if time.monotonic() < self._next_s:
            return
        self._has_grown = True
        try:
            for one in self._files:
                one()
        except OSError as error:
            raise _unwritable(error) from None
        self._next_s = time.monotonic() + self._period_s


def part_of(path: str) -> str:
    """The name of a file while the run goes on."""
    return str(Path(path).with_suffix(f".part{Path(path).suffix}"))


def remove_part(path: str) -> None:
    """Remove the growing file: the whole one is there now."""
    part = part_of(path)
    with suppress(OSError):
        if os.path.isdir(part):
            shutil.rmtree(part)
        else:
            os.unlink(part)


def _unwritable(error: OSError) -> Exception:
    name = visible(str(error.filename)) if error.filename else "the run"
    return refusal("K903", name, f"cannot be written: {error.strerror}")
