"""What a ledger knows of the time that was spent on each claim."""

from __future__ import annotations

from dataclasses import dataclass

from koord.semantics.every_number import NotFiniteError
from koord.syntax.source import NOWHERE
from koord.syntax.system import System, dealt
from koord.verify.claims import Claim, claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.ledger import Ledger, Reach, VerificationProblem
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.loading import program_of

TEXT = """
local:
    int x = 0
Step:
    pre: x < 3
    eff: x = x + 1
invariant A: forall i: x@i < 9
invariant B: forall i: x@i < 8
"""


@dataclass
class Clock:
    now: float = 100.0

    def __call__(self) -> float:
        return self.now


def begun(clock: Clock) -> tuple[Ledger, Claim, Claim]:
    program = program_of(TEXT)
    system: System = dealt(program, 2)
    claims = claims_of(system)

    def judge(*of: object) -> None:
        raise AssertionError

    subject = VerificationProblem(system, judge, system)  # type: ignore[arg-type]
    ledger = Ledger(subject, Bounds(), Deadline(), claims, clock=clock)
    return ledger, claims[0], claims[1]


def held(claim: Claim) -> dict[Claim, Verdict]:
    return {claim: Verdict(claim, Outcome.HOLDS, Engine.SEARCH, 0.0)}


def test_all_engines_that_were_asked_count() -> None:
    clock = Clock()
    ledger, a, b = begun(clock)
    clock.now += 2
    ledger.leave([a, b], Reach(Engine.BMC, 3, "gave up", 0.0))
    clock.now += 3
    ledger.settle(held(a))
    clock.now += 4
    assert ledger.verdict(a).seconds == 5
    assert ledger.verdict(b).seconds == 9


def test_a_claim_that_nobody_said_anything_of_was_worked_on_all_the_same() -> None:
    clock = Clock()
    ledger, a, _ = begun(clock)
    ledger.stopped = "timeout"
    clock.now += 7
    verdict = ledger.verdict(a)
    assert (verdict.reason, verdict.seconds) == ("timeout", 7)


def test_who_waits_for_others_does_not_count() -> None:
    """Claims that are asked singly, one after the other: each has its own time."""
    clock = Clock()
    ledger, a, b = begun(clock)
    clock.now += 1
    with ledger.waiting():
        for claim, seconds in ((a, 10), (b, 20)):
            own = ledger.of([claim], lambda text: None)
            clock.now += seconds
            own.settle(held(claim))
            ledger.take(own.extract([claim]))
    assert ledger.verdict(a).seconds == 11
    assert ledger.verdict(b).seconds == 21


def test_two_who_work_at_the_same_time_count_once() -> None:
    clock = Clock()
    ledger, a, _ = begun(clock)
    one, two = (ledger.of([a], lambda text: None) for _ in range(2))
    clock.now += 10
    first = one.extract([a])
    clock.now += 5
    two.settle(held(a))
    with ledger.waiting():
        ledger.take(first)
        ledger.take(two.extract([a]))
    assert ledger.verdict(a).seconds == 15


def test_what_was_spent_before_counts() -> None:
    clock = Clock()
    ledger, a, _ = begun(clock)
    ledger.before = {a: 30.0}
    clock.now += 1
    ledger.settle(held(a))
    assert ledger.verdict(a).seconds == 31


def test_the_live_line_names_claims_and_says_what_goes_on_for() -> None:
    ledger, a, b = begun(Clock())
    told: list[str] = []
    ledger.report = told.append
    ledger.progress("bmc, round 2 of 20")
    ledger.settle(held(a))
    ledger.progress("bmc, round 3 of 20")
    ledger.leave(ledger.open(), Reach(Engine.BMC, ledger.bounds.rounds, "", 0.0))
    ledger.progress("induction over 2 rounds")
    ledger.settle(held(b))
    ledger.say("looking for what never happens: event Step")
    assert told == [
        "A, B and 1 more: bmc, round 2 of 20",
        "B, no fault: bmc, round 3 of 20",
        "answered; for all rounds, B, no fault: induction over 2 rounds",
        "looking for what never happens: event Step",
    ]


def test_what_an_engine_cannot_follow_is_a_limit_and_no_mistake() -> None:
    ledger, a, _ = begun(Clock())

    def work() -> None:
        raise NotFiniteError(NOWHERE, "a list may have any length")

    with ledger.stopping(), ledger.enduring("bmc"):
        work()
    assert not ledger.failures
    assert "a list may have any length" in ledger.verdict(a).reason
