"""A new program with all that belongs to it, to begin from: ``koord new``."""

from __future__ import annotations

import os
import re
from importlib.resources import files
from os import PathLike

from koord.api.files import write_folder
from koord.api.results import ArgumentError, Result
from koord.syntax.diagnostics import refusal
from koord.syntax.source import visible

#: The files of a new project, by the names of their templates; ``@name@`` is the program's name.
FILES = {
    "program.txt": "@name@.krd",
    "properties.txt": "properties.krd",
    "configuration.txt": "@name@.yaml",
    "test.txt": "test_@name@.py",
    "readme.txt": "README.md",
}

#: Names that are those of files on every system, and of modules of Python with ``test_`` before.
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")

#: Names of devices, which are no names of files on Windows.
_DEVICES = frozenset(
    {"con", "prn", "aux", "nul", *(f"{x}{k}" for x in ("com", "lpt") for k in range(1, 10))}
)

#: Files that would have the same name as another one of the project.
_TAKEN = frozenset({"properties"})


class NewProject(Result, frozen=True):
    """A folder that was made, with its files in order: the program first."""

    folder: str
    files: tuple[str, ...]

    @property
    def name(self) -> str:
        """The name of the program."""
        return os.path.basename(self.folder)

    def to_dict(self) -> dict[str, object]:
        """The names of what was made."""
        return {"folder": self.folder, "files": list(self.files)}

    def __repr__(self) -> str:
        return f"<NewProject {self.folder}: {', '.join(self.files)}>"


def new(folder: str | PathLike[str]) -> NewProject:
    """Make a folder with a program, a configuration, properties, a test and a guide.

    The last part of ``folder`` is the name of the program. The folder is made as a whole or not at
    all, and must not be there before. Raises :class:`koord.ArgumentError` for a name that is none,
    :class:`koord.KoordError` where the folder cannot be made.

    >>> koord.new("posts").files
    ('posts.krd', 'properties.krd', 'posts.yaml', 'test_posts.py', 'README.md')
    """
    path = os.fspath(folder)
    name = os.path.basename(os.path.normpath(path))
    _check(name)
    if os.path.lexists(path):
        hint = "koord new replaces nothing: choose another name, or move what is there"
        raise refusal("K903", visible(path), "cannot be written: it is there already", hint)
    texts = files("koord.api").joinpath("template")
    made = {
        target.replace("@name@", name): texts.joinpath(template)
        .read_text(encoding="utf-8")
        .replace("@name@", name)
        .encode("utf-8")
        for template, target in FILES.items()
    }
    write_folder(path, made)
    return NewProject(os.path.normpath(path), tuple(made))


def _check(name: str) -> None:
    """Raise ArgumentError for what cannot be the name of a program."""
    if name in _DEVICES or name in _TAKEN:
        raise ArgumentError("name", f"{name!r} is taken by another file; write my_{name}")
    if _NAME.fullmatch(name):
        return
    near = re.sub(r"[^a-z0-9_]+", "_", name.lower()).strip("_")[:40].rstrip("_")
    near = near if _NAME.fullmatch(near) and near not in _DEVICES | _TAKEN else "my_robots"
    rule = "a name has a to z, 0 to 9 and _, begins with a letter and is at most 40 long"
    raise ArgumentError("name", f"{name!r} is no name of a program; {rule}: write {near}")
