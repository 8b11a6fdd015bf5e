"""Unrolled circuits on SAT solvers, and independent checks of invariants."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct, field

from koord.verify.effort import Deadline
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.clauses import OTHER, Clauses
from koord.verify.engines.bits.graph import FALSE, Graph
from koord.verify.engines.bits.ic3 import Cube, SafetyQuery


class Copy(Struct):
    """One copy of a circuit's nodes in another graph: of INIT, or of a round."""

    source: Graph
    target: Graph
    label: str
    meaning: dict[int, int] = field(default_factory=dict)  #: node of the source → literal

    def of(self, literal: int) -> int:
        """The copy of a literal."""
        meaning, g, to = self.meaning, self.source, self.target
        root = literal >> 1
        if root not in meaning and root:
            stack = [root]
            while stack:
                node = stack[-1]
                if node in meaning or node == 0:
                    stack.pop()
                    continue
                if g.is_input(node):
                    meaning[node] = to.input(f"{g.names[node]}{self.label}")
                    stack.pop()
                    continue
                a, b = g.left[node], g.right[node]
                x, y = self._there(a), self._there(b)
                if x is None or y is None:
                    if x is None:
                        stack.append(a >> 1)
                    if y is None:
                        stack.append(b >> 1)
                    continue
                meaning[node] = to.both(x, y)
                stack.pop()
        found = self._there(literal)
        assert found is not None
        return found

    def _there(self, literal: int) -> int | None:
        if literal < 2:
            return literal
        found = self.meaning.get(literal >> 1)
        return None if found is None else found ^ (literal & 1)


class CircuitRun(Struct, frozen=True):
    """A run of a circuit: the values of inputs and latches, in INIT and in each round.

    A node that is not mentioned may be anything.
    """

    opening: dict[int, bool]
    rounds: tuple[dict[int, bool], ...]


class UnrolledCircuit:
    """A circuit unrolled so far. ``completed`` rounds were checked and break nothing."""

    def __init__(self, circuit: Circuit) -> None:
        self.circuit = circuit
        self.graph = Graph()
        self.clauses = Clauses(self.graph, OTHER)
        self.opening = Copy(circuit.d.graph, self.graph, "#init")
        self.rounds: list[Copy] = []
        self.lost = FALSE

    def begin(self) -> Copy:
        """Append one more round."""
        circuit = self.circuit
        before = self.rounds[-1] if self.rounds else self.opening
        copy = Copy(circuit.d.graph, self.graph, f"#{len(self.rounds)}")
        if self.rounds:
            self.clauses.require(before.of(circuit.steps))
            self.clauses.require(before.of(circuit.lost) ^ 1)
            for latch in circuit.latches:
                copy.meaning[latch.literal >> 1] = before.of(latch.next)
        else:
            self.clauses.require(before.of(circuit.opens))
            for latch in circuit.latches:
                copy.meaning[latch.literal >> 1] = before.of(latch.init)
        self.rounds.append(copy)
        return copy

    def asked(self, literal: int, deadline: Deadline) -> SolverAnswer:
        """Check whether a literal can hold."""
        if literal == FALSE:
            return SolverAnswer.UNSAT
        return self.clauses.can_hold_in_time(literal, deadline)

    def never(self, literal: int) -> None:
        """Require that a literal does not hold, as was shown."""
        if literal != FALSE:
            self.clauses.require(literal ^ 1)

    def witnessed(self) -> CircuitRun:
        """The run of the last satisfiable query."""
        model = self.clauses.model()
        inputs = {
            node: model[number] > 0
            for node in self.graph.names
            if (number := self.clauses.known(node)) is not None and number < len(model)
        }

        def read(copy: Copy) -> dict[int, bool]:
            nodes = [n for n in copy.meaning if copy.source.is_input(n)]
            values = self.graph.values([copy.meaning[n] for n in nodes], inputs)
            return dict(zip(nodes, values, strict=True))

        return CircuitRun(read(self.opening), tuple(read(copy) for copy in self.rounds))


def holds_always(
    g: Graph, question: SafetyQuery, cubes: Sequence[Cube], deadline: Deadline | None = None
) -> bool:
    """Return whether no run ever reaches one of the cubes or a bad state, nor breaks ``kept``."""
    left_out = [_left_out(g, question, cube) for cube in cubes]
    return keeps(g, question, [*left_out, *question.kept], deadline or Deadline())


def keeps(g: Graph, question: SafetyQuery, statements: Sequence[int], deadline: Deadline) -> bool:
    """Return whether statements about latches are an inductive invariant that excludes bad states.

    That is: they hold of INIT, a round leads from where all of them hold to where all of them do,
    and there nothing is bad. Raises OutOfBudgetError where the deadline passes first.
    """
    init = {latch.literal >> 1: latch.init for latch in question.latches}
    next_ = {latch.literal >> 1: latch.next for latch in question.latches}
    start = Clauses(g, OTHER, deadline)
    start.require(question.opens)
    first = g.all_of(g.all_substituted(statements, init))
    initiated = not start.can_hold(first ^ 1)
    start.close()
    step = Clauses(g, OTHER, deadline)
    for literal in (*question.given, *question.in_range, *statements):
        step.require(literal)
    safe = not step.can_hold(question.bad)
    step.require(question.steps)
    # One by one: many easy questions are quicker than a hard one.
    then = g.all_substituted(statements, next_)
    kept = not any(step.can_hold(x ^ 1) for x in then)
    step.close()
    return initiated and safe and kept


def _left_out(g: Graph, question: SafetyQuery, cube: Cube) -> int:
    """The literal that a state is not in a cube."""
    literals = (question.latches[abs(x) - 1].literal ^ (x < 0) for x in cube)
    return g.all_of(literals) ^ 1
