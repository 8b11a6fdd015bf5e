"""Reading and writing of users' files: every failure is a diagnostic."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Mapping
from contextlib import suppress
from os import PathLike
from typing import TYPE_CHECKING, BinaryIO

from msgspec import Struct

from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import Source, Span, normalise, visible

if TYPE_CHECKING:
    from pathlib import Path

#: A program of this size is none; what is longer (``/dev/zero``) is not read to its end.
LARGEST_FILE = 64 * 1024 * 1024

#: What a folder that may be replaced has in it: rosbag2 folders are the only ones written.
_OURS = "metadata.yaml"


def file_name(given: str | PathLike[str] | None) -> str | None:
    """The name of a file or folder as people have given it; None: none."""
    return None if given is None else os.fspath(given)


class InputFile(Struct, frozen=True):
    """A file as it was read: its bytes and its text."""

    path: str
    raw: bytes
    source: Source


def read_program(path: str) -> InputFile:
    """Read a program. Raises KoordError if there is no text in it."""
    return input_file(path, visible(path), read_bytes(path))


def input_file(path: str, name: str, raw: bytes) -> InputFile:
    """Decode a file, under the given name. Raises KoordError if it is no text."""
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise refusal("K902", _place_of_byte(name, raw, error.start), *_not_utf8(error)) from None
    return InputFile(path, raw, Source(name, normalise(text)))


def read_written(path: str) -> bytes:
    """As :func:`read_bytes`, for files that koord writes: there is no limit of size.

    Of a pipe, whose end nobody knows, so much is read as of any input. Raises KoordError.
    """
    largest = None if os.path.isfile(path) else LARGEST_FILE
    return _read(path, largest)


def read_bytes(path: str) -> bytes:
    """Read the bytes of a file. Raises KoordError."""
    return _read(path, LARGEST_FILE)


def _read(path: str, largest: int | None) -> bytes:
    """Read the bytes of a file up to a limit of size. Raises KoordError."""
    name = visible(path)
    try:
        with open(path, "rb") as file:
            return read_all(file, name, largest)
    except (OSError, ValueError) as error:
        raise unreadable(name, error) from None


def unreadable(name: str, error: OSError | ValueError) -> KoordError:
    """Make the error that a file cannot be read."""
    return refusal("K901", name, f"cannot be read: {_reason(error)}")


def read_all(file: BinaryIO, name: str, largest: int | None) -> bytes:
    """Read the rest of an open file up to a limit of size. Raises KoordError and OSError."""
    raw = file.read(-1 if largest is None else largest + 1)
    if largest is not None and len(raw) > largest:
        limit = f"it is larger than {largest // 2**20} MiB"
        raise refusal("K901", name, f"cannot be read: {limit}")
    return raw


def write_atomically(path: str, data: bytes) -> None:
    """Write ``data`` to a file atomically: no reader, and no crash, ever sees half of it.

    An existing file keeps its mode, and a symbolic link goes on pointing to it. What is no
    regular file (``/dev/stdout``, a pipe) is simply written. Raises KoordError.
    """
    from pathlib import Path  # seldom needed, as all that writes here

    try:
        target = Path(os.path.realpath(path))
        if target.exists() and not target.is_file():
            target.write_bytes(data)
        else:
            _replace(target, data)
    except (OSError, ValueError) as error:
        raise refusal("K903", visible(path), f"cannot be written: {_reason(error)}") from None


def check_writable(path: str, read: Iterable[str] = ()) -> None:
    """Raise KoordError if ``path`` is evidently not writable, before long work is done.

    What is ``read`` by the same command is nobody's to replace.
    """
    target = os.path.realpath(path)
    folder = os.path.dirname(target)
    reason = None
    if any(os.path.realpath(name) == target for name in read):
        reason = "it is read by the same command"
    elif os.path.isdir(target):
        reason = "it is a folder"
    elif not os.path.isdir(folder):
        reason = f"there is no folder {visible(folder)}"
    elif os.path.exists(target):
        reason = None if os.access(target, os.W_OK) else "permission denied"
    elif not os.access(folder, os.W_OK):
        reason = "permission denied"
    if reason is not None:
        raise refusal("K903", visible(path), f"cannot be written: {reason}")


def same_file(one: str, other: str) -> bool:
    """Return whether two names are those of one file."""
    return os.path.realpath(one) == os.path.realpath(other)


def no_folder(folder: Path, error: OSError) -> KoordError:
    """Make the error that a folder cannot be made, or nothing in it."""
    is_file = isinstance(error, FileExistsError | NotADirectoryError)
    reason = "it is a file, and not a folder" if is_file else _reason(error)
    return refusal("K903", visible(str(folder)), f"cannot be written: {reason}")


def check_folder(path: str) -> None:
    """Raise KoordError if ``path`` is evidently no place for a folder of files of ours."""
    from pathlib import Path

    target = Path(os.path.realpath(path))
    reason = None
    if target.exists() and not (target / _OURS).is_file():
        reason = "something else is there"
    elif not target.parent.is_dir():
        reason = f"there is no folder {visible(str(target.parent))}"
    elif not os.access(target.parent, os.W_OK):
        reason = "permission denied"
    if reason is not None:
        raise refusal("K903", visible(path), f"cannot be written: {reason}")


def write_folder(path: str, files: Mapping[str, bytes]) -> None:
    """Write a folder of files atomically: as a whole or not at all.

    One that was written like this before is replaced. Raises KoordError.
    """
    import shutil
    from pathlib import Path

    check_folder(path)
    target = Path(os.path.realpath(path))
    try:
        made = _beside(target)
        made.mkdir()
        try:
            for name, data in files.items():
                (made / name).write_bytes(data)
            if target.exists():
                shutil.rmtree(target)
            made.replace(target)
        except BaseException:  # Ctrl-C too
            shutil.rmtree(made, ignore_errors=True)
            raise
    except (OSError, ValueError) as error:
        raise refusal("K903", visible(path), f"cannot be written: {_reason(error)}") from None


def _replace(target: Path, data: bytes) -> None:
    mode = None
    if target.exists():
        if not os.access(target, os.W_OK):
            raise PermissionError(13, "permission denied", str(target))
        mode = stat.S_IMODE(target.stat().st_mode)
    temporary = _beside(target)
    try:
        with open(temporary, "xb", opener=None if mode is None else _private) as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if mode is not None:
            os.chmod(temporary, mode)
        os.replace(temporary, target)
    except BaseException:  # Ctrl-C too: the temporary file must not stay behind
        with suppress(OSError):
            os.unlink(temporary)
        raise


def _private(name: str, flags: int) -> int:
    """Open a file that nobody else may read yet."""
    return os.open(name, flags, 0o600)


def _beside(target: Path) -> Path:
    """A temporary name in the folder of a file that is written atomically."""
    return target.parent / f".{target.name[:100]}.{os.urandom(8).hex()}"


def _reason(error: OSError | ValueError) -> str:
    match error:
        case FileNotFoundError():
            return "there is no such file"
        case IsADirectoryError():
            return "it is a folder; name the files in it"
        case PermissionError():
            return "permission denied"
        case OSError(strerror=str(story)):
            return story[:1].lower() + story[1:]
        case _:
            return str(error)  # a NUL in the name


def _not_utf8(error: UnicodeDecodeError) -> tuple[str, str]:
    byte = error.object[error.start]
    return (
        f"byte 0x{byte:02x} is not UTF-8: the file is in another encoding, or is no text",
        "save the file as UTF-8",
    )


def _place_of_byte(name: str, raw: bytes, offset: int) -> Span:
    before = normalise(raw[:offset].decode("utf-8", errors="replace"))
    line = before.count("\n") + 1
    column = len(before) - (before.rfind("\n") + 1) + 1
    return Span(name, line, column, line, column + 1)
