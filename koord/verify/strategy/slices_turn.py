"""Single claims, each asked of a program without what that claim cannot depend on. [T-CONE]"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import TypeVar

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.recordings import Recording
from koord.syntax.analysis.auxiliary import Var
from koord.verify.claims import Claim, ClaimPhase, claims_of, liveness_of
from koord.verify.ledger import Ledger, VerificationProblem
from koord.verify.reduction.influence import Cone, Part
from koord.verify.reduction.problems import Identity, identity, problem_of
from koord.verify.reduction.slices import Slices
from koord.verify.strategy.each_claim_turn import EachClaimTurn
from koord.verify.strategy.resumption import Steps
from koord.verify.strategy.turns import AnyTurn
from koord.verify.verdicts import Counterexample, Outcome, Verdict
from koord.verify.witness import NotReplayedError

T = TypeVar("T")


class Doubts(Struct):
    """Claims that something seemed to break which is no run, with its number of rounds."""

    rounds: dict[Identity, int] = field(default_factory=dict)

    def watching(self, problem: VerificationProblem) -> VerificationProblem:
        """The problem, whose judge tells of what does not replay."""

        def judge(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
            try:
                return problem.judge(recording, claim, phase)
            except NotReplayedError:
                self.rounds[identity(claim)] = len(recording.rounds)
                raise

        return replace(problem, judge=judge)


class _Part(Struct):
    """A slice, and the claims that have just this cone of influence."""

    name: str
    extent: frozenset[Part]
    cone: Cone
    claims: dict[Identity, Claim]  #: as they are on the ledger of all
    is_alone: bool  #: no invariant that speaks of more can help to prove them


class _Asking(Struct):
    """Engines that are asked about a slice, one after the other."""

    part: _Part
    inner: Ledger  #: of the slice
    doubts: Doubts
    engines: Iterator[tuple[int, AnyTurn]]
    steps: Steps
    alone: bool  #: one engine is asked, which has all the time
    followed: bool  #: claims about whole runs are asked behind all of these

    def goes_on(self, ledger: Ledger) -> bool:
        """Ask one more engine; whether there may be others."""
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
        """Whoever looks at more of the program is asked only what may be found out from there."""
        if not self.part.is_alone or ledger.deadline.passed():
            return
        for claim in self._own():
            if identity(claim) not in self.doubts.rounds:
                outer = self.part.claims[identity(claim)]
                ledger.settle({outer: ledger.verdict(outer)})

    def _own(self) -> list[Claim]:
        """The claims, as they are on the slice."""
        return [claim for claim in self.inner.claims if identity(claim) in self.part.claims]

    def _tell(self, ledger: Ledger) -> None:
        """Put down what was found out by now."""
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
    """Engines on slices that are smaller than what a ledger is about, for the claims of these.

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

    @property
    def name(self) -> str:
        """What it is called where it fails."""
        return "slices"

    def work(self, ledger: Ledger) -> None:
        waiting = [self._asking(ledger, part) for part in self._parts(ledger)]
        while waiting:
            going = [(asking, asking.goes_on(ledger)) for asking in waiting]
            for asking, goes_on in going:
                if not goes_on:
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
        """The claim as it is stated of the system itself."""
        return self.slices.claims[identity(claim)]

    def _asking(self, ledger: Ledger, part: _Part) -> _Asking:
        system, doubts = self.slices.system, Doubts()
        smaller = self.slices.slice_of(part.cone)
        inner = _inner(ledger, doubts.watching(problem_of(system, smaller)), part)
        engines = self.engines() if part.is_alone else self.shared()
        followed = bool(liveness_of(system))
        return _Asking(part, inner, doubts, enumerate(engines), self.steps, self.alone, followed)


def on_slice(slices: Slices, ledger: Ledger, claim: Claim) -> tuple[Ledger, Claim]:
    """A ledger of the slice of one claim, on which nothing is known, and the claim there."""
    system, meant = slices.system, identity(claim)
    smaller = slices.slice_of(slices.cone([slices.claims[meant]]))
    problem = problem_of(system, smaller)
    claims = tuple(each for each in claims_of(problem.system) if identity(each) == meant)
    return ledger.about(problem, claims), claims[0]


def _inner(ledger: Ledger, problem: VerificationProblem, part: _Part) -> Ledger:
    """A ledger of a slice, with what is known of it, and other claims that may be lemmas."""
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
    """Whether no possible lemma speaks of something in a slice and of something outside of it."""
    variables = {part for part in extent if isinstance(part, Var)}
    return not any(
        extents[claim] & variables and not extents[claim] <= extent
        for claim in ledger.claims
        if claim.is_state_property and _serves(ledger, claim)
    )


def _serves(ledger: Ledger, claim: Claim) -> bool:
    """Whether a claim may be a lemma: it is proved, or may still be."""
    return claim not in ledger.verdicts or claim in ledger.proved()


def _violated(ledger: Ledger) -> dict[Claim, Verdict]:
    return {c: v for c, v in ledger.verdicts.items() if v.outcome is Outcome.VIOLATED}
