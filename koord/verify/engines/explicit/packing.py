"""States of a search as packed ones of machine code, and back. [CONFIG]"""

from __future__ import annotations

from collections.abc import Sequence

from koord.kernels.layout import Layout, unset_somewhere
from koord.kernels.terms import NoKernelError
from koord.syntax.analysis.symmetry import Symmetry
from koord.syntax.system import System
from koord.verify.engines.explicit.states import State, StateStore

#: The widths of cells that are tried, in bits.
_WIDTHS = (8, 16, 32)

#: So many contents of the store are remembered with what their cells hold.
_MOST_SHARED = 100_000


class Packing:
    """The packed states of a search that begins with some states, ``starts``.

    ``bits`` is the width of cells.

    Raises NoKernelError where there are none.
    """

    def __init__(
        self,
        system: System,
        vault: StateStore,
        starts: Sequence[State],
        symmetry: Symmetry | None = None,
        *,
        tracks_ran: bool,
    ) -> None:
        self._system, self._vault = system, vault
        found = [vault.configuration(state) for state in starts]
        unset = unset_somewhere(system, found)
        self.layout = Layout(system, symmetry, unset, tracks_ran=tracks_ran)
        self.starts = [self.layout.numbers(start) for start in found]
        bits = next((b for b in _WIDTHS if all(_fit(n, b) for n in self.starts)), None)
        if bits is None:
            raise NoKernelError("an integer is too large")
        self.bits = bits
        self._robots: dict[tuple[int, int], list[int]] = {}
        self._shared: dict[tuple[int, ...], list[int]] = {}

    def numbers(self, state: State) -> list[int]:
        """What the cells of a state hold, each part of it worked out once."""
        count, vault, layout = self._system.robots, self._vault, self.layout
        shared, numbers = state[count:], list[int]()
        for key in enumerate(state[:count]):
            own = self._robots.get(key)
            if own is None:
                store = vault.store(state)
                own = layout.robot_numbers(key[0], vault.state_of(key[1], store), store)
                self._robots[key] = own
            numbers += own
        rest = self._shared.get(shared)
        if rest is None:
            if len(self._shared) > _MOST_SHARED:
                self._shared.clear()
            rest = self._shared[shared] = layout.shared_numbers(vault.store(state))
        return numbers + rest

    def state(self, numbers: Sequence[int]) -> State:
        """The state whose cells hold some numbers."""
        made = self.layout.from_numbers(numbers)
        robots = (self._vault.robot(i, robot) for i, robot in enumerate(made.robots))
        return (*robots, *self._vault.shared(made.store))


def _fit(numbers: Sequence[int], bits: int) -> bool:
    most = 2 ** (bits - 1)
    return all(-most <= number < most for number in numbers)
