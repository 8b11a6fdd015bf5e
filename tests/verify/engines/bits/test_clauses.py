"""Each question to a SAT solver ends in time."""

from __future__ import annotations

from itertools import combinations

import pytest

from koord.verify.effort import Deadline
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.engines.bits.clauses import OTHER, QUICK, Clauses, NoAnswerError
from koord.verify.engines.bits.graph import Graph

#: So many pigeons and one more do not go into as many holes: quick to ask, slow to tell.
HOLES = 11


def crowded(engine: str, deadline: Deadline | None = None, left: int | None = None) -> Clauses:
    clauses = Clauses(Graph(), engine, deadline or Deadline(), left)
    at = [[clauses.variable() for _ in range(HOLES)] for _ in range(HOLES + 1)]
    for pigeon in at:
        clauses.add(pigeon)
    for hole in range(HOLES):
        for one, other in combinations(at, 2):
            clauses.add([-one[hole], -other[hole]])
    return clauses


@pytest.mark.parametrize("engine", [QUICK, OTHER])
def test_a_hard_question_ends_with_the_time(engine: str) -> None:
    assert crowded(engine).solve_in_time([], Deadline.after(0.3)) is SolverAnswer.UNKNOWN
    with pytest.raises(NoAnswerError):
        crowded(engine, Deadline.after(0.3)).solve([])


def test_hard_questions_end_after_so_much_work() -> None:
    with pytest.raises(NoAnswerError):
        crowded(QUICK, left=3).solve([])


def test_easy_questions_cost_none_of_it() -> None:
    clauses = Clauses(Graph(), QUICK, left=1)
    x = clauses.variable()
    clauses.add([x])
    assert all(clauses.solve([x]) for _ in range(10))
    assert not clauses.solve([-x])
    assert clauses.left == 1
