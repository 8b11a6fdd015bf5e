"""The files that a command line names; ``-`` is standard input."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from koord.api import files
from koord.api.files import InputFile
from koord.syntax.diagnostics import refusal
from koord.syntax.source import visible

#: The name that stands for standard input and output on the command line.
DASH = "-"
STDIN_NAME = "<stdin>"


def read_program(path: str) -> InputFile:
    """Read a program, ``-`` from standard input. Raises KoordError if there is no text in it."""
    if path != DASH:
        return files.read_program(path)
    return files.input_file(path, STDIN_NAME, read_bytes(path))


def name_of(path: str) -> str:
    """The name of a file in messages, without characters that act on a terminal."""
    return STDIN_NAME if path == DASH else visible(path)


def read_written(path: str) -> bytes:
    """As :func:`read_bytes`, of what koord writes itself: a file may be as large as it is.

    Raises KoordError.
    """
    return read_bytes(path) if path == DASH else files.read_written(path)


def read_bytes(path: str) -> bytes:
    """The bytes of a file, ``-`` of standard input. Raises KoordError."""
    if path != DASH:
        return files.read_bytes(path)
    if sys.stdin is None:
        raise refusal("K901", STDIN_NAME, "standard input is closed")
    try:
        return files.read_all(sys.stdin.buffer, STDIN_NAME, files.LARGEST_FILE)
    except (OSError, ValueError) as error:
        raise files.unreadable(STDIN_NAME, error) from None


def write_out(text: str) -> None:
    """Write a program to standard output in UTF-8, whatever the locale's encoding is."""
    if sys.stdout is None:
        return
    sys.stdout.flush()
    sys.stdout.buffer.write(text.encode("utf-8"))
    sys.stdout.buffer.flush()


def check_writable(path: str, read: Iterable[str] = ()) -> None:
    """Raise KoordError if ``path`` is evidently not writable, before long work is done.

    What is ``read`` by the same command is nobody's to replace.
    """
    files.check_writable(path, [name for name in read if name != DASH])
