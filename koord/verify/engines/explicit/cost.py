"""What a search by Python costs, and from where on machine code costs less.

Costs are in about a microsecond, and counted alike on every machine: no clock says which road a
search takes. Prices are fitted to 315 measurements of the examples with 3 to 5 robots; nine in ten
took 0.7 to 2.6 times what is counted, where few rounds stand for many states a tenth.
"""

from __future__ import annotations

from msgspec import Struct

#: What making machine code costs, about. A search goes over to it where Python has cost as much:
#: what takes less is done before any is made, what takes more takes about twice as long at most.
COMPILED_FROM = 400_000

#: The same of graphs of whole runs, whose machine code is shorter.
FAIR_COMPILED_FROM = 150_000

_STATE, _JOINT, _WAY, _STEP, _LOOK = 4, 35, 1, 40, 3


class Cost(Struct):
    """The work of a search so far, beside its states and what it has spent of a budget."""

    joints: int = 0  #: joint transitions, from all states
    ways: int = 0  #: configurations after them
    looked_at: int = 0  #: contents that were looked at or renamed for representatives

    def of(self, states: int, spent: int) -> int:
        """The cost with so many states, if so much is spent of the budget.

        Each joint transition and each configuration after one has spent one step of it.
        """
        steps = max(0, spent - self.joints - self.ways)
        return (
            _STATE * states
            + _JOINT * self.joints
            + _WAY * self.ways
            + _STEP * steps
            + _LOOK * self.looked_at
        )
