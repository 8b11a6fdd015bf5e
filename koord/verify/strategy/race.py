"""Races: engines that are asked at the same time, whose answers count in the table's order.

Each engine works in a process of its own, on what was known when the race began, and knows nothing
of the others. So what is said hangs neither on how many processes there are, nor on who is first:
answers count one after the other, as if each engine had been asked in turn. Once all is settled,
those behind are ended at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain, zip_longest

from msgspec import Struct

from koord.syntax.budget import OutOfBudgetError
from koord.verify.claims import Claim
from koord.verify.job_process import JobChannel
from koord.verify.ledger import Extract, Ledger, reach_of
from koord.verify.obstacles import Failure
from koord.verify.processes import Job, Pool
from koord.verify.strategy.each_claim_turn import SlicesTurn
from koord.verify.strategy.resumption import PastVerification, Steps, StrategyStep
from koord.verify.strategy.table import AnyTurn
from koord.verify.verdicts import Outcome, Verdict

#: Makes a turn, with engines of its own, for whoever takes its steps.
Maker = Callable[[Steps], AnyTurn]


class Runner(Struct, frozen=True):
    """An engine in a race: its number among the steps of the strategy, its name, its turn."""

    number: int
    name: str
    turn: Maker


class RaceTurn(Struct, frozen=True):
    """A turn: engines race for the open claims.

    The answers of ``first`` count first, then those of ``beside``; they are started alternately.
    It goes on while claims are ``wanted``.
    """

    first: Sequence[Runner]
    beside: Sequence[Runner]
    pool: Pool
    steps: Steps
    stage: str
    wanted: Callable[[Ledger], bool]
    quick: bool = False

    @property
    def name(self) -> str:
        """The turn's name in reports of failures."""
        return "race"

    def work(self, ledger: Ledger) -> None:
        claims = ledger.open()
        known = ledger.of(claims, ledger.report)
        jobs = {
            runner.number: self._started(known, claims, runner, PastVerification())
            for runner in self._alternately()
            if self.steps.is_open(self.stage, runner.number, runner.name)
        }
        try:
            for runner in (*self.first, *self.beside):
                if self.steps.begin(self.stage, runner.number, runner.name):
                    self._take(ledger, known, claims, runner, jobs)
                if not self.wanted(ledger) or ledger.is_overtime():
                    return
        except BaseException:
            # What is known by then counts, whoever it is that knows.
            for job in jobs.values():
                _take_notes(ledger, job)
            raise
        finally:
            for job in jobs.values():
                self.pool.drop(job)

    def _alternately(self) -> Iterator[Runner]:
        pairs = zip_longest(self.first, self.beside)
        return (runner for runner in chain.from_iterable(pairs) if runner is not None)

    def _started(
        self,
        known: Ledger,
        claims: Sequence[Claim],
        runner: Runner,
        past: PastVerification,
        *,
        first: bool = False,
    ) -> Job[Extract]:
        work = partial(_asked, known, claims, runner, past)
        until = known.deadline.at_last()
        return self.pool.submit("", work, until=until, counts=False, first=first)

    def _take(
        self,
        ledger: Ledger,
        known: Ledger,
        claims: Sequence[Claim],
        runner: Runner,
        jobs: dict[int, Job[Extract]],
    ) -> None:
        """Merge the answer of an engine; one that dies is followed by the rest of its turn."""
        past = PastVerification()
        while True:
            job = jobs[runner.number]
            with ledger.waiting():
                said = self.pool.answer(job)
            if said is not None:
                ledger.take(said)
                if said.interrupted:
                    raise KeyboardInterrupt
                return
            _take_notes(ledger, job)
            if ledger.deadline.passed():
                raise OutOfBudgetError
            before, past = past, past.told(job.noted)
            who = past.begun[-1].who if past.begun else runner.name
            ledger.fail(Failure(who, job.end))
            if len(past.begun) == len(before.begun):
                return  # it gets no further
            jobs[runner.number] = self._started(known, claims, runner, past, first=True)


def _asked(
    known: Ledger,
    claims: Sequence[Claim],
    runner: Runner,
    past: PastVerification,
    tell: JobChannel,
) -> Extract:
    """Take one turn in a process of its own, which tells of steps and verdicts as they come."""
    own = known.of(claims, tell)
    steps = Steps(past, tell.note, tell.lasting)
    steps.follow(own)
    turn = runner.turn(steps)
    try:
        if isinstance(turn, SlicesTurn):  # it asks others
            with own.enduring(turn.name):
                turn.work(own)
        else:
            steps.take("", runner.number, turn.name, turn.work, own)
    except KeyboardInterrupt:
        own.stopped, own.interrupted = "interrupted", True
    return own.extract(claims)


def _take_notes(ledger: Ledger, job: Job[Extract]) -> None:
    """Merge what a process told of before it ended, or by now."""
    for noted in job.noted:
        match noted:
            case Verdict(outcome=outcome, claim=claim) if claim in ledger.open():
                if outcome is Outcome.UNKNOWN:
                    ledger.leave([claim], reach_of(noted))
                else:
                    ledger.settle({claim: noted})
            case Failure():
                ledger.fail(noted)
            case Verdict() | StrategyStep():
                pass
            case _:
                raise AssertionError(noted)
