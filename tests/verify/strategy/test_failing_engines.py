"""An engine that fails costs its own answer, whatever becomes of it: the others' verdicts stay."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from ctypes import ArgumentError
from functools import partial

import pytest
import z3

from koord.verify.bounded_check import Unroller
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose
from koord.verify.ledger import Ledger, VerificationProblem
from koord.verify.strategy import resumption
from koord.verify.strategy.each_claim_turn import EachClaimTurn
from koord.verify.strategy.table import AnyTurn, EngineTurn
from koord.verify.strategy.time_limits import verify_apart
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Report
from tests.sampling import first
from tests.verify.asking import judged, of_text

PROGRAM = """
local:
    int x = 0
    int y = 0
    bool done = false

Grow:
    pre: x < 5
    eff:
        x = x + 1
        y = y + x * x

Finish:
    pre: x == 5
    eff: done = true

invariant Easy: forall i: x@i >= 0
invariant Broken: forall i: x@i < 2
invariant Open: forall i: y@i != 54
eventually Done: forall i: done@i
"""

#: Everybody that the default asks, with the name that its failures have.
ENGINES = {
    "search, to refute": "search",
    "every N": "every N",
    "every N, to infer": "every N",
    "search": "search",
    "induction": "induction",
    "bits": "bits",
    "bmc": "bmc",
    "bmc, each claim": "bmc",
    "spacer, to hold back": "spacer",
    "spacer, to release": "spacer",
    "search, of runs": "search",
    "bits, of runs": "bits",
}

#: Those that settle what the others are to leave alone.
DECIDING = {
    "every N",
    "induction",
    "bmc",
    "bmc, each claim",
    "search, of runs",
    "bits, of runs",
}


def who(turn: AnyTurn) -> str:
    """Whose turn it is, for what."""
    if not isinstance(turn, EngineTurn):
        return f"{turn.name}, each claim"
    if turn.workers.of_runs:
        return f"{turn.name}, of runs"
    if turn.task.purpose is not Purpose.SETTLE:
        return f"{turn.name}, to {turn.task.purpose.value}"
    return turn.name


def raising(error: BaseException) -> Callable[[object, Ledger], None]:
    def work(self: object, ledger: Ledger) -> None:
        raise error

    return work


def killed_by(number: signal.Signals) -> Callable[[object, Ledger], None]:
    def work(self: object, ledger: Ledger) -> None:
        os.kill(os.getpid(), number)

    return work


def deep(self: object, ledger: Ledger) -> None:
    deep(self, ledger)


def hanging(self: object, ledger: Ledger) -> None:
    signal.pause()


#: What may become of an engine, and what is said of it.
FAULTS: dict[str, tuple[Callable[[object, Ledger], None], str]] = {
    "raises": (raising(AssertionError("made to fail")), "AssertionError: made to fail"),
    "is killed": (killed_by(signal.SIGKILL), "its process was ended by SIGKILL"),
    "crashes": (killed_by(signal.SIGSEGV), "its process was ended by SIGSEGV"),
    "has no memory": (raising(MemoryError()), "out of memory"),
    "has no memory for Z3": (raising(z3.Z3Exception("out of memory")), "out of memory"),
    "disappoints Z3": (raising(z3.Z3Exception("parser error")), "Z3Exception: parser error"),
    "recurses": (deep, "RecursionError"),
}

#: What is so of the program, whoever fails.
OUTCOMES = {
    "Easy": (Outcome.HOLDS, None),
    "Broken": (Outcome.VIOLATED, None),
    "Open": (Outcome.HOLDS, 3),
    "no fault": (Outcome.HOLDS, None),
    "Done": (Outcome.HOLDS, None),
}

OVERDUE = "it did not end when its share of the time was over"

#: Those that end the process that an engine works in.
ENDING = {"is killed", "crashes"}

#: Those that fail by default: what becomes of a process hangs little on whose turn it was.
SAMPLE = {
    ("every N", "is killed"),
    *((engine, "raises") for engine in ("search, to refute", "bits, of runs", "induction")),
}

CASES = [
    pytest.param(
        engine,
        fault,
        id=f"{engine} {fault}",
        marks=[] if (engine, fault) in SAMPLE else [pytest.mark.slow],
    )
    for engine in ENGINES
    for fault in FAULTS
]


def asked(
    choice: Engine | None = None, seconds: float | None = None, *, apart: bool = True
) -> Report:
    ask = verify_apart if apart else verify
    return ask(of_text(PROGRAM, robots=1), Bounds(3, seconds), choice)


def outcomes(report: Report) -> dict[str, tuple[Outcome, int | None]]:
    return {v.claim.name: (v.outcome, v.rounds) for v in report.verdicts}


def failing(monkeypatch: pytest.MonkeyPatch, fault: str, *engines: str) -> None:
    """Let engines fail, and those that are neither they nor needed to settle things say nothing."""
    fails = hanging if fault == "hangs" else FAULTS[fault][0]
    for kind in (EngineTurn, EachClaimTurn):
        whole = kind.work

        def work(self: AnyTurn, ledger: Ledger, whole: Callable[..., None] = whole) -> None:
            if who(self) in engines:
                fails(self, ledger)
            elif who(self) in DECIDING:
                whole(self, ledger)

        monkeypatch.setattr(kind, "work", work)


@pytest.mark.parametrize(("engine", "fault"), first(2, CASES))
def test_the_others_verdicts_stay(engine: str, fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, fault, engine)
    report = asked(apart=fault in ENDING)
    assert outcomes(report) == OUTCOMES
    if engine == "bits, of runs":  # the search was quicker
        assert report.failures == ()
        return
    # Where it is asked twice, the words of Python may differ behind the kind of its mistake.
    said = {(failure.who, failure.what[: len(FAULTS[fault][1])]) for failure in report.failures}
    assert said == {(ENGINES[engine], FAULTS[fault][1])}


@pytest.mark.parametrize("fault", ["raises", "is killed"])
def test_what_is_open_names_the_engine_that_failed(
    fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, fault, "bits", "bits, of runs")
    report = asked(Engine.BITS)
    for verdict in report.verdicts:
        assert verdict.outcome is Outcome.UNKNOWN
        assert f"bits failed: {FAULTS[fault][1]}" in verdict.reason


#: What the others need together is a small part of it, and what a hanging one has of it another.
BUDGET_S, SMALL_SHARE = 30.0, 0.06


@pytest.mark.parametrize(
    "engine",
    [pytest.param(e, marks=[] if e == "every N" else [pytest.mark.slow]) for e in ENGINES],
)
def test_an_engine_that_hangs_costs_its_share_of_the_time(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, "hangs", engine)
    monkeypatch.setattr(resumption, "SHARE", SMALL_SHARE)
    report = asked(seconds=BUDGET_S)
    assert outcomes(report) == OUTCOMES
    assert report.seconds <= 1.05 * BUDGET_S
    named = (
        () if engine == "bits, of runs" else ((ENGINES[engine], OVERDUE),)
    )  # the search was quicker
    assert tuple((f.who, f.what) for f in report.failures) == named


def test_an_engine_that_hangs_alone_is_ended_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, "hangs", "search", "search, of runs")
    report = asked(Engine.SEARCH, seconds=1.0)
    found = {v.claim.name: v for v in report.verdicts}
    assert found["Broken"].outcome is Outcome.UNKNOWN
    assert found["Broken"].reason == "timeout; search was being asked"
    assert report.seconds < 10.0  # who hangs would never end


def disguised(self: object, ledger: Ledger) -> None:
    """What ctypes makes of Ctrl-C inside a call of Z3."""
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise ArgumentError("argument 1: KeyboardInterrupt") from None


def test_ctrl_c_is_no_failure_whatever_it_is_raised_as(monkeypatch: pytest.MonkeyPatch) -> None:
    turn = EngineTurn.work

    def work(self: EngineTurn, ledger: Ledger) -> None:
        (disguised if who(self) == "every N, to infer" else turn)(self, ledger)

    monkeypatch.setattr(EngineTurn, "work", work)
    report = asked()
    assert report.interrupted
    assert report.failures == ()
    assert outcomes(report)["Easy"] == (Outcome.HOLDS, None)
    # Who was asked at the same time may have found out more.
    assert outcomes(report)["Open"][0] is not Outcome.VIOLATED


def test_unrolling_that_failed_begins_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was half done when it failed is relied on by nobody."""

    def half_done(self: Unroller, *rest: object) -> None:
        raise AssertionError("half done")

    system = of_text(PROGRAM, robots=1)
    subject = VerificationProblem(system, partial(judged, system), system)
    ledger = Ledger(subject, Bounds(3), Deadline(), claims_of(system))
    unrolling = Unroller()
    with monkeypatch.context() as patched:
        patched.setattr(Unroller, "_through", half_done)
        with ledger.enduring(unrolling.name):
            unrolling.work(ledger)
    assert unrolling.bounded is None
    assert [str(failure.what) for failure in ledger.failures] == ["AssertionError: half done"]
    unrolling.work(ledger)
    assert ledger.is_violated
