"""Which engine is asked what, cheapest first; and one report of what they said."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.budget import Patience
from koord.syntax.system import System
from koord.verify.bounded_check import ByUnrolling
from koord.verify.claims import Claim, claims_of, liveness_of
from koord.verify.effort import Deadline, Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.bmc.counterexample_enumeration import others
from koord.verify.engines.every_n.engine import FEW, ByEveryN, ByInference
from koord.verify.engines.every_n.proving import HASTY, SPARING
from koord.verify.engines.explicit.limits import FEW_STATES, HANDFUL, Limits
from koord.verify.engines.workers import (
    FIRST_GLANCE_S,
    FIRST_LOOK,
    FIRST_ROUNDS,
    SECOND_LOOK,
    ByGlance,
    ByInduction,
    BySearch,
    ByShallowSearch,
    ByStep,
)
from koord.verify.failures import VACUITY, Failure, failure_of
from koord.verify.ledger import Ledger, Subject, Works, reach_of
from koord.verify.per_claim import ByRounds
from koord.verify.processes import Job, Pool, Progress, was_interrupted
from koord.verify.reduction.problems import identity, plain_subject, subject_of
from koord.verify.reduction.sliced_problems import BySlices, Doubts, on_slice
from koord.verify.reduction.slices import Slices
from koord.verify.resumption import Past, Steps
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

if TYPE_CHECKING:
    from koord.verify.engines.horn.engine import BySpacer
    from koord.verify.liveness_strategy import Settled


class Choice(Enum):
    """Which engines may answer."""

    AUTO = "auto"
    ABC = "abc"
    BITS = "bits"
    BMC = "bmc"
    SEARCH = "search"
    SPACER = "spacer"
    INDUCTION = "induction"
    EVERY_N = "every N"


def verify(
    system: System,
    bounds: Bounds,
    choice: Choice = Choice.AUTO,
    *,
    names: Sequence[str] = (),
    known: Sequence[Verdict] = (),
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str], None] = lambda text: None,
    interrupted: Callable[[], bool] = lambda: False,
    noted: Callable[[object], None] = lambda value: None,
    lasting: Callable[[float | None], None] = lambda until: None,
    past: Past | None = None,
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
    system = replace(system, patience=Patience(is_over))
    steps = Steps(past or Past(), noted, lasting)
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
        subject = subject_of(system, part)
        every_n = choice is Choice.EVERY_N
        seen = slices.happening() if not known else system
        happens = subject if seen is part else subject_of(system, seen)
        beside = _Beside(
            pool, steps, failures, system, happens, wanted=not known, of_any_number=every_n
        )
        before = _before(system, known, names) if known else None
        found, ledger = ask(doubts.watching(subject), before, beside, slices=slices)
        found, last = found.doubting(doubts), ledger
        is_whole = part is system and not subject.is_abstract
        if not is_whole and found.suspected is not None and not ledger.interrupted:
            # Opaque values let something happen that real ones do not, or what was left out
            # stands in the way of it: look at everything.
            found, last = ask(plain_subject(system), found, beside)
        every = [
            replace(verdict, claim=claim)
            for claim, verdict in zip(claims_of(system), found.verdicts, strict=True)
        ]
        held = [v.claim for v in every if v.outcome is Outcome.HOLDS and v.rounds is None]
        verdicts = tuple(v for v in every if not names or v.claim.name in names)
        empty: tuple[Vacuity, ...] = ()
        cut = last.interrupted
        beside.wanted &= not cut and not ledger.stopped
        hollow = _Hollow()
        if of_runs := [c for c in liveness_of(system) if not names or c.name in names]:
            beside.begin(ledger)
        if beside.job is None:
            hollow = beside.end(ledger, names)
            cut = cut or hollow.interrupted
        if of_runs:
            asked = None if cut else choice
            spent = {v.claim.name: v.seconds for v in known}
            live = _of_whole_runs(
                slices, bounds, asked, deadline, names, held, seed, pool, spent, steps
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
            hollow = beside.end(ledger, names)
    seconds = time.monotonic() - started
    cut = cut or hollow.interrupted
    failed = tuple(dict.fromkeys([*ledger.failures, *last.failures, *failures]))
    vacuities_ = hollow.vacuities + empty
    return Report(verdicts, vacuities_, seconds, cut, failed, every_n, hollow.unlooked)


class _Known(Struct, frozen=True):
    """The verdicts on a subject's claims, in order.

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


class _Hollow(Struct, frozen=True):
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
    happens: Subject  #: what is looked at, whatever engines left out
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

            self.job = self.pool.hand_in("", looked)

    def end(self, ledger: Ledger, names: Collection[str]) -> _Hollow:
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
            return _Hollow((), own.interrupted, missing)
        return _Hollow(found.vacuities, own.interrupted, found.unlooked)

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


#: They are asked first, and seldom take longer than a process does to start.
_QUICK = (ByShallowSearch, ByEveryN, ByStep)


def _before(system: System, known: Sequence[Verdict], names: Sequence[str]) -> _Known:
    """What is known already, where nobody asks about claims that are not named."""
    verdicts = {verdict.claim: verdict for verdict in known}
    claims = claims_of(system)
    left = frozenset(n for n, claim in enumerate(claims) if claim.name not in names)
    return _Known(tuple(verdicts[claim] for claim in claims), None, left)


def _ask(
    subject: Subject,
    known: _Known | None,
    beside: _Beside,
    *,
    deadline: Deadline,
    bounds: Bounds,
    choice: Choice,
    seed: int,
    pool: Pool,
    names: Collection[str],
    steps: Steps,
    slices: Slices | None = None,
) -> tuple[_Known, Ledger]:
    """Verdicts on the claims about a subject; if there are ``names``, until those are settled.

    Of ``known`` ones only the unknown are asked, suspected rounds first; how far those were seen to
    hold counts even if the time is up. With ``slices`` claims are asked of theirs, too.
    """
    claims = claims_of(subject.system)
    stated = {identity(claim): claim for claim in claims_of(beside.system)}
    before = known.verdicts if known is not None else ()
    ledger = Ledger(
        subject,
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
    unrolling = ByUnrolling()
    with ledger.stopping():
        suspects = known is not None and known.suspected is not None
        if suspects and steps.begin(stage, -1, unrolling.name):
            assert known is not None
            assert known.suspected is not None
            # What is proved narrows down what functions may answer, to answers that often do not
            # replay: without it others are found.
            suspected = min(known.suspected, bounds.rounds)
            with ledger.enduring(unrolling.name):
                ByUnrolling(relying=False).through(ledger, suspected)
                unrolling.through(ledger, suspected)
        in_turn = enumerate(engines(choice, unrolling, pool, names, slices, steps))
        while _wanted(ledger, names) and (following := next(in_turn, None)) is not None:
            turn, engine = following
            if not isinstance(engine, _QUICK):
                beside.begin(ledger)
            if isinstance(engine, BySlices):  # it asks others
                with ledger.enduring(engine.name):
                    engine.work(ledger)
            else:
                alone = isinstance(engine, ByRounds) and not liveness_of(beside.system)
                is_last = choice is not Choice.AUTO or alone
                steps.take(stage, turn, engine.name, engine.work, ledger, is_last=is_last)
            if ledger.hurry():
                break
    if ledger.hurried and not ledger.interrupted and not deadline.passed():
        ledger.deadline, ledger.stopped = deadline, ""
    with ledger.stopping():
        _find_others(ledger, asked, pool, slices)
    verdicts = tuple(ledger.verdict(claim) for claim in claims)
    return _Known(verdicts, unrolling.suspected, left), ledger


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
        claim: pool.hand_in(claim.name, partial(find, claim, verdict.counterexample))
        for claim, verdict in ledger.verdicts.items()
        if claim in asked and wanted > 0 and verdict.counterexample is not None
    }
    for claim in jobs:  # until there is an answer
        ledger.settle({claim: replace(ledger.verdicts[claim], ways=Ways(False, "interrupted"))})
    for claim, answer in pool.answers(jobs):
        found, ways = answer or ((), Ways(complete=False, reason=jobs[claim].end))
        ledger.settle({claim: replace(ledger.verdicts[claim], others=found, ways=ways)})


def engines(
    choice: Choice,
    unrolling: ByUnrolling,
    pool: Pool,
    names: Collection[str] = (),
    slices: Slices | None = None,
    steps: Steps | None = None,
) -> Iterator[Works]:
    """The engines that a choice asks, in turn, cheapest first; about all claims, or named ones.

    Each is loaded when its turn comes: most questions are answered before. With ``slices`` those of
    single claims are asked first, but for what is quick with all claims together.
    """
    steps = steps or Steps()
    induction = ByInduction(unrolling)
    if choice is Choice.INDUCTION:
        # What a quick step proves of all claims together is asked once, not of every slice.
        yield ByStep(induction, hasty=True)
    if slices is not None and choice not in (Choice.AUTO, Choice.EVERY_N):
        yield BySlices(
            slices, partial(_on_slices, choice, pool, names), _nobody, steps, names, alone=True
        )
    match choice:
        case Choice.AUTO:
            yield ByShallowSearch(FIRST_LOOK)
            # A proof for every number of robots is one for this number.
            yield ByEveryN(SPARING)
            yield ByStep(induction)
            # What is violated is told before invariants are looked for that cannot be found.
            yield ByShallowSearch(SECOND_LOOK)
            yield ByGlance(unrolling, Effort.of_seconds(FIRST_GLANCE_S), FIRST_ROUNDS)
            yield ByInference(HASTY, FEW)
            if slices is not None:
                thorough = partial(_after_quick_ones, pool)
                yield BySlices(slices, thorough, _sparing_ones, steps, names)
            yield from _after_quick_ones(pool, induction)
        case Choice.EVERY_N:
            yield ByEveryN()
            yield ByInference()
        case Choice.INDUCTION:
            yield induction
        case Choice.SEARCH:
            yield BySearch(Limits())
        case Choice.BITS | Choice.ABC:
            if names:
                # Alone they often make a much smaller circuit, and need no lemmas.
                yield _by_bits(sparing=True, abc=choice is Choice.ABC, names=names)
            yield _by_bits(abc=choice is Choice.ABC)
        case Choice.SPACER:
            yield _by_spacer()
        case Choice.BMC:
            yield ByGlance(unrolling)
            yield ByRounds(unrolling, pool)
        case _:
            assert_never(choice)


def _after_quick_ones(pool: Pool, induction: ByInduction | None = None) -> Iterator[Works]:
    """What is asked about claims that are neither proved nor refuted in no time."""
    induction = induction or ByInduction(ByUnrolling())
    yield from _sparing_ones(induction)
    hasty, patient = _spacers()
    # Of what holds, invariants for every number of robots say more than Spacer's.
    inference = (hasty, ByInference(SPARING), _kept_back(hasty))
    yield ByRounds(induction.unrolling, pool, (*inference, patient, _kept_back(patient)))


def _sparing_ones(induction: ByInduction | None = None) -> Iterator[Works]:
    """Those of them that take some seconds at most."""
    induction = induction or ByInduction(ByUnrolling())
    # Finitely many configurations are most often few, and looked at in no time.
    yield BySearch(Limits(states=HANDFUL))
    yield induction
    yield BySearch(Limits(states=FEW_STATES))
    yield _by_bits(sparing=True)
    yield ByGlance(induction.unrolling)


def _on_slices(choice: Choice, pool: Pool, names: Collection[str]) -> Iterator[Works]:
    """What one engine is asked about slices: first for a while, as others are waiting."""
    if choice is Choice.SEARCH:
        yield BySearch(Limits(states=FEW_STATES))
    elif choice in (Choice.BITS, Choice.ABC):
        yield _by_bits(sparing=True, abc=choice is Choice.ABC)
    yield from engines(choice, ByUnrolling(), pool, names)


def _nobody() -> Iterator[Works]:
    return iter(())


def _by_bits(*, sparing: bool = False, abc: bool = False, names: Collection[str] = ()) -> Works:
    from koord.verify.engines.bits.engine import ByBits

    return ByBits(sparing, abc, names)


def _by_spacer() -> BySpacer:
    from koord.verify.engines.horn.engine import BySpacer

    return BySpacer()


def _spacers() -> tuple[BySpacer, BySpacer]:
    """One before others are asked, and one after."""
    from koord.verify.engines.horn.engine import HASTY_S, SPARING_S, BySpacer

    return BySpacer(HASTY_S, waits=True), BySpacer(SPARING_S, waits=True)


def _kept_back(spacer: BySpacer) -> Works:
    from koord.verify.engines.horn.engine import KeptBack

    return KeptBack(spacer)


def _of_whole_runs(
    slices: Slices,
    bounds: Bounds,
    choice: Choice | None,
    deadline: Deadline,
    names: Sequence[str],
    proved: Sequence[Claim],
    seed: int,
    pool: Pool,
    spent: Mapping[str, float],
    steps: Steps,
) -> Settled:
    """Verdicts on what is claimed of whole runs, by the engines that can tell."""
    from koord.verify.liveness_strategy import Ways, settled

    ways = {
        Choice.AUTO: Ways.ALL,
        Choice.SEARCH: Ways.SEARCH,
        Choice.BITS: Ways.BITS,
        Choice.ABC: Ways.BITS,
    }
    asked = ways.get(choice, Ways.NONE) if choice is not None else Ways.NONE
    return settled(
        slices.system,
        bounds,
        asked,
        deadline,
        names=names,
        proved=proved,
        seed=seed,
        pool=pool,
        before=spent,
        steps=steps,
        slices=slices,
    )
