"""The strategy for liveness claims: engines in order, the cheapest first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import assert_never

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimKind, claims_of, liveness_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Workers, load
from koord.verify.job_process import Progress
from koord.verify.ledger import Extract, Ledger, Reach, reach_of
from koord.verify.obstacles import VACUITY, Failure, Unreplayed, WholeRuns
from koord.verify.processes import Pool
from koord.verify.reduction.influence import Cone, Part
from koord.verify.reduction.problems import abstract_problem, identity, plain_problem
from koord.verify.reduction.slicing import Slices, speaks_of
from koord.verify.strategy.each_claim_turn import SpuriousViolations
from koord.verify.strategy.race import RaceTurn, Runner
from koord.verify.strategy.resumption import Steps
from koord.verify.strategy.table import (
    FIRST_LASSOS,
    AnyTurn,
    AskAtOnce,
    AskEngine,
    EngineTurn,
    LivenessRow,
)
from koord.verify.vacuity.vacuous_goals import vacuous_goals
from koord.verify.verdicts import Bounds, Outcome, Vacuity, Verdict

#: The number of the first turn after others: turns of all rows have different numbers.
_LATER = 10

#: The steps of races have higher numbers than turns, each race a hundred.
_RACES = 100


class LivenessVerdicts(Struct, frozen=True):
    """Verdicts on all liveness claims, in order, and their vacuities."""

    verdicts: tuple[Verdict, ...]
    vacuities: tuple[Vacuity, ...] = ()
    interrupted: bool = False
    failures: tuple[Failure, ...] = ()


def settled(
    slices: Slices,
    bounds: Bounds,
    rows: Sequence[LivenessRow],
    deadline: Deadline,
    *,
    names: Sequence[str] = (),
    proved: Sequence[Claim] = (),
    everyone: Sequence[Claim] = (),
    found: Sequence[core.Property] = (),
    seed: int = 0,
    pool: Pool | None = None,
    before: Mapping[str, float] | None = None,
    steps: Steps | None = None,
    so_far: Sequence[Verdict] = (),
    is_last: bool = True,
) -> LivenessVerdicts:
    """Run the engines of some rows on a system's liveness claims, or the named ones.

    ``proved`` are claims that hold in every round: proofs may rely on them, and on ``everyone``,
    which hold of every number of robots, if they are for every number. What was ``found`` to
    prove these is tried first where more is needed. ``before`` is what was
    spent on claims already, by their names; ``steps`` are told of what is known by and by.
    ``so_far`` is what rows before these found out; ``is_last``: there are no rows after them.
    """
    system = slices.system
    claims = tuple(c for c in liveness_of(system) if not names or c.name in names)
    if not claims:
        return LivenessVerdicts(())
    pool = pool or Pool()
    ledger = Ledger(plain_problem(system), bounds, deadline, claims, seed, pool.progress)
    steps = steps or Steps()
    steps.follow(ledger)
    ledger.before = {c: before.get(c.name, 0.0) for c in claims} if before else {}
    for verdict in so_far:
        if verdict.outcome is Outcome.UNKNOWN:
            ledger.leave([verdict.claim], reach_of(verdict))
        else:
            ledger.settle({verdict.claim: verdict})
    if not rows and is_last and not so_far:
        ledger.in_the_way = (WholeRuns(),)
        ledger.stopped = WholeRuns().what
    asking = _Asking(ledger, rows, proved, everyone, found, pool, steps, bool(so_far))
    parts = _parts(slices, {claim: slices.cone([claim]) for claim in claims})
    with ledger.stopping():
        asking.about(parts)
        # What is a lasso of a slice may be none of the program: more of it is asked then, first
        # all that such a lasso has to come back to.
        for cone in (slices.returning, slices.whole):
            if doubted := asking.doubted():
                asking.about(_parts(slices, {claim: cone([claim]) for claim in doubted}))
    verdicts = tuple(ledger.verdict(claim) for claim in claims)
    empty = [*asking.empty, *ledger.vacuities]
    if is_last and not empty and steps.begin("whole runs", _LATER - 1, VACUITY):
        with ledger.stopping(), ledger.enduring(VACUITY):
            for part in parts:
                of = [
                    verdict
                    for verdict in verdicts
                    if verdict.claim in part.claims
                    and verdict.claim.name not in steps.past.substance.claims
                ]
                empty += vacuous_goals(part.system, of, deadline, seed)
    unique = tuple(dict.fromkeys(empty))
    return LivenessVerdicts(verdicts, unique, ledger.interrupted, tuple(ledger.failures))


class _Part(Struct, frozen=True):
    """A slice, and the claims that have exactly this cone of influence. [T-CONE]"""

    system: System
    claims: tuple[Claim, ...]
    stage: str


def _parts(slices: Slices, cones: Mapping[Claim, Cone]) -> list[_Part]:
    """The slices of some claims by their cones, smaller ones first."""
    found: dict[Cone, list[Claim]] = {}
    for claim, cone in cones.items():
        found.setdefault(slices.extent(cone), []).append(claim)
    parts = []
    for extent, of in sorted(found.items(), key=lambda each: len(each[0])):
        part = slices.slice_of(frozenset[Part]().union(*(cones[claim] for claim in of)))
        names = " ".join(sorted(map(slices.name, extent)))
        stage = "whole runs" if part is slices.system else f"whole runs of {names}"
        parts.append(_Part(part, tuple(of), stage))
    return parts


class _Asking(Struct):
    """Engines at work on slices; their results count as runs of the whole system."""

    ledger: Ledger
    rows: Sequence[LivenessRow]
    proved: Sequence[Claim]
    everyone: Sequence[Claim]
    found: Sequence[core.Property]
    pool: Pool
    steps: Steps
    late: bool  #: whether others were asked before
    doubts: SpuriousViolations = field(default_factory=SpuriousViolations)
    empty: list[Vacuity] = field(default_factory=list)  #: what was found out besides

    @property
    def last(self) -> int:
        """The number of the last turn."""
        return len(self.rows) - 1 + (_LATER if self.late else 0)

    def doubted(self) -> list[Claim]:
        """The open claims that a slice's lasso breaks, which is no run of the whole system.

        What another process ran into is told by what stood in its way.
        """
        return [
            claim
            for claim in self.ledger.open()
            if identity(claim) in self.doubts.rounds
            or any(isinstance(x, Unreplayed) for x in self.ledger.verdict(claim).obstacles)
        ]

    def about(self, parts: Sequence[_Part]) -> None:
        """Run each engine on all slices before the next engine."""
        self.doubts = SpuriousViolations()
        workers = Workers(self.pool, of_runs=True)
        workers.tools.vacuities = self.empty
        for number, row in enumerate(self.rows, _LATER if self.late else 0):
            for part in parts:
                match row:
                    case AskEngine():
                        turn = self._turn(part, row, workers)
                        self._ask(part, partial(self._take, part, number, turn))
                    case AskAtOnce():
                        self._ask(part, partial(_raced, self._race(part, number, row)))
                    case _:
                        assert_never(row)

    def _turn(self, part: _Part, row: AskEngine, workers: Workers) -> AnyTurn:
        """The turn of an engine on a slice."""
        turn = EngineTurn(row.engine, row.task, workers)
        return _PartTurn(self, part, turn) if row.opaque else turn

    def _take(self, part: _Part, number: int, turn: AnyTurn, ledger: Ledger) -> None:
        is_last = number == self.last
        self.steps.take(part.stage, number, turn.name, turn.work, ledger, is_last=is_last)

    def _race(self, part: _Part, number: int, row: AskAtOnce) -> RaceTurn:
        """The turn of engines that race on a slice, each in a process of its own."""
        first, beside = (
            [
                Runner(
                    _RACES * number + k,
                    each.engine.value,
                    partial(self._apart, part, each),
                    load=partial(load, each.engine, of_runs=True),
                )
                for k, each in enumerate(engines, start)
                if isinstance(each, AskEngine)
            ]
            for engines, start in ((row.first, 0), (row.beside, len(row.first)))
        )
        return RaceTurn(
            first,
            beside,
            self.pool,
            self.steps,
            part.stage,
            lambda ledger: bool(ledger.open()),
            patience=row.patience,
        )

    def _apart(self, part: _Part, row: AskEngine, steps: Steps) -> AnyTurn:
        """Make the turn of a row for a process of its own, which starts no others."""
        pool = Pool(1)
        workers = Workers(pool, of_runs=True)
        alone = replace(self, pool=pool, steps=steps)
        return _ApartTurn(alone._turn(part, row, workers), workers)

    def _ask(self, part: _Part, work: Callable[[Ledger], None]) -> None:
        is_whole = part.system is self.ledger.system
        asked = [claim for claim in self.ledger.open() if claim in part.claims]
        if not is_whole:
            asked = [claim for claim in asked if identity(claim) not in self.doubts.rounds]
        if not asked:
            return
        inner = self.ledger
        if len(asked) < len(inner.claims) or not is_whole:
            inner = inner.of(asked, inner.report)
        if not is_whole:
            problem = plain_problem(self.ledger.system, part.system)
            inner.problem = self.doubts.watching(problem)
        if inner is self.ledger:
            work(inner)
            return
        try:
            with self.ledger.waiting():
                work(inner)
        finally:
            self.ledger.take(inner.extract(asked))

    def on_opaque(self, part: _Part, turn: EngineTurn, ledger: Ledger) -> None:
        """Run an engine on a slice, with lemmas, and opaque values where there are any."""
        whole = self.ledger.system
        problem = abstract_problem(whole, part.system)
        if problem is None:
            problem = ledger.problem
        elif part.system is not whole:
            problem = self.doubts.watching(problem)
        outer = {identity(claim): claim for claim in ledger.open()}
        originals = {
            claim: outer[identity(claim)]
            for claim in liveness_of(problem.system)
            if identity(claim) in outer
        }
        of_everyone = turn.engine is Engine.EVERY_N
        given = self.everyone if of_everyone else self.proved
        known = {identity(claim) for claim in given if claim.is_state_property}
        lemmas = tuple(c for c in claims_of(problem.system) if identity(c) in known)
        inner = replace(ledger.about(problem, tuple(originals)), report=ledger.progress)
        inner.noted = lambda verdict: _put_down(
            ledger, verdict, originals[verdict.claim], inner, turn.engine
        )
        with ledger.waiting():
            try:
                if of_everyone:
                    likely = tuple(_said_of(problem.system.program, self.found))
                    task = replace(turn.task, lemmas=lemmas, likely=likely)
                    replace(turn, task=task).work(inner)
                else:
                    _without_lemmas_first(inner, turn, lemmas, self.pool)
            finally:
                for claim in inner.open():
                    inner.noted(inner.verdict(claim))
                for failure in inner.failures:
                    ledger.fail(failure)


def _said_of(program: core.Program, found: Sequence[core.Property]) -> Iterator[Claim]:
    """Yield the statements that a slice has words for, as claims about it."""
    for k, stated in enumerate(found):
        if speaks_of(program, stated):
            yield Claim(f"found {k}", ClaimKind.PROPERTY, stated)


def _raced(turn: RaceTurn, ledger: Ledger) -> None:
    with ledger.enduring(turn.name):
        turn.work(ledger)


class _PartTurn(Struct, frozen=True):
    """A turn of an engine on a slice, with lemmas, and opaque values where there are any."""

    asking: _Asking
    part: _Part
    turn: EngineTurn

    @property
    def name(self) -> str:
        return self.turn.name

    def work(self, ledger: Ledger) -> None:
        self.asking.on_opaque(self.part, self.turn, ledger)


class _ApartTurn(Struct, frozen=True):
    """A turn in a process of its own: what is found out besides stands on the ledger."""

    turn: AnyTurn
    workers: Workers

    @property
    def name(self) -> str:
        return self.turn.name

    def work(self, ledger: Ledger) -> None:
        try:
            self.turn.work(ledger)
        finally:
            ledger.vacuities += self.workers.tools.vacuities


def _put_down(
    ledger: Ledger, verdict: Verdict, claim: Claim, inner: Ledger, engine: Engine
) -> None:
    """Merge the results on a claim from a ledger of its own."""
    said = inner.extract([verdict.claim])
    first = next(iter(verdict.obstacles), None)
    reach = Reach(engine, None, verdict.reason, verdict.seconds, obstacle=first)
    settled = verdict.outcome is not Outcome.UNKNOWN
    ledger.take(
        replace(
            said,
            failures={},
            verdicts={claim: verdict} if settled else {},
            reaches={} if settled else {claim: [reach]},
            spans={claim: said.spans[verdict.claim]},
        )
    )


def _without_lemmas_first(
    ledger: Ledger, turn: EngineTurn, lemmas: tuple[Claim, ...], pool: Pool
) -> None:
    """Run first without lemmas, which make the circuit larger, and then with them.

    About a single claim that can be done at the same time: what is found without counts first.
    """
    (_, *others), ahead = ledger.open(), None
    helped = replace(turn, task=replace(turn.task, lemmas=lemmas))
    if lemmas and not others and pool.jobs > 1:
        ahead = pool.submit("", partial(_asked, ledger, helped))
    if lemmas:
        first = FIRST_LASSOS if turn.task.rounds is None else turn.task
        replace(turn, task=first).work(ledger)
    if ahead is None:
        if ledger.open():
            helped.work(ledger)
    elif not ledger.open():
        pool.drop(ahead)
    elif (found := pool.answer(ahead)) is not None:
        said, empty = found
        ledger.take(said)
        turn.workers.tools.vacuities += empty
    else:
        ledger.fail(Failure(turn.name, ahead.end))


def _asked(ledger: Ledger, turn: EngineTurn, tell: Progress) -> tuple[Extract, list[Vacuity]]:
    """The results of an engine that runs in a process of its own."""
    own = ledger.of(ledger.open(), tell)
    alone = replace(turn, workers=Workers(Pool(1), of_runs=True))
    with own.stopping(), own.enduring(turn.name):
        alone.work(own)
    return own.extract(ledger.open()), alone.workers.tools.vacuities
