"""Machine code that is kept from run to run: as shared objects, which load without LLVM.

Keys are made of all that code is made of: what the caller says, koord's files, the processor and
the version of llvmlite. What cannot be kept, or linked, is made anew in each process, as it is
where nothing is kept (decision record 0125).
"""

from __future__ import annotations

import ctypes
import os
import struct
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from msgspec import Struct

from koord.machine.processor import processor
from koord.stores.folder import FileForm, FolderStore, is_switched_off, usual_folder

# `koord cache` and `koord doctor` look at the store where there is no NumPy, too.
if TYPE_CHECKING:
    from koord.machine.code import Ir

#: How machine code is kept in a folder.
CODE_FILES = FileForm(
    "piece of machine code", b"koord-machine-2", "code", 64 * 2**20, 64 * 2**20, is_run=True
)

#: The rooms whose files machine code may hang on.
_ROOMS = ("machine", "runtime", "sim", "syntax")

#: Before what is told of it and the shared object: the length of the former.
_HEAD = struct.Struct("<I")

_LINK_S = 30


class Compiled(Protocol):
    """Machine code in this process."""

    def function(self, name: str, arguments: int) -> Callable[..., int]:
        """A function of 64-bit numbers and addresses with a 64-bit result."""
        ...


class KeptCode(Struct, frozen=True):
    """Machine code that was kept, and what was told of it then."""

    code: Compiled
    about: bytes


#: Folders that this process has put machine code in, since somebody asked.
_NEWS: list[str] = []


def newly_kept() -> str:
    """The folder where machine code is kept since the last call; empty if nothing is new."""
    found = _NEWS[-1] if _NEWS else ""
    _NEWS.clear()
    return found


class Shared:
    """A shared object that was loaded. It stays until the process ends."""

    def __init__(self, raw: bytes) -> None:
        """Load a shared object. Raises OSError if the system does not want to."""
        number = os.memfd_create("koord-machine")
        with os.fdopen(os.dup(number), "wb") as file:
            file.write(raw)
        # The file stays open: systems tell libraries apart by their names.
        self._library = ctypes.CDLL(f"/proc/self/fd/{number}")

    def function(self, name: str, arguments: int) -> Callable[..., int]:
        type_ = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * arguments)
        return cast("Callable[..., int]", type_((name, self._library)))


def machine_store() -> FolderStore | None:
    """The store of machine code; None if none is kept."""
    if is_switched_off() or not hasattr(os, "memfd_create"):
        return None
    try:
        return FolderStore(os.path.join(usual_folder(), "machine"), CODE_FILES)
    except RuntimeError:  # nobody's home
        return None


def kept(name: str, of: tuple[object, ...], make: Callable[[], Ir]) -> Compiled:
    """Load the machine code of a module that ``make`` writes of some values.

    ``name`` says which module that is. Values are numbers, strings, tuples, arrays and structs of
    them; raises TypeError for others.
    """
    key = key_of(name, *of)
    found = find(key)
    return found.code if found is not None else keep(key, make(), improved=True)


def find(key: str | None) -> KeptCode | None:
    """Load what is kept under a key."""
    store = machine_store() if key is not None else None
    if key is None or store is None:
        return None
    data = store.get(key)
    if data is None:
        return None
    (size,) = _HEAD.unpack_from(data)
    end = _HEAD.size + size
    try:
        return KeptCode(Shared(data[end:]), data[_HEAD.size : end])
    except OSError:
        return None


def is_kept(key: str | None) -> bool:
    """Return whether something is kept under a key; it may turn out that it does not load."""
    store = machine_store() if key is not None else None
    return key is not None and store is not None and store.has(key)


def keep(
    key: str | None,
    module: Ir,
    about: bytes = b"",
    *,
    hasty: bool = False,
    improved: bool = False,
) -> Compiled:
    """Compile a module, and keep it under a key with what is to be told of it.

    LLVM's passes are worth their time where it is kept only. Raises TooMuchCodeError.
    """
    from koord.machine.code import Loaded, object_of

    store, linker = machine_store(), _linker()
    if key is None or store is None or linker is None:
        return Loaded(module, hasty=hasty)
    linked = _linked(linker, object_of(module, hasty=hasty, improved=improved))
    if linked is None:
        return Loaded(module, hasty=hasty)
    try:
        code = Shared(linked)
    except OSError:
        return Loaded(module, hasty=hasty)
    if store.put(key, b"".join((_HEAD.pack(len(about)), about, linked))):
        _NEWS.append(store.path)
    return code


def key_of(*of: object) -> str | None:
    """The key of what is made of some values; None where it is not known what all that is.

    Raises TypeError for values of other types than :func:`kept` has.
    """
    if not processor():
        return None
    whole = _surroundings().copy()
    try:
        for value in of:
            _put(whole, value)
    except _ForeignError:
        return None
    return str(whole.hexdigest())


class _ForeignError(Exception):
    """Raised for a struct of a class that is not koord's: its methods are in no known file."""


def _put(whole: Any, value: object) -> None:
    """Hash a value, with its kind and length, so that no two look alike."""
    import numpy as np

    parts: tuple[object, ...] = ()
    match value:
        case None | bool() | int() | float():
            text = repr(value).encode()
        case str():
            text = value.encode("utf-8", "surrogatepass")
        case bytes():
            text = value
        case tuple():
            text, parts = str(len(value)).encode(), value
        case np.ndarray():
            text, parts = value.tobytes(), (str(value.dtype), value.shape)
        case Struct() if not type(value).__module__.startswith("koord."):
            raise _ForeignError
        case Struct():
            fields = value.__struct_fields__
            text, parts = str(len(fields)).encode(), tuple(getattr(value, f) for f in fields)
        case _:
            raise TypeError(f"no key is made of a {type(value).__name__}")
    whole.update(f"{type(value).__qualname__} {len(text)} ".encode())
    whole.update(text)
    for part in parts:
        _put(whole, part)


@cache
def _surroundings() -> Any:
    """The hash of what all machine code is made of: this Python, the processor, and our files."""
    import numpy as np

    from koord.machine.code import compiler

    whole = sha256()
    _put(whole, (sys.version, np.__version__, compiler(), tuple(processor().items()), *_files()))
    return whole


def _files() -> list[tuple[object, ...]]:
    """The files of the rooms, told apart by their sizes and when they were changed."""
    root = Path(__file__).resolve().parents[1]
    found, folders = [], [str(root / room) for room in _ROOMS]
    while folders:
        with os.scandir(folders.pop()) as listed:
            for file in listed:
                if file.name.endswith(".py"):
                    told = file.stat()
                    path = os.path.relpath(file.path, root)
                    found.append((path, told.st_size, told.st_mtime_ns))
                elif "." not in file.name and file.name != "__pycache__" and file.is_dir():
                    folders.append(file.path)
    return sorted(found)


@cache
def _linker() -> str | None:
    """What makes a shared object of an object, if there is something here."""
    import shutil

    return next(filter(None, map(shutil.which, ("ld", "ld.lld", "ld.gold"))), None)


def _linked(linker: str, raw: bytes) -> bytes | None:
    """A shared object of an object; None if that cannot be."""
    import subprocess
    import tempfile

    with tempfile.TemporaryDirectory(prefix="koord-link-") as folder:
        given, made = os.path.join(folder, "code.o"), os.path.join(folder, "code.so")
        Path(given).write_bytes(raw)
        try:
            subprocess.run(
                [linker, "-shared", "-z", "noexecstack", "-z", "now", "-o", made, given],
                check=True,
                capture_output=True,
                timeout=_LINK_S,
            )
            return Path(made).read_bytes()
        except (OSError, subprocess.SubprocessError):
            return None
