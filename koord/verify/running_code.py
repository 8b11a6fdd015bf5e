"""The code that is running, by name: two machines with the same one give the same answers."""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from koord.verify.engines.bits.abc import installed
from koord.version import __version__

#: What may find other proofs, or other runs, in another version.
_SOLVERS = ("z3-solver", "python-sat", "llvmlite")

_ROOT = Path(__file__).resolve().parent.parent


@cache
def code_here() -> str:
    """Koord by version and digest of its files, solvers and Python by version.

    >>> code_here()
    'koord 0.1.0 (4f1c09d2ab17), z3-solver 4.13.0, python-sat 1.8, no llvmlite, no abc, Python 3.11'
    """
    digest = hashlib.sha256()
    for path in sorted(_ROOT.rglob("*")):
        if path.suffix in (".py", ".krd", ".lark"):
            digest.update(path.relative_to(_ROOT).as_posix().encode())
            digest.update(path.read_bytes())
    parts = [f"koord {__version__} ({digest.hexdigest()[:12]})", *map(_told, _SOLVERS)]
    parts += ["no abc" if installed() is None else "abc"]
    return ", ".join([*parts, f"Python {sys.version_info[0]}.{sys.version_info[1]}"])


def _told(package: str) -> str:
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return f"no {package}"
