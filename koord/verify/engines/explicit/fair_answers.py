"""What a graph of whole rounds says of liveness: lassos, proofs, and what these need.
[T-FAIR-CYCLE]

The graph is that of Python or that of machine code: both give their nodes, edges and fair sets.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from itertools import islice
from typing import NamedTuple, Protocol

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.liveness import Response, expected, locks_of
from koord.semantics.recordings import Recording, Round
from koord.syntax import core
from koord.syntax.system import System
from koord.verify.different_responses import different_responses
from koord.verify.engines.explicit.fair_cycles import (
    Edge,
    FairnessConditions,
    Graph,
    Stems,
    Way,
    fair_loop,
    short_loop,
)
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.found_runs import Tracer
from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
from koord.verify.engines.explicit.states import State

#: Shorter lassos are looked for from so many nodes at most, with so many tries for each.
_MOST_ENTRIES = 200
_MOST_TRIES = 2_000


class Fairness(Struct, frozen=True):
    """The fairness that a proof needs: of robots, of locks, and named expectations."""

    robots: bool = False
    locks: bool = False
    expectations: tuple[str, ...] = ()


class FairCycleReport(Struct, frozen=True):
    """The results of a search for fair cycles, per property.

    ``violated`` has a lasso for each that is, ``needs`` what the proof of each that holds rests on;
    if the search did not end by itself, nothing holds. ``is_empty`` says that no run is fair at
    all: then everything holds, of nothing. ``is_compiled`` says that the graph is machine code's.
    """

    violated: dict[str, Recording]
    needs: dict[str, Fairness]
    end: Exhausted | OutOfBounds | NotFinite
    is_empty: bool = False
    is_compiled: bool = False


class Region(Struct, frozen=True):
    """The nodes in which a run that breaks a response may stay for ever, and its entries.

    ``roots`` is where runs start that come to enter it.
    """

    nodes: Container[int]
    starts: Container[int]
    roots: tuple[int, ...]


class FairGraph(Protocol):
    """A graph of whole rounds: of each node the edges, and who asks for what."""

    @property
    def graph(self) -> Graph: ...

    def region(self, response: Response | None) -> Region:
        """The region of a response; of all runs, if there is none."""

    def fair_set(self, region: Region, wanted: FairnessConditions) -> frozenset[int] | None:
        """A fair set in a region, or None."""

    def is_fair(self, region: Region, wanted: FairnessConditions) -> bool:
        """Return whether there is a fair set in a region."""

    def components(self, region: Region) -> Sequence[int]:
        """Of each node the number of its strongly connected component in a region, or 0."""

    def state(self, node: int) -> State: ...

    def owed(self, node: int) -> int: ...

    def as_good_as(self, node: int) -> list[int]:
        """The nodes of the same state that owe no more: a cycle that ends there is infinite."""


class RoundLabels(Protocol):
    """How Python labels the rounds from a state that owes so much."""

    def label_of(self, state: State, owed: int, round_: Round) -> tuple[int, int]: ...


class _Lasso(NamedTuple):
    """A lasso in the graph: a path to a node, and a cycle from there."""

    entry: int
    stem: Way
    loop: Way

    @property
    def rounds(self) -> int:
        return len(self.stem) + len(self.loop)


class _Component(Container[int]):
    """The nodes of a strongly connected component: a cycle through one has no others."""

    def __init__(self, numbers: Sequence[int], number: int) -> None:
        self._numbers, self._number = numbers, number

    def __contains__(self, node: object) -> bool:
        assert isinstance(node, int)
        return self._numbers[node] == self._number


class FairAnswers:
    """What a graph says of some properties. ``labels`` and ``tracer`` write lassos down."""

    def __init__(
        self, system: System, graph: FairGraph, labels: RoundLabels, tracer: Tracer
    ) -> None:
        self._system, self._fair = system, graph
        self._labels, self._tracer = labels, tracer
        self._spend = system.budget.spend
        self._expected = expected(system)
        self._locks = locks_of(system)

    def of(
        self, properties: Sequence[core.Property], end: Exhausted | OutOfBounds
    ) -> FairCycleReport:
        """Decide each property, as far as the graph goes."""
        everything = self._everything
        violated: dict[str, Recording] = {}
        needs: dict[str, Fairness] = {}
        for stated in properties:
            regions = list(self._regions(stated))
            lasso = self._lasso(regions, everything)
            if lasso is not None:
                violated[stated.name] = lasso
            elif isinstance(end, Exhausted):
                needs[stated.name] = self._least(regions, everything)
        is_empty = isinstance(end, Exhausted) and not self._fair.is_fair(
            self._fair.region(None), self._wanted(everything)
        )
        return FairCycleReport(violated, needs, end, is_empty)

    def is_violated(self, stated: core.Property) -> bool:
        """Return whether some fair run of the graph breaks a property."""
        wanted = self._wanted(self._everything)
        return any(self._fair.is_fair(region, wanted) for region in self._regions(stated))

    @property
    def _everything(self) -> Fairness:
        """All the fairness that there is."""
        names = tuple(dict.fromkeys(response.name for response in self._expected))
        return Fairness(robots=True, locks=bool(self._locks), expectations=names)

    def _regions(self, stated: core.Property) -> Iterator[Region]:
        """The regions of what a property says, each made when it is asked for."""
        return map(self._fair.region, different_responses(self._system, stated))

    def _wanted(self, of: Fairness) -> FairnessConditions:
        count = self._system.robots
        met = (1 << count) - 1 if of.robots else 0
        for k, response in enumerate(self._expected):
            met |= (1 << count + k) if response.name in of.expectations else 0
        return FairnessConditions(met, (1 << len(self._locks)) - 1 if of.locks else 0)

    def _least(self, regions: list[Region], known: Fairness) -> Fairness:
        """A minimal fairness for the proof: conditions are dropped one after the other."""
        for less in _weaker(known):
            if not any(self._fair.is_fair(region, self._wanted(less)) for region in regions):
                return self._least(regions, less)
        return known

    # --- lassos ---------------------------------------------------------------------------------

    def _lasso(self, regions: list[Region], fairness: Fairness) -> Recording | None:
        """The lasso of a fair run that breaks one of the responses, or None. [LASSO]

        It is a short one, and one with the fewest rounds unless it takes long to find that.
        """
        graph, wanted = self._fair.graph, self._wanted(fairness)
        best: _Lasso | None = None
        for region in regions:
            part = self._fair.fair_set(region, wanted)
            if part is None:
                continue
            roots, starts, nodes = region.roots, region.starts, region.nodes
            stems = Stems(graph, roots, starts, nodes, self._spend, part, _MOST_ENTRIES)
            reached = (node for node in stems.lengths if node in part)
            entry = min(reached, key=lambda node: (stems.lengths[node], node))
            found = _Lasso(entry, stems.to(entry), fair_loop(graph, part, entry, wanted))
            if best is None or found.rounds < best.rounds:
                best = found
            numbers: Sequence[int] | None = None
            for entry, length in islice(stems.lengths.items(), _MOST_ENTRIES):
                self._spend()
                most = best.rounds - 1 - length
                if most < 1:
                    break
                ends = self._fair.as_good_as(entry)
                among = nodes
                if ends == [entry]:
                    if numbers is None:
                        numbers = self._fair.components(region)
                    among = _Component(numbers, numbers[entry])
                loop = short_loop(graph, among, entry, ends, wanted, most, _MOST_TRIES)
                if loop is not None:
                    best = _Lasso(entry, stems.to(entry), loop)
        return None if best is None else self._recording(best)

    def _recording(self, lasso: _Lasso) -> Recording:
        start = lasso.stem[0][0] if lasso.stem else lasso.entry
        recording = self._tracer.run([self._fair.state(start)])
        taken = [self._round(node, edge) for node, edge in [*lasso.stem, *lasso.loop]]
        return replace(recording, rounds=tuple(taken), loop=len(lasso.stem))

    def _round(self, node: int, edge: Edge) -> Round:
        """The moves of a round along an edge with a given label."""
        state, target = self._fair.state(node), self._fair.state(edge.target)
        owed = self._fair.owed(node)
        for round_, after in self._tracer.rounds(state):
            if after == target and self._labels.label_of(state, owed, round_) == edge[1:]:
                return round_
        raise AssertionError("the search has seen a round that there is not")


def _weaker(known: Fairness) -> Iterator[Fairness]:
    if known.locks:
        yield replace(known, locks=False)
    for name in known.expectations:
        rest = tuple(other for other in known.expectations if other != name)
        yield replace(known, expectations=rest)
    if known.robots:
        yield replace(known, robots=False)
