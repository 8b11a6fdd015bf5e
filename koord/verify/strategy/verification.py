"""Verification: runs the strategy on a system, and reports verdicts and vacuities."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import nullcontext
from functools import partial
from itertools import count, takewhile
from typing import assert_never

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax.budget import Budget
from koord.syntax.system import System
from koord.verify.bounded_check import Unroller
from koord.verify.claims import Claim, claims_of, liveness_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Workers, load
from koord.verify.helpers import Helpers
from koord.verify.job_process import Progress, was_interrupted
from koord.verify.ledger import Ledger, VerificationProblem, reach_of
from koord.verify.obstacles import VACUITY, Failure, failure_of
from koord.verify.processes import Job, Pool, can_fork
from koord.verify.reduction.problems import identity, plain_problem, problem_of
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy.each_claim_turn import (
    EachClaimTurn,
    SlicesTurn,
    SpuriousViolations,
    on_slice,
)
from koord.verify.strategy.liveness import LivenessVerdicts, settled
from koord.verify.strategy.race import Ahead, RaceTurn, Runner
from koord.verify.strategy.resumption import PastVerification, Steps
from koord.verify.strategy.table import (
    LIVENESS,
    SAFETY,
    AnyTurn,
    AskAtOnce,
    AskEachClaim,
    AskEngine,
    AskOnSlices,
    EngineTurn,
    Fleet,
    LivenessRow,
    Row,
    Rows,
)
from koord.verify.vacuity.analysis import (
    FoundVacuities,
    GoalSearch,
    is_every_n,
    look,
    of_any_number,
    unlooked,
    vacuities,
)
from koord.verify.verdicts import (
    Bounds,
    Counterexample,
    Emptiness,
    EnumerationResult,
    Outcome,
    ReachingRun,
    Report,
    Substance,
    UnsearchedGoal,
    Vacuity,
    Verdict,
)


def verify(
    system: System,
    bounds: Bounds,
    choice: Engine | None = None,
    *,
    names: Sequence[str] = (),
    known: Sequence[Verdict] = (),
    seed: int = 0,
    jobs: int = 1,
    helpers: Helpers | None = None,
    progress: Callable[[str], None] = lambda text: None,
    interrupted: Callable[[], bool] = lambda: False,
    noted: Callable[[object], None] = lambda value: None,
    lasting: Callable[[float | None], None] = lambda until: None,
    past: PastVerification | None = None,
) -> Report:
    """Verify all claims about a system, or the named ones.

    Claims that are not named still serve as lemmas. If verdicts on all claims are ``known``, of
    what they leave open the named ones alone are asked. KeyboardInterrupt ends it with what is
    known so far, and so does ``interrupted``, which is asked now and then. Of what takes long so
    many ``jobs`` are done at a time, or done by ``helpers``, which has no influence on the
    verdicts. ``noted`` is told of verdicts, steps and failures as they come, and ``lasting`` of
    when each step is to be over. With those of a process that died as its ``past``, another one
    goes on behind it.
    """
    started = time.monotonic()
    deadline = Deadline.after(bounds.timeout_s)
    steps = Steps(past or PastVerification(), noted, lasting)
    with Pool(jobs, progress, interrupted, helpers) as pool:

        def is_over() -> bool:
            # Ctrl-C that came while this process waited for others is for its own work, too.
            if interrupted() or pool.is_stopped:
                raise KeyboardInterrupt
            return deadline.passed()

        watched = replace(system, budget=Budget(is_over))
        work = _Verification(watched, bounds, choice, tuple(names), seed, deadline, pool, steps)
        report = work.report(known)
    return replace(report, seconds=time.monotonic() - started)


class _Verification(Struct, frozen=True):
    """The claims asked about a system, with bounds, deadline and processes to decide them."""

    system: System
    bounds: Bounds
    choice: Engine | None
    names: tuple[str, ...]  #: of the claims that are asked about; none are all
    seed: int
    deadline: Deadline
    pool: Pool
    steps: Steps

    def report(self, known: Sequence[Verdict]) -> Report:
        """Verdicts on claims about states, then about runs, and what makes them vacuous."""
        slices = Slices(self.system)
        common = slices.common()
        problem = problem_of(self.system, common)
        seen = self.system if known else slices.happening()
        happens = problem if seen is common else problem_of(self.system, seen)
        every_n = self.choice is Engine.EVERY_N
        search = _ReachabilitySearch(
            self.pool, self.steps, self.system, happens, wanted=not known, of_any_number=every_n
        )
        ahead = None if known else self._ahead(slices)
        verdicts, ledger, last = self._of_states(problem, slices, known, search, ahead)
        cut = last.interrupted
        if every_n and not cut:
            from koord.verify.strategy.few_robots import looked_at_with_few

            verdicts = looked_at_with_few(self.system, verdicts, self.deadline, self.pool.progress)
        search.wanted &= not cut and not ledger.stopped
        proved = [v for v in verdicts if v.outcome is Outcome.HOLDS and v.rounds is None]
        rows = () if cut else LIVENESS.get(self.choice, ())
        # What is looked at for vacuity hangs on whether verdicts are for every number of robots.
        # Where others are for these robots alone, so may these be, which are found sooner.
        soon, rows = _soon(rows, everyone=_are_for_every_n(verdicts) or every_n)
        first, told = LivenessVerdicts(()), None
        if ahead is not None:
            if not cut and len(proved) == len(verdicts) and _are_for_every_n(verdicts):
                search.begin(ledger, self.names, every_n=True)
                try:
                    told = self.pool.answer(ahead)
                except KeyboardInterrupt:
                    none = self._of_runs(slices, proved, known, (), is_last=False)
                    told = replace(none, interrupted=True)
                    cut = True
            else:
                self.pool.drop(ahead)
        if told is not None:
            first = told
            for verdict in first.verdicts:
                self.steps.noted(verdict)
        elif soon:
            first = self._of_runs(slices, proved, known, soon, is_last=not rows)
        search.runs = first.verdicts
        cut |= first.interrupted
        settled_soon = {v.claim.name for v in first.verdicts if v.outcome is not Outcome.UNKNOWN}
        of_runs = filter(self._is_asked, liveness_of(self.system))
        if any(claim.name not in settled_soon for claim in of_runs):
            search.begin(ledger, self.names)
        unreachable = _Vacuities()
        if search.job is None:
            unreachable = search.end(ledger, self.names)
        cut |= unreachable.interrupted
        runs = first
        if not soon or rows:
            later = () if cut else rows
            runs = self._of_runs(slices, proved, known, later, first.verdicts)
        if search.job is not None and not (cut or runs.interrupted):
            unreachable = search.end(ledger, self.names)
        failures = [*ledger.failures, *last.failures, *search.failures]
        failures += [*first.failures, *runs.failures]
        report = Report(
            (*(v for v in verdicts if self._is_asked(v.claim)), *runs.verdicts),
            unreachable.vacuities + runs.vacuities,
            0.0,
            cut or runs.interrupted or unreachable.interrupted,
            tuple(dict.fromkeys(failures)),
            every_n,
            unreachable.unlooked,
            of_slice=last is ledger and not known,
            reaching=search.reaching,
        )
        return replace(report, substance=_substance(report, search.substance))

    def _ahead(self, slices: Slices) -> Job[LivenessVerdicts] | None:
        """Ask about whole runs beside claims about states, in a process of its own.

        That rests on these claims, as if they were proved for every number of robots. So it counts
        only if they are; and it is done only where they were, of a program like this one, or where
        many robots leave little else to try.
        """
        past, asked = self.steps.past, claims_of(self.system)
        soon, rows = _soon(LIVENESS.get(self.choice, ()), everyone=True)
        live = [claim for claim in liveness_of(self.system) if self._is_asked(claim)]
        names = [claim.name for claim in (*asked, *live)]
        is_open = not all(past.verdict(claim.name) for claim in live)
        if self.pool.jobs == 1 or not (live and soon and is_open):
            return None
        has_many = self.choice is None and Fleet.MANY.has(self.system.robots)
        if not (has_many or past.was_for_every_n(names)):
            return None
        given = [Verdict(claim, Outcome.HOLDS, Engine.EVERY_N, 0.0) for claim in asked]

        def looked(tell: Progress) -> LivenessVerdicts:
            own = replace(self, pool=Pool(1, tell), steps=Steps(past))
            return own._of_runs(slices, given, (), soon, is_last=not rows)

        return self.pool.submit("", looked)

    def _is_asked(self, claim: Claim) -> bool:
        return not self.names or claim.name in self.names

    def _of_states(
        self,
        problem: VerificationProblem,
        slices: Slices,
        known: Sequence[Verdict],
        search: _ReachabilitySearch,
        ahead: Job[LivenessVerdicts] | None,
    ) -> tuple[list[Verdict], Ledger, Ledger]:
        """Verdicts on all claims about states, and the ledgers of the first and the last asking."""
        doubts, before = SpuriousViolations(), None
        if known:
            before = _before(self.system, known, self.names)
        found, ledger = self._ask(doubts.watching(problem), before, search, slices, ahead)
        found, last = found.doubting(doubts), ledger
        is_whole = problem.system is self.system and not problem.is_abstract
        if not is_whole and found.suspected is not None and not ledger.interrupted:
            # Opaque values let something happen that real ones do not, or what was left out
            # stands in the way of it: look at everything.
            found, last = self._ask(plain_problem(self.system), found, search)
        claims = claims_of(self.system)
        verdicts = [replace(v, claim=c) for c, v in zip(claims, found.verdicts, strict=True)]
        return verdicts, ledger, last

    def _of_runs(
        self,
        slices: Slices,
        proved: Sequence[Verdict],
        known: Sequence[Verdict],
        rows: Sequence[LivenessRow],
        so_far: Sequence[Verdict] = (),
        *,
        is_last: bool = True,
    ) -> LivenessVerdicts:
        """Verdicts on the claims about runs that are asked about, if there are any."""
        everyone = [verdict for verdict in proved if verdict.engine is Engine.EVERY_N]
        live = settled(
            slices,
            self.bounds,
            rows,
            self.deadline,
            names=self.names,
            proved=[verdict.claim for verdict in proved],
            everyone=[v.claim for v in everyone],
            found=tuple(dict.fromkeys(x for v in everyone for x in v.lemmas)),
            seed=self.seed,
            pool=self.pool,
            before={v.claim.name: v.seconds for v in (*known, *so_far)},
            steps=self.steps,
            so_far=so_far,
            is_last=is_last,
        )
        if self.bounds.violations == 1:
            return live
        one = EnumerationResult(complete=False, reason="of runs without end one is looked for")
        verdicts = (v if v.counterexample is None else replace(v, ways=one) for v in live.verdicts)
        return replace(live, verdicts=tuple(verdicts))

    def _ask(
        self,
        problem: VerificationProblem,
        known: _Known | None,
        search: _ReachabilitySearch,
        slices: Slices | None = None,
        ahead: Job[LivenessVerdicts] | None = None,
    ) -> tuple[_Known, Ledger]:
        """Verdicts on all claims about a problem; until those that are asked about are settled.

        Of ``known`` ones only the unknown are asked, suspected rounds first; how far those were
        seen to hold counts even if the time is up. With ``slices`` claims are asked of theirs, too.
        """
        claims = claims_of(problem.system)
        stated = {identity(claim): claim for claim in claims_of(self.system)}
        ledger = Ledger(problem, self.bounds, self.deadline, claims, self.seed, self.pool.progress)
        left: frozenset[int] = frozenset()
        if known is not None:
            left = known.left
            ledger.before = {c: v.seconds for c, v in zip(claims, known.verdicts, strict=True)}
            _put_down(ledger, known)
        self.steps.follow(ledger, lambda v: replace(v, claim=stated[identity(v.claim)]))
        asked = ledger.open()
        names = self._names_of_states()
        stage = "plain" if slices is None else "slice"
        workers = Workers(self.pool)
        again = self.steps.past.speaks_for_every_n([claim.name for claim in claims])
        asking = _Asking(self.pool, names, self.steps, workers, slices, stage, self.system, again)
        unroller = asking.workers.tools.unroller
        with ledger.stopping():
            suspected = known.suspected if known is not None else None
            if suspected is not None and self.steps.begin(stage, -1, Engine.BMC.value):
                # What is proved narrows down what functions may answer, to answers that often do
                # not replay: without it others are found.
                last = min(suspected, self.bounds.rounds)
                with ledger.enduring(Engine.BMC.value):
                    Unroller(relying=False).through(ledger, last)
                    unroller.through(ledger, last)
            self._take_turns(ledger, stage, asking, search, ahead)
        if ledger.shortened and not ledger.interrupted and not self.deadline.passed():
            ledger.deadline, ledger.stopped = self.deadline, ""
        with ledger.stopping():
            _find_others(ledger, asked, self.pool, slices)
        verdicts = tuple(ledger.verdict(claim) for claim in claims)
        return _Known(verdicts, unroller.suspected, left), ledger

    def _take_turns(
        self,
        ledger: Ledger,
        stage: str,
        asking: _Asking,
        search: _ReachabilitySearch,
        ahead: Job[LivenessVerdicts] | None,
    ) -> None:
        """One engine after the other, as the table has them, while claims are open.

        What is asked ``ahead`` is in the way of others, once these are needed.
        """
        rows = SAFETY[self.choice]
        begun = None if ahead is not None else asking.begun_ahead(rows, ledger)
        with begun.ending(ledger, self.pool) if begun is not None else nullcontext():
            if begun is not None and begun.settles(ledger, partial(_wanted, names=asking.names)):
                for runner in begun.runners:
                    self.steps.begin(stage, runner.number, runner.name)
                return
            self._take_each(ledger, stage, asking, search, ahead, asking.turns(rows, begun))

    def _take_each(
        self,
        ledger: Ledger,
        stage: str,
        asking: _Asking,
        search: _ReachabilitySearch,
        ahead: Job[LivenessVerdicts] | None,
        made: Iterator[AnyTurn],
    ) -> None:
        turns = enumerate(made)
        while _wanted(ledger, asking.names) and (following := next(turns, None)) is not None:
            number, turn = following
            if not (isinstance(turn, EngineTurn | RaceTurn) and turn.quick):
                search.begin(ledger, self.names)
            elif isinstance(turn, RaceTurn):
                turn = replace(turn, meanwhile=partial(search.begin, ledger, self.names))
            if isinstance(turn, SlicesTurn | RaceTurn):  # it asks others
                if ahead is not None:
                    self.pool.drop(ahead)
                with ledger.enduring(turn.name):
                    turn.work(ledger)
            else:
                ends = isinstance(turn, EachClaimTurn) and not liveness_of(self.system)
                is_last = self.choice is not None or ends
                self.steps.take(stage, number, turn.name, turn.work, ledger, is_last=is_last)
            if ledger.is_overtime():
                break

    def _names_of_states(self) -> frozenset[str]:
        """The names that are asked about, if all are of claims about states.

        A claim about runs rests on all the others: then those are asked as well.
        """
        names = frozenset(self.names)
        of_states = {claim.name for claim in claims_of(self.system)}
        return names if names <= of_states else frozenset()


class _Known(Struct, frozen=True):
    """The verdicts on a problem's claims, in order.

    ``suspected`` is the last round in which something seemed violated and was not. ``left`` are
    the positions of claims that are left as they are, known or not.
    """

    verdicts: tuple[Verdict, ...]
    suspected: int | None
    left: frozenset[int]

    def doubting(self, doubts: SpuriousViolations) -> _Known:
        """The verdicts with candidate violations of engines that do not work round by round."""
        rounds = [
            doubts.rounds[identity(verdict.claim)]
            for verdict in self.verdicts
            if verdict.outcome is Outcome.UNKNOWN and identity(verdict.claim) in doubts.rounds
        ]
        if self.suspected is not None:
            rounds.append(self.suspected)
        return replace(self, suspected=max(rounds, default=None))


class _Vacuities(Struct, frozen=True):
    """The vacuities found, as far as Ctrl-C did not end the search."""

    vacuities: tuple[Vacuity, ...] = ()
    interrupted: bool = False
    unlooked: tuple[UnsearchedGoal, ...] = ()


class _ReachabilitySearch(Struct):
    """The search for what never happens, beside other work if there are processes for that."""

    pool: Pool
    steps: Steps
    system: System
    happens: VerificationProblem  #: what is looked at, whatever engines left out
    wanted: bool
    of_any_number: bool = False
    failures: list[Failure] = field(default_factory=list)
    runs: Sequence[Verdict] = ()  #: what is known of whole runs
    reaching: tuple[ReachingRun, ...] = ()  #: runs that reach goals
    relied: Substance = Substance()  #: what the job does not look at
    every_n: bool = False  #: whether the job takes verdicts to be for every number of robots
    substance: Substance | None = None  #: what was found, but for what vacuities say
    job: Job[tuple[GoalSearch | str, tuple[Failure, ...]]] | None = None

    def begin(self, ledger: Ledger, names: Collection[str], *, every_n: bool | None = None) -> None:
        """Start the search in a process: the work that follows takes long.

        ``every_n`` says whether verdicts will be for every number of robots, if somebody knows.
        """
        apart = self.pool.jobs > 1 and not self.of_any_number
        if every_n is None:
            every_n = is_every_n(self.system, ledger, names, self.runs)
        self._drop_if(self.every_n and not every_n)
        if self.wanted and self.job is None and apart:
            self.every_n = every_n
            own = self._of_what_happens(ledger).of((), lambda text: None)
            self.relied = known = self.steps.past.substance.where(every_n=every_n)

            def looked(tell: Progress) -> tuple[GoalSearch | str, tuple[Failure, ...]]:
                found: GoalSearch | str = ""
                with own.stopping(), own.enduring(VACUITY):
                    found = self._search(own, every_n=every_n, known=known)
                return found, tuple(own.failures)

            # It is done in any case: what others do may be in vain, and waits.
            self.job = self.pool.submit("", looked, first=True)

    def end(self, ledger: Ledger, names: Collection[str]) -> _Vacuities:
        """Finish the search: the vacuities of a ledger's verdicts."""
        found: FoundVacuities | None = None
        everywhere = ledger.is_of_all_rounds(names)
        every_n = is_every_n(self.system, ledger, names, self.runs)
        known = self.steps.past.substance.where(every_n=every_n, all_rounds=everywhere)
        ledger = self._of_what_happens(ledger)
        own = ledger.of(ledger.open(), ledger.report)
        if self.wanted and self.steps.begin("vacuity", 0, VACUITY):
            with own.stopping(), own.enduring(VACUITY):
                if self.of_any_number:
                    found = of_any_number(own, of_all_rounds=everywhere)
                else:
                    looked = self._looked(own, every_n=every_n, known=known)
                    if isinstance(looked, GoalSearch):
                        self.reaching = looked.runs
                        found = vacuities(own, looked, of_all_rounds=everywhere, known=known)
                        self.substance = Substance(True, frozenset(), every_n, everywhere)
        self.failures += own.failures
        if found is None:
            missing = unlooked(ledger.system) if self.wanted else ()
            return _Vacuities((), own.interrupted, missing)
        return _Vacuities(found.vacuities, own.interrupted, found.unlooked)

    def _search(self, own: Ledger, *, every_n: bool, known: Substance) -> GoalSearch:
        past = self.steps.past
        return look(
            own, every_n=every_n, before=past.reaching, keeps_runs=past.keeps_runs, known=known
        )

    def _looked(self, own: Ledger, *, every_n: bool, known: Substance) -> GoalSearch | str:
        """The result of the parallel search, or of one made now."""
        # It left out what is not known after all, or looked at few robots where it is about these,
        # or at many where few are enough: whether it began, and is done, hangs on what is free.
        of_many = every_n and Fleet.MANY.has(self.system.robots)
        self._drop_if(self.relied != known or self.every_n > every_n or self.every_n < of_many)
        if self.job is None:
            return self._search(own, every_n=every_n, known=known)
        answer = self.pool.answer(self.job)
        if answer is None:
            own.fail(Failure(VACUITY, self.job.end))
            return ""
        looked, failures = answer
        for failure in failures:
            own.fail(failure)
        return looked

    def _drop_if(self, vain: bool) -> None:
        """Drop the search that was begun if it is of no use."""
        if vain and self.job is not None:
            self.pool.drop(self.job)
            self.job, self.every_n = None, False

    def _of_what_happens(self, ledger: Ledger) -> Ledger:
        """A ledger of the slice that influences what happens, with the known results."""
        if ledger.system.program is self.happens.system.program:
            return ledger
        verdicts = tuple(ledger.verdict(claim) for claim in ledger.claims)
        own = ledger.about(self.happens, claims_of(self.happens.system))
        _put_down(own, _Known(verdicts, None, frozenset()))
        return own


def _substance(report: Report, looked: Substance | None) -> Substance | None:
    """What is seen to have no vacuities, if it was looked for all of them to the end."""
    if looked is None or report.interrupted or report.failures or report.unlooked:
        return None
    held = {v.claim.name for v in report.verdicts if v.outcome is Outcome.HOLDS}
    told = {vacuity.subject for vacuity in report.vacuities}
    of_events = any(vacuity.what is Emptiness.EVENT for vacuity in report.vacuities)
    return replace(looked, happens=told <= held and not of_events, claims=frozenset(held - told))


def _are_for_every_n(verdicts: Sequence[Verdict]) -> bool:
    return all(
        verdict.engine is Engine.EVERY_N for verdict in verdicts if verdict.outcome is Outcome.HOLDS
    )


def _soon(
    rows: Sequence[LivenessRow], *, everyone: bool
) -> tuple[tuple[LivenessRow, ...], tuple[LivenessRow, ...]]:
    """Divide rows about whole runs: proofs for every number of robots, and all behind them.

    Those that stand first do so where other verdicts are for ``everyone``, and otherwise behind a
    search.
    """
    of_all = tuple(takewhile(_is_of_every_n, rows))
    others = tuple(rows[len(of_all) :])
    return (of_all, others) if everyone else ((), (*others[:1], *of_all, *others[1:]))


def _is_of_every_n(row: LivenessRow) -> bool:
    return isinstance(row, AskEngine) and row.engine is Engine.EVERY_N


def _before(system: System, known: Sequence[Verdict], names: Sequence[str]) -> _Known:
    """The known verdicts, where claims that are not named are left alone."""
    verdicts = {verdict.claim: verdict for verdict in known}
    claims = claims_of(system)
    left = frozenset(n for n, claim in enumerate(claims) if claim.name not in names)
    return _Known(tuple(verdicts[claim] for claim in claims), None, left)


def _put_down(ledger: Ledger, known: _Known) -> None:
    """Record known verdicts on a new ledger."""
    for n, (claim, verdict) in enumerate(zip(ledger.claims, known.verdicts, strict=True)):
        if verdict.outcome is not Outcome.UNKNOWN or n in known.left:
            ledger.settle({claim: replace(verdict, claim=claim)})
        else:
            ledger.leave([claim], reach_of(verdict))


#: The steps of races have higher numbers than turns, each race a hundred.
_RACES = 100

#: What takes a glance takes some tenths of a second. A solver that keeps to no limit is ended then.
_LONGEST_GLANCE_S = 60.0


def _wanted(ledger: Ledger, names: Collection[str]) -> bool:
    return any(not names or claim.name in names for claim in ledger.open())


def _load(row: Row) -> None:
    """Load what a row's engine needs, which most programs ask again after a race."""
    if isinstance(row, AskEngine):
        load(row.engine)


def _find_others(ledger: Ledger, asked: Sequence[Claim], pool: Pool, slices: Slices | None) -> None:
    """Search for as many different counterexamples to each claim as were asked for.

    With ``slices`` they are looked for in that of the claim first.
    """
    wanted = ledger.bounds.violations - 1

    def find(
        claim: Claim, shown: Counterexample, tell: Progress
    ) -> tuple[tuple[Counterexample, ...], EnumerationResult]:
        from koord.verify.engines.bmc.engine import others

        tell("other ways to break it")
        try:
            if slices is not None:
                found, ways = others(*on_slice(slices, ledger, claim), shown, wanted)
                if len(found) == wanted or ways.complete:
                    return found, ways
            return others(ledger, claim, shown, wanted)
        except Exception as error:
            if was_interrupted():
                raise KeyboardInterrupt from error
            return (), EnumerationResult(
                complete=False, reason=str(failure_of(Engine.BMC.value, error))
            )

    jobs = {
        claim: pool.submit(claim.name, partial(find, claim, verdict.counterexample))
        for claim, verdict in ledger.verdicts.items()
        if claim in asked and wanted > 0 and verdict.counterexample is not None
    }
    for claim in jobs:  # until there is an answer
        ledger.settle(
            {claim: replace(ledger.verdicts[claim], ways=EnumerationResult(False, "interrupted"))}
        )
    for claim, answer in pool.answers(jobs):
        found, ways = answer or ((), EnumerationResult(complete=False, reason=jobs[claim].end))
        ledger.settle({claim: replace(ledger.verdicts[claim], others=found, ways=ways)})


class _Asking(Struct, frozen=True):
    """The common data of turns about one problem; with ``slices`` they run on its slices."""

    pool: Pool
    names: frozenset[str]
    steps: Steps
    workers: Workers
    slices: Slices | None
    stage: str
    system: System
    again: bool  #: whether such claims were proved for every number of robots before

    def begun_ahead(self, rows: Rows, ledger: Ledger) -> Ahead | None:
        """Begin with those who are asked first in a race, if a row says so.

        Where the same was proved of a program like this one they need no race.
        """
        for position, row in enumerate(rows):
            if isinstance(row, AskAtOnce) and row.ahead is not None and not self.again:
                runners = self._runners(row.first, count(_RACES * (1 + position)))
                open_ = [r for r in runners if self.steps.is_open(self.stage, r.number, r.name)]
                if open_ and row.ahead.has(self.system.robots):
                    return self._begun(open_, ledger)
        return None

    def _begun(self, runners: Sequence[Runner], ledger: Ledger) -> Ahead:
        """Begin in this process, where there may be others, and in one of them if this died of it.

        With one process others are asked first: whatever is violated soon is told sooner.
        """
        first = runners[0]
        is_free = self.pool.jobs > 1 and can_fork()
        if not is_free or not self.steps.begin(f"glance, {self.stage}", first.number, first.name):
            return Ahead.begun(runners, ledger, self.pool)
        self.steps.lasting(time.monotonic() + _LONGEST_GLANCE_S)
        begun = Ahead.begun(runners, ledger, self.pool, here=True)
        self.steps.lasting(None)
        return begun

    def turns(self, rows: Rows, begun: Ahead | None = None) -> Iterator[AnyTurn]:
        """Make the turns for rows of the strategy, where some were begun ahead."""
        for position, row in enumerate(rows):
            match row:
                case AskEngine():
                    task = replace(row.task, named=self.names) if row.named else row.task
                    if self._is_wanted(row):
                        yield EngineTurn(row.engine, task, self.workers, row.quick)
                case AskOnSlices():
                    if self.slices is not None:
                        yield SlicesTurn(
                            self.slices,
                            partial(self._anew, row.rows),
                            partial(self._anew, row.shared),
                            self.steps,
                            self.names,
                            row.alone,
                            row.ends,
                        )
                case AskEachClaim():
                    beside = tuple(self.turns(row.beside))
                    yield EachClaimTurn(self.workers.tools.unroller, self.pool, beside)
                case AskAtOnce():
                    numbers = count(_RACES * (1 + position))
                    yield RaceTurn(
                        tuple(self._runners(row.first, numbers)),
                        tuple(self._runners(row.beside, numbers)),
                        self.pool,
                        self.steps,
                        self.stage,
                        partial(_wanted, names=self.names),
                        row.quick,
                        row.patience,
                        ahead=begun if row.ahead is not None else None,
                    )
                case _:
                    assert_never(row)

    def _is_wanted(self, row: AskEngine) -> bool:
        """Return whether a row is for this system, and for what is asked and known of it."""
        search = self.workers.tools.search
        has_ended = search is not None and search.is_exhausted
        return (
            row.suits(self.system)
            and (bool(self.names) or not row.named)
            and (self.again or not row.again)
            and (has_ended or not row.ended)
        )

    def _anew(self, rows: Rows) -> Iterator[AnyTurn]:
        """Make the turns on a slice, with new engines."""
        return replace(self, workers=Workers(self.pool), slices=None).turns(rows)

    def _runners(self, rows: Rows, numbers: Iterator[int]) -> Iterator[Runner]:
        """Make what takes part in a race; rows that do not apply have no turn."""
        for row, number in zip(rows, numbers, strict=False):
            has_answers = isinstance(row, AskEngine) and row.ended
            for turn in self.turns((row,)):
                made = partial(self._apart, row)
                yield Runner(number, turn.name, made, has_answers, partial(_load, row))

    def _apart(self, row: Row, steps: Steps) -> AnyTurn:
        """Make the turn of a row for a process of its own, which starts no others."""
        pool = Pool(1)
        workers = Workers(pool)
        if can_fork():  # then it is another one there
            workers.tools.search = self.workers.tools.search
        alone = replace(self, pool=pool, steps=steps, workers=workers)
        asked = replace(row, ended=False) if isinstance(row, AskEngine) else row
        (turn,) = alone.turns((asked,))
        return turn
