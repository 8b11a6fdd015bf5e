"""Liveness by explicit search: all states and edges, and the fair cycles in them. [T-FAIR-CYCLE]

Unlike the search for violated invariants it keeps every state and every edge: symmetry would
forget who is passed over, and a skip is told from an event that changes nothing. [T-FULL-STATES]
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.liveness import Response, expected, locks_of, reads_ran, responses
from koord.semantics.recordings import Recording, Round
from koord.syntax import core
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.system import System
from koord.verify.engines.explicit.commits import Commits
from koord.verify.engines.explicit.fair_cycles import (
    Edge,
    FairnessConditions,
    Graph,
    Stems,
    Way,
    fair_loop,
    fair_set,
    short_loop,
)
from koord.verify.engines.explicit.finiteness import NotFinite, not_finite
from koord.verify.engines.explicit.found_runs import Tracer, as_it_is
from koord.verify.engines.explicit.initial_states import openings
from koord.verify.engines.explicit.joint_transitions import JointTransition, JointTransitions
from koord.verify.engines.explicit.limits import LimitReachedError, Limits, Meter
from koord.verify.engines.explicit.property_checks import (
    ENDS,
    Check,
    Exhausted,
    OutOfBounds,
    check,
    end_of,
)
from koord.verify.engines.explicit.robot_transitions import Menu, Menus
from koord.verify.engines.explicit.states import State, StateStore

#: Told now and then: states seen, rounds finished.
Progress = Callable[[int, int], None]


class Fairness(Struct, frozen=True):
    """The fairness that a proof needs: of robots, of locks, and named expectations."""

    robots: bool = False
    locks: bool = False
    expectations: tuple[str, ...] = ()


class FairCycleReport(Struct, frozen=True):
    """The results of a search for fair cycles, per property.

    ``violated`` has a lasso for each that is, ``needs`` what the proof of each that holds rests on;
    if the search did not end by itself, nothing holds. ``is_empty`` says that no run is fair at
    all: then everything holds, of nothing.
    """

    violated: dict[str, Recording]
    needs: dict[str, Fairness]
    end: Exhausted | OutOfBounds | NotFinite
    is_empty: bool = False


def lively(
    system: System,
    properties: Sequence[core.Property],
    limits: Limits | None = None,
    *,
    most_edges: int | None = None,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> FairCycleReport:
    """Decide liveness properties on all reachable states. [PROP-EVENTUALLY] [PROP-LEADS-TO]

    Beside the limits there may be one of edges: many robots have many ways to go on from a state.
    """
    asked = [s for p in properties for r in responses(system, p) for s in r.statements]
    asked += [s for r in expected(system) for s in r.statements]
    reason = not_finite(system, asked)
    if reason is not None:
        return FairCycleReport({}, {}, reason)
    meter = Meter(limits if limits is not None else Limits(), clock)
    tracks_ran = any(reads_ran(system, p) for p in properties)
    search = _Search(system, meter, progress, most_edges, tracks_ran=tracks_ran)
    return search.run(properties)


#: Shorter lassos are looked for from so many nodes at most, with so many tries for each.
_MOST_ENTRIES = 200
_MOST_TRIES = 2_000


class _Lasso(NamedTuple):
    """A lasso in the graph: a path to a node, and a cycle from there."""

    entry: int
    stem: Way
    loop: Way

    @property
    def rounds(self) -> int:
        return len(self.stem) + len(self.loop)


class _Nodes(Struct):
    """The nodes of the graph. ``owed`` has a bit for each expectation that a node owes."""

    states: list[State] = field(default_factory=list)
    owed: list[int] = field(default_factory=list)
    asks: list[int] = field(default_factory=list)
    edges: list[tuple[Edge, ...]] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)
    numbers: dict[tuple[State, int], int] = field(default_factory=dict)


class _Search:
    """A search: builds the graph, then searches it for fair cycles."""

    def __init__(
        self,
        system: System,
        meter: Meter,
        progress: Progress | None,
        most_edges: int | None,
        *,
        tracks_ran: bool,
    ) -> None:
        vault = StateStore(system, tracks_ran=tracks_ran)
        self._system = system
        self._vault = vault
        self._meter = meter
        self._progress = progress
        self._most_edges = most_edges
        self._edges = 0
        self._commits = Commits(vault)
        menus = Menus(system, vault, self._commits, relaxed=True, labelled=True)
        self._joints = JointTransitions(system, vault, menus, self._commits, relaxed=True)
        self._assumptions = [check(system, vault, a) for a in system.program.assumptions]
        self._expected = [(r, *self._checks(r)) for r in expected(system)]
        self._locks = locks_of(system)
        self._bit = {pair: 1 << k for k, pair in enumerate(self._locks)}
        self._nodes = _Nodes()
        self._depth = 0

    def _checks(self, response: Response) -> tuple[Check | None, Check]:
        trigger = response.trigger
        goal = check(self._system, self._vault, response.goal)
        return (None if trigger is None else check(self._system, self._vault, trigger)), goal

    def run(self, properties: Sequence[core.Property]) -> FairCycleReport:
        """Build the graph, as far as limits allow, and decide each property."""
        end: Exhausted | OutOfBounds | NotFinite
        nodes = self._nodes
        try:
            self._build()
        except ENDS as error:
            end = end_of(error, len(nodes.states), self._depth)
            if isinstance(end, NotFinite) or isinstance(error, OutOfBudgetError):
                return FairCycleReport({}, {}, end)
        else:
            end = Exhausted(len(nodes.states), self._depth)
        # What was not looked at any more has no edges, so what is found is there all the same.
        nodes.edges += [()] * (len(nodes.states) - len(nodes.edges))
        nodes.asks += [0] * (len(nodes.states) - len(nodes.asks))
        try:
            return self._answered(properties, end)
        except OutOfBudgetError as error:
            return FairCycleReport({}, {}, end_of(error, len(nodes.states), self._depth))

    # --- the graph ------------------------------------------------------------------------------

    def _build(self) -> None:
        nodes = self._nodes
        for opened in openings(self._system, self._vault, self._commits):
            self._tick()
            if not opened.is_faulted and all(a.holds(opened.state) for a in self._assumptions):
                start = self._number(opened.state, 0)
                if start not in nodes.starts:
                    nodes.starts.append(start)
        last = len(nodes.states)
        while len(nodes.edges) < len(nodes.states):
            if len(nodes.edges) == last:
                self._depth += 1
                last = len(nodes.states)
            if self._depth == self._meter.limits.rounds:
                raise LimitReachedError(f"more than {self._depth} rounds")
            self._tick()
            self._expand(len(nodes.edges))

    def _number(self, state: State, owed: int) -> int:
        """The number of the node for a state and its predecessor's owed expectations.
        [FAIR-ASSUME]
        """
        for k, (_, trigger, goal) in enumerate(self._expected):
            assert trigger is not None
            bit = 1 << k
            if owed & bit or trigger.holds(state):
                owed = owed & ~bit if goal.holds(state) else owed | bit
        nodes = self._nodes
        key = (state, owed)
        number = nodes.numbers.setdefault(key, len(nodes.states))
        if number == len(nodes.states):
            nodes.states.append(state)
            nodes.owed.append(owed)
        return number

    def _expand(self, node: int) -> None:
        nodes, state = self._nodes, self._nodes.states[node]
        menus = self._joints.menus(state)
        found: dict[int, list[Edge]] = {}
        for joint in self._joints.joints(state, menus):
            self._system.budget.spend()
            if not joint.is_whole:
                continue
            meets, grants = self._label_of(node, menus, joint)
            for robots, shared in joint.successors():
                self._system.budget.spend()
                self._edges += 1
                if self._most_edges is not None and self._edges > self._most_edges:
                    raise LimitReachedError(f"more than {self._most_edges} ways to go on")
                target = self._number((*robots, *shared), nodes.owed[node])
                _add(found.setdefault(target, []), Edge(target, meets, grants))
        nodes.edges.append(tuple(edge for edges in found.values() for edge in edges))
        nodes.asks.append(sum(bit for (i, k), bit in self._bit.items() if menus[i].asks >> k & 1))

    def _label_of(self, node: int, menus: list[Menu], joint: JointTransition) -> tuple[int, int]:
        ran = [course.runs for course in joint.courses]
        classes = [course.classes for course in joint.courses]
        return self._label(node, menus, ran, classes)

    def _label(
        self, node: int, menus: list[Menu], ran: Sequence[bool], classes: Sequence[int]
    ) -> tuple[int, int]:
        """The conditions that a round meets and grants. [FAIR-ROBOT] [FAIR-LOCK] [FAIR-ASSUME]"""
        count = self._system.robots
        meets = sum(1 << i for i in range(count) if ran[i] or not menus[i].ready)
        paid = ~self._nodes.owed[node] & ((1 << len(self._expected)) - 1)
        grants = sum(bit for (i, k), bit in self._bit.items() if ran[i] and classes[i] >> k & 1)
        return meets | paid << count, grants

    def _tick(self) -> None:
        reached = self._meter.reached(len(self._nodes.states))
        if reached:
            raise LimitReachedError(reached)
        if self._progress is not None and self._meter.is_time_to_tell():
            self._progress(len(self._nodes.states), self._depth)

    # --- answers --------------------------------------------------------------------------------

    @property
    def _graph(self) -> Graph:
        return Graph(self._nodes.edges, self._nodes.asks)

    def _wanted(self, of: Fairness) -> FairnessConditions:
        count = self._system.robots
        met = (1 << count) - 1 if of.robots else 0
        for k, (response, _, _) in enumerate(self._expected):
            met |= (1 << count + k) if response.name in of.expectations else 0
        return FairnessConditions(met, (1 << len(self._locks)) - 1 if of.locks else 0)

    def _answered(
        self, properties: Sequence[core.Property], end: Exhausted | OutOfBounds
    ) -> FairCycleReport:
        names = tuple(dict.fromkeys(response.name for response, _, _ in self._expected))
        everything = Fairness(robots=True, locks=bool(self._locks), expectations=names)
        violated: dict[str, Recording] = {}
        needs: dict[str, Fairness] = {}
        for stated in properties:
            regions = [_Region.of(self, response) for response in responses(self._system, stated)]
            lasso = self._lasso(regions, everything)
            if lasso is not None:
                violated[stated.name] = lasso
            elif isinstance(end, Exhausted):
                needs[stated.name] = self._least(regions, everything)
        spend, every = self._system.budget.spend, range(len(self._nodes.states))
        is_empty = isinstance(end, Exhausted) and not fair_set(
            self._graph, every, self._wanted(everything), spend
        )
        return FairCycleReport(violated, needs, end, is_empty)

    def _least(self, regions: list[_Region], known: Fairness) -> Fairness:
        """A minimal fairness for the proof: conditions are dropped one after the other."""
        for less in _weaker(known):
            if not self._is_broken(regions, less):
                return self._least(regions, less)
        return known

    def _is_broken(self, regions: list[_Region], fairness: Fairness) -> bool:
        """Return whether a fair run breaks one of the responses."""
        wanted, spend = self._wanted(fairness), self._system.budget.spend
        return any(fair_set(self._graph, r.nodes, wanted, spend) is not None for r in regions)

    def _lasso(self, regions: list[_Region], fairness: Fairness) -> Recording | None:
        """The lasso of a fair run that breaks one of the responses, or None. [LASSO]

        It is a short one, and one with the fewest rounds unless it takes long to find that.
        """
        graph, wanted, spend = self._graph, self._wanted(fairness), self._system.budget.spend
        best: _Lasso | None = None
        for region in regions:
            part = fair_set(graph, region.nodes, wanted, spend)
            if part is None:
                continue
            stems = Stems(graph, region.roots, region.starts, region.nodes, spend)
            entry = min(part, key=lambda node: (stems.lengths[node], node))
            found = _Lasso(entry, stems.to(entry), fair_loop(graph, part, entry, wanted))
            if best is None or found.rounds < best.rounds:
                best = found
            for entry, length in islice(stems.lengths.items(), _MOST_ENTRIES):
                spend()
                most = best.rounds - 1 - length
                if most < 1:
                    break
                ends = self._as_good_as(entry)
                loop = short_loop(graph, region.nodes, entry, ends, wanted, most, _MOST_TRIES)
                if loop is not None:
                    best = _Lasso(entry, stems.to(entry), loop)
        return None if best is None else self._recording(best)

    def _as_good_as(self, node: int) -> list[int]:
        """The nodes of the same state that owe no more: a cycle that ends there is infinite."""
        nodes, every = self._nodes, range(1 << len(self._expected))
        less = (owed for owed in every if not owed & ~nodes.owed[node])
        found = (nodes.numbers.get((nodes.states[node], owed)) for owed in less)
        return [number for number in found if number is not None]

    def _recording(self, lasso: _Lasso) -> Recording:
        nodes = self._nodes
        tracer = Tracer(self._system, self._vault, self._commits, self._joints, as_it_is)
        start = lasso.stem[0][0] if lasso.stem else lasso.entry
        recording = tracer.run([nodes.states[start]])
        taken = [self._round(tracer, node, edge) for node, edge in [*lasso.stem, *lasso.loop]]
        return replace(recording, rounds=tuple(taken), loop=len(lasso.stem))

    def _round(self, tracer: Tracer, node: int, edge: Edge) -> Round:
        """The moves of a round along an edge with a given label."""
        state, target = self._nodes.states[node], self._nodes.states[edge.target]
        menus = self._joints.menus(state)
        for round_, after in tracer.rounds(state):
            if after != target:
                continue
            ran = [position is not None for position in round_.events]
            classes = [self._classes(i, position) for i, position in enumerate(round_.events)]
            if self._label(node, menus, ran, classes) == edge[1:]:
                return round_
        raise AssertionError("the search has seen a round that there is not")

    def _classes(self, robot: int, position: int | None) -> int:
        if position is None:
            return 0
        event = self._system.agent(robot).events[position]
        return sum(1 << k for k in event.lock_classes)


class _Region(Struct, frozen=True):
    """The nodes in which a run that breaks a response may stay for ever, and its entries.

    ``roots`` is where runs start that come to enter it.
    """

    nodes: frozenset[int]
    starts: tuple[int, ...]
    roots: tuple[int, ...]

    @staticmethod
    def of(search: _Search, response: Response) -> _Region:
        nodes = search._nodes
        trigger, goal = search._checks(response)
        wanting = [not goal.holds(state) for state in nodes.states]
        if trigger is None:
            roots = starts = [n for n in nodes.starts if wanting[n]]
        else:
            roots = nodes.starts
            starts = [n for n, s in enumerate(nodes.states) if wanting[n] and trigger.holds(s)]
        seen = set(starts)
        queue = deque(starts)
        while queue:
            search._system.budget.spend()
            for edge in nodes.edges[queue.popleft()]:
                if wanting[edge.target] and edge.target not in seen:
                    seen.add(edge.target)
                    queue.append(edge.target)
        return _Region(frozenset(seen), tuple(starts), tuple(roots))


def _weaker(known: Fairness) -> Iterator[Fairness]:
    if known.locks:
        yield replace(known, locks=False)
    for name in known.expectations:
        rest = tuple(other for other in known.expectations if other != name)
        yield replace(known, expectations=rest)
    if known.robots:
        yield replace(known, robots=False)


def _add(edges: list[Edge], new: Edge) -> None:
    """Keep the maximal edges to a node: those that no other edge dominates."""
    for edge in edges:
        if not new.meets & ~edge.meets and not new.grants & ~edge.grants:
            return
    edges[:] = [e for e in edges if e.meets & ~new.meets or e.grants & ~new.grants]
    edges.append(new)
