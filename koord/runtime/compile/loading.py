"""Loading of compiled programs as classes, without a file."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType

from koord.runtime.robot import Robot

#: Compiled modules have this name; it is in no package, so nothing can import it by chance.
_NAME = "koord_compiled"


def loaded(text: str) -> tuple[type[Robot], ...]:
    """The robot classes of a compiled program, by the position of their kind.

    The text is one that :func:`koord.runtime.compile.compiled` made: it is run, so nothing that
    came over a network may be passed in.
    """
    module = ModuleType(_NAME)
    before = sys.modules.get(_NAME)
    sys.modules[_NAME] = module
    try:
        exec(compile(text, f"<{_NAME}>", "exec"), module.__dict__)
    finally:
        if before is None:
            del sys.modules[_NAME]
        else:
            sys.modules[_NAME] = before
    return classes_of(module)


def classes_of(module: ModuleType) -> tuple[type[Robot], ...]:
    """The robot classes of an imported compiled module."""
    kinds: Sequence[type[Robot]] = module.KINDS
    return tuple(kinds)
