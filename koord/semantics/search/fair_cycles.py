"""Fair cycles in finite graphs: strongly connected sets, taken apart where need be. [T-FAIR-CYCLE]

An edge has the conditions that it *meets* and those that it *grants*, a bit each; a node those that
it *asks*. A set of nodes is fair if its inner edges together meet all that is wanted, and grant
whatever a node of it asks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import NamedTuple


class Edge(NamedTuple):
    """An edge to a node. Several may lead to the same one."""

    target: int
    meets: int
    grants: int


class Wanted(NamedTuple):
    """The conditions that count: to be met by every fair set, and to be granted if asked."""

    met: int
    granted: int


class Graph(NamedTuple):
    """Nodes are numbers; those that are found first come first."""

    edges: Sequence[Sequence[Edge]]
    asks: Sequence[int]


def fair_set(
    graph: Graph, nodes: Collection[int], wanted: Wanted, spend: Callable[[], None]
) -> frozenset[int] | None:
    """A fair set among some nodes, the one with the first of them; None if there is none."""
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
    """The maximal strongly connected sets among some nodes (Tarjan), without recursion."""
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


def way(
    graph: Graph,
    starts: Iterable[int],
    among: Collection[int],
    is_end: Callable[[int], bool],
) -> list[tuple[int, Edge]] | None:
    """A shortest way to a node, as nodes with the edges that leave them; empty from an end."""
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


def fair_loop(
    graph: Graph, part: frozenset[int], start: int, wanted: Wanted
) -> list[tuple[int, Edge]]:
    """A way from a node of a fair set back to it that is fair by itself.

    It goes to whatever is nearest of what is still wanting, and home when nothing is.
    """
    loop: list[tuple[int, Edge]] = []
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


def _nearest(
    graph: Graph, part: frozenset[int], here: int, missing: int, denied: int
) -> list[tuple[int, Edge]]:
    """A shortest way whose last edge meets or grants something that is wanting."""

    def useful(node: int) -> Edge | None:
        inner = (e for e in graph.edges[node] if e.target in part)
        return next((e for e in inner if e.meets & missing or e.grants & denied), None)

    steps = way(graph, [here], part, lambda node: useful(node) is not None)
    assert steps is not None
    at = steps[-1][1].target if steps else here
    last = useful(at)
    assert last is not None
    return [*steps, (at, last)]


def _home(graph: Graph, part: frozenset[int], here: int, start: int) -> list[tuple[int, Edge]]:
    """A shortest way to the start, of one edge at least."""
    first = [(here, edge) for edge in graph.edges[here] if edge.target in part]
    best: list[tuple[int, Edge]] | None = None
    for node, edge in first:
        rest = way(graph, [edge.target], part, lambda n: n == start)
        if rest is not None and (best is None or len(rest) + 1 < len(best)):
            best = [(node, edge), *rest]
    assert best is not None
    return best


def _back(before: dict[int, tuple[int, Edge] | None], node: int) -> list[tuple[int, Edge]]:
    steps: list[tuple[int, Edge]] = []
    while (step := before[node]) is not None:
        steps.append(step)
        node = step[0]
    return steps[::-1]
