"""Koord: programs for teams of robots, with a formal semantics that is run and verified.

    import koord

    program = koord.load("task.krd")
    report = koord.verify(program, robots=3, rounds=20)
    print(report)

Importing this package loads nothing else: each name is loaded when it is first asked for. The
floors are described in ``ARCHITECTURE.md``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from koord.api.documents import schema as schema
    from koord.api.programs import CheckReport as CheckReport
    from koord.api.programs import Program as Program
    from koord.api.programs import check as check
    from koord.api.programs import load as load
    from koord.api.progress import Cancellation as Cancellation
    from koord.api.progress import Progress as Progress
    from koord.api.results import ArgumentError as ArgumentError
    from koord.syntax.diagnostics import Diagnostic as Diagnostic
    from koord.syntax.diagnostics import KoordError as KoordError
    from koord.syntax.source import Source as Source
    from koord.syntax.source import Span as Span

#: Where each public name stands.
_HOMES = {
    "koord.api.documents": ("schema",),
    "koord.api.programs": ("CheckReport", "Program", "check", "load"),
    "koord.api.progress": ("Cancellation", "Progress"),
    "koord.api.results": ("ArgumentError",),
    "koord.syntax.diagnostics": ("Diagnostic", "KoordError"),
    "koord.syntax.source": ("Source", "Span"),
}

_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = ("__version__", *_HOME)


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(_HOME[name]), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
