"""Turns of the strategy on single claims: in processes, and on slices. [T-CONE]

Engines are asked about all claims together first, for so much effort. Claims that are open then
know nothing of each other, so that no answer hangs on another, nor on how many are asked at a time.
Effort is counted in work, not in time: what is asked singly is the same on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, TypeVar

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.recordings import Recording
from koord.syntax.analysis.auxiliary import Var
from koord.verify.bounded_check import AFTERWARDS_S, Unroller
from koord.verify.claims import Claim, ClaimPhase, claims_of, liveness_of
from koord.verify.engine_names import Engine
from koord.verify.job_process import JobChannel, Progress
from koord.verify.ledger import Extract, Judge, Ledger, VerificationProblem, reach_of
from koord.verify.obstacles import Failure
from koord.verify.processes import Job, Pool, can_fork
from koord.verify.reduction.influence import Cone, Part
from koord.verify.reduction.problems import Identity, identity, problem_of
from koord.verify.reduction.slicing import Slices
from koord.verify.strategy.resumption import Steps
from koord.verify.strategy.table import AnyTurn
from koord.verify.verdicts import Counterexample, NotReplayedError, Outcome, Verdict

if TYPE_CHECKING:
    from koord.verify.strategy.rounds_question import Looked


class _Slice(Struct, frozen=True):
    """The budget of each claim, in about seconds of a solver (None: unlimited).

    ``afresh``: from INIT on, and not from where all claims together were left. What the solver was
    told of the other claims by then helps with some (SATS: 4 s instead of 17 s), and is in the way
    of others (Task: 24 s instead of 1 s).
    """

    seconds: float | None
    afresh: bool


#: What is spent on each claim in turn, until it is known whether another one is violated.
SLICES = (_Slice(5, False), _Slice(2, True), _Slice(50, False), _Slice(20, True))
AT_LAST = _Slice(None, False)


class EachClaimTurn(Struct, frozen=True):
    """A turn: bounded model checking claim by claim, with proofs of all claims in parallel.

    What ``proofs`` say, which are asked in turn, counts first: the rounds that were looked at
    meanwhile count where that settles nothing. ``unrolling`` was asked about all claims together
    for a while.
    """

    unrolling: Unroller
    pool: Pool
    proofs: Sequence[AnyTurn] = ()

    @property
    def name(self) -> str:
        return Engine.BMC.value

    def work(self, ledger: Ledger) -> None:
        wanting, open_ = ledger.wanting(), ledger.open()
        if not can_fork():
            for engine in self.proofs:
                if ledger.open():
                    with ledger.enduring(engine.name):
                        engine.work(ledger)
            self.unrolling.work(ledger)
            return
        proving = self._proving(ledger, open_, 0) if self.proofs else None
        slices = _slices(ledger)
        is_here = self.pool.helpers is None
        alone = not wanting or (not self.proofs and len(wanting) < 2 and is_here)
        jobs = {} if alone else self._submitted(ledger, wanting, slices[0])
        while proving is not None:
            for _, said in self.pool.answers({None: proving}):
                if said is not None:
                    ledger.take(said)
            proving = self._behind(ledger, open_, proving)
        if alone:
            self.unrolling.work(ledger)
            return
        if ledger.open() != open_:
            # What is settled helps with the rest.
            for job in chain.from_iterable(jobs.values()):
                self.pool.drop(job)
            slices = _slices(ledger)
            jobs = self._submitted(ledger, ledger.wanting(), slices[0])
        tired = self._taken(ledger, jobs)
        for slice_ in slices[1:]:
            if ledger.is_violated or not tired:
                break
            tired = self._taken(ledger, self._submitted(ledger, tired, slice_))

    def _proving(self, ledger: Ledger, claims: Sequence[Claim], first: int) -> Job[Extract]:
        """Start the proofs from a given one on, in a process of their own."""
        proofs = list(enumerate(self.proofs))[first:]
        return self.pool.submit("", partial(asked, ledger, claims, proofs))

    def _behind(
        self, ledger: Ledger, claims: Sequence[Claim], died: Job[Extract]
    ) -> Job[Extract] | None:
        """Merge the notes of a proof process that died, and start the next engine.

        None if there is nothing to go on with.
        """
        begun = [turn for turn in died.noted if isinstance(turn, int)]
        if died.found is not None or died.is_late:
            return None
        for verdict in died.noted:
            if isinstance(verdict, Verdict) and verdict.claim not in ledger.verdicts:
                if verdict.outcome is not Outcome.UNKNOWN:
                    ledger.settle({verdict.claim: verdict})
                else:
                    ledger.leave([verdict.claim], reach_of(verdict))
        name = self.proofs[begun[-1]].name if begun else "koord"
        ledger.fail(Failure(name, died.end))
        if not begun or begun[-1] + 1 >= len(self.proofs) or not ledger.open():
            return None
        return self._proving(ledger, claims, begun[-1] + 1)

    def _submitted(
        self, ledger: Ledger, claims: Sequence[Claim], slice_: _Slice
    ) -> dict[Claim, list[Job[Looked]]]:
        """Start the checks of some claims: of each one, or what others do of it together."""
        from koord.verify.strategy.rounds_question import RoundsQuestion, by_cubes, look

        until = ledger.deadline.at_last()

        def go_on(claim: Claim, tell: Progress) -> Looked:
            return look(ledger.of([claim], tell), claim, slice_.seconds, self.unrolling)

        def submitted(claim: Claim) -> list[Job[Looked]]:
            questions = []
            if slice_.afresh:
                questions = [RoundsQuestion(ledger.detached([claim]), claim, slice_.seconds)]
            elif slice_.seconds is None and self.pool.helpers is not None:
                questions = by_cubes(ledger, claim)
            if not questions:
                return [self.pool.submit(claim.name, partial(go_on, claim), until=until)]
            return [
                self.pool.submit(claim.name, each, portable=each, until=until) for each in questions
            ]

        return {claim: submitted(claim) for claim in claims}

    def _taken(self, ledger: Ledger, jobs: Mapping[Claim, Sequence[Job[Looked]]]) -> list[Claim]:
        """Merge results; return the claims whose checks can go on."""
        from koord.verify.each_claim import note_end
        from koord.verify.strategy.rounds_question import joined

        tired: list[Claim] = []
        looks: dict[Claim, list[Looked]] = {claim: [] for claim in jobs}
        over: set[Claim] = set()
        parts = {(claim, n): job for claim, its in jobs.items() for n, job in enumerate(its)}
        with ledger.waiting():
            for (claim, n), looked in self.pool.answers(parts):
                if claim in over:
                    continue
                job, rest = jobs[claim][n], jobs[claim][n + 1 :]
                if looked is None:
                    note_end(ledger, claim, self.name, job.end)
                else:
                    looks[claim].append(looked.as_of(job.started))
                    if rest and not looked.violates(claim):
                        continue
                    (whole, *more), known = looks[claim], ledger.verdict(claim).rounds
                    if more or rest:
                        whole = joined(claim, looks[claim], known)
                    self._take(ledger, claim, whole, tired)
                over.add(claim)
                for other in rest:
                    self.pool.drop(other)
        if ledger.interrupted:
            raise KeyboardInterrupt
        return tired

    def _take(self, ledger: Ledger, claim: Claim, looked: Looked, tired: list[Claim]) -> None:
        """Merge the results of a claim's check; it is ``tired`` if it can go on."""
        ledger.take(looked.found.said)
        if looked.unreplayed is not None:
            self.unrolling.of(ledger).unreplayed[claim] = looked.unreplayed
        if looked.tired and claim not in ledger.verdicts:
            tired.append(claim)


def _slices(ledger: Ledger) -> Sequence[_Slice]:
    wanting = len(ledger.wanting())
    if ledger.is_violated:
        # Nobody waits long for the others.
        return [_Slice(AFTERWARDS_S / max(1, wanting), False)]
    return [*SLICES, AT_LAST] if wanting > 1 else [AT_LAST]


def asked(
    ledger: Ledger,
    claims: Sequence[Claim],
    engines: Iterable[tuple[int, AnyTurn]],
    tell: JobChannel,
) -> Extract:
    """Run engines on some claims in turn, in a process of its own.

    It tells whose turn it is, and what is known by then.
    """
    own = ledger.of(claims, tell)
    own.noted = tell.note
    proofs = list(engines)
    with own.stopping():
        for n, (turn, engine) in enumerate(proofs):
            if own.open():
                tell.note(turn)
                # The rounds wait, too.
                with own.deadline.sharing(1 / (1 + len(proofs) - n)) as ended:
                    tell.lasting(ended)
                    with own.enduring(engine.name):
                        engine.work(own)
    return own.extract(claims)


T = TypeVar("T")


class SpuriousViolations(Struct):
    """The claims with a candidate violation that did not replay, with its number of rounds."""

    rounds: dict[Identity, int] = field(default_factory=dict)

    def watching(self, problem: VerificationProblem) -> VerificationProblem:
        """The problem with a judge that records failed replays."""
        return replace(problem, judge=_WatchedJudge(problem.judge, self.rounds))


class _WatchedJudge(Struct):
    """A judge that records failed replays, with their numbers of rounds."""

    judge: Judge
    rounds: dict[Identity, int]

    def __call__(self, recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
        try:
            return self.judge(recording, claim, phase)
        except NotReplayedError:
            self.rounds[identity(claim)] = len(recording.rounds)
            raise


class _Part(Struct):
    """A slice, and the claims that have exactly this cone of influence."""

    name: str
    extent: frozenset[Part]
    cone: Cone
    claims: dict[Identity, Claim]  #: as they are on the ledger of all
    is_alone: bool  #: no invariant that speaks of more can help to prove them


class _Asking(Struct):
    """Engines at work on a slice, one after the other."""

    part: _Part
    inner: Ledger  #: of the slice
    doubts: SpuriousViolations
    engines: Iterator[tuple[int, AnyTurn]]
    steps: Steps
    alone: bool  #: one engine is asked, which has all the time
    followed: bool  #: claims about whole runs are asked behind all of these

    def goes_on(self, ledger: Ledger) -> bool:
        """Run one more engine; return whether there may be others."""
        if all(claim in self.inner.verdicts for claim in self._own()):
            return False
        following = next(self.engines, None)
        if following is None:
            return False
        turn, engine = following
        # A new one: the time until now was spent on others. Where something is violated, nobody
        # waits long to see the rest.
        known = self.inner.verdicts | _violated(ledger)
        self.inner = replace(self.inner, verdicts=known)
        try:
            with ledger.waiting():
                others = any(claim not in self.part.claims.values() for claim in ledger.open())
                last = isinstance(engine, EachClaimTurn) and not others and not self.followed
                is_last = self.alone or last
                self.steps.take(
                    self.part.name, turn, engine.name, engine.work, self.inner, is_last=is_last
                )
        finally:
            self._tell(ledger)
        over = ledger.is_overtime()
        self.inner.deadline = ledger.deadline
        return not over

    def close(self, ledger: Ledger) -> None:
        """End the work on the slice: larger slices need only check what could still be found."""
        if not self.part.is_alone or ledger.deadline.passed():
            return
        for claim in self._own():
            if identity(claim) not in self.doubts.rounds:
                outer = self.part.claims[identity(claim)]
                ledger.settle({outer: ledger.verdict(outer)})

    def _own(self) -> list[Claim]:
        """The claims in terms of the slice."""
        return [claim for claim in self.inner.claims if identity(claim) in self.part.claims]

    def _tell(self, ledger: Ledger) -> None:
        """Record the results so far."""
        own = self._own()
        said = self.inner.extract(own)

        def outer(found: Mapping[Claim, T]) -> dict[Claim, T]:
            return {self.part.claims[identity(claim)]: each for claim, each in found.items()}

        failures = {
            failure: frozenset(outer(dict.fromkeys(claims.intersection(own))))
            for failure, claims in said.failures.items()
        }
        ledger.take(
            replace(
                said,
                verdicts=outer(said.verdicts),
                reaches=outer(said.reaches),
                failures=failures,
                spans=outer(said.spans),
            )
        )


class SlicesTurn(Struct, frozen=True):
    """A turn: engines on slices that are smaller than the ledger's system, for their claims.

    Of all slices the first engine is asked before the next one, so that no claim waits long for
    what is quick. Claims that invariants about more than their slice may help to prove are asked
    of the ``shared`` engines only, and the rest is left to those who look at more. So is what
    seems violated in a slice and does not replay.
    """

    slices: Slices
    engines: Callable[[], Iterator[AnyTurn]]
    shared: Callable[[], Iterator[AnyTurn]]
    steps: Steps
    names: Collection[str] = ()
    alone: bool = False  #: these are all one engine, which has all the time
    ends: bool = True  #: what is open in the end stays so where a slice is all that counts

    @property
    def name(self) -> str:
        """The turn's name in reports of failures."""
        return "slices"

    def work(self, ledger: Ledger) -> None:
        waiting = [self._asking(ledger, part) for part in self._parts(ledger)]
        while waiting:
            going = [(asking, asking.goes_on(ledger)) for asking in waiting]
            for asking, goes_on in going:
                if not goes_on and self.ends:
                    asking.close(ledger)
            waiting = [asking for asking, goes_on in going if goes_on]

    def _parts(self, ledger: Ledger) -> list[_Part]:
        """The slices of the open claims, smaller ones first."""
        cones = {claim: self.slices.cone([self._stated(claim)]) for claim in ledger.claims}
        extents = {claim: self.slices.extent(cone) for claim, cone in cones.items()}
        everything = frozenset[Part]().union(*extents.values())
        found: dict[frozenset[Part], _Part] = {}
        for claim in ledger.open():
            extent = extents[claim]
            if extent == everything or (self.names and claim.name not in self.names):
                continue
            if extent not in found:
                name = " ".join(["slice of", *sorted(map(self.slices.name, extent))])
                found[extent] = _Part(
                    name, extent, frozenset(), {}, _is_alone(ledger, extent, extents)
                )
            found[extent].cone |= cones[claim]
            found[extent].claims[identity(claim)] = claim
        return sorted(found.values(), key=lambda part: len(part.extent))

    def _stated(self, claim: Claim) -> Claim:
        """The claim in terms of the system."""
        return self.slices.claims[identity(claim)]

    def _asking(self, ledger: Ledger, part: _Part) -> _Asking:
        system, doubts = self.slices.system, SpuriousViolations()
        smaller = self.slices.slice_of(part.cone)
        inner = _inner(ledger, doubts.watching(problem_of(system, smaller)), part)
        engines = self.engines() if part.is_alone else self.shared()
        followed = bool(liveness_of(system))
        return _Asking(part, inner, doubts, enumerate(engines), self.steps, self.alone, followed)


def on_slice(slices: Slices, ledger: Ledger, claim: Claim) -> tuple[Ledger, Claim]:
    """An empty ledger of one claim's slice, and the claim there."""
    system, meant = slices.system, identity(claim)
    smaller = slices.slice_of(slices.cone([slices.claims[meant]]))
    problem = problem_of(system, smaller)
    claims = tuple(each for each in claims_of(problem.system) if identity(each) == meant)
    return ledger.about(problem, claims), claims[0]


def _inner(ledger: Ledger, problem: VerificationProblem, part: _Part) -> Ledger:
    """A ledger of a slice with known results, and other claims as possible lemmas."""
    proved = {identity(claim): ledger.verdicts[claim] for claim in ledger.proved()}
    lemmas = {identity(c) for c in ledger.claims if c.is_state_property and _serves(ledger, c)}
    wanted = lemmas | part.claims.keys()
    claims = tuple(claim for claim in claims_of(problem.system) if identity(claim) in wanted)
    inner = ledger.about(problem, claims)
    for claim in claims:
        if identity(claim) in proved:
            inner.settle({claim: replace(proved[identity(claim)], claim=claim)})
    return inner


def _is_alone(
    ledger: Ledger, extent: frozenset[Part], extents: Mapping[Claim, frozenset[Part]]
) -> bool:
    """Return whether no possible lemma relates variables inside a slice to ones outside."""
    variables = {part for part in extent if isinstance(part, Var)}
    return not any(
        extents[claim] & variables and not extents[claim] <= extent
        for claim in ledger.claims
        if claim.is_state_property and _serves(ledger, claim)
    )


def _serves(ledger: Ledger, claim: Claim) -> bool:
    """Return whether a claim may serve as a lemma: it is proved, or still open."""
    return claim not in ledger.verdicts or claim in ledger.proved()


def _violated(ledger: Ledger) -> dict[Claim, Verdict]:
    return {c: v for c, v in ledger.verdicts.items() if v.outcome is Outcome.VIOLATED}
