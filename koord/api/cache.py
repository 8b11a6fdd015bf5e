"""The cache of verdicts: in memory, and in a folder if one is given."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import cache as once
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as version_of
from pathlib import Path

from koord.machine.kept import machine_store
from koord.stores.folder import VARIABLE, FolderStore, FolderUse, usual_folder
from koord.stores.store import LayeredStore, MemoryStore
from koord.syntax.system import System
from koord.verify.cache.forms import digest
from koord.verify.cache.kept import VERDICT_FILES, VerdictCache
from koord.verify.cache.verifying import CachedVerification
from koord.verify.engine_names import Engine
from koord.verify.verdicts import Bounds
from koord.version import __version__

#: The packages that verdicts depend on, beside koord.
_SOLVERS = ("z3-solver", "python-sat")


class Cache:
    """A cache of verdicts, which is given to :func:`koord.verify` again and again.

    Known verdicts are shown again (``kept``) where the part of the program that they depend on is
    the same, and the claim, the robots, the bounds and the engine are; a run that breaks a claim
    is replayed first. What was *unknown* is asked again.

    They are kept in memory, and in a ``folder`` if one is given, which several processes may share:
    at most ``limit`` bytes there, those of the last use. ``note`` is told of files there that are
    damaged; they are removed. A folder's verdicts count only for the same version of koord, of its
    files and of its solvers.

    >>> cache = koord.Cache()
    >>> koord.verify("task.krd", cache=cache).verdict("Route").kept
    False
    >>> koord.verify("task.krd", cache=cache).verdict("Route").kept
    True
    """

    def __init__(
        self,
        folder: str | os.PathLike[str] | None = None,
        *,
        limit: int = VERDICT_FILES.limit,
        note: Callable[[str], None] = lambda text: None,
    ) -> None:
        path = None if folder is None else os.fspath(folder)
        self._folder = None if path is None else FolderStore(path, VERDICT_FILES, limit, note)
        self._version = "" if folder is None else version_in_use()
        memory = MemoryStore()
        store = memory if self._folder is None else LayeredStore(memory, self._folder)
        self._verdicts = VerdictCache(store, note)

    def looked_up(
        self,
        system: System,
        bounds: Bounds,
        engine: Engine | None,
        *,
        names: frozenset[str],
        seed: int,
    ) -> CachedVerification:
        """What is known about a system."""
        return CachedVerification.begun(
            self._verdicts, system, bounds, engine, names=names, seed=seed, version=self._version
        )

    @property
    def folder(self) -> str | None:
        """The path of its folder, if it has one."""
        return None if self._folder is None else self._folder.path

    def use(self) -> FolderUse:
        """How many entries are in its folder, and how many bytes they take."""
        return FolderUse(0, 0) if self._folder is None else self._folder.use()

    def clear(self) -> FolderUse:
        """Remove all entries from its folder; return how much there was."""
        return FolderUse(0, 0) if self._folder is None else self._folder.clear()


def kept_code(*, clear: bool = False) -> FolderUse:
    """How much machine code of simulations is kept in the usual folder; removed if asked for."""
    store = machine_store()
    if store is None:
        return FolderUse(0, 0)
    return store.clear() if clear else store.use()


@once
def version_in_use() -> str:
    """The version of all that gives verdicts: a mistake that was mended counts for nothing.

    Koord's own files are told apart by when they were changed, too: whoever works on them keeps the
    number of the version.
    """
    root = Path(__file__).resolve().parents[1]
    files = []
    for folder, _, names in os.walk(root):
        for name in names:
            if name.endswith((".py", ".krd", ".lark")):
                found = os.stat(os.path.join(folder, name))
                path = os.path.relpath(os.path.join(folder, name), root)
                files.append(f"{path} {found.st_size} {found.st_mtime_ns}")
    solvers = [f"{name} {_installed(name)}" for name in _SOLVERS]
    return f"{__version__} {digest(sys.version, *solvers, *sorted(files))}"


def _installed(package: str) -> str:
    try:
        return version_of(package)
    except PackageNotFoundError:
        return "none"


__all__ = ["VARIABLE", "Cache", "kept_code", "usual_folder", "version_in_use"]
