"""Machine code by LLVM, and how it is loaded."""

from importlib.util import find_spec


def is_installed() -> bool:
    """Return whether there is llvmlite (extra ``fast``), without which no machine code is made."""
    return find_spec("llvmlite") is not None
