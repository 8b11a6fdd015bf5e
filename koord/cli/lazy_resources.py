"""Modules of others, which are loaded when somebody asks for what takes long to load.

Z3 asks ``importlib.resources`` for the folder of its own package, and so loads readers of archives,
temporary files and addresses: that takes as long as Z3's own interface. msgspec brings what makes
schemas along, by way of UUIDs what finds out about this machine, and all that Python would do about
dates if it were not done in C. So does what writes objects down for other processes. argparse looks
for translations of its words, of which there are none.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from importlib import import_module
from os.path import join
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from koord.syntax.lazy_modules import LazyModule

_NAME, _Z3 = "importlib.resources", "z3"

#: What writes objects down: in C, and once more in Python, for who wants to look into it.
_PICKLE = "pickle"


class Folder(str):
    """The folder of a package, as Z3 asks for what is in it."""

    def joinpath(self, name: str) -> Folder:
        return Folder(join(self, name))


class _Resources(ModuleType):
    """The module as others have it, but for Z3."""

    def __getattr__(self, name: str) -> Any:
        return getattr(_loaded(), name)


def load_argparse() -> None:
    """Load argparse without what looks for translations."""
    words = ModuleType("gettext")
    vars(words).update(gettext=_as_it_is, ngettext=_one_or_many)
    with _standing_in({"gettext": words}):
        import argparse
    vars(argparse)["_"] = _as_it_is


def load_msgspec() -> None:
    """Load msgspec without what it needs for files, and with little of what it asks for.

    For msgspec ``typing_extensions`` is another name of ``typing``, which loads the readers of
    Python's own text. UUIDs are told by what Python was built for, so that nothing else is asked.
    Dates are those of Python's C library, as everywhere.
    """
    if "msgspec" in sys.modules:
        return
    from koord.syntax import lazy_modules

    for name in _OF_FILES:
        lazy_modules.put_off(name)
    if _SCHEMAS not in sys.modules:
        schemas = lazy_modules.LazyModule(_SCHEMAS)
        vars(schemas).update((name, _later(schemas, name)) for name in _MADE)
        sys.modules[_SCHEMAS] = schemas
    passing: dict[str, ModuleType | None] = {"typing_extensions": None}
    if sys.platform == "linux":
        machine = ModuleType("platform")
        vars(machine).update(system=lambda: os.uname().sysname)
        passing["platform"] = machine
    with suppress(ImportError):
        passing["datetime"] = _written_in_c("datetime")
    with _standing_in(passing):
        import msgspec  # noqa: F401


def _written_in_c(name: str) -> ModuleType:
    """A module with what Python's C library has of one. Raises ImportError if that is nothing."""
    module = ModuleType(name)
    own = vars(import_module(f"_{name}"))
    vars(module).update({key: value for key, value in own.items() if not key.startswith("__")})
    return module


@contextmanager
def _standing_in(modules: dict[str, ModuleType | None]) -> Iterator[None]:
    """Within the context these stand in for modules of their names that nobody has loaded.

    None: there is no such module.
    """
    mine = {name: module for name, module in modules.items() if name not in sys.modules}
    sys.modules.update(cast(Any, mine))
    try:
        yield
    finally:
        for name in mine:
            del sys.modules[name]


#: What msgspec loads for schemas, and for files in its forms.
_OF_FILES = tuple(f"msgspec.{name}" for name in ("inspect", "msgpack", "toml", "yaml"))

#: What makes schemas, and the functions of it that are part of its reader of JSON.
_SCHEMAS, _MADE = "msgspec._json_schema", ("schema", "schema_components")


def _later(module: LazyModule, name: str) -> Callable[..., Any]:
    """A function of a module that is loaded when the function is called."""

    def call(*arguments: Any, **named: Any) -> Any:
        return getattr(module.loaded(), name)(*arguments, **named)

    return call


def _as_it_is(text: str) -> str:
    return text


def _one_or_many(one: str, many: str, count: int) -> str:
    return one if count == 1 else many


def put_off() -> None:
    """Load all of this only if somebody needs it from now on."""
    load_argparse()
    if _PICKLE not in sys.modules:
        from koord.syntax.lazy_modules import LazyModule

        with suppress(ImportError):
            quick = LazyModule(_PICKLE)
            vars(quick).update(vars(_written_in_c(_PICKLE)))
            sys.modules[_PICKLE] = quick
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
