"""``importlib.resources``, which is loaded when somebody asks for more than where Z3's library is.

Z3 asks it for the folder of its own package, and so loads readers of archives, temporary files and
addresses: that takes as long as Z3's own interface.
"""

from __future__ import annotations

import importlib
import sys
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from os.path import join
from types import ModuleType
from typing import Any

_NAME, _Z3 = "importlib.resources", "z3"


class Folder(str):
    """The folder of a package, as Z3 asks for what is in it."""

    def joinpath(self, name: str) -> Folder:
        return Folder(join(self, name))


class _Resources(ModuleType):
    """The module as others have it, but for Z3."""

    def __getattr__(self, name: str) -> Any:
        return getattr(_loaded(), name)


def put_off() -> None:
    """Load ``importlib.resources`` only if somebody needs it from now on."""
    if _NAME not in sys.modules:
        resources = _Resources(_NAME)
        folder = join(importlib.__path__[0], "resources")
        vars(resources).update(files=_files, as_file=_as_file, __path__=[folder])
        sys.modules[_NAME] = resources


def _files(anchor: Any = None) -> Any:
    """The folder of a package."""
    package = sys.modules.get(_Z3)
    if anchor != _Z3 or package is None:
        return _loaded().files(anchor)
    return Folder(package.__path__[0])


def _as_file(path: Any) -> AbstractContextManager[Any]:
    """What is at a path, as a file."""
    if isinstance(path, Folder):
        return nullcontext(path)
    found: AbstractContextManager[Any] = _loaded().as_file(path)
    return found


def _loaded() -> Any:
    """The module itself."""
    if isinstance(sys.modules.get(_NAME), _Resources):
        del sys.modules[_NAME]
    return import_module(_NAME)
