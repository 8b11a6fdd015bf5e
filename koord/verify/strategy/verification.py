"""Which engine is asked what, cheapest first; and one report of what they said."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from typing import assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.budget import Budget
from koord.syntax.system import System
from koord.verify.bounded_check import Unroller
from koord.verify.claims import Claim, claims_of, liveness_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.bmc.counterexample_enumeration import others
from koord.verify.engines.engine import Workers
from koord.verify.failures import VACUITY, Failure, failure_of
from koord.verify.ledger import Ledger, VerificationProblem, reach_of
from koord.verify.processes import Job, Pool, Progress, was_interrupted
from koord.verify.reduction.problems import identity, plain_problem, problem_of
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy.each_claim_turn import Doubts, EachClaimTurn, SlicesTurn, on_slice
from koord.verify.strategy.resumption import PastVerification, Steps
from koord.verify.strategy.table import (
    LIVENESS,
    SAFETY,
    AnyTurn,
    AskEachClaim,
    AskEngine,
    AskOnSlices,
    EngineTurn,
    Rows,
)
from koord.verify.vacuity.analysis import Hollow, Looked, look, of_any_number, unlooked, vacuities
from koord.verify.verdicts import (
    Bounds,
    Counterexample,
    Outcome,
    Report,
    Unlooked,
    Vacuity,
    Verdict,
    Ways,
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
    progress: Callable[[str], None] = lambda text: None,
    interrupted: Callable[[], bool] = lambda: False,
    noted: Callable[[object], None] = lambda value: None,
    lasting: Callable[[float | None], None] = lambda until: None,
    past: PastVerification | None = None,
) -> Report:
    """Verdicts on all claims about a system, or on the named ones.

    Claims that are not named still serve as lemmas. If verdicts on all claims are ``known``, of
    what they leave open the named ones alone are asked. KeyboardInterrupt ends it with what is
    known so far, and so does ``interrupted``, which is asked now and then. Of what takes long so
    many ``jobs`` are done at a time, which has no influence on the verdicts. ``noted`` is told of
    verdicts, steps and failures as they come, and ``lasting`` of when each step is to be
    over. With those of a process that died as its ``past``,
    another one goes on behind it.
    """

    def is_over() -> bool:
        if interrupted():
            raise KeyboardInterrupt
        return deadline.passed()

    started = time.monotonic()
    deadline = Deadline.after(bounds.timeout_s)
    system = replace(system, budget=Budget(is_over))
    steps = Steps(past or PastVerification(), noted, lasting)
    failures: list[Failure] = []
    with Pool(jobs, progress, interrupted) as pool:
        own = frozenset(names) if _are_all_of_states(system, names) else frozenset()
        ask = partial(
            _ask,
            deadline=deadline,
            bounds=bounds,
            choice=choice,
            seed=seed,
            pool=pool,
            names=own,
            steps=steps,
        )
        slices, doubts = Slices(system), Doubts()
        part = slices.common()
        problem = problem_of(system, part)
        every_n = choice is Engine.EVERY_N
        seen = slices.happening() if not known else system
        happens = problem if seen is part else problem_of(system, seen)
        beside = _Beside(
            pool, steps, failures, system, happens, wanted=not known, of_any_number=every_n
        )
        before = _before(system, known, names) if known else None
        found, ledger = ask(doubts.watching(problem), before, beside, slices=slices)
        found, last = found.doubting(doubts), ledger
        is_whole = part is system and not problem.is_abstract
        if not is_whole and found.suspected is not None and not ledger.interrupted:
            # Opaque values let something happen that real ones do not, or what was left out
            # stands in the way of it: look at everything.
            found, last = ask(plain_problem(system), found, beside)
        every = [
            replace(verdict, claim=claim)
            for claim, verdict in zip(claims_of(system), found.verdicts, strict=True)
        ]
        held = [v.claim for v in every if v.outcome is Outcome.HOLDS and v.rounds is None]
        verdicts = tuple(v for v in every if not names or v.claim.name in names)
        empty: tuple[Vacuity, ...] = ()
        cut = last.interrupted
        beside.wanted &= not cut and not ledger.stopped
        vacuous_goals = _Vacuities()
        if of_runs := [c for c in liveness_of(system) if not names or c.name in names]:
            beside.begin(ledger)
        if beside.job is None:
            vacuous_goals = beside.end(ledger, names)
            cut = cut or vacuous_goals.interrupted
        if of_runs:
            from koord.verify.strategy.liveness import settled

            live = settled(
                slices,
                bounds,
                () if cut else LIVENESS.get(choice, ()),
                deadline,
                names=names,
                proved=held,
                seed=seed,
                pool=pool,
                before={v.claim.name: v.seconds for v in known},
                steps=steps,
            )
            failures += live.failures
            one = Ways(complete=False, reason="of runs without end one is looked for")
            several = bounds.violations > 1
            verdicts += tuple(
                replace(v, ways=one) if several and v.counterexample is not None else v
                for v in live.verdicts
            )
            empty, cut = live.vacuities, cut or live.interrupted
        if beside.job is not None and not cut:
            vacuous_goals = beside.end(ledger, names)
    seconds = time.monotonic() - started
    cut = cut or vacuous_goals.interrupted
    failed = tuple(dict.fromkeys([*ledger.failures, *last.failures, *failures]))
    vacuities_ = vacuous_goals.vacuities + empty
    return Report(verdicts, vacuities_, seconds, cut, failed, every_n, vacuous_goals.unlooked)


class _Known(Struct, frozen=True):
    """The verdicts on a problem's claims, in order.

    ``suspected`` is the last round in which something seemed violated and was not. ``left`` are
    the positions of claims that are left as they are, known or not.
    """

    verdicts: tuple[Verdict, ...]
    suspected: int | None
    left: frozenset[int]

    def doubting(self, doubts: Doubts) -> _Known:
        """The same, with what seemed violated to engines that look at no round after the other."""
        rounds = [
            doubts.rounds[identity(verdict.claim)]
            for verdict in self.verdicts
            if verdict.outcome is Outcome.UNKNOWN and identity(verdict.claim) in doubts.rounds
        ]
        if self.suspected is not None:
            rounds.append(self.suspected)
        return replace(self, suspected=max(rounds, default=None))


class _Vacuities(Struct, frozen=True):
    """What makes verdicts say less than they seem to, as far as Ctrl-C did not end the search."""

    vacuities: tuple[Vacuity, ...] = ()
    interrupted: bool = False
    unlooked: tuple[Unlooked, ...] = ()


class _Beside(Struct):
    """The search for what never happens, beside other work if there are processes for that."""

    pool: Pool
    steps: Steps
    failures: list[Failure]
    system: System
    happens: VerificationProblem  #: what is looked at, whatever engines left out
    wanted: bool
    of_any_number: bool = False
    job: Job[tuple[Looked | str, tuple[Failure, ...]]] | None = None

    def begin(self, ledger: Ledger) -> None:
        """Other work that follows takes long."""
        apart = self.pool.jobs > 1 and not self.of_any_number
        if self.wanted and self.job is None and apart:
            own = self._of_what_happens(ledger).of((), lambda text: None)

            def looked(tell: Progress) -> tuple[Looked | str, tuple[Failure, ...]]:
                found: Looked | str = ""
                with own.stopping(), own.enduring(VACUITY):
                    found = look(own)
                return found, tuple(own.failures)

            self.job = self.pool.submit("", looked)

    def end(self, ledger: Ledger, names: Collection[str]) -> _Vacuities:
        """What makes the verdicts of a ledger say less than they seem to."""
        found: Hollow | None = None
        ledger = self._of_what_happens(ledger)
        own = ledger.of(ledger.open(), ledger.report)
        everywhere = ledger.is_of_all_rounds(names)
        if self.wanted and self.steps.begin("vacuity", 0, VACUITY):
            with own.stopping(), own.enduring(VACUITY):
                if self.of_any_number:
                    found = of_any_number(own, of_all_rounds=everywhere)
                else:
                    looked = self._looked(own)
                    if isinstance(looked, Looked):
                        found = vacuities(own, looked, of_all_rounds=everywhere)
        self.failures += own.failures
        if found is None:
            missing = unlooked(ledger.system) if self.wanted else ()
            return _Vacuities((), own.interrupted, missing)
        return _Vacuities(found.vacuities, own.interrupted, found.unlooked)

    def _looked(self, own: Ledger) -> Looked | str:
        """What was found out beside, or is now."""
        if self.job is None:
            return look(own)
        answer = self.pool.answer(self.job)
        if answer is None:
            own.fail(Failure(VACUITY, self.job.end))
            return ""
        looked, failures = answer
        for failure in failures:
            own.fail(failure)
        return looked

    def _of_what_happens(self, ledger: Ledger) -> Ledger:
        """A ledger of all that has an influence on what happens, with what is known."""
        if ledger.system.program is self.happens.system.program:
            return ledger
        verdicts = tuple(ledger.verdict(claim) for claim in ledger.claims)
        own = ledger.about(self.happens, claims_of(self.happens.system))
        _put_down(own, _Known(verdicts, None, frozenset()))
        return own


def _before(system: System, known: Sequence[Verdict], names: Sequence[str]) -> _Known:
    """What is known already, where nobody asks about claims that are not named."""
    verdicts = {verdict.claim: verdict for verdict in known}
    claims = claims_of(system)
    left = frozenset(n for n, claim in enumerate(claims) if claim.name not in names)
    return _Known(tuple(verdicts[claim] for claim in claims), None, left)


def _ask(
    problem: VerificationProblem,
    known: _Known | None,
    beside: _Beside,
    *,
    deadline: Deadline,
    bounds: Bounds,
    choice: Engine | None,
    seed: int,
    pool: Pool,
    names: frozenset[str],
    steps: Steps,
    slices: Slices | None = None,
) -> tuple[_Known, Ledger]:
    """Verdicts on the claims about a problem; if there are ``names``, until those are settled.

    Of ``known`` ones only the unknown are asked, suspected rounds first; how far those were seen to
    hold counts even if the time is up. With ``slices`` claims are asked of theirs, too.
    """
    claims = claims_of(problem.system)
    stated = {identity(claim): claim for claim in claims_of(beside.system)}
    before = known.verdicts if known is not None else ()
    ledger = Ledger(
        problem,
        bounds,
        deadline,
        claims,
        seed,
        pool.progress,
        before={claim: verdict.seconds for claim, verdict in zip(claims, before, strict=False)},
    )
    left = known.left if known is not None else frozenset()
    if known is not None:
        _put_down(ledger, known)
    steps.follow(ledger, lambda v: replace(v, claim=stated[identity(v.claim)]))
    stage = "plain" if slices is None else "slice"
    asked = ledger.open()
    asking = _Asking(pool, names, steps, Workers(pool), slices)
    unroller = asking.workers.tools.unroller
    with ledger.stopping():
        suspects = known is not None and known.suspected is not None
        if suspects and steps.begin(stage, -1, Engine.BMC.value):
            assert known is not None
            assert known.suspected is not None
            # What is proved narrows down what functions may answer, to answers that often do not
            # replay: without it others are found.
            suspected = min(known.suspected, bounds.rounds)
            with ledger.enduring(Engine.BMC.value):
                Unroller(relying=False).through(ledger, suspected)
                unroller.through(ledger, suspected)
        in_turn = enumerate(asking.turns(SAFETY[choice]))
        while _wanted(ledger, names) and (following := next(in_turn, None)) is not None:
            number, turn = following
            if not (isinstance(turn, EngineTurn) and turn.quick):
                beside.begin(ledger)
            if isinstance(turn, SlicesTurn):  # it asks others
                with ledger.enduring(turn.name):
                    turn.work(ledger)
            else:
                ends = isinstance(turn, EachClaimTurn) and not liveness_of(beside.system)
                is_last = choice is not None or ends
                steps.take(stage, number, turn.name, turn.work, ledger, is_last=is_last)
            if ledger.is_overtime():
                break
    if ledger.shortened and not ledger.interrupted and not deadline.passed():
        ledger.deadline, ledger.stopped = deadline, ""
    with ledger.stopping():
        _find_others(ledger, asked, pool, slices)
    verdicts = tuple(ledger.verdict(claim) for claim in claims)
    return _Known(verdicts, unroller.suspected, left), ledger


def _put_down(ledger: Ledger, known: _Known) -> None:
    """Write down on a new ledger what is known already."""
    for n, (claim, verdict) in enumerate(zip(ledger.claims, known.verdicts, strict=True)):
        if verdict.outcome is not Outcome.UNKNOWN or n in known.left:
            ledger.settle({claim: replace(verdict, claim=claim)})
        else:
            ledger.leave([claim], reach_of(verdict))


def _wanted(ledger: Ledger, names: Collection[str]) -> bool:
    return any(not names or claim.name in names for claim in ledger.open())


def _are_all_of_states(system: System, names: Sequence[str]) -> bool:
    """Whether none of the names is of a claim about runs: those rest on all the other claims."""
    return {claim.name for claim in claims_of(system)}.issuperset(names)


def _find_others(ledger: Ledger, asked: Sequence[Claim], pool: Pool, slices: Slices | None) -> None:
    """As many different counterexamples to each claim as were asked for.

    With ``slices`` they are looked for in that of the claim first.
    """
    wanted = ledger.bounds.violations - 1

    def find(
        claim: Claim, shown: Counterexample, tell: Progress
    ) -> tuple[tuple[Counterexample, ...], Ways]:
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
            return (), Ways(complete=False, reason=str(failure_of(Engine.BMC.value, error)))

    jobs = {
        claim: pool.submit(claim.name, partial(find, claim, verdict.counterexample))
        for claim, verdict in ledger.verdicts.items()
        if claim in asked and wanted > 0 and verdict.counterexample is not None
    }
    for claim in jobs:  # until there is an answer
        ledger.settle({claim: replace(ledger.verdicts[claim], ways=Ways(False, "interrupted"))})
    for claim, answer in pool.answers(jobs):
        found, ways = answer or ((), Ways(complete=False, reason=jobs[claim].end))
        ledger.settle({claim: replace(ledger.verdicts[claim], others=found, ways=ways)})


class _Asking(Struct, frozen=True):
    """What the turns about one problem have in common; with ``slices`` they are asked of theirs."""

    pool: Pool
    names: frozenset[str]
    steps: Steps
    workers: Workers
    slices: Slices | None

    def turns(self, rows: Rows) -> Iterator[AnyTurn]:
        """The turns that rows of the strategy stand for."""
        for row in rows:
            match row:
                case AskEngine():
                    task = row.task
                    if row.named:
                        task = replace(task, named=self.names)
                    if self.names or not row.named:
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
                        )
                case AskEachClaim():
                    beside = tuple(self.turns(row.beside))
                    yield EachClaimTurn(self.workers.tools.unroller, self.pool, beside)
                case _:
                    assert_never(row)

    def _anew(self, rows: Rows) -> Iterator[AnyTurn]:
        """The turns about a slice, by engines that know nothing yet."""
        return replace(self, workers=Workers(self.pool), slices=None).turns(rows)
