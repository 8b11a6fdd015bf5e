"""A time limit for each claim: what is open after all were asked together is asked one by one."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from dataclasses import replace
from textwrap import dedent
from typing import Any

import pytest

from koord.semantics.configurations import System, dealt
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.verify import apart
from koord.verify.apart import verify_apart
from koord.verify.claims import claims_of, liveness_of
from koord.verify.portfolio import Choice, verify
from koord.verify.verdicts import Bounds, Engine, Outcome, Report, Verdict

#: More than anything here takes, on any machine.
AMPLE = Bounds(rounds=6, claim_s=600.0)

TEXT = """
local:
    int steps = 0
    int laps = 0
allwrite:
    int sum = 0
Step:
    pre: steps < 3
    eff:
        atomic:
            steps = steps + 1
            sum = sum + 1
Rest:
    pre: steps >= 3
    eff: stop
invariant Within: forall i: steps@i <= 3
invariant Idle: forall i: laps@i == 0
invariant Few: sum < 4
invariant Uneven: forall i, j: steps@i <= steps@j + 1
eventually Done: forall i: steps@i == 3
"""


@pytest.fixture
def system() -> System:
    program = load(Source("apart.krd", dedent(TEXT))).program
    assert program is not None
    return dealt(program, 2)


def nothing(system: System) -> Report:
    """A report in which everything is open."""
    claims = (*claims_of(system), *liveness_of(system))
    return Report(tuple(Verdict(c, Outcome.UNKNOWN, Engine.NONE, 0.0) for c in claims), (), 0.0)


def without_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """All claims together come to nothing, so that each is asked by itself."""

    def asked(system: System, bounds: Bounds, choice: Choice, **more: Any) -> Report:
        if not more.get("known"):
            return nothing(system)
        return verify(system, bounds, choice, **more)

    monkeypatch.setattr(apart, "verify", asked)


def timeless(report: Report) -> list[Verdict]:
    return [replace(verdict, seconds=0.0) for verdict in report.verdicts]


def outcomes(report: Report) -> dict[str, Outcome]:
    return {verdict.claim.name: verdict.outcome for verdict in report.verdicts}


def test_with_time_for_all_it_is_one_verification(system: System) -> None:
    plain = verify(system, AMPLE)
    assert timeless(verify_apart(system, AMPLE)) == timeless(plain)
    assert outcomes(plain) == {
        "Within": Outcome.HOLDS,
        "Idle": Outcome.HOLDS,
        "Few": Outcome.VIOLATED,
        "Uneven": Outcome.VIOLATED,
        "no fault": Outcome.HOLDS,
        "Done": Outcome.HOLDS,
    }


def test_what_is_open_is_asked_one_by_one(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    without_the_first(monkeypatch)
    assert outcomes(verify_apart(system, AMPLE)) == outcomes(verify(system, AMPLE))


def test_several_processes_give_the_answers_of_one(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Verdicts, engines and counterexamples are equal."""
    without_the_first(monkeypatch)
    one = verify_apart(system, AMPLE, names=["Idle", "Few", "Done"])
    two = verify_apart(system, AMPLE, names=["Idle", "Few", "Done"], jobs=2)
    assert [verdict.claim.name for verdict in one.verdicts] == ["Idle", "Few", "Done"]
    assert timeless(one) == timeless(two)
    assert not two.interrupted


def counting(calls: int) -> Callable[[], bool]:
    """True after so many calls."""
    left = iter(range(calls))
    return lambda: next(left, None) is None


def test_on_ctrl_c_no_process_stays(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    without_the_first(monkeypatch)
    report = verify_apart(system, AMPLE, jobs=2, interrupted=counting(1))
    assert report.interrupted
    assert Outcome.UNKNOWN in outcomes(report).values()
    assert multiprocessing.active_children() == []


def test_what_takes_longer_is_unknown(system: System) -> None:
    report = verify_apart(system, replace(AMPLE, claim_s=1e-9))
    assert set(outcomes(report).values()) == {Outcome.UNKNOWN}
    assert {verdict.reason for verdict in report.verdicts} == {"timeout"}


def test_what_is_proved_by_then_stays_and_helps(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of known verdicts those that settle something are lemmas, the others are left alone."""
    plain = verify(system, AMPLE)
    some = replace(
        plain,
        verdicts=tuple(
            v if v.claim.name != "Few" else replace(v, outcome=Outcome.UNKNOWN, counterexample=None)
            for v in plain.verdicts
        ),
    )

    def asked(system: System, bounds: Bounds, choice: Choice, **more: Any) -> Report:
        if not more.get("known"):
            return some
        # In a process of its own: what is wrong there is raised here.
        assert (more["names"], len(more["known"])) == (["Few"], len(plain.verdicts))
        return verify(system, bounds, choice, **more)

    monkeypatch.setattr(apart, "verify", asked)
    report = verify_apart(system, AMPLE)
    assert outcomes(report) == outcomes(plain)
