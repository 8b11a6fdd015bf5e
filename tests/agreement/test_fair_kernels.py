"""Graphs of whole rounds by machine code against the road of Python: verdicts, lassos, what proofs
need, numbers of nodes, edges. [T-FAIR-CYCLE] [T-FULL-STATES] [FAIR-ROBOT] [FAIR-LOCK] [FAIR-ASSUME]
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence
from itertools import islice
from random import Random

import pytest
from msgspec import Struct, field

from koord.refinement.generating.programs import system
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.verify.engines.explicit.fair_compiled import CompiledGraph
from koord.verify.engines.explicit.fair_cycles import (
    Edge,
    FairnessConditions,
    Graph,
    components,
    fair_set,
)
from koord.verify.engines.explicit.fair_search import lively
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
from tests.agreement.test_lassos import LIVELY, assert_lassos, with_liveness
from tests.environments import ROOT

pytest.importorskip("llvmlite")

from koord.kernels import fair_exploration
from koord.kernels.context import STATE_COUNT
from koord.kernels.exploration import Block
from koord.kernels.fair_context import (
    EDGE_LABELS,
    EDGE_TARGETS,
    FAIR_CONTEXT_WORDS,
    FIRSTS,
    NODE_LABELS,
)
from koord.kernels.fair_exploration import FairExploration, Parts
from koord.kernels.fair_labels import LabelBits
from koord.kernels.fair_sets import INNER, FairSetCode, fair_set_code
from koord.machine.code import Loaded, new_module
from tests.agreement.test_kernels import is_packable
from tests.sampling import first


def live(seed: int) -> System:
    random = Random(seed)
    return with_liveness(system(random, LIVELY), random)


def compare(of: System, seed: object, states: int = 300) -> str:
    """Compare all that is said of whole runs; a word for what it was."""
    plain = lively(of, of.program.properties, Limits(states=states), compiled_from=None)
    if not isinstance(plain.end, Exhausted):
        return "too large, or not finite"
    made = lively(of, of.program.properties, Limits(states=states), compiled_from=0)
    if not made.is_compiled:
        return "no machine code"
    assert_lassos(of, made, seed)
    assert made.end == plain.end, seed
    assert made.needs == plain.needs, seed
    assert made.is_empty is plain.is_empty, seed
    rounds = [{name: len(r.rounds) for name, r in f.violated.items()} for f in (plain, made)]
    assert rounds[0] == rounds[1], seed
    return "violated" if made.violated else "holds"


def packable(seeds: range, most: int) -> Iterator[tuple[int, System]]:
    """The first few generated systems that may have machine code."""
    systems = ((seed, live(seed)) for seed in seeds)
    return islice(((seed, of) for seed, of in systems if is_packable(of)), most)


@pytest.mark.slow
@pytest.mark.parametrize("first", first(1, [0, 5_000]))
def test_as_the_road_of_python(first: int) -> None:
    seeds = range(first, first + 5_000)
    count = Counter(compare(of, seed) for seed, of in packable(seeds, 10))
    assert count["violated"] + count["holds"] >= 3, count


@pytest.mark.slow
def test_as_the_road_of_python_on_many() -> None:
    count = Counter(compare(of, seed) for seed, of in packable(range(10_000, 20_000), 400))
    assert count["violated"] > 60, count
    assert count["holds"] > 30, count


# --- programs -------------------------------------------------------------------------------------

#: Who holds the lock may keep it from others: fairness of locks is needed, and pruned by.
LOCKED = """\
local:
    int at = 0

allwrite:
    int turns = 0

Ask:
    pre: at == 0
    eff: at = 1

Work:
    pre: at == 1
    eff:
        atomic:
            turns = (turns + 1) % 3
            at = 0

Look:
    pre: turns == 1
    eff: pass

eventually Works: at == 1 leadsto at == 0
eventually Third: turns == 0 leadsto turns == 2
eventually Rests: at == 0 leadsto at == 1
"""

#: Nobody does without: the lock has to be granted for ever.
NEEDED = LOCKED.replace("Look:\n    pre: turns == 1\n    eff: pass\n", "")

#: What is expected is owed from round to round, of each robot by itself.
EXPECTED = """\
local:
    int at = 0

Ask:
    pre: at == 0
    eff: at = 1

Serve:
    pre: at == 1
    eff: at = 2

Rest:
    pre: at == 1
    eff: at = 0

Stay:
    pre: at == 2
    eff: at = at

assume Served: at == 1 leadsto ran(Serve)
assume Back: ran(Serve) leadsto ran(Stay)
eventually Ends: at == 1 leadsto at == 2
eventually Stays: ran(Serve) leadsto ran(Stay)
eventually All: at == 0 leadsto forall i: at@i == 2
"""

STOPPING = """\
local:
    int at = 0

Work:
    pre: at < 2
    eff: at = at + 1

Leave:
    pre: at == 2
    eff: stop()

eventually Over: forall i: at@i == 2
eventually Begun: exists i: at@i == 1
eventually Still: at == 0 leadsto at == 1
"""

#: The environment decides: who waits for a sensor may wait for ever.
SENSED = """\
using Door:
    sensors:
        bool open = false
        int side = 0
    contract Sides:
        ensures: 0 <= side' and side' <= 1

local:
    int at = 0

Enter:
    pre: Door.open and at == 0
    eff: at = 1 + Door.side

Leave:
    pre: at > 0
    eff: at = 0

eventually Enters: at == 0 leadsto at > 0
eventually Leaves: at > 0 leadsto at == 0
"""

PROTOCOLS = ROOT / "specs" / "examples" / "protocols"

PROGRAMS = {
    "lock_server": ((PROTOCOLS / "lock_server.krd").read_text("utf-8"), 3),
    "locked": (LOCKED, 3),
    "needed": (NEEDED, 3),
    "expected": (EXPECTED, 2),
    "stopping": (STOPPING, 3),
    "sensed": (SENSED, 2),
}


@pytest.mark.parametrize("name", first(2, PROGRAMS))
def test_programs_as_the_road_of_python(name: str) -> None:
    text, robots = PROGRAMS[name]
    assert compare(read(text, robots), name, states=5_000) in ("violated", "holds")


def read(text: str, robots: int) -> System:
    read = load(Source("model.krd", text))
    assert read.program is not None, read.diagnostics
    return dealt(read.program, robots)


# --- fair sets in graphs --------------------------------------------------------------------------

#: Robots, pairs of a robot and a lock class, and expectations of generated graphs.
_BITS = LabelBits(2, ((0, 0), (1, 0), (1, 1)), 1)


class Sets(Struct):
    """The machine code of fair sets on a graph that somebody gives."""

    loaded: Loaded
    code: FairSetCode
    blocks: list[Block] = field(default_factory=list)

    @staticmethod
    def made() -> Sets:
        module = new_module("sets")
        fair_set_code(module)
        loaded = Loaded(module)
        return Sets(loaded, FairSetCode(loaded.function))

    def parts(self, graph: Graph, roots: Iterable[int], alive: Iterable[int]) -> Parts:
        """The components of a graph whose labels are packed as those of rounds are."""
        count = len(graph.edges)
        firsts = [0]
        for edges in graph.edges:
            firsts.append(firsts[-1] + len(edges))
        every = [edge for edges in graph.edges for edge in edges]
        labels = [edge.meets | edge.grants << _BITS.robots for edge in every]
        asks = [asked << _BITS.robots for asked in graph.asks]
        context = self._block("q", [0] * FAIR_CONTEXT_WORDS).view("q")
        context[STATE_COUNT] = count
        context[FIRSTS] = self._block("q", firsts).address
        context[EDGE_TARGETS] = self._block("I", [edge.target for edge in every]).address
        context[EDGE_LABELS] = self._block("Q", labels).address
        context[NODE_LABELS] = self._block("Q", asks).address
        where = self.blocks[-5].address
        some = (bytes(k in chosen for k in range(count)) for chosen in (set(roots), set(alive)))
        return Parts(self.code, where, count, *(Block.of(each) for each in some))

    def _block(self, form: str, numbers: Sequence[int]) -> Block:
        self.blocks.append(Block.of(array(form, numbers).tobytes()))
        return self.blocks[-1]


def generated(random: Random) -> Graph:
    """A graph of few nodes, in which conditions are met and granted now and then."""
    count = random.randrange(1, 9)
    edges = [
        [
            Edge(random.randrange(count), random.getrandbits(2), random.getrandbits(3))
            for _ in range(random.choice((0, 1, 1, 2, 3)))
        ]
        for _ in range(count)
    ]
    return Graph(edges, [random.getrandbits(3) & random.getrandbits(3) for _ in range(count)])


def nothing() -> None:
    pass


@pytest.mark.parametrize("first", [0, 5_000])
def test_fair_sets_as_those_of_python(first: int) -> None:
    seeds = range(first, first + 1_500)
    sets = Sets.made()
    count: Counter[bool] = Counter()
    for seed in seeds:
        random = Random(seed)
        graph = generated(random)
        nodes = range(len(graph.edges))
        alive = {node for node in nodes if random.random() < 0.9}
        roots = {node for node in nodes if random.random() < 0.4}
        reached = reach(graph, roots & alive, alive)
        parts = sets.parts(graph, roots, alive)
        numbers = parts.numbers.tolist()
        found = {frozenset(n for n in nodes if numbers[n] == k) for k in set(numbers) - {0}}
        assert found == set(components(graph, reached)), seed
        assert parts.kinds() == {labels_of(graph, part) for part in found} - {None}, seed
        wanted = FairnessConditions(random.getrandbits(2), random.getrandbits(3))
        expected = fair_set(graph, reached, wanted, nothing)
        fair = parts.fair(*_BITS.wanted(*wanted))
        assert (fair is None) is (expected is None), seed
        if fair is not None:
            # What is found is one by itself: no smaller part of it has to be looked for.
            members = fair[0].members(fair[1])
            assert fair_set(graph, members, wanted, nothing) == members, seed
        count[fair is None] += 1
        sets.blocks.clear()
    assert min(count.values()) > len(seeds) // 10, count


def labels_of(graph: Graph, part: frozenset[int]) -> tuple[int, int] | None:
    """The labels of the edges within a component and of its nodes, if it has any such edge."""
    inner = [edge for node in part for edge in graph.edges[node] if edge.target in part]
    edges, nodes = INNER, 0
    for edge in inner:
        edges |= edge.meets | edge.grants << _BITS.robots
    for node in part:
        nodes |= graph.asks[node] << _BITS.robots
    return (edges, nodes) if inner else None


def reach(graph: Graph, roots: Iterable[int], alive: Container[int]) -> set[int]:
    """The nodes that some lead to within others."""
    seen, waiting = set(roots), list(roots)
    while waiting:
        for edge in graph.edges[waiting.pop()]:
            if edge.target in alive and edge.target not in seen:
                seen.add(edge.target)
                waiting.append(edge.target)
    return seen


def test_numbers_that_are_no_proof_are_seen() -> None:
    """An edge to a greater number, a root without a number, a number of what is not alive."""
    sets = Sets.made()
    graph = Graph([[Edge(1, 0, 0)], [Edge(2, 0, 0)], []], [0, 0, 0])
    sets.parts(graph, {0}, {0, 1, 2})
    where = sets.blocks[-5].address

    def flaws(roots: list[int], alive: list[int], numbers: list[int]) -> int:
        blocks = [Block.of(bytes(roots)), Block.of(bytes(alive))]
        blocks.append(Block.of(array("I", numbers).tobytes()))
        return sets.code.flaws(where, *(block.address for block in blocks))

    assert flaws([1, 0, 0], [1, 1, 1], [3, 2, 1]) == 0
    assert flaws([1, 0, 0], [1, 1, 1], [1, 1, 1]) == 0
    assert flaws([1, 0, 0], [1, 1, 1], [2, 3, 1]) == 1
    assert flaws([1, 0, 0], [1, 1, 1], [2, 1, 0]) == 1
    assert flaws([1, 0, 0], [1, 1, 1], [0, 0, 0]) == 1
    assert flaws([1, 0, 0], [1, 1, 0], [3, 2, 1]) == 1


# --- what machine code says is not believed alone -------------------------------------------------


@pytest.mark.parametrize("wrong", ["edges", "asks", "marks"])
def test_what_python_sees_otherwise_is_not_believed(
    wrong: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    of = read(LOCKED, 2)
    plain = lively(of, of.program.properties, compiled_from=None)
    match wrong:
        case "edges":
            monkeypatch.setattr(LabelBits, "met", lambda self, label: 0)
        case "asks":
            monkeypatch.setattr(CompiledGraph, "_asks", lambda self, node: 255)
        case _:
            monkeypatch.setattr(
                FairExploration, "marked", lambda self, statement: bytearray(b"\1" * self.states)
            )
    made = lively(of, of.program.properties, compiled_from=0)
    assert not made.is_compiled
    assert made == plain


def test_limits_end_the_graph_where_it_is() -> None:
    of = read(LOCKED, 3)
    for limits, edges in ((Limits(rounds=1), None), (Limits(), 1)):
        found = lively(of, of.program.properties, limits, most_edges=edges, compiled_from=0)
        assert isinstance(found.end, OutOfBounds)
        assert not found.needs
        assert_lassos(of, found, edges)


def test_room_for_edges_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    """A node whose edges have no room is looked at once more, and has each edge once."""
    monkeypatch.setattr(fair_exploration, "_FIRST_EDGES", 4)
    of = read(LOCKED, 3)
    assert compare(of, "room") == "violated"


def test_a_node_with_too_many_edges_is_left_to_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fair_exploration, "_MOST_OF_ONE", 3)
    of = read(LOCKED, 3)
    assert compare(of, "many") == "no machine code"


def test_urgent_events_and_guards_that_ask_are_left_to_python() -> None:
    urgent = LOCKED.replace("Ask:", "urgent Ask:")
    asking = "def fun lucky() -> bool: extern fresh\n\n" + LOCKED.replace(
        "pre: at == 0", "pre: at == 0 and lucky()"
    )
    for text in (urgent, asking):
        assert compare(read(text, 2), text) == "no machine code"
