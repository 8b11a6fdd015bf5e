"""Where a deadline is set no solver is asked without a limit, and the clock is looked at."""

from __future__ import annotations

import time
from typing import Any

import pytest
import z3

from koord.syntax.system import System, dealt
from koord.verify import processes
from koord.verify.engine_names import Engine
from koord.verify.strategy import each_claim_turn
from koord.verify.strategy.table import SAFETY
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome
from tests.loading import program_of

TEXT = """
local:
    int n = 0
    float x = 0.0
allwrite:
    int sum = 0
Up:
    pre: n < 3
    eff:
        atomic:
            n = n + 1
            sum = sum + n
Drift:
    pre: n >= 3
    eff: x = x / 2 + 1
invariant Small: forall i: x@i < 2.5
invariant Few: sum < 40
"""

#: Those that ask Z3.
ENGINES = [None, Engine.BMC, Engine.INDUCTION, Engine.EVERY_N, Engine.SPACER]

#: More than is needed; in whole seconds, to be told from Z3's own default.
BUDGET_S = 60.0


@pytest.fixture
def system() -> System:
    return dealt(program_of(TEXT), 2)


def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "can_fork", lambda: False)
    monkeypatch.setattr(each_claim_turn, "can_fork", lambda: False)


@pytest.mark.parametrize("choice", ENGINES, ids=str)
def test_no_question_is_asked_without_a_limit(
    system: System, choice: Engine | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_this_process(monkeypatch)
    limits: dict[int, dict[str, int]] = {}
    asked: list[dict[str, int]] = []

    def watch(kind: Any, question: str) -> None:
        plain_set, plain_ask = kind.set, getattr(kind, question)

        def set_(self, *setting, **settings):  # type: ignore[no-untyped-def]
            limits.setdefault(id(self), {}).update([setting] if setting else settings)
            return plain_set(self, *setting, **settings)

        def ask(self, *terms):  # type: ignore[no-untyped-def]
            asked.append(dict(limits.get(id(self), {})))
            return plain_ask(self, *terms)

        monkeypatch.setattr(kind, "set", set_)
        monkeypatch.setattr(kind, question, ask)

    watch(z3.Solver, "check")
    watch(z3.Fixedpoint, "query")
    verify(system, Bounds(3, timeout_s=BUDGET_S), choice)
    assert asked
    for each in asked:
        is_quick = 0 < each.get("rlimit", 0) <= 200_000
        assert is_quick or 0 < each.get("timeout", 0) <= BUDGET_S * 1000, each


@pytest.mark.parametrize("choice", list(SAFETY), ids=str)
def test_the_clock_is_looked_at(
    system: System, choice: Engine | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a clock on which each look takes a second, few looks are taken after the time is up."""
    in_this_process(monkeypatch)
    looks = [0]

    class TooLateError(BaseException):
        """No engine endures this."""

    def monotonic() -> float:
        looks[0] += 1
        if looks[0] > 400:
            raise TooLateError
        return float(looks[0])

    monkeypatch.setattr(time, "monotonic", monotonic)
    report = verify(system, Bounds(10_000, timeout_s=40.0), choice)
    assert {verdict.outcome for verdict in report.verdicts} <= {Outcome.HOLDS, Outcome.UNKNOWN}
