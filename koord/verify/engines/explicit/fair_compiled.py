"""The graph of whole rounds on machine code, where a system has any. [T-FAIR-CYCLE]
[T-FULL-STATES]

:mod:`koord.kernels` has what :mod:`fair_search` says, for packed states. Of nodes chosen by a
generator of random numbers with a fixed seed Python works out the edges as well: they have to be
the same, with their labels, and so has who asks and where statements hold. Components are looked at
once more by what makes them a proof. A lasso is written down by the road of Python, so that nothing
that machine code says is shown without having been worked out again.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from itertools import islice
from random import Random
from typing import TYPE_CHECKING, Protocol, TypeVar, overload

from koord.semantics.liveness import Response, expected
from koord.syntax import core
from koord.syntax.budget import BATCH, OutOfBudgetError
from koord.syntax.system import System
from koord.verify.engines.explicit.fair_answers import FairCycleReport, Region
from koord.verify.engines.explicit.fair_cycles import Edge, FairnessConditions, Graph, add_edge
from koord.verify.engines.explicit.fair_lookout import Lookout
from koord.verify.engines.explicit.limits import LimitReachedError, Meter
from koord.verify.engines.explicit.packing import Packing
from koord.verify.engines.explicit.property_checks import (
    Exhausted,
    OutOfBounds,
    end_of,
)
from koord.verify.engines.explicit.second_look import DisagreementError
from koord.verify.engines.explicit.states import State, StateStore

if TYPE_CHECKING:
    from koord.kernels.fair_exploration import FairExploration, Parts
    from koord.kernels.fair_labels import LabelBits

T = TypeVar("T")

#: So many nodes are looked at in one go at first, and at most.
_FIRST_BATCH, _MOST_BATCH = 16, 4_096

#: So many edges Python works out at first, and one more for so many of machine code.
_AT_FIRST, _EDGES_PER_LOOK = 500, 32_768

#: Of one node so many are, and of one batch so many nodes; statements are looked at in so many.
_MOST_AFTER_ONE, _MOST_NODES, _STATED_NODES = 400, 4, 30

#: As long as Python takes for a way to go on, machine code takes for so many, or more.
_COMPILED_EDGES = 256


#: Of so many nodes edges are kept that were read: lassos go through few of them again and again.
_MOST_HELD = 65_536


class Reference(Protocol):
    """What the road of Python says of a state, with which machine code is compared."""

    def ways(self, state: State, owed: int) -> Iterator[tuple[State, int, int]]: ...

    def owes(self, state: State, owed: int) -> int: ...

    def asks(self, state: State) -> int: ...

    def holds(self, statement: core.Property, state: State) -> bool: ...


class CompiledGraph:
    """A graph by machine code. ``states`` counts its nodes, ``depth`` the rounds to the last."""

    def __init__(
        self,
        system: System,
        vault: StateStore,
        asked: Sequence[Response],
        starts: Sequence[State],
        reference: Reference,
        most_mb: int,
    ) -> None:
        """Raises NoKernelError, or ImportError where there is nothing to make machine code with."""
        from koord.kernels.exploration import OutOfRoomError
        from koord.kernels.fair_exploration import FairExploration
        from koord.kernels.fair_rounds import FairRounds
        from koord.kernels.terms import NoKernelError

        self._system, self._reference = system, reference
        owing = expected(system)
        self._packing = packing = Packing(system, vault, starts, tracks_ran=True)
        cells = packing.layout.beside(len(owing))
        self._statements = list(dict.fromkeys(s for response in asked for s in response.statements))
        pairs = [
            (_stated(response.trigger), _stated(response.goal))
            for response in owing
            if response.trigger is not None
        ]
        rounds = FairRounds(
            packing.layout,
            packing.bits,
            cells,
            pairs,
            [_stated(s) for s in self._statements],
            tracks_ran=vault.tracks_ran,
        )
        self._bits: LabelBits = rounds.labels
        self._first_owed = len(packing.layout.cells) - len(cells)
        self._random = Random(1)
        self._looked = 0
        self._expanded = 0
        self.depth = 0
        try:
            self._exploration: FairExploration = FairExploration(rounds, most_mb * 1_000_000)
            found = [self._exploration.enter(self._numbers(start, 0)) for start in starts]
        except OutOfRoomError:
            raise NoKernelError("there is no memory for tables") from None
        self._starts = tuple(dict.fromkeys(found))

    @property
    def states(self) -> int:
        """So many nodes were seen."""
        return self._exploration.states

    # --- building -------------------------------------------------------------------------------

    def build(
        self,
        meter: Meter,
        most_edges: int | None,
        lookout: Lookout,
        tell: Callable[[int, int], None],
    ) -> FairCycleReport | Exhausted | OutOfBounds:
        """Look at all nodes, as far as limits allow, or until all is violated.

        Raises NoKernelError.
        """
        try:
            report = self._build(meter, most_edges, lookout, tell)
        except (LimitReachedError, OutOfBudgetError) as error:
            self._exploration.finish(self._expanded)
            end = end_of(error, self.states, self.depth)
            assert isinstance(end, OutOfBounds)
            if isinstance(error, OutOfBudgetError):
                raise
            return end
        self._exploration.finish(self._expanded)
        return report or Exhausted(self.states, self.depth)

    def _build(
        self,
        meter: Meter,
        most_edges: int | None,
        lookout: Lookout,
        tell: Callable[[int, int], None],
    ) -> FairCycleReport | None:
        from koord.kernels.exploration import OutOfRoomError

        exploration, batch = self._exploration, _FIRST_BATCH
        while self._expanded < exploration.states:
            if self.depth == meter.limits.rounds:
                raise LimitReachedError(f"more than {self.depth} rounds")
            end = exploration.states
            while self._expanded < end:
                reached = meter.reached_now(exploration.states, meter.limits.compiled_states)
                if reached:
                    raise LimitReachedError(reached)
                if most_edges is not None and exploration.work > most_edges * _COMPILED_EDGES:
                    raise LimitReachedError(f"more than {most_edges} ways to go on")
                self._system.budget.spend(min(batch, BATCH))
                first = self._expanded
                try:
                    self._expanded = exploration.expand(first, min(end, first + batch))
                except OutOfRoomError:
                    most = meter.limits.memory_mb
                    raise LimitReachedError(f"more than {most} MB of memory") from None
                batch = min(2 * batch, _MOST_BATCH)
                tell(exploration.states, self.depth)
                self._look_again(first, self._expanded)
                whole = self.depth + (self._expanded == end)
                if self._expanded < exploration.states and lookout.is_due(self._expanded, whole):
                    exploration.finish(self._expanded)
                    report = lookout.look(exploration.states, self._expanded, whole)
                    if report is not None:
                        return report
            if self._expanded < exploration.states:
                self.depth += 1
        return None

    # --- what machine code says, held against Python --------------------------------------------

    def _look_again(self, first: int, end: int) -> None:
        """Work out the edges of some nodes once more. Raises DisagreementError."""
        for _ in range(min(_MOST_NODES, end - first)):
            if self._looked > _AT_FIRST + self._exploration.work // _EDGES_PER_LOOK:
                return
            self._look(self._random.randrange(first, end))

    def _look(self, node: int) -> None:
        state, owed, reference = self.state(node), self.owed(node), self._reference
        if reference.asks(state) != self._asks(node):
            raise DisagreementError("machine code does not see who asks")
        found: dict[int, list[Edge]] = {}
        ways = reference.ways(state, owed)
        for after, meets, grants in islice(ways, _MOST_AFTER_ONE):
            self._looked += 1
            target = self._number(after, reference.owes(after, owed))
            if target < 0:
                raise DisagreementError("machine code misses a state")
            add_edge(found.setdefault(target, []), Edge(target, meets, grants))
        theirs: dict[int, list[Edge]] = {}
        for edge in self.edges_of(node):
            add_edge(theirs.setdefault(edge.target, []), edge)
        if next(ways, None) is None:
            is_same = theirs.keys() == found.keys() and all(
                set(edges) == set(theirs[target]) for target, edges in found.items()
            )
        else:
            is_same = all(
                any(_covers(its, edge) for its in theirs.get(target, ()))
                for target, edges in found.items()
                for edge in edges
            )
        if not is_same:
            raise DisagreementError("machine code has other ways to go on")

    def _marked(self, statement: core.Property) -> bytearray:
        """Of each node whether a statement holds. Raises DisagreementError."""
        found = self._exploration.marked(self._statements.index(statement))
        for _ in range(min(_STATED_NODES, len(found))):
            node = self._random.randrange(len(found))
            if self._reference.holds(statement, self.state(node)) != bool(found[node]):
                raise DisagreementError("machine code evaluates otherwise")
        return found

    # --- the graph ------------------------------------------------------------------------------

    @property
    def graph(self) -> Graph:
        """Edges, and who asks for what; each is read when it is looked at."""
        count = self.states
        return Graph(_Read(self.edges_of, count), _Read(self._asks, count))

    def edges_of(self, node: int) -> tuple[Edge, ...]:
        """The edges of a node."""
        bits, label = self._bits, self._exploration.label(node)
        idle = bits.met(label)
        return tuple(
            Edge(target, bits.met(its) | idle, bits.granted(its))
            for target, its in self._exploration.edges(node)
        )

    def _asks(self, node: int) -> int:
        return self._bits.granted(self._exploration.label(node))

    def state(self, node: int) -> State:
        """The state of a node."""
        return self._packing.state(self._exploration.numbers(node))

    def owed(self, node: int) -> int:
        """What a node owes, a bit an expectation."""
        held = self._exploration.numbers(node)[self._first_owed :]
        return sum(1 << k for k, owes in enumerate(held) if owes)

    def as_good_as(self, node: int) -> list[int]:
        """The nodes of the same state that owe no more."""
        state, owed = self.state(node), self.owed(node)
        every = range(1 << len(expected(self._system)))
        found = (self._number(state, less) for less in every if not less & ~owed)
        return [number for number in found if number >= 0]

    def _numbers(self, state: State, owed: int) -> list[int]:
        numbers = self._packing.numbers(state)
        first = len(numbers) - len(expected(self._system))
        for k in range(len(numbers) - first):
            numbers[first + k] = owed >> k & 1
        return numbers

    def _number(self, state: State, owed: int) -> int:
        """The number of the node of a state that owes so much, or -1."""
        return self._exploration.lookup(self._numbers(state, owed))

    def components(self, region: Region) -> memoryview[int]:
        """Of each node the number of its strongly connected component in a region, or 0."""
        assert isinstance(region, CompiledRegion)
        return region.numbers

    # --- fair sets ------------------------------------------------------------------------------

    def region(self, response: Response | None) -> Region:
        """The region of a response; of all runs, if there is none. Raises FlawedError."""
        starts = bytearray(self.states)
        for start in self._starts:
            starts[start] = 1
        if response is None:
            return self._region(bytes(starts), b"\1" * self.states, self._starts)
        wanting = self._marked(response.goal).translate(_OTHER)
        roots = self._starts
        if response.trigger is None:
            roots = tuple(start for start in roots if wanting[start])
        else:
            starts = self._marked(response.trigger)
        return self._region(_both(starts, wanting), bytes(wanting), roots)

    def _region(self, entries: bytes, alive: bytes, roots: tuple[int, ...]) -> CompiledRegion:
        self._system.budget.spend(min(self.states, BATCH))
        parts = self._exploration.parts(entries, alive)
        nodes, starts = _Members(parts.numbers), _Members(memoryview(entries))
        return CompiledRegion(nodes, starts, roots, entries, alive, parts.numbers, parts.kinds())

    def fair_set(self, region: Region, wanted: FairnessConditions) -> frozenset[int] | None:
        """A fair set in a region, or None. Raises FlawedError."""
        found = self._fair_part(region, wanted)
        return None if found is None else found[0].members(found[1])

    def is_fair(self, region: Region, wanted: FairnessConditions) -> bool:
        """Return whether there is a fair set in a region. Raises FlawedError."""
        assert isinstance(region, CompiledRegion)
        is_whole = region.is_fair(*self._bits.wanted(*wanted))
        return is_whole or self._fair_part(region, wanted) is not None

    def _fair_part(self, region: Region, wanted: FairnessConditions) -> tuple[Parts, int] | None:
        assert isinstance(region, CompiledRegion)
        met, granted = self._bits.wanted(*wanted)
        if not region.may_be_fair(met):
            return None
        self._system.budget.spend(min(self.states, BATCH))
        return self._exploration.parts(region.entries, region.alive).fair(met, granted)


class CompiledRegion(Region, frozen=True):
    """A region as sets of machine code: its entries, and all nodes that wait for the goal.

    ``numbers`` are those of components of what the entries lead to, of each node or 0.
    ``kinds`` are the labels of edges within a component and of its nodes, of all components.
    """

    entries: bytes
    alive: bytes
    numbers: memoryview[int]
    kinds: frozenset[tuple[int, int]]

    def may_be_fair(self, met: int) -> bool:
        """Return whether some component has all that is wanted of each; parts of it have less."""
        return any(not met & ~(edges | nodes) for edges, nodes in self.kinds)

    def is_fair(self, met: int, granted: int) -> bool:
        """Return whether some component is a fair set as a whole."""
        return any(
            not met & ~(edges | nodes) and not nodes & granted & ~edges
            for edges, nodes in self.kinds
        )


class _Members(Container[int]):
    """The nodes for which some numbers are not zero."""

    def __init__(self, held: memoryview[int]) -> None:
        self._held = held

    def __contains__(self, node: object) -> bool:
        assert isinstance(node, int)
        return bool(self._held[node])


class _Read(Sequence[T]):
    """What is read of each node when it is looked at; that of the first ones is kept."""

    def __init__(self, read: Callable[[int], T], count: int) -> None:
        self._read, self._count = read, count
        self._held: dict[int, T] = {}

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, node: int) -> T: ...

    @overload
    def __getitem__(self, node: slice) -> list[T]: ...

    def __getitem__(self, node: int | slice) -> T | list[T]:
        if isinstance(node, slice):
            return [self[k] for k in range(*node.indices(self._count))]
        held = self._held.get(node)
        if held is None:
            held = self._read(node)
            if len(self._held) < _MOST_HELD:
                self._held[node] = held
        return held


#: Bytes that say whether something is not so, by those that say whether it is.
_OTHER = bytes([1, *[0] * 255])


def _both(one: bytes | bytearray, other: bytes | bytearray) -> bytes:
    """The nodes that are in two sets."""
    both = int.from_bytes(one, "little") & int.from_bytes(other, "little")
    return both.to_bytes(len(one), "little")


def _stated(statement: core.Property | None) -> tuple[core.Expr, int]:
    assert statement is not None
    return statement.condition, statement.bound


def _covers(edge: Edge, other: Edge) -> bool:
    return not other.meets & ~edge.meets and not other.grants & ~edge.grants
