"""Each question to a SAT solver ends in time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import combinations, product
from random import Random

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


class _Impatient(Clauses):
    """All that can be taken apart is asked in parts."""

    def _answer(
        self, assumptions: Sequence[int], deadline: Deadline, conflicts: int | None = None
    ) -> SolverAnswer:
        if conflicts is not None:
            return SolverAnswer.UNKNOWN
        return super()._answer(assumptions, deadline)


@pytest.mark.parametrize("engine", [QUICK, OTHER])
def test_parts_say_what_the_whole_says(engine: str) -> None:
    """Of random formulas that are true somewhere or nowhere, under assumptions."""
    count: Counter[str] = Counter()
    for seed in range(150):
        random, g = Random(seed), Graph()
        inputs = [g.input(f"i{k}") for k in range(5)]

        def made(depth: int, r: Random = random, leaves: Sequence[int] = inputs) -> list[int]:
            parts = [r.choice(leaves) ^ r.choice((0, 1)) for _ in range(r.choice((2, 3)))]
            for _ in range(depth):
                how = g.all_of if r.random() < 0.5 else g.any_of  # noqa: B023
                parts = [how([*parts, *made(depth - 1)]), r.choice(leaves) ^ r.choice((0, 1))]
            return parts

        literal = g.all_of([g.any_of(made(2)), g.any_of(made(2)), *made(1)])
        given = [x ^ random.choice((0, 1)) for x in random.sample(inputs, 2)]
        clauses = _Impatient(g, engine)
        assumed = [clauses.of(x) for x in given]
        everywhere = [
            dict(zip((x >> 1 for x in inputs), bits, strict=True))
            for bits in product((False, True), repeat=len(inputs))
        ]
        expected = any(all(g.values([literal, *given], bits)) for bits in everywhere)
        assert clauses.can_hold(literal, assumed) is expected, seed
        count[f"{expected}, {min(len(g.ways(literal)), 2)} ways"] += 1
        if not expected:
            core = [x for x, number in zip(given, assumed, strict=True) if number in clauses.core()]
            assert not any(all(g.values([literal, *core], bits)) for bits in everywhere), seed
    assert count["True, 2 ways"] >= 10, count
    assert count["False, 2 ways"] >= 10, count


def test_a_hard_question_that_is_taken_apart_ends_with_the_time_too() -> None:
    for deadline, left in ((Deadline.after(0.3), None), (None, 2)):
        clauses = crowded(QUICK, deadline, left)
        g = clauses.graph
        either = g.any_of([g.input("a"), g.input("b")])
        with pytest.raises(NoAnswerError):
            clauses.can_hold(either)
