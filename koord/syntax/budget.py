"""Budgets: long computations check now and then whether to continue.

Evaluation is bounded by what a program may cost, which can still be many seconds, and formulas by
less. So a system carries the budget of whoever works with it, and evaluation spends it.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct

#: So much is done between two questions: some milliseconds at most.
_EVERY = 100

#: What as much machine code as is run at once takes, in steps: some milliseconds, too.
BATCH = 100


class OutOfBudgetError(Exception):
    """Raised where the budget is used up: time is over, or the work was interrupted."""


class Budget(Struct, eq=False):
    """A budget of work; ``is_over`` says whether to stop.

    What is half done by then is lost, so it must not count. ``heard`` is told of work now and then,
    how much of it was done since; it hears of that of all parts, and of what no ration counts.
    """

    is_over: Callable[[], bool]
    whole: Budget | None = None  #: that this one is a part of
    heard: Callable[[int], None] | None = None
    _left: int = _EVERY

    def __reduce__(self) -> tuple[object, ...]:
        # Who is asked whether it is over is no part of what is sent: elsewhere others look on.
        return _endless, ()

    def spend(self, steps: int = 1) -> None:
        """Spend work; check now and then whether to continue. Raises OutOfBudgetError."""
        self._left -= steps
        while self._left < 0:
            self._left += _EVERY
            self.report(_EVERY)
            if self.is_over():
                raise OutOfBudgetError

    def report(self, steps: int) -> None:
        """Tell whoever hears of it of work that was done, as by a solver, which is no step."""
        root = self.root
        if root.heard is not None:
            root.heard(steps)

    @property
    def root(self) -> Budget:
        """The budget that this one is a part of, or a part of a part; or itself."""
        return self if self.whole is None else self.whole.root

    def rationed(self, most: int) -> Budget:
        """A part of this budget, of about so much work, counted alike on every machine."""
        return Ration(self, most).budget()


class Ration(Struct):
    """A part of a budget, which may be used up sooner; it can be filled again."""

    whole: Budget
    left: int

    def budget(self) -> Budget:
        """The part as a budget."""
        return Budget(self.is_over, self.whole)

    def is_over(self) -> bool:
        self.left -= _EVERY
        return self.left < 0 or self.whole.is_over()


class Count(Struct):
    """A count of what is spent of a budget, about, as ``Budget(count.is_over, whole)``."""

    whole: Budget
    steps: int = 0

    def is_over(self) -> bool:
        self.steps += _EVERY
        return self.whole.is_over()


def _never() -> bool:
    return False


#: A budget without end.
ENDLESS = Budget(_never)


def _endless() -> Budget:
    return ENDLESS
