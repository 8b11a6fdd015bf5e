"""A graph of whole rounds by machine code, and fair sets in it. [T-FAIR-CYCLE]"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from typing import TypeAlias

from koord.kernels import context as fields
from koord.kernels import fair_context as fair
from koord.kernels.exploration import Block, Exploration
from koord.kernels.fair_rounds import FairRounds
from koord.kernels.fair_sets import INNER, FairSetCode
from koord.kernels.terms import NoKernelError

#: There is room for so many edges at first; of one node so many are looked at.
_FIRST_EDGES = 1 << 18
_MOST_OF_ONE = 1 << 22

#: Numbers of edges are 32 bits wide where they are of one node or mark one.
_MOST_EDGES = 1 << 32

#: Bytes for an edge: where it leads to, and its label.
_EDGE_BYTES = 12

#: Bytes for a node: its first edge, its label and its mark.
_NODE_BYTES = 20

#: So many different labels of components are told apart by machine code.
_MOST_KINDS = 256

#: An edge: the node that it leads to, and its label.
PackedEdge: TypeAlias = tuple[int, int]


class FlawedError(NoKernelError):
    """Raised where components are none: machine code is not believed."""


class FairExploration(Exploration):
    """The nodes that a search has seen, with their edges, in tables of at most ``most_bytes``."""

    words = fair.FAIR_CONTEXT_WORDS

    def __init__(self, rounds: FairRounds, most_bytes: int | None = None) -> None:
        self._fair_rounds = rounds
        self._firsts = self._labels = self._marks = Block(0)
        self._targets = self._edge_labels = Block(0)
        self._chain = Block(4 * _MOST_OF_ONE)  # no more of it than is touched
        super().__init__(rounds, most_bytes)
        self._put(fair.CHAIN, self._chain.address)
        self._put(fair.CHAIN_ROOM, _MOST_OF_ONE)
        self._grow_edges(_FIRST_EDGES)

    # --- tables ---------------------------------------------------------------------------------

    def _grow_states(self, entries: int) -> None:
        super()._grow_states(entries)
        room = int(self._context[fields.STATE_ROOM])
        self._make_room(0, room * _NODE_BYTES)
        self._firsts = self._firsts.grown(8 * (room + 1))
        self._labels = self._labels.grown(8 * room)
        self._marks = self._marks.grown(4 * room)
        self._put(fair.FIRSTS, self._firsts.address)
        self._put(fair.NODE_LABELS, self._labels.address)
        self._put(fair.MARKS, self._marks.address)

    def _grow_edges(self, room: int) -> None:
        self._make_room(0, room * _EDGE_BYTES)
        if room > _MOST_EDGES:
            raise NoKernelError("there are too many edges to number")
        self._targets = self._targets.grown(4 * room)
        self._edge_labels = self._edge_labels.grown(8 * room)
        self._put(fair.EDGE_TARGETS, self._targets.address)
        self._put(fair.EDGE_LABELS, self._edge_labels.address)
        self._put(fair.EDGE_ROOM, room)

    @property
    def table_bytes(self) -> int:
        """The bytes of all tables."""
        more = (self._firsts, self._labels, self._marks, self._targets, self._edge_labels)
        return super().table_bytes + sum(block.size for block in more)

    def _once_more(self) -> int:
        if self._context[fair.EDGE_COUNT] < self._context[fair.EDGE_ROOM]:
            return super()._once_more()
        self._put(fields.LEFT, 0)
        self._grow_edges(2 * int(self._context[fair.EDGE_ROOM]))
        return int(self._context[fields.CURRENT])

    # --- the graph ------------------------------------------------------------------------------

    @property
    def edge_count(self) -> int:
        """So many edges were found."""
        return int(self._context[fair.EDGE_DONE])

    def finish(self, expanded: int) -> None:
        """Say that nodes from a number on have not been looked at: they have no edges yet."""
        rest = self.states - expanded
        firsts = self._firsts.view("q")
        firsts[expanded + 1 : self.states + 1] = memoryview(array("q", [self.edge_count]) * rest)

    def label(self, node: int) -> int:
        """The label of a node."""
        return int(self._labels.view("Q")[node])

    def edges(self, node: int) -> Iterator[PackedEdge]:
        """The edges of a node that has been looked at."""
        firsts = self._firsts.view("q")
        first, end = firsts[node], firsts[node + 1]
        targets, labels = self._targets.view("I"), self._edge_labels.view("Q")
        return zip(targets[first:end].tolist(), labels[first:end].tolist(), strict=True)

    def marked(self, statement: int) -> bytearray:
        """Of each node whether a statement holds, a byte each."""
        block = Block(self.states)
        self._fair_rounds.marks[statement](self._address, block.address)
        return bytearray(block.memory[: self.states])

    # --- fair sets ------------------------------------------------------------------------------

    def parts(self, roots: bytes | bytearray, alive: bytes | bytearray) -> Parts:
        """The components among some nodes, as far as roots lead to them. Raises FlawedError."""
        sets = self._fair_rounds.sets
        return Parts(sets, self._address, self.states, Block.of(roots), Block.of(alive))


class Parts:
    """Strongly connected components of a part of a graph, and their labels.

    ``numbers`` has of each node the number of its component, or 0; that is what ``roots`` lead to
    within ``alive``.
    """

    def __init__(
        self, code: FairSetCode, address: int, states: int, roots: Block, alive: Block
    ) -> None:
        """``address`` is that of the context with the graph of so many states."""
        self._code, self._address, self._states = code, address, states
        self._numbers, space = Block(4 * states), Block(24 * states + 8)
        held = (roots.address, alive.address, self._numbers.address)
        self.count = code.components(address, *held, space.address)
        if code.flaws(address, *held):
            raise FlawedError("components are none")
        self._edges, self._nodes = (Block(8 * (self.count + 1)) for _ in range(2))
        code.summaries(address, *self._sums)

    @property
    def _sums(self) -> tuple[int, int, int]:
        return self._numbers.address, self._edges.address, self._nodes.address

    @property
    def numbers(self) -> memoryview[int]:
        """Of each node the number of its component, from 1 on, or 0."""
        return self._numbers.view("I")[: self._states]

    def fair(self, met: int, granted: int) -> tuple[Parts, int] | None:
        """A fair component, with the components among which it is one; None if there is none.

        ``met`` and ``granted`` are the bits that are wanted, as labels have them. Whoever asks for
        what nobody grants is in no fair part of a component: what is left of it is looked at again.
        Raises FlawedError.
        """
        parts = self
        while True:
            alive = Block(self._states)
            found = self._code.prune(self._address, *parts._sums, alive.address, met, granted)
            if found >= 0:
                return (parts, found) if found else None
            parts = Parts(self._code, self._address, self._states, alive, alive)

    def kinds(self) -> frozenset[tuple[int, int]]:
        """The labels of edges within a component and of its nodes, of all that have such edges."""
        out = Block(16 * _MOST_KINDS)
        sums = (self._edges.address, self._nodes.address)
        found = self._code.kinds(*sums, self.count, out.address, _MOST_KINDS)
        if found <= _MOST_KINDS:
            held = out.view("Q")[: 2 * found].tolist()
            return frozenset(zip(held[::2], held[1::2], strict=True))
        both = zip(self._edges.view("Q"), self._nodes.view("Q"), strict=True)
        return frozenset((edges, nodes) for edges, nodes in both if edges & INNER)

    def members(self, number: int) -> frozenset[int]:
        """The nodes of a component."""
        return frozenset(node for node, its in enumerate(self.numbers) if its == number)
