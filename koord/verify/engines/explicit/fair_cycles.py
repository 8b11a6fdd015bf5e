"""Fair cycles in finite graphs, by refinement of strongly connected components. [T-FAIR-CYCLE]

An edge has the conditions that it *meets* and those that it *grants*, a bit each; a node those that
it *asks*. A set of nodes is fair if its inner edges together meet all that is wanted, and grant
whatever a node of it asks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Container, Iterable, Sequence
from typing import Any, NamedTuple, TypeAlias


class Edge(NamedTuple):
    """An edge to a node. Several may lead to the same node."""

    target: int
    meets: int
    grants: int


def add_edge(edges: list[Edge], new: Edge) -> None:
    """Keep the maximal edges to a node: those that no other edge dominates."""
    for edge in edges:
        if not new.meets & ~edge.meets and not new.grants & ~edge.grants:
            return
    edges[:] = [e for e in edges if e.meets & ~new.meets or e.grants & ~new.grants]
    edges.append(new)


class FairnessConditions(NamedTuple):
    """The fairness conditions: to be met by every fair set, and to be granted if asked."""

    met: int
    granted: int


class Graph(NamedTuple):
    """A graph whose nodes are numbers, in the order of discovery."""

    edges: Sequence[Sequence[Edge]]
    asks: Sequence[int]


def fair_set(
    graph: Graph, nodes: Collection[int], wanted: FairnessConditions, spend: Callable[[], None]
) -> frozenset[int] | None:
    """A fair strongly connected set among some nodes, the one with the first; None if none is."""
    waiting = sorted(components(graph, nodes), key=min, reverse=True)
    while waiting:
        spend()
        part = waiting.pop()
        inner = [edge for node in part for edge in graph.edges[node] if edge.target in part]
        met = granted = asked = 0
        for edge in inner:
            met |= edge.meets
            granted |= edge.grants
        for node in part:
            asked |= graph.asks[node]
        denied = asked & wanted.granted & ~granted
        if not inner or wanted.met & ~met:
            continue
        if not denied:
            return part
        # Whoever asks for what nobody grants cannot be in a fair part of it.
        left = [node for node in part if not graph.asks[node] & denied]
        waiting += sorted(components(graph, left), key=min, reverse=True)
    return None


def components(graph: Graph, nodes: Collection[int]) -> list[frozenset[int]]:
    """The maximal strongly connected components among some nodes (Tarjan), without recursion."""
    among = set(nodes)
    number: dict[int, int] = {}
    low: dict[int, int] = {}
    open_: list[int] = []
    is_open: set[int] = set()
    found: list[frozenset[int]] = []
    for root in sorted(among):
        if root in number:
            continue
        number[root] = low[root] = len(number)
        open_.append(root)
        is_open.add(root)
        walk = [(root, iter(graph.edges[root]))]
        while walk:
            node, edges = walk[-1]
            for edge in edges:
                after = edge.target
                if after not in among:
                    continue
                if after not in number:
                    number[after] = low[after] = len(number)
                    open_.append(after)
                    is_open.add(after)
                    walk.append((after, iter(graph.edges[after])))
                    break
                if after in is_open:
                    low[node] = min(low[node], number[after])
            else:
                walk.pop()
                if walk:
                    low[walk[-1][0]] = min(low[walk[-1][0]], low[node])
                if low[node] == number[node]:
                    part = set()
                    while node not in part:
                        part.add(open_.pop())
                    is_open -= part
                    found.append(frozenset(part))
    return found


#: Nodes with the edges that leave them, one after the other.
Way: TypeAlias = list[tuple[int, Edge]]


def way(
    graph: Graph,
    starts: Iterable[int],
    among: Container[int],
    is_end: Callable[[int], bool],
) -> Way | None:
    """A shortest path to a node; empty from an end."""
    before: dict[int, tuple[int, Edge] | None] = dict.fromkeys(starts)
    queue = deque(before)
    while queue:
        node = queue.popleft()
        if is_end(node):
            return _back(before, node)
        for edge in graph.edges[node]:
            if edge.target in among and edge.target not in before:
                before[edge.target] = (node, edge)
                queue.append(edge.target)
    return None


class Stems:
    """Shortest paths from starts through a trigger, and then within a set of nodes.

    They are looked for until one of ``wanted`` is found, and so many in all: then no further than
    they are.
    """

    def __init__(
        self,
        graph: Graph,
        starts: Iterable[int],
        triggers: Container[int],
        among: Container[int],
        spend: Callable[[], None],
        wanted: Container[int],
        most: int,
    ) -> None:
        # Of a node, and whether the trigger came: where a way comes from.
        self._before: dict[tuple[int, bool], tuple[tuple[int, bool], Edge] | None] = {}
        #: How far it is to nodes behind a trigger, in order of that.
        self.lengths: dict[int, int] = {}
        queue: deque[tuple[tuple[int, bool], int]] = deque()
        found: list[int] = []  # lengths to those that are wanted

        def reach(node: int, came: bool, length: int, by: Any) -> None:
            for since in (True,) if came else (False, True) if node in triggers else (False,):
                if (node, since) not in self._before:
                    self._before[node, since] = by
                    queue.append(((node, since), length))
                    if since:
                        self.lengths[node] = length
                        if not found and node in wanted:
                            found.append(length)

        for start in starts:
            reach(start, False, 0, None)
        while queue:
            spend()
            here, length = queue.popleft()
            if found and length >= found[0] and len(self.lengths) >= most:
                break
            node, came = here
            for edge in graph.edges[node]:
                if not came or edge.target in among:
                    reach(edge.target, came, length + 1, (here, edge))

    def to(self, node: int) -> Way:
        """A shortest path to a node behind a trigger."""
        steps: Way = []
        here = (node, True)
        while (step := self._before[here]) is not None:
            here, edge = step
            steps.append((here[0], edge))
        return steps[::-1]


def fair_loop(graph: Graph, part: frozenset[int], start: int, wanted: FairnessConditions) -> Way:
    """A fair cycle from a node of a fair set.

    It goes to whatever is nearest of what is still wanting, and home when nothing is.
    """
    loop: Way = []
    missing, granted, asked, here = wanted.met, 0, 0, start
    while True:
        denied = asked & ~granted
        if loop and here == start and not missing and not denied:
            return loop
        steps = _nearest(graph, part, here, missing, denied) if missing or denied else []
        if not steps:
            steps = _home(graph, part, here, start)
        for node, edge in steps:
            missing &= ~edge.meets
            granted |= edge.grants
            asked |= graph.asks[node] & wanted.granted
        loop += steps
        here = steps[-1][1].target


def short_loop(
    graph: Graph,
    among: Container[int],
    start: int,
    ends: Container[int],
    wanted: FairnessConditions,
    most: int,
    tries: int,
) -> Way | None:
    """A shortest fair cycle from a node back to an equivalent one, with at most so many edges.

    None if there is none, or none was found after so many tries.
    """
    # What is left of a way is the same from one node with the same conditions still wanting.
    first = (start, wanted.met, 0, 0)
    before: dict[tuple[int, int, int, int], tuple[Any, Edge] | None] = {first: None}
    level = [first]
    for _ in range(most):
        after = []
        for here in level:
            node, missing, granted, asked = here
            asked |= graph.asks[node] & wanted.granted
            for edge in graph.edges[node]:
                if edge.target not in among:
                    continue
                grants = granted | edge.grants & wanted.granted
                there = (edge.target, missing & ~edge.meets, grants, asked)
                if there in before and there != first:
                    continue
                tries -= 1
                if tries < 0:
                    return None
                if edge.target in ends and not there[1] and not asked & ~grants:
                    steps: Way = [(node, edge)]
                    while (step := before[here]) is not None:
                        here, by = step
                        steps.append((here[0], by))
                    return steps[::-1]
                if there not in before:
                    before[there] = (here, edge)
                    after.append(there)
        level = after
    return None


def _nearest(
    graph: Graph, part: frozenset[int], here: int, missing: int, denied: int
) -> list[tuple[int, Edge]]:
    """A shortest path whose last edge meets or grants a missing condition."""

    def useful(node: int) -> Edge | None:
        inner = (e for e in graph.edges[node] if e.target in part)
        return next((e for e in inner if e.meets & missing or e.grants & denied), None)

    steps = way(graph, [here], part, lambda node: useful(node) is not None)
    assert steps is not None
    at = steps[-1][1].target if steps else here
    last = useful(at)
    assert last is not None
    return [*steps, (at, last)]


def _home(graph: Graph, part: frozenset[int], here: int, start: int) -> Way:
    """A shortest path back to the start, with at least one edge."""
    first: dict[int, Edge] = {}
    for edge in graph.edges[here]:
        if edge.target in part:
            first.setdefault(edge.target, edge)
    rest = way(graph, first, part, lambda node: node == start)
    assert rest is not None
    return [(here, first[rest[0][0] if rest else start]), *rest]


def _back(before: dict[int, tuple[int, Edge] | None], node: int) -> Way:
    steps: Way = []
    while (step := before[node]) is not None:
        steps.append(step)
        node = step[0]
    return steps[::-1]
