"""A time limit for each claim: what is open after all were asked together is asked one by one."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from koord.syntax.system import System, dealt
from koord.verify import processes
from koord.verify.claims import claims_of, liveness_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.strategy import time_limits, verification
from koord.verify.strategy.resumption import StrategyStep
from koord.verify.strategy.time_limits import verify_apart
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report, Verdict
from tests.children import forked_children
from tests.loading import program_of

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
    return dealt(program_of(TEXT), 2)


def nothing(system: System) -> Report:
    """A report in which everything is open."""
    claims = (*claims_of(system), *liveness_of(system))
    return Report(tuple(Verdict(c, Outcome.UNKNOWN, Engine.NONE, 0.0) for c in claims), (), 0.0)


def without_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """All claims together come to nothing, so that each is asked by itself."""

    def asked(system: System, bounds: Bounds, choice: Engine | None, **more: Any) -> Report:
        if not more.get("known"):
            return nothing(system)
        return verify(system, bounds, choice, **more)

    monkeypatch.setattr(verification, "verify", asked)


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
    assert forked_children() == set()


def test_what_takes_longer_is_unknown(system: System) -> None:
    report = verify_apart(system, replace(AMPLE, claim_s=1e-9), names=["Idle"])
    assert set(outcomes(report).values()) == {Outcome.UNKNOWN}
    assert {verdict.reason.split("; ")[0] for verdict in report.verdicts} == {"timeout"}


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

    def asked(system: System, bounds: Bounds, choice: Engine | None, **more: Any) -> Report:
        if not more.get("known"):
            return some
        # In a process of its own: what is wrong there is raised here.
        assert (more["names"], len(more["known"])) == (["Few"], len(plain.verdicts))
        return verify(system, bounds, choice, **more)

    monkeypatch.setattr(verification, "verify", asked)
    report = verify_apart(system, AMPLE)
    assert outcomes(report) == outcomes(plain)


# --- nothing takes longer than it may ------------------------------------------------------------


def deaf(system: System, bounds: Bounds, choice: Engine | None, **more: Any) -> Report:
    """Tells of one verdict, and then hears nothing and looks at no clock."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    first = claims_of(system)[0]
    more["noted"](Verdict(first, Outcome.UNKNOWN, Engine.BMC, 0.1, 4))
    if not more.get("known"):
        more["noted"](Verdict(claims_of(system)[1], Outcome.HOLDS, Engine.INDUCTION, 0.1))
    while True:
        pass


def test_who_does_not_end_in_time_is_ended(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it had told of by then counts."""
    monkeypatch.setattr(verification, "verify", deaf)
    report = verify_apart(system, replace(AMPLE, claim_s=None, timeout_s=0.01))
    shown = {v.claim.name: (v.outcome, v.rounds, v.reason) for v in report.verdicts}
    assert shown["Within"] == (Outcome.UNKNOWN, 4, "timeout")
    assert shown["Idle"] == (Outcome.HOLDS, None, "")
    assert shown["Done"] == (Outcome.UNKNOWN, None, "timeout")
    assert all(v.seconds > 0 for v in report.verdicts)
    assert not report.interrupted
    assert forked_children() == set()


def test_who_does_not_hear_ctrl_c_is_ended(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verification, "verify", deaf)
    monkeypatch.setattr(processes, "_ENDED_S", 0.3)
    monkeypatch.setattr(processes, "_TOLD_S", 0.1)
    report = verify_apart(system, replace(AMPLE, claim_s=None), interrupted=counting(2))
    assert report.interrupted
    assert {v.claim.name: v.outcome for v in report.verdicts}["Idle"] is Outcome.HOLDS
    assert forked_children() == set()


def test_all_that_is_done_for_a_claim_counts(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is spent on all together is no more there for each by itself."""
    given: list[float] = []

    def asked(tell: Any, bounds: Bounds, **more: Any) -> Report:
        assert bounds.timeout_s is not None
        given.append(bounds.timeout_s)
        clock[0] += bounds.timeout_s
        return nothing(system)

    def together(self: Any, seconds: float, jobs: int, names: Any = ()) -> Report:
        return asked(None, replace(AMPLE, timeout_s=seconds))

    def each(self: Any, names: Any, seconds: float, *more: Any) -> bool:
        given.append(seconds)
        return False

    clock = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(time_limits._Asking, "together", together)
    monkeypatch.setattr(time_limits._Asking, "each", each)
    verify_apart(system, replace(AMPLE, claim_s=10.0))
    assert sum(given) <= 10.0 * 1.01
    alone = replace(system, program=replace(system.program, properties=()))
    given.clear()
    verify_apart(alone, replace(AMPLE, claim_s=10.0))
    assert sum(given) <= 10.0 * 1.01


def test_who_goes_on_after_a_crash_has_what_is_left(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that died has spent the time of its claim all the same."""
    given: list[float] = []

    class Dying:
        """Each process gets a step further, takes three seconds, and dies."""

        def __init__(self, *more: Any) -> None: ...

        def __enter__(self) -> Dying:
            return self

        def __exit__(self, *more: Any) -> None: ...

        def submit(
            self, name: str, work: Any, *, portable: Any, lasts_s: float, until: Any
        ) -> processes.Job[Any]:
            given.append(lasts_s)
            assert len(given) < 9, "there is no end to it"
            job: processes.Job[Any] = processes.Job(name, work)
            job.noted.append(StrategyStep("plain", len(given), "bmc"))
            job.lasted_s, job.exit_code = 3.0, -11
            return job

        def answers(self, jobs: Any) -> Any:
            return ((name, None) for name in jobs)

    monkeypatch.setattr(time_limits, "Pool", Dying)
    asking = time_limits._Asking(system, AMPLE, None, 0, 1, lambda text: None, lambda: False)
    found = {v.claim.name: v for v in nothing(system).verdicts}
    assert not asking.each(["Few"], 10.0, Deadline(), tuple(found.values()), found)
    assert given == pytest.approx([10.5, 7.35, 4.2, 1.1])
    assert found["Few"].seconds == pytest.approx(10.0)
    assert found["Few"].reason.startswith("timeout; bmc was being asked")
