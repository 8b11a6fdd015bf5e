"""Liveness by explicit search: all states and edges, and the fair cycles in them. [T-FAIR-CYCLE]

Unlike the search for violated invariants it keeps every state and every edge: symmetry would
forget who is passed over, and a skip is told from an event that changes nothing. [T-FULL-STATES]
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import assert_never

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.liveness import Response, expected, locks_of, reads_ran, responses
from koord.semantics.recordings import Round
from koord.syntax import core
from koord.syntax.budget import Budget, Count, OutOfBudgetError
from koord.syntax.system import System
from koord.verify.different_responses import different_responses
from koord.verify.engines.explicit.commits import Commits
from koord.verify.engines.explicit.compiled import is_installed
from koord.verify.engines.explicit.cost import FAIR_COMPILED_FROM, Cost
from koord.verify.engines.explicit.fair_answers import (
    FairAnswers,
    FairCycleReport,
    FairGraph,
    Region,
)
from koord.verify.engines.explicit.fair_cycles import (
    Edge,
    FairnessConditions,
    Graph,
    add_edge,
    components,
    fair_set,
)
from koord.verify.engines.explicit.fair_lookout import COMPILED_FACTOR, LOOK_FROM, Lookout
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


def lively(
    system: System,
    properties: Sequence[core.Property],
    limits: Limits | None = None,
    *,
    most_edges: int | None = None,
    compiled_from: int | None = FAIR_COMPILED_FROM,
    look_from: int | None = LOOK_FROM,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> FairCycleReport:
    """Decide liveness properties on all reachable states. [PROP-EVENTUALLY] [PROP-LEADS-TO]

    Beside the limits there may be one of edges: many robots have many ways to go on from a state.
    Where Python has cost more than ``compiled_from`` (see :mod:`cost`) machine code is used, if
    there is any; None: it is not. From ``look_from`` nodes on it is looked now and then whether all
    properties are violated already (see :mod:`fair_lookout`); None: not before the graph is whole.
    """
    asked = [s for p in properties for r in responses(system, p) for s in r.statements]
    asked += [s for r in expected(system) for s in r.statements]
    reason = not_finite(system, asked)
    if reason is not None:
        return FairCycleReport({}, {}, reason)
    meter = Meter(limits if limits is not None else Limits(), clock)
    tracks_ran = any(reads_ran(system, p) for p in properties)
    search = _Search(system, meter, progress, most_edges, tracks_ran=tracks_ran)
    return search.run(properties, compiled_from if is_installed() else None, look_from)


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
        self._cost = Cost()
        self._count = Count(system.budget)
        system = replace(system, budget=Budget(self._count.is_over, system.budget))
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
        self._level = 0  #: so many nodes are no further away than that
        self._spent_looking = 0  #: steps of the budget that were not for the graph

    def _checks(self, response: Response) -> tuple[Check | None, Check]:
        trigger = response.trigger
        goal = check(self._system, self._vault, response.goal)
        return (None if trigger is None else check(self._system, self._vault, trigger)), goal

    def run(
        self,
        properties: Sequence[core.Property],
        compiled_from: int | None,
        look_from: int | None,
    ) -> FairCycleReport:
        """Build the graph, as far as limits allow, and decide each property."""
        lookout = self._lookout(self, properties, look_from)
        end = self._built(compiled_from, lookout)
        if end is None:
            report = self._by_machine_code(properties, look_from)
            if report is not None:
                return report
            end = self._built(None, lookout)
        assert end is not None
        return self._answered(self, properties, end)

    def _answers(self, graph: FairGraph) -> FairAnswers:
        tracer = Tracer(self._system, self._vault, self._commits, self._joints, as_it_is)
        return FairAnswers(self._system, graph, self, tracer)

    def _lookout(
        self, graph: FairGraph, properties: Sequence[core.Property], look_from: int | None
    ) -> Lookout:
        return Lookout(self._answers(graph), properties, look_from)

    def _answered(
        self,
        graph: FairGraph,
        properties: Sequence[core.Property],
        end: FairCycleReport | Exhausted | OutOfBounds | NotFinite,
    ) -> FairCycleReport:
        """The report on a graph that came to such an end: one that was made before, as it is."""
        match end:
            case FairCycleReport():
                return end
            case NotFinite():
                return FairCycleReport({}, {}, end)
            case Exhausted() | OutOfBounds():
                try:
                    return self._answers(graph).of(properties, end)
                except OutOfBudgetError as error:
                    return FairCycleReport({}, {}, end_of(error, end.states, end.depth))
            case _:
                assert_never(end)

    def _by_machine_code(
        self, properties: Sequence[core.Property], look_from: int | None
    ) -> FairCycleReport | None:
        """The report on the graph of machine code, or None where that does not get to the end."""
        from koord.kernels.terms import NoKernelError
        from koord.verify.engines.explicit.fair_compiled import CompiledGraph

        asked = [r for s in properties for r in different_responses(self._system, s)]
        starts = [self._nodes.states[node] for node in self._nodes.starts]
        most_mb = self._meter.limits.memory_mb
        try:
            made = CompiledGraph(self._system, self._vault, asked, starts, self, most_mb)
            first = None if look_from is None else COMPILED_FACTOR * look_from
            lookout = self._lookout(made, properties, first)
            end = made.build(self._meter, self._most_edges, lookout, self._tell_of)
            return replace(self._answered(made, properties, end), is_compiled=True)
        except NoKernelError:
            return None

    # --- the graph ------------------------------------------------------------------------------

    def _built(
        self, most: int | None, lookout: Lookout
    ) -> FairCycleReport | Exhausted | OutOfBounds | NotFinite | None:
        """How the graph came to an end; None where it has cost more than ``most`` before.

        A report, where all is violated in what there is of it.
        """
        nodes = self._nodes
        try:
            if not nodes.starts:
                self._begin()
            while len(nodes.edges) < len(nodes.states):
                is_due = most is not None and self._is_due(most)
                if is_due or lookout.is_due(len(nodes.edges), self._whole):
                    report = self._looked(lookout)
                    if report is not None or is_due:
                        return report
                if len(nodes.edges) == self._level:
                    self._depth += 1
                    self._level = len(nodes.states)
                if self._depth == self._meter.limits.rounds:
                    raise LimitReachedError(f"more than {self._depth} rounds")
                self._tick()
                self._expand(len(nodes.edges))
        except ENDS as error:
            return end_of(error, len(nodes.states), self._depth)
        return Exhausted(len(nodes.states), self._depth)

    @property
    def _whole(self) -> int:
        """All nodes less than so many rounds from a start have their edges."""
        return self._depth + (len(self._nodes.edges) == self._level)

    def _looked(self, lookout: Lookout) -> FairCycleReport | None:
        """What a look at the graph says. It is no work that machine code would do with less."""
        nodes, before = self._nodes, self._count.steps
        try:
            return lookout.look(len(nodes.states), len(nodes.edges), self._whole)
        finally:
            self._spent_looking += self._count.steps - before

    def _is_due(self, most: int) -> bool:
        """Return whether to go over to machine code: it costs less than what Python has done."""
        states = len(self._nodes.states)
        cost = self._cost.of(states, self._count.steps - self._spent_looking)
        return cost > most or states > self._meter.limits.states

    def _begin(self) -> None:
        nodes = self._nodes
        for opened in openings(self._system, self._vault, self._commits):
            self._tick()
            if not opened.is_faulted and all(a.holds(opened.state) for a in self._assumptions):
                start = self._number(opened.state, 0)
                if start not in nodes.starts:
                    nodes.starts.append(start)
        self._level = len(nodes.states)

    def _number(self, state: State, owed: int) -> int:
        """The number of the node for a state and its predecessor's owed expectations."""
        owed = self.owes(state, owed)
        nodes = self._nodes
        key = (state, owed)
        number = nodes.numbers.setdefault(key, len(nodes.states))
        if number == len(nodes.states):
            nodes.states.append(state)
            nodes.owed.append(owed)
        return number

    def owes(self, state: State, owed: int) -> int:
        """What is owed in a state, from what was before it. [FAIR-ASSUME]"""
        for k, (_, trigger, goal) in enumerate(self._expected):
            assert trigger is not None
            bit = 1 << k
            if owed & bit or trigger.holds(state):
                owed = owed & ~bit if goal.holds(state) else owed | bit
        return owed

    def _expand(self, node: int) -> None:
        nodes, state, owed = self._nodes, self._nodes.states[node], self._nodes.owed[node]
        found: dict[int, list[Edge]] = {}
        for after, meets, grants in self.ways(state, owed):
            self._edges += 1
            if self._most_edges is not None and self._edges > self._most_edges:
                raise LimitReachedError(f"more than {self._most_edges} ways to go on")
            target = self._number(after, owed)
            add_edge(found.setdefault(target, []), Edge(target, meets, grants))
        nodes.edges.append(tuple(edge for edges in found.values() for edge in edges))
        nodes.asks.append(self.asks(state))

    def ways(self, state: State, owed: int) -> Iterator[tuple[State, int, int]]:
        """Yield the states after the rounds from one, with what these meet and grant."""
        menus = self._joints.menus(state)
        for joint in self._joints.joints(state, menus):
            self._system.budget.spend()
            self._cost.joints += 1
            if not joint.is_whole:
                continue
            meets, grants = self._label_of(owed, menus, joint)
            for robots, shared in joint.successors():
                self._system.budget.spend()
                self._cost.ways += 1
                yield (*robots, *shared), meets, grants

    def holds(self, statement: core.Property, state: State) -> bool:
        """Return whether a statement holds in a state."""
        return check(self._system, self._vault, statement).holds(state)

    def asks(self, state: State) -> int:
        """Who asks for which lock in a state, a bit a pair. [FAIR-LOCK]"""
        menus = self._joints.menus(state)
        return sum(bit for (i, k), bit in self._bit.items() if menus[i].asks >> k & 1)

    def _label_of(self, owed: int, menus: list[Menu], joint: JointTransition) -> tuple[int, int]:
        ran = [course.runs for course in joint.courses]
        classes = [course.classes for course in joint.courses]
        return self._label(owed, menus, ran, classes)

    def _label(
        self, owed: int, menus: list[Menu], ran: Sequence[bool], classes: Sequence[int]
    ) -> tuple[int, int]:
        """The conditions that a round meets and grants. [FAIR-ROBOT] [FAIR-LOCK] [FAIR-ASSUME]"""
        count = self._system.robots
        meets = sum(1 << i for i in range(count) if ran[i] or not menus[i].ready)
        paid = ~owed & ((1 << len(self._expected)) - 1)
        grants = sum(bit for (i, k), bit in self._bit.items() if ran[i] and classes[i] >> k & 1)
        return meets | paid << count, grants

    def _tick(self) -> None:
        reached = self._meter.reached(len(self._nodes.states))
        if reached:
            raise LimitReachedError(reached)
        self._tell_of(len(self._nodes.states), self._depth)

    def _tell_of(self, states: int, rounds: int) -> None:
        if self._progress is not None and self._meter.is_time_to_tell():
            self._progress(states, rounds)

    # --- answers --------------------------------------------------------------------------------

    @property
    def graph(self) -> Graph:
        """The graph as far as it was built: what was not looked at has no edges."""
        nodes, count = self._nodes, len(self._nodes.states)
        none: tuple[Edge, ...] = ()
        edges = nodes.edges + (count - len(nodes.edges)) * [none]
        return Graph(edges, nodes.asks + (count - len(nodes.asks)) * [0])

    def state(self, node: int) -> State:
        """The state of a node."""
        return self._nodes.states[node]

    def owed(self, node: int) -> int:
        """What a node owes, a bit an expectation."""
        return self._nodes.owed[node]

    def fair_set(self, region: Region, wanted: FairnessConditions) -> frozenset[int] | None:
        """A fair set in a region, or None."""
        assert isinstance(region.nodes, Collection)
        return fair_set(self.graph, region.nodes, wanted, self._system.budget.spend)

    def is_fair(self, region: Region, wanted: FairnessConditions) -> bool:
        """Return whether there is a fair set in a region."""
        return self.fair_set(region, wanted) is not None

    def region(self, response: Response | None) -> Region:
        """The region of a response; of all runs, if there is none."""
        nodes = self._nodes
        if response is None:
            return Region(range(len(nodes.states)), nodes.starts, tuple(nodes.starts))
        edges = self.graph.edges
        trigger, goal = self._checks(response)
        wanting = [not goal.holds(state) for state in nodes.states]
        if trigger is None:
            roots = starts = [n for n in nodes.starts if wanting[n]]
        else:
            roots = nodes.starts
            starts = [n for n, s in enumerate(nodes.states) if wanting[n] and trigger.holds(s)]
        seen = set(starts)
        queue = deque(starts)
        while queue:
            self._system.budget.spend()
            for edge in edges[queue.popleft()]:
                if wanting[edge.target] and edge.target not in seen:
                    seen.add(edge.target)
                    queue.append(edge.target)
        return Region(frozenset(seen), frozenset(starts), tuple(roots))

    def components(self, region: Region) -> list[int]:
        """Of each node the number of its strongly connected component in a region, or 0."""
        assert isinstance(region.nodes, Collection)
        numbers = [0] * len(self._nodes.states)
        for number, part in enumerate(components(self.graph, region.nodes), 1):
            self._system.budget.spend(len(part))
            for node in part:
                numbers[node] = number
        return numbers

    def as_good_as(self, node: int) -> list[int]:
        """The nodes of the same state that owe no more: a cycle that ends there is infinite."""
        nodes, every = self._nodes, range(1 << len(self._expected))
        less = (owed for owed in every if not owed & ~nodes.owed[node])
        found = (nodes.numbers.get((nodes.states[node], owed)) for owed in less)
        return [number for number in found if number is not None]

    def label_of(self, state: State, owed: int, round_: Round) -> tuple[int, int]:
        """The label of a round from a state that owes so much."""
        ran = [position is not None for position in round_.events]
        classes = [self._classes(i, position) for i, position in enumerate(round_.events)]
        return self._label(owed, self._joints.menus(state), ran, classes)

    def _classes(self, robot: int, position: int | None) -> int:
        if position is None:
            return 0
        event = self._system.agent(robot).events[position]
        return sum(1 << k for k in event.lock_classes)
