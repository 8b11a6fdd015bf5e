"""The writes of robots to allwrite variables in one round, and the possible stores. [T-COMMIT]"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from itertools import permutations
from typing import NamedTuple

from koord.semantics.domain import EXACT, Constant
from koord.semantics.locations import Mask
from koord.semantics.properties import overlap
from koord.verify.engines.explicit.cells import CACHE_LIMIT, Interner
from koord.verify.engines.explicit.recipes import VariableEffect
from koord.verify.engines.explicit.states import StateStore

#: The number of the write that writes nothing.
NOTHING = 0

#: The numbers of what the allwrite variables hold.
Shared = tuple[int, ...]


class TurnWrites(NamedTuple):
    """The writes of one turn to allwrite variables.

    ``updates`` are the variables that it computes from their own old values outside of ``atomic``.
    """

    parts: tuple[VariableEffect, ...] = ()
    updates: frozenset[int] = frozenset()


class StoreOutcome(NamedTuple):
    """A possible store after a round, and an order of the writers that leads to it.

    ``order`` lists positions in the sequence of writes.
    """

    shared: Shared
    order: tuple[int, ...]


class Commits:
    """Interned writes, and the stores they lead to, each computed once.

    ``every_order`` tries all orders of all writers, whether or not they meet.
    """

    def __init__(self, vault: StateStore, *, every_order: bool = False) -> None:
        self._vault = vault
        self._every_order = every_order
        self._writes: Interner[TurnWrites] = Interner()
        assert self._writes.number(TurnWrites()) == NOTHING
        self._overlaps: dict[tuple[int, int], bool] = {}
        self._lost: dict[tuple[int, int], frozenset[int]] = {}
        self._ends: dict[tuple[Shared, tuple[int, ...]], tuple[StoreOutcome, ...]] = {}

    def number(
        self, parts: tuple[VariableEffect, ...], updates: frozenset[int] = frozenset()
    ) -> int:
        """The number of a turn's writes."""
        return self._writes.number(TurnWrites(parts, updates)) if parts else NOTHING

    def lost(self, mine: int, theirs: int) -> frozenset[int]:
        """The variables whose update by one write meets another write. [LOST-UPDATE]"""
        known = self._lost.get((mine, theirs))
        if known is None:
            others = {part.slot: part.mask for part in self._writes.values[theirs].parts}
            write = self._writes.values[mine]
            known = frozenset(
                part.slot
                for part in write.parts
                if part.slot in write.updates
                and overlap(EXACT, part.mask, others.get(part.slot)) is True
            )
            self._lost[mine, theirs] = known
        return known

    def ends(self, shared: Shared, writes: tuple[int, ...]) -> tuple[StoreOutcome, ...]:
        """The distinct stores in which the writes of a round may end."""
        if not writes:
            return (StoreOutcome(shared, ()),)
        known = self._ends.get((shared, writes))
        if known is None:
            if len(self._ends) > CACHE_LIMIT:
                self._ends.clear()
            known = self._ends[shared, writes] = tuple(self._worked_out(shared, writes))
        return known

    def _worked_out(self, shared: Shared, writes: tuple[int, ...]) -> Iterator[StoreOutcome]:
        """Compute the stores: writers that meet in every order, others in any order."""
        if self._every_order:
            for order in permutations(range(len(writes))):
                yield StoreOutcome(reduce(self._commit, (writes[k] for k in order), shared), order)
            return
        found = [StoreOutcome(shared, ())]
        for component in self._components(writes):
            found = [
                StoreOutcome(end.shared, (*before.order, *end.order))
                for before in found
                for end in self._orders(before.shared, writes, component)
            ]
        yield from found

    def _components(self, writes: tuple[int, ...]) -> list[list[int]]:
        """Groups of writers that meet, directly or through others, as positions."""
        components: list[list[int]] = []
        for position, write in enumerate(writes):
            met = [c for c in components if any(self._meet(write, writes[k]) for k in c)]
            components = [c for c in components if c not in met]
            components.append([*(k for c in met for k in c), position])
        return components

    def _meet(self, a: int, b: int) -> bool:
        known = self._overlaps.get((a, b))
        if known is None:
            others = {part.slot: part.mask for part in self._writes.values[b].parts}
            known = any(_meet(p.mask, others.get(p.slot)) for p in self._writes.values[a].parts)
            self._overlaps[a, b] = self._overlaps[b, a] = known
        return known

    def _orders(
        self, shared: Shared, writes: tuple[int, ...], component: Sequence[int]
    ) -> Iterable[StoreOutcome]:
        """The stores of one group. Orders with a common prefix and store are merged."""
        if len(component) == 1:
            return [StoreOutcome(self._commit(shared, writes[component[0]]), tuple(component))]
        reached: dict[tuple[frozenset[int], Shared], tuple[int, ...]] = {(frozenset(), shared): ()}
        for _ in component:
            further: dict[tuple[frozenset[int], Shared], tuple[int, ...]] = {}
            for (done, now), order in reached.items():
                # Whoever writes the same comes by number: any other order ends in the same store.
                first: dict[int, int] = {}
                for position in component:
                    if position not in done:
                        first.setdefault(writes[position], position)
                for position in first.values():
                    after = self._commit(now, writes[position])
                    further.setdefault((done | {position}, after), (*order, position))
            reached = further
        return [StoreOutcome(after, order) for (_, after), order in reached.items()]

    def _commit(self, shared: Shared, write: int) -> Shared:
        """The store after one write. [SHARED-ASSIGN]"""
        after = list(shared)
        for part in self._writes.values[write].parts:
            after[part.slot] = part.put(self._vault.allwrite[part.slot], after[part.slot])
        return tuple(after)


def _meet(mine: Mask[Constant], theirs: Mask[Constant] | None) -> bool:
    """Return whether the order of two writes may matter: a common location, or keys of one map."""
    if theirs is None:
        return False
    if overlap(EXACT, mine, theirs) is True or (mine.keys and theirs.keys):
        return True
    pairs = zip(mine.parts, theirs.parts, strict=False)
    return any(_meet(a, b) for a, b in pairs if a is not None)
