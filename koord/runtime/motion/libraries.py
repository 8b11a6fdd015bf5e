"""Diagnostics for libraries of the motion room that are not installed."""

from __future__ import annotations

from importlib.util import find_spec

from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import NOWHERE

#: The optional dependencies of motion and simulation, by the extra that has them.
SIM = ("numpy", "ompl", "pymunk", "scipy", "shapely")


def missing(library: str, extra: str) -> KoordError:
    """The error for a library that cannot be imported, and the extra that has it. (K950)"""
    return absent(library, f"pip install 'koord[{extra}]'")


def absent(library: str, install: str) -> KoordError:
    """The error for libraries that cannot be imported, and the command that installs them. (K950)

    ``library`` is a name, or several with commas between them.
    """
    is_ = "are" if "," in library else "is"
    return KoordError(
        (
            Diagnostic(
                "K950",
                Severity.ERROR,
                NOWHERE,
                f"{library} {is_} needed for this and {is_} not installed",
                f"install it with: {install}",
            ),
        )
    )


def require(libraries: tuple[str, ...], extra: str) -> None:
    """Check that libraries are installed. Raises KoordError for those that are not."""
    absent = [name for name in libraries if find_spec(name) is None]
    if absent:
        raise missing(", ".join(absent), extra)
