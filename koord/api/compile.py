"""Compilation of programs to Python."""

from __future__ import annotations

import os

from koord.api.files import write_atomically
from koord.api.programs import Loadable, program_of
from koord.api.results import Result
from koord.runtime.compile import compiled


class CompiledProgram(Result, frozen=True):
    """A compiled program: a Python module that imports :mod:`koord.runtime.robot` only."""

    program: str  #: the name of the text that it was made of
    text: str

    def to_dict(self) -> dict[str, object]:
        """The fields as plain data."""
        return {"program": self.program, "text": self.text}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file, whole or not at all. Raises :class:`koord.KoordError`."""
        write_atomically(os.fspath(path), self.text.encode("utf-8"))

    def __repr__(self) -> str:
        return f"<CompiledProgram {self.program}: {len(self.text.splitlines())} lines>"


def compile(program: Loadable) -> CompiledProgram:
    """Compile a program to Python.

    Raises :class:`koord.KoordError` for one with errors, or with numbers that no double has.

    >>> koord.compile("task.krd").save("task.py")
    """
    loaded = program_of(program)
    return CompiledProgram(loaded.name, compiled(loaded.core))
