"""From core programs to Python: `koord compile`."""

from koord.runtime.compile.program import compiled
from koord.runtime.compile.spelling import NotCompilableError, NumberTooLargeError

__all__ = ["NotCompilableError", "NumberTooLargeError", "compiled"]
