"""Which of many goals can be met, asked together as far as the solver has an answer to that."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pytest

from koord.syntax import core
from koord.syntax.types import INT
from koord.verify.effort import Deadline, Effort
from koord.verify.encoding.solver import Solver, SolverAnswer
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem
from koord.verify.engines.every_n.questions import GENEROUS, Asking, Means
from tests.loading import program_of, protocol_text
from tests.verify.asking import system_of

#: Goals about one unknown number, of which every other one can be met.
GOALS = 8


@pytest.fixture
def asking() -> Asking:
    means = Means(Deadline(), Effort.of_seconds(GENEROUS.seconds), GENEROUS, 0)
    system = system_of(program_of(protocol_text("lock_server")), 2)
    return Asking(ParameterisedSystem.of(system), means)


def goals_of(asking: Asking) -> list[tuple[int, list[Term]]]:
    d = asking.world.d
    number = d.fresh("number", INT)
    asking.world.book.note(d.binary(core.BinaryOp.LE, number, GOALS))
    return [
        (k, [d.binary(core.BinaryOp.EQ, number, k if k % 2 else GOALS + 1 + k)])
        for k in range(GOALS)
    ]


def giving_up(monkeypatch: pytest.MonkeyPatch, hard: Sequence[Term]) -> list[int]:
    """Let the solver give up on what has one of some goals in it; the limits of its questions."""
    asked, check = list[int](), Solver.check
    texts = [str(term) for term in hard]

    def checked(
        solver: Solver,
        question: Iterable[Term],
        deadline: Deadline,
        effort: Effort | None = None,
        *,
        at_most: int = 0,
        for_model: bool = True,
    ) -> SolverAnswer:
        question = list(question)
        asked.append(at_most)
        if any(text in str(question[-1]) for text in texts):
            return SolverAnswer.UNKNOWN
        return check(solver, question, deadline, effort, at_most=at_most, for_model=for_model)

    monkeypatch.setattr(Solver, "check", checked)
    return asked


def test_what_can_be_met_is_told_in_both_ways(asking: Asking) -> None:
    goals = goals_of(asking)
    can_be = {k for k in range(GOALS) if k % 2}
    assert asking.sift(goals, []) == can_be
    assert asking.sift(goals, [], halves=True) == can_be
    assert asking.sift([], [], halves=True) == set()


def test_one_hard_goal_leaves_answers_about_the_others(
    asking: Asking, monkeypatch: pytest.MonkeyPatch
) -> None:
    goals = goals_of(asking)
    hard = 4  # which cannot be met: nobody knows that now
    asked = giving_up(monkeypatch, goals[hard][1])
    assert asking.sift(goals, []) == set(range(GOALS))
    assert asking.sift(goals, [], halves=True) == {1, 3, 5, 7, hard}
    # By itself it may take all that it could together with others.
    assert max(asked) == asked[0] == 4 * GENEROUS.question
    assert len(asked) < 2 * GOALS
