"""Whether an invariant is one: asked of fresh solvers, which know nothing of how it was found."""

from __future__ import annotations

from collections.abc import Sequence

from koord.verify.bits.clauses import OTHER, Clauses
from koord.verify.bits.graph import Graph
from koord.verify.bits.pdr import Cube, Question


def holds_always(g: Graph, question: Question, cubes: Sequence[Cube]) -> bool:
    """Whether no run ever is in one of the cubes or bad.

    That is: INIT is in none of them, a round leads from outside of all of them to none, and outside
    of them nothing is bad.
    """
    now = [_cube(g, cube, [latch.literal for latch in question.latches]) for cube in cubes]
    first = [_cube(g, cube, [latch.init for latch in question.latches]) for cube in cubes]
    then = [_cube(g, cube, [latch.next for latch in question.latches]) for cube in cubes]
    start = Clauses(g, OTHER)
    start.require(question.opens)
    initiated = not start.solve([start.of(g.any_of(first))])
    start.close()
    step = Clauses(g, OTHER)
    for literal in (*question.given, *(x ^ 1 for x in now)):
        step.require(literal)
    safe = not step.solve([step.of(question.bad)])
    step.require(question.steps)
    kept = not step.solve([step.of(g.any_of(then))])
    step.close()
    return initiated and safe and kept


def _cube(g: Graph, cube: Cube, literals: Sequence[int]) -> int:
    return g.all_of(literals[abs(x) - 1] ^ (x < 0) for x in cube)
