"""The files of a program, as far as folders and texts tell: for editors, and for tests.

A program says in a comment how it is verified, and so which files belong to it:

    # koord verify: --with properties.krd --set tasks=4

Where no program of a folder says anything, and there is one only, the files of properties there
belong to it. Its configurations are named like it: ``app.yaml``, ``app_large.yaml``.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from glob import escape
from itertools import islice
from pathlib import Path

from msgspec import Struct

from koord.api.files import read_program
from koord.syntax.diagnostics import KoordError
from koord.syntax.literals import ParamValue, read_value
from koord.syntax.source import Source, normalise
from koord.syntax.vocabulary import SECTIONS

#: A comment of a program that says how it is verified: ``# koord verify: --robots 2..4``.
SAID = re.compile(r"^[ \t]*#[ \t]*koord verify:(.*)$", re.MULTILINE)

#: Sections that files of properties may have, and those that make a file a program.
_OF_PROPERTIES = ("assume", "invariant", "eventually", "def", "param")
_PROPERTY = re.compile(r"^(?:assume|invariant|eventually)\b", re.MULTILINE)
_EITHER = "|".join(_OF_PROPERTIES)
_OF_PROGRAMS = "|".join(sorted(SECTIONS - set(_OF_PROPERTIES)))
_PROGRAM = re.compile(
    rf"^(?:(?:{_OF_PROGRAMS})\b|def\s+adt\b|(?!(?:{_EITHER})\b)[A-Za-z_]\w*[ \t]*:)",
    re.MULTILINE,
)

#: A folder with more programs is no project of one.
_MOST_FILES = 200

#: The text of an open file, None if it is not open.
OpenTexts = Callable[[Path], str | None]


class ProgramFiles(Struct, frozen=True):
    """A program's own text, its files of properties, its configurations, values of params.

    Sources have the names of their files as seen from the program's folder.
    """

    main: Source
    properties: tuple[Source, ...] = ()
    configurations: tuple[Source, ...] = ()
    params: Mapping[str, ParamValue] = {}


class _Said(Struct, frozen=True):
    """What a text says about the files and params of its verification."""

    files: tuple[str, ...] = ()
    params: tuple[tuple[str, ParamValue], ...] = ()


def program_files(path: Path, text: str, opened: OpenTexts) -> ProgramFiles:
    """The files of the program that a file belongs to, which has a text that is perhaps not saved.

    >>> program_files(Path("properties.krd"), text, lambda path: None).main.name
    'app.krd'
    """
    folder = Folder(path, text, opened)
    main = folder.main_of(path, text)
    if main != path:
        found = folder.text(main)
        if found is None:
            return ProgramFiles(Source(path.name, normalise(text)))
        text = found
    said = _said(text)
    files = [beside(path, name) for name in said.files]
    if not files and folder.only_program() == main:
        files = folder.properties()
    return ProgramFiles(
        Source(main.name, normalise(text)),
        tuple(folder.sources(file for file in files if file != main)),
        tuple(folder.sources(sorted(main.parent.glob(f"{escape(main.stem)}*.yaml")))),
        dict(said.params),
    )


def program_beside(path: Path, opened: OpenTexts) -> Source | None:
    """The program that a configuration is named like; of several that with the longest name.

    >>> program_beside(Path("app_large.yaml"), lambda path: None).name
    'app.krd'
    """
    try:
        found = [one for one in path.parent.glob("*.krd") if path.stem.startswith(one.stem)]
    except OSError:
        return None
    found.sort(key=lambda one: len(one.stem), reverse=True)
    folder = Folder(path, "", opened)
    return next((s for s in folder.sources(found) if not is_of_properties(s.text)), None)


def beside(path: Path, name: str) -> Path:
    """The file of a name that is seen from the folder of another file."""
    return Path(os.path.normpath(path.parent / name))


class Folder:
    """The programs beside a file; texts that are open are those that count."""

    def __init__(self, path: Path, text: str, opened: OpenTexts) -> None:
        self.folder, self._here, self._text, self._opened = path.parent, path, text, opened

    def text(self, path: Path) -> str | None:
        """The text of a file; None if there is none."""
        if path == self._here:
            return self._text
        known = self._opened(path)
        if known is not None:
            return known
        try:
            state = path.stat()
            return _on_disk(str(path), state.st_mtime_ns, state.st_size)
        except OSError:
            return None

    def sources(self, paths: Iterator[Path] | list[Path]) -> Iterator[Source]:
        """The texts of files that can be read, each once."""
        for path in dict.fromkeys(paths):
            text = self.text(path)
            if text is not None:
                yield Source(os.path.relpath(path, self.folder), normalise(text))

    def main_of(self, path: Path, text: str) -> Path:
        """The program that a file belongs to: itself, unless it has properties alone."""
        if not is_of_properties(text):
            return path
        for other, said in self._programs():
            if any(beside(other, name) == path for name in said.files):
                return other
        return self.only_program() or path

    def only_program(self) -> Path | None:
        """The program of the folder, if there is just one."""
        found = [path for path, _ in islice(self._programs(), 2)]
        return found[0] if len(found) == 1 else None

    def properties(self) -> list[Path]:
        """The files of properties alone."""
        return [path for path, text in self._texts() if is_of_properties(text)]

    def configurations(self) -> list[Path]:
        """The files of YAML, unless there are too many for a project."""
        try:
            found = sorted(self.folder.glob("*.yaml"))
        except OSError:
            return []
        return found if len(found) <= _MOST_FILES else []

    def _programs(self) -> Iterator[tuple[Path, _Said]]:
        for path, text in self._texts():
            if _is_program(text):
                yield path, _said(text)

    def _texts(self) -> Iterator[tuple[Path, str]]:
        try:
            paths = sorted(self.folder.glob("*.krd"))
        except OSError:
            paths = []
        for path in paths if len(paths) <= _MOST_FILES else []:
            text = self.text(path)
            if text is not None:
                yield path, text


@lru_cache(maxsize=256)
def is_of_properties(text: str) -> bool:
    """Whether a text states properties, and has no part of a program. It may have mistakes."""
    return _PROGRAM.search(text) is None and _PROPERTY.search(text) is not None


@lru_cache(maxsize=256)
def _is_program(text: str) -> bool:
    return _PROGRAM.search(text) is not None


@lru_cache(maxsize=256)
def _on_disk(path: str, mtime_ns: int, size: int) -> str | None:
    try:
        return read_program(path).source.text
    except KoordError:
        return None


def _said(text: str) -> _Said:
    """The files and params that a text says; flags that cannot be read are passed over."""
    files: list[str] = []
    params: list[tuple[str, ParamValue]] = []
    for flag, value in flags_said(SAID, text):
        if flag == "--with":
            files.append(value)
        elif flag == "--set" and "=" in value:
            name, _, given = value.partition("=")
            with suppress(ValueError):
                params.append((name, read_value(given)))
    return _Said(tuple(files), tuple(params))


def flags_said(comment: re.Pattern[str], text: str) -> Iterator[tuple[str, str]]:
    """Yield the flags with their values in the comments of a text that a pattern finds.

    >>> list(flags_said(SAID, "# koord verify: --with a.krd --set n=4"))
    [('--with', 'a.krd'), ('--set', 'n=4')]
    """
    for told in comment.findall(text):
        try:
            words = shlex.split(told)
        except ValueError:  # a quote that is not closed yet
            continue
        pending = ""
        for word in words:
            flag, equals, value = word.partition("=")
            if pending or not equals:
                flag, value = pending, word
            pending = "" if flag else word
            if flag:
                yield flag, value
