"""Machine code of programs that is made when it is wanted for the first time."""

from __future__ import annotations

from koord.runtime.compile.machine.made import Turns
from koord.syntax import core


class LazyTurns:
    """The machine code of a program, made when it is asked for; None where there is none."""

    def __init__(self, program: core.Program) -> None:
        self.is_made = False
        self._program = program
        self._turns: Turns | None = None

    def __call__(self) -> Turns | None:
        """The machine code. It takes llvmlite (extra ``fast``); without it there is none."""
        if not self.is_made:
            self.is_made = True
            try:
                from koord.runtime.compile.machine.turns import turns_of
            except ModuleNotFoundError:
                return None
            self._turns = turns_of(self._program)
        return self._turns
