"""Machine code of programs that is made when it is wanted for the first time."""

from __future__ import annotations

import sys

from koord.runtime.compile.machine.made import Turns
from koord.runtime.compile.watching import Watched
from koord.syntax import core

#: Compiling takes as long as so many turns by compiled robots, with what is looked at of them, and
#: a run may be over before. And importing llvmlite, where nobody has done so.
_WORTH_TURNS, _WORTH_TURNS_AND_IMPORT = 2_500, 10_000


class LazyTurns:
    """The machine code of a program, and of the claims that are watched, made when it is asked for.

    None where there is none.
    """

    def __init__(self, program: core.Program, watched: Watched | None = None) -> None:
        self.is_made = False
        self._program, self._watched = program, watched
        self._turns: Turns | None = None

    def without_claims(self) -> LazyTurns:
        """The same for who looks at no claims."""
        return self if self.is_made else LazyTurns(self._program)

    @property
    def worth_turns(self) -> int:
        """Making it takes as long as so many turns by compiled robots."""
        return _WORTH_TURNS if "llvmlite" in sys.modules else _WORTH_TURNS_AND_IMPORT

    def __call__(self) -> Turns | None:
        """The machine code. It takes llvmlite (extra ``fast``); without it there is none."""
        if not self.is_made:
            self.is_made = True
            try:
                from koord.runtime.compile.machine.turns import turns_of
            except ModuleNotFoundError:
                return None
            self._turns = turns_of(self._program, self._watched)
        return self._turns
