"""Modules in files, found and read with less than Python asks about each of them.

For each module of a package Python looks at the folder, at the file, and at what the file was
compiled to, in functions of Python's own: of three hundred modules that takes a tenth of what it
takes to load them. Here a module is where its name says: the file is looked at once, and what it
was compiled to is read if it is of that file, by the rule that Python has for it. All else goes the
usual way: what is not compiled yet, packages of several folders, extensions, archives.
"""

from __future__ import annotations

import marshal
import os
import sys
from _frozen_importlib import ModuleSpec
from _frozen_importlib_external import MAGIC_NUMBER, PathFinder, SourceFileLoader
from types import CodeType, ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

#: The packages whose modules are looked for here: those that commands load most of.
_PACKAGES = frozenset({"koord", "msgspec", "z3"})

#: What Python names compiled files by.
_TAG = sys.implementation.cache_tag

#: How a compiled file begins: with the version of Python, and that what it is of is known by its
#: time and its size, which follow.
_BEGIN = MAGIC_NUMBER + bytes(4)
_HEADER = 16

#: Of times and sizes so many bits are kept.
_KEPT = 0xFFFF_FFFF


class _Loader(SourceFileLoader):
    """The loader of a module in a file, which looked like this when the module was found."""

    def __init__(self, name: str, path: str, compiled: str, file: os.stat_result) -> None:
        super().__init__(name, path)
        self._compiled, self._file = compiled, file

    def get_code(self, fullname: str) -> CodeType | None:
        """The code of the module, read or compiled."""
        return self._read() or super().get_code(fullname)

    def _read(self) -> CodeType | None:
        """What was compiled from this very file; None if there is no such thing."""
        try:
            descriptor = os.open(self._compiled, os.O_RDONLY | os.O_CLOEXEC)
            try:
                content = os.read(descriptor, os.fstat(descriptor).st_size)
            finally:
                os.close(descriptor)
        except OSError:
            return None
        here = int(self._file.st_mtime) & _KEPT, self._file.st_size & _KEPT
        known = int.from_bytes(content[8:12], "little"), int.from_bytes(content[12:16], "little")
        if content[:8] != _BEGIN or known != here:
            return None
        try:
            code = marshal.loads(memoryview(content)[_HEADER:])
        except (EOFError, TypeError, ValueError):
            return None  # Python knows what to say of it
        # Of a folder that was moved it tells the old name, which Python puts right.
        return code if isinstance(code, CodeType) and code.co_filename == self.path else None


class Finder:
    """The finder of modules of packages that have one folder each."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module of a name below a package at a path; None: others may find it."""
        if path is None or len(path) != 1 or name.partition(".")[0] not in _PACKAGES:
            return None
        (folder,) = path
        own = name.rpartition(".")[2]
        file, is_package = f"{folder}/{own}.py", False
        try:
            found = os.stat(file)
        except OSError:
            folder, own, is_package = f"{folder}/{own}", "__init__", True
            file = f"{folder}/{own}.py"
            try:
                found = os.stat(file)
            except OSError:
                return None
        compiled = f"{folder}/__pycache__/{own}.{_TAG}.pyc"
        spec = ModuleSpec(name, _Loader(name, file, compiled, found), origin=file)
        spec.has_location, spec.cached = True, compiled
        if is_package:
            spec.submodule_search_locations = [folder]
        return spec


def look_here_first() -> None:
    """Let modules of these packages be looked for here before Python does, which finds the same."""
    if sys.platform != "linux" or sys.pycache_prefix is not None or sys.flags.optimize:
        return
    there = sys.meta_path
    if PathFinder in there and Finder not in there:
        there.insert(there.index(PathFinder), Finder)
