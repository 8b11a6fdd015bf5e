"""The compiler from core programs to Python: ``koord compile``."""

from koord.runtime.compile.naming import NotCompilableError, NumberTooLargeError
from koord.runtime.compile.program import compiled

__all__ = ["NotCompilableError", "NumberTooLargeError", "compiled"]
