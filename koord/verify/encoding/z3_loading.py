"""Z3's Python interface, without what takes long to load and is seldom asked for.

That interface declares each of the seven hundred functions of Z3 when it is loaded, of which a
verification calls a tenth, and brings modules for polynomials, algebraic numbers and the like.
Here a function is declared when it is first called, and such a module is loaded when something of
it is asked for: that saves a third of what it takes to load Z3.
"""

from __future__ import annotations

import ctypes
import sys
from importlib import import_module
from typing import Any, Final

from koord.syntax.lazy_modules import put_off

#: The modules of Z3's interface that nothing else in it needs.
_SELDOM: Final = ("z3.z3num", "z3.z3poly", "z3.z3rcf", "z3.z3regex", "z3.z3util")

#: The functions that are called after each other one.
_ALWAYS: Final = frozenset({"Z3_get_error_code", "Z3_get_error_msg"})


class _Function:
    """A function of Z3's library, which is looked up when it is first called."""

    restype: Any = ctypes.c_int  #: what ctypes takes it to return if nobody says
    argtypes: Any = None

    def __init__(self, library: ctypes.CDLL, name: str) -> None:
        self._library, self._name = library, name

    def __call__(self, *arguments: Any) -> Any:
        found = self.found()
        found.restype = self.restype
        if self.argtypes is not None:
            found.argtypes = self.argtypes
        interface = sys.modules.get("z3.z3core")
        if interface is not None:  # it is gone where Python comes to its end
            # From now on it is called without this one.
            elements = getattr(interface, self._name).__defaults__[-1]
            if elements.f is self:
                elements.f = found
        return found(*arguments)

    def found(self) -> Any:
        """The function in the library, as nobody has declared it."""
        return getattr(self._library, self._name)


class _Library:
    """Z3's library, as its interface declares it."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        self._handle = library._handle  #: by which ctypes finds functions in it

    def __getattr__(self, name: str) -> Any:
        late = name.startswith("Z3_") and name not in _ALWAYS
        found = _Function(self._library, name) if late else getattr(self._library, name)
        setattr(self, name, found)
        return found


def _load() -> None:
    """Load Z3, unless somebody else has."""
    if "z3" in sys.modules:
        return
    for name in _SELDOM:
        put_off(name)
    loads = ctypes.CDLL

    def library(path: str) -> Any:
        return _Library(loads(path))

    ctypes.CDLL = library  # type: ignore[assignment,misc]
    try:
        import_module("z3")
    finally:
        ctypes.CDLL = loads  # type: ignore[misc]


_load()

import z3 as z3  # noqa: E402  # its users have it from here


def address_of(name: str) -> int:
    """Where the function of a name is in Z3's library."""
    (elements,) = getattr(z3, name).__defaults__
    function = elements.f.found() if isinstance(elements.f, _Function) else elements.f
    address = ctypes.cast(function, ctypes.c_void_p).value
    assert address is not None
    return address
