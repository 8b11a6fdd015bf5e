"""What is looked at in a run that goes by whole rounds."""

from __future__ import annotations

from msgspec import Struct

from koord.syntax import core


class Claims(Struct, frozen=True):
    """Statements that are looked at after each step, or between rounds.

    Those that are ``sought`` are looked at between rounds as well, until they are met.
    """

    always: tuple[core.Expr, ...] = ()
    between_rounds: tuple[core.Expr, ...] = ()
    sought: tuple[core.Expr, ...] = ()

    def includes(self, others: Claims) -> bool:
        """Return whether code for these looks at the others as well, and at no more for sure."""
        same = (self.always, self.between_rounds) == (others.always, others.between_rounds)
        return same and all(one in self.sought for one in others.sought)
