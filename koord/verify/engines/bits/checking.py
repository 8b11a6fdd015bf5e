"""Whether an invariant is one: asked of fresh solvers, which know nothing of how it was found."""

from __future__ import annotations

from collections.abc import Sequence

from koord.verify.effort import Deadline
from koord.verify.engines.bits.clauses import OTHER, Clauses
from koord.verify.engines.bits.graph import Graph
from koord.verify.engines.bits.ic3 import Cube, SafetyQuery


def holds_always(
    g: Graph, question: SafetyQuery, cubes: Sequence[Cube], deadline: Deadline | None = None
) -> bool:
    """Whether no run ever is in one of the cubes or bad."""
    return keeps(
        g, question, [_left_out(g, question, cube) for cube in cubes], deadline or Deadline()
    )


def keeps(g: Graph, question: SafetyQuery, statements: Sequence[int], deadline: Deadline) -> bool:
    """Whether statements about latches hold in every run, and nothing bad happens.

    That is: they hold of INIT, a round leads from where all of them hold to where all of them do,
    and there nothing is bad. Raises OutOfBudgetError where the deadline passes first.
    """
    init = {latch.literal >> 1: latch.init for latch in question.latches}
    next_ = {latch.literal >> 1: latch.next for latch in question.latches}
    start = Clauses(g, OTHER, deadline)
    start.require(question.opens)
    first = g.all_of(g.substituted(x, init) for x in statements)
    initiated = not start.solve([start.of(first ^ 1)])
    start.close()
    step = Clauses(g, OTHER, deadline)
    for literal in (*question.given, *statements):
        step.require(literal)
    safe = not step.solve([step.of(question.bad)])
    step.require(question.steps)
    then = g.all_of(g.substituted(x, next_) for x in statements)
    kept = not step.solve([step.of(then ^ 1)])
    step.close()
    return initiated and safe and kept


def _left_out(g: Graph, question: SafetyQuery, cube: Cube) -> int:
    """That a state is not in a cube."""
    literals = (question.latches[abs(x) - 1].literal ^ (x < 0) for x in cube)
    return g.all_of(literals) ^ 1
