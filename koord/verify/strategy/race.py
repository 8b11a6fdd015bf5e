"""Races: engines that are asked at the same time, whose answers count in the table's order.

Each engine works in a process of its own, on what was known when the race began, and knows nothing
of the others. So what is said hangs neither on how many processes there are, nor on who is first:
answers count one after the other, as if each engine had been asked in turn. Once all is settled,
those behind are ended at once.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax.budget import OutOfBudgetError
from koord.verify.claims import Claim
from koord.verify.encoding.contexts import make_ahead
from koord.verify.encoding.z3_loading import z3
from koord.verify.job_process import JobChannel
from koord.verify.ledger import Extract, Ledger, reach_of
from koord.verify.obstacles import Failure
from koord.verify.processes import Job, Pool, can_fork
from koord.verify.strategy.each_claim_turn import SlicesTurn
from koord.verify.strategy.resumption import PastVerification, Steps, StrategyStep
from koord.verify.strategy.table import AnyTurn, Patience
from koord.verify.verdicts import Outcome, Verdict

#: Makes a turn, with engines of its own, for whoever takes its steps.
Maker = Callable[[Steps], AnyTurn]


class Worked(Struct, frozen=True):
    """The news of how much work a process did so far, in steps of evaluation."""

    steps: int


class Runner(Struct, frozen=True):
    """An engine in a race: its number among the steps of the strategy, its name, its turn.

    Where it ``has_answers`` it only has to say them. Others like it need what it is to ``load``.
    """

    number: int
    name: str
    turn: Maker
    has_answers: bool = False
    load: Callable[[], object] = lambda: None


class Ahead(Struct, frozen=True):
    """Those who are asked first in a race, and begun before it, on what is ``known`` by then.

    With one process they wait for the race.
    """

    runners: tuple[Runner, ...]
    known: Ledger
    job: Job[Extract]

    @staticmethod
    def begun(
        runners: Sequence[Runner], ledger: Ledger, pool: Pool, *, here: bool = False
    ) -> Ahead:
        """Begin with all open claims of a ledger, if there may be another process.

        ``here``: in this process; what takes longer than a glance goes on in another one.
        """
        known = ledger.of(ledger.open(), ledger.report)
        with ledger.waiting():
            job = _started(pool, known, runners, here=here)
        return Ahead(tuple(runners), known, job)

    def violated(self, ledger: Ledger) -> bool:
        """Return whether something is violated, as a ledger says, that they try to prove.

        That takes them longer than all else: an answer is looked for of which there is none.
        """
        found = (ledger.verdicts.get(claim) for claim in self.known.open())
        return any(verdict and verdict.outcome is Outcome.VIOLATED for verdict in found)

    def settles(self, ledger: Ledger, wanted: Callable[[Ledger], bool]) -> bool:
        """Take what they have at a glance if nothing is ``wanted`` behind it, or on Ctrl-C.

        Otherwise nothing is taken: others are asked, as if these were at it all the time. Raises
        KeyboardInterrupt where that ended it.
        """
        found = self.job.found
        if found is None:
            return False
        if not found.interrupted:
            probe = _with_answer(ledger, found)
            if wanted(probe):
                return False
        _take_all(ledger, found)
        return True

    @contextmanager
    def ending(self, ledger: Ledger, pool: Pool) -> Iterator[None]:
        """At the end of the context it is ended, be it that no race was run.

        If that is by Ctrl-C or for want of time, what it told of by then counts.
        """
        try:
            yield
        except BaseException:
            _take_notes(ledger, self.job)
            raise
        finally:
            pool.drop(self.job)


#: So much work is done by those who were begun ahead before others are asked beside them: what they
#: have at a glance needs no race, and is known to the others.
_HEAD_START = 3_000


class RaceTurn(Struct, frozen=True):
    """A turn: engines race for the open claims.

    The answers of ``first`` count first, who are asked in turn in one process; then those of
    ``beside``, each from a process of its own. Once others have answers, ``first`` are waited for
    with ``patience`` (None: to the end). It goes on while claims are ``wanted``. What is done
    ``meanwhile`` is begun as soon as they alone are waited for, or are done: a core is free for it.
    """

    first: Sequence[Runner]
    beside: Sequence[Runner]
    pool: Pool
    steps: Steps
    stage: str
    wanted: Callable[[Ledger], bool]
    quick: bool = False
    patience: Patience | None = None
    meanwhile: Callable[[], None] = lambda: None
    ahead: Ahead | None = None  #: those who are asked first, if they were begun before

    @property
    def name(self) -> str:
        """The turn's name in reports of failures."""
        return "race"

    def work(self, ledger: Ledger) -> None:
        jobs: dict[tuple[Runner, ...], Job[Extract]] = {}
        given: dict[tuple[Runner, ...], Ledger] = {}
        first, patience = tuple(filter(self._is_open, self.first)), self.patience
        try:
            if self.ahead is not None:
                violated = self.ahead.violated(ledger)
                first = self._after_head_start(ledger, self.ahead, jobs, anew=violated)
                if not violated:
                    given[self.ahead.runners] = self.ahead.known
                    if patience is not None:
                        glance = _at_a_glance(self.ahead.job)
                        patience = replace(patience, steps=patience.steps + glance)
                if not self.wanted(ledger):
                    return
            known = ledger.of(ledger.open(), ledger.report)
            beside = tuple(filter(self._is_open, self.beside))
            groups = [runners for runners in (first, *((each,) for each in beside)) if runners]
            if can_fork() and not (beside and beside[0].has_answers):
                make_ahead(z3.Context)  # for those who ask solvers, of whom some will be begun
            for runners in self._in_turn(groups, first):
                if runners not in jobs:
                    own = given.get(runners, known)
                    jobs[runners] = _started(self.pool, own, runners)
            most = None
            if first and patience is not None and can_fork():
                with ledger.waiting():
                    most = self._most(known, [jobs[runners] for runners in groups], patience)
            for runners in groups:
                self._begin(runners)
                if most is not None and runners is first:
                    _take_some(ledger, jobs[first], most)
                else:
                    self._take(ledger, given.get(runners, known), runners, jobs)
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

    def _after_head_start(
        self,
        ledger: Ledger,
        ahead: Ahead,
        jobs: dict[tuple[Runner, ...], Job[Extract]],
        *,
        anew: bool,
    ) -> tuple[Runner, ...]:
        """Take what those who were begun ahead have at a glance; return them if they go on.

        They begin ``anew`` in the race where something else is known by now than when they began.
        """
        job = jobs[ahead.runners] = ahead.job
        if can_fork():
            with ledger.waiting():
                self.pool.wait(job, lambda: job.is_done or _worked(job) > _HEAD_START)
        found = job.found if _worked(job) <= _HEAD_START else None
        if found is None:
            _take_notes(ledger, job, _HEAD_START)
        else:
            self._begin(ahead.runners)
            _take_all(ledger, found)
        if self.pool.is_stopped:
            raise KeyboardInterrupt
        if found is not None:
            return ()
        if anew or (self.pool.jobs == 1 and not job.is_done):
            # If there is one core, it is for others: they begin behind these.
            self.pool.drop(job)
            del jobs[ahead.runners]
        return ahead.runners

    def _begin(self, runners: Sequence[Runner]) -> None:
        for each in runners:
            self.steps.begin(self.stage, each.number, each.name)

    def _in_turn(
        self, groups: Sequence[tuple[Runner, ...]], first: tuple[Runner, ...]
    ) -> Sequence[tuple[Runner, ...]]:
        """The order in which processes are started: what counts first, if there is another core.

        With one, who says more waits for what is quick, and has no more work than counts.
        """
        if self.pool.jobs > 1 or not self.quick:
            return groups
        return sorted(groups, key=lambda runners: runners == first)

    def _is_open(self, runner: Runner) -> bool:
        return self.steps.is_open(self.stage, runner.number, runner.name)

    def _most(self, known: Ledger, jobs: Sequence[Job[Extract]], patience: Patience) -> int | None:
        """The work of the first process of which it counts what it said by then; None: all of it.

        It is as if others were asked one after the other beside it, and all stopped once what both
        had said until then is an answer. That hangs on what each of them does, and not on time.
        """
        first, *rest = jobs
        beside = _Beside(rest, [known], self.wanted, self.pool)
        for number, job in enumerate(rest):
            said = beside.said[number]

            def is_told(job: Job[Extract] = job, said: Ledger = said) -> bool:
                beside.look()
                self._use_core(first, beside)
                return job.is_done or (
                    first.is_done
                    and _worked(first) <= patience.of(beside.worked(job), _worked(job))
                    and not self.wanted(_with_notes(said, first))
                )

            self.pool.wait(job, is_told)
            if not job.is_done:
                return None
            beside.look()
            said, most = beside.said[number + 1], patience.of(beside.worked(job), _worked(job))
            broken = {c: v for c, v in said.verdicts.items() if v.outcome is Outcome.VIOLATED}
            heard = 0

            def is_late(
                most: int = most, broken: Mapping[Claim, Verdict] = broken, said: Ledger = said
            ) -> bool:
                nonlocal heard
                beside.look()
                if first.is_done or _worked(first) > most or self._is_hopeless(said, beside):
                    return True
                self._use_core(first, beside)
                new, heard = first.noted[heard:], len(first.noted)
                if heard > len(new) and all(isinstance(noted, Worked) for noted in new):
                    return False  # no more is known than before
                # Of what is violated nobody can say more.
                return not self.wanted(_with_notes(known, first, most, broken))

            self.pool.wait(first, is_late)
            if not self.wanted(_with_notes(said, first, most)):
                return most
        return None

    def _use_core(self, first: Job[Extract], beside: _Beside) -> None:
        """Begin other work once ``first`` alone are waited for, or no longer."""
        if not beside.leaves_core and (first.is_done or not self.wanted(beside.said[-1])):
            beside.leaves_core = True
            self.meanwhile()

    def _is_hopeless(self, said: Ledger, beside: _Beside) -> bool:
        """Return whether something is wanted that is open, and violated, as others found by now.

        Then whoever proves things has no answer with what is said.
        """
        found = beside.said[-1].verdicts
        broken = {c for c in said.open() if c in found and found[c].outcome is Outcome.VIOLATED}
        if not broken:
            return False
        others = [claim for claim in said.open() if claim not in broken]
        probe = said.of(said.open(), _unheard)
        probe.verdicts.update((claim, said.verdict(claim)) for claim in others)
        return self.wanted(probe)

    def _take(
        self,
        ledger: Ledger,
        known: Ledger,
        runners: tuple[Runner, ...],
        jobs: dict[tuple[Runner, ...], Job[Extract]],
    ) -> None:
        """Merge the answer of a process; one that dies is followed by the rest of its turns."""
        past = PastVerification()
        while True:
            job = jobs[runners]
            with ledger.waiting():
                said = self.pool.answer(job)
            if said is not None:
                _take_all(ledger, said)
                return
            _take_notes(ledger, job)
            if ledger.deadline.passed():
                raise OutOfBudgetError
            before, past = past, past.told(x for x in job.noted if not isinstance(x, Worked))
            who = past.begun[-1].who if past.begun else runners[0].name
            ledger.fail(Failure(who, job.end))
            if len(past.begun) == len(before.begun):
                return  # it gets no further
            jobs[runners] = _started(self.pool, known, runners, past, first=True)


class _Beside(Struct):
    """Those who are asked beside others: what is ``said`` once so many of them are done."""

    jobs: Sequence[Job[Extract]]
    said: list[Ledger]
    wanted: Callable[[Ledger], bool]
    pool: Pool
    leaves_core: bool = False  #: for other work, which was begun
    seen: set[int] = field(default_factory=set)  #: those who are done, and were looked at
    ends: int | None = None  #: so many of them are asked at most

    def look(self) -> None:
        """See who is done. Behind one who has all answers nobody is asked, before that some are."""
        while len(self.said) <= len(self.jobs) and self.jobs[len(self.said) - 1].is_done:
            said = _with_answer(self.said[-1], self.jobs[len(self.said) - 1].found)
            self.said.append(said)
            if not self.wanted(said):
                self._end_behind(len(self.said) - 1)
                return
        for place, job in enumerate(self.jobs[: self.ends]):
            if job.is_done and place not in self.seen:
                self.seen.add(place)
                if not self.wanted(_with_answer(self.said[0], job.found)):
                    self._end_behind(place + 1)
                    return

    def _end_behind(self, place: int) -> None:
        for behind in self.jobs[place : self.ends]:
            self.pool.drop(behind)
        self.ends = place

    def worked(self, job: Job[Extract]) -> int:
        """The work of a job and of those before it."""
        return sum(map(_worked, self.jobs[: self.jobs.index(job) + 1]))


def _started(
    pool: Pool,
    known: Ledger,
    runners: Sequence[Runner],
    past: PastVerification | None = None,
    *,
    first: bool = False,
    here: bool = False,
) -> Job[Extract]:
    """Submit turns on the claims that are open, as far as is known; or begin with them ``here``."""
    work = partial(_asked, known, known.open(), runners, past or PastVerification())
    until = known.deadline.at_last()
    if here:
        return pool.begin_here("", work, is_long=_Glance().is_over, until=until)
    return pool.submit("", work, until=until, counts=False, first=first, load=runners[0].load)


def _asked(
    known: Ledger,
    claims: Sequence[Claim],
    runners: Sequence[Runner],
    past: PastVerification,
    tell: JobChannel,
) -> Extract:
    """Take turns in a process of its own, which tells of steps and verdicts as they come."""
    own = known.of(claims, tell)
    with _working(own, tell) as meter:
        steps = Steps(past, meter.note, tell.lasting)
        steps.follow(own)
        own.noted = partial(meter.before, own.noted)
        try:
            for runner in runners:
                if own.open():
                    meter.say()
                    _take_turn(runner, own, steps)
        except KeyboardInterrupt:
            own.stopped, own.interrupted = "interrupted", True
    return own.extract(claims)


def _take_turn(runner: Runner, own: Ledger, steps: Steps) -> None:
    turn = runner.turn(steps)
    if isinstance(turn, SlicesTurn):  # it asks others
        with own.enduring(turn.name):
            turn.work(own)
    else:
        steps.take("", runner.number, turn.name, turn.work, own)


#: So many steps of work are done before somebody hears of them.
_HEARD = 200


class _Meter(Struct):
    """The work of a process, which it tells of now and then. Those that it forks have no line."""

    tell: JobChannel
    process: int = field(default_factory=os.getpid)
    worked: int = 0
    told: int = 0

    def hear(self, steps: int) -> None:
        self.worked += steps
        if os.getpid() == self.process and self.worked - self.told >= _HEARD:
            self.say()

    def say(self) -> None:
        self.told = self.worked
        self.note(Worked(self.worked))

    def note(self, value: object) -> None:
        self.tell.note(value)
        self.process = os.getpid()  # once it is told that it is long, work goes on in another one

    def before(self, noted: Callable[[Verdict], None], verdict: Verdict) -> None:
        """Tell of the work before a verdict."""
        self.say()
        noted(verdict)


@contextmanager
def _working(own: Ledger, tell: JobChannel) -> Iterator[_Meter]:
    """Within the context, work on a ledger is told of, at the end to the last step."""
    meter, budget = _Meter(tell), own.system.budget.root
    before, budget.heard = budget.heard, meter.hear
    try:
        yield meter
    finally:
        budget.heard = before
        meter.say()


class _Glance(Struct):
    """What is over once there was so much work, or the first turn has left claims open."""

    turns: int = 0

    def is_over(self, noted: object) -> bool:
        """Return whether it is over by what somebody tells of."""
        self.turns += isinstance(noted, StrategyStep)
        return self.turns > 1 or (isinstance(noted, Worked) and noted.steps > _HEAD_START)


def _worked(job: Job[Extract]) -> int:
    """The work that a process told of."""
    return next((x.steps for x in reversed(job.noted) if isinstance(x, Worked)), 0)


def _at_a_glance(job: Job[Extract]) -> int:
    """The work of the first who had a turn, if that was over within the head start; else none.

    As others are asked behind it, they need not wait for it.
    """
    worked, turns = 0, 0
    for noted in job.noted:
        match noted:
            case Worked(steps=worked) if worked > _HEAD_START:
                return 0
            case StrategyStep():
                turns += 1
                if turns == 2:
                    return worked
            case _:
                pass
    return 0


def _with_answer(known: Ledger, found: Extract | None) -> Ledger:
    """A ledger of what is known, and of what a process has answered, if it did."""
    own = known.of(known.open(), _unheard)
    if found is not None:
        own.take(found)
    return own


def _with_notes(
    known: Ledger,
    job: Job[Extract],
    most: int | None = None,
    others: Mapping[Claim, Verdict] | None = None,
) -> Ledger:
    """A ledger of what is known, of what others say, and of what a process told of so far."""
    own = known.of(known.open(), _unheard)
    own.settle(others or {})
    _take_notes(own, job, most)
    return own


def _take_some(ledger: Ledger, job: Job[Extract], most: int) -> None:
    """Merge the answer of a process, or what it told of with so much work if it did more."""
    if job.found is not None and _worked(job) <= most:
        _take_all(ledger, job.found)
    else:
        _take_notes(ledger, job, most)


def _take_all(ledger: Ledger, said: Extract) -> None:
    ledger.take(said)
    if said.interrupted:
        raise KeyboardInterrupt


def _take_notes(ledger: Ledger, job: Job[Extract], most: int | None = None) -> None:
    """Merge what a process told of before it ended, or by now; or with so much work at most."""
    for noted in job.noted:
        match noted:
            case Worked(steps=steps):
                if most is not None and steps > most:
                    return
            case Verdict(outcome=outcome, claim=claim) if claim in ledger.open():
                # What holds as far as it was asked about is open for all rounds.
                if outcome is Outcome.UNKNOWN or noted.rounds is not None:
                    ledger.leave([claim], reach_of(noted))
                else:
                    ledger.settle({claim: noted})
            case Failure():
                ledger.fail(noted)
            case Verdict() | StrategyStep():
                pass
            case _:
                raise AssertionError(noted)


def _unheard(text: str) -> None:
    """Hear of something, and ignore it."""
