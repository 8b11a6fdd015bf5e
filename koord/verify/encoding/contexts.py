"""Contexts of Z3, of which there are few at a time.

A context takes 17 MB, all of which Z3 writes to at once: that takes ten times as long as the rest
of what makes one, or more where a machine has to find the memory. One that has the memory of
another takes a millisecond. Processes that are forked are given some that are made and not used:
of their memory each writes to a small part.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import TypeVar, cast
from weakref import WeakSet

from koord.verify.job_process import depth

C = TypeVar("C")

#: So many contexts may be there, and so many are made, before it is looked for what nobody needs:
#: to look takes as long as to make four of them in memory that comes in huge pages.
_FEW = 4

#: So many are made for each process that is forked: most need no more.
_AHEAD = 2

_there: WeakSet[object] = WeakSet()
_made_since = 0

#: Contexts that were made ahead, and what made the last one.
_ahead: list[object] = []
_maker: Callable[[], object] | None = None


def new_context(make: Callable[[], C]) -> C:
    """Return a context that was made ahead, or make one."""
    global _maker
    if _ahead and _maker is make:
        return cast("C", _ahead.pop())
    _maker = make
    return _made(make)


def make_ahead(make: Callable[[], object] | None = None) -> None:
    """Make what each process that is forked from now on needs.

    If this one needed none so far, that is what ``make`` makes, or nothing.
    """
    global _maker
    _maker = _maker or make
    if _maker is not None:
        _ahead.extend(_made(_maker) for _ in range(_AHEAD - len(_ahead)))


def _made(make: Callable[[], C]) -> C:
    """Make a context, in the memory of one that nobody needs any more if there may be such.

    What questions are made of refers to itself, so that Python's garbage collector has to find it.
    It looks only where work is done for another process, whose own objects are not looked at.
    """
    global _made_since
    if _made_since >= _FEW <= len(_there) and depth() > 0:
        gc.collect()
        _made_since = 0
    _made_since += 1
    context = make()
    _there.add(context)
    return context
