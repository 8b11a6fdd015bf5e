"""Machine code of programs that is made when it is wanted for the first time."""

from __future__ import annotations

import sys
from functools import cached_property

from koord.machine import is_installed
from koord.runtime.compile.machine.made import Turns
from koord.runtime.compile.watching import Watched
from koord.syntax import core

#: Compiling takes as long as so many turns by compiled robots, with what is looked at of them, and
#: a run may be over before. And importing llvmlite, where nobody has done so; or loading what was
#: kept.
_WORTH_TURNS, _WORTH_TURNS_AND_IMPORT, _WORTH_KEPT_TURNS = 2_500, 10_000, 100


class LazyTurns:
    """The machine code of a program, and of the claims that are watched, made when it is asked for.

    None where there is none.
    """

    def __init__(self, program: core.Program, watched: Watched | None = None) -> None:
        self.is_made = False
        self._program, self._watched = program, watched
        self._turns: Turns | None = None
        self._is_kept: bool | None = None

    def without_claims(self) -> LazyTurns:
        """The same for who looks at no claims."""
        return self if self.is_made else LazyTurns(self._program)

    @property
    def worth_turns(self) -> int:
        """Making it takes as long as so many turns by compiled robots."""
        if self._is_kept is None:
            self._is_kept = is_installed() and self._are_kept()
        if self._is_kept:
            return _WORTH_KEPT_TURNS
        return _WORTH_TURNS if "llvmlite.binding" in sys.modules else _WORTH_TURNS_AND_IMPORT

    def _are_kept(self) -> bool:
        from koord.machine.kept import is_kept

        return is_kept(self._key)

    @cached_property
    def _key(self) -> str | None:
        """The key of the machine code. To write out a program takes a while."""
        from koord.runtime.compile.machine.kept_turns import key_of_turns

        return key_of_turns(self._program, self._watched)

    def __call__(self) -> Turns | None:
        """The machine code. It takes llvmlite (extra ``fast``); without it there is none."""
        if not self.is_made:
            self.is_made = True
            if is_installed():
                self._turns = self._kept() or self._compiled()
        return self._turns

    def _kept(self) -> Turns | None:
        from koord.runtime.compile.machine.kept_turns import kept_turns

        return kept_turns(self._program, self._watched, self._key)

    def _compiled(self) -> Turns | None:
        try:
            from koord.runtime.compile.machine.turns import turns_of
        except ModuleNotFoundError:
            return None
        return turns_of(self._program, self._watched, self._key)
