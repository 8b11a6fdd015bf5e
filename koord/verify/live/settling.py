"""Who is asked about whole runs, cheapest first; what is said of them in one place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial

from koord.semantics.configurations import System
from koord.semantics.search.limits import FEW_STATES, Limits
from koord.semantics.traces.recording import Recording
from koord.verify.abstraction import abstracted
from koord.verify.claims import Claim, Phase, claims_of, liveness_of
from koord.verify.concretion import Concretion
from koord.verify.failures import VACUITY
from koord.verify.ledger import Ledger, Reach, Said, Subject
from koord.verify.live.bits import LiveByBits
from koord.verify.live.hollow import hollow
from koord.verify.live.lassos import replayed_lasso
from koord.verify.live.search import FEW_EDGES, LiveBySearch
from koord.verify.obstacles import WholeRuns, what
from koord.verify.pool import Pool, Progress
from koord.verify.resuming import Steps
from koord.verify.solving import Deadline
from koord.verify.verdicts import (
    Bounds,
    Counterexample,
    Engine,
    Failure,
    Outcome,
    Vacuity,
    Verdict,
)


class Ways(Enum):
    """Which engines may answer."""

    ALL = "all"
    SEARCH = "search"
    BITS = "bits"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Settled:
    """Verdicts on all liveness claims, in order, and what makes them say less."""

    verdicts: tuple[Verdict, ...]
    vacuities: tuple[Vacuity, ...] = ()
    interrupted: bool = False
    failures: tuple[Failure, ...] = ()


def settled(
    system: System,
    bounds: Bounds,
    ways: Ways,
    deadline: Deadline,
    *,
    names: Sequence[str] = (),
    proved: Sequence[Claim] = (),
    seed: int = 0,
    pool: Pool | None = None,
    before: Mapping[str, float] | None = None,
    steps: Steps | None = None,
) -> Settled:
    """Ask about everything that a program claims of whole runs, or what is named.

    ``proved`` are claims that hold in every round: proofs may rely on them. ``before`` is what was
    spent on claims already, by their names; ``steps`` are told of what is known by and by.
    """
    claims = tuple(c for c in liveness_of(system) if not names or c.name in names)
    if not claims:
        return Settled(())
    search = LiveBySearch(Limits())
    if ways is Ways.ALL:
        search = LiveBySearch(Limits(states=FEW_STATES), FEW_EDGES)
    pool = pool or Pool()
    bits = LiveByBits(pool, sparing=ways is Ways.ALL)
    ledger = Ledger(_plainly(system), bounds, deadline, claims, seed, pool.progress)
    steps = steps or Steps()
    steps.follow(ledger)
    ledger.before = {c: before.get(c.name, 0.0) for c in claims} if before else {}
    if ways is Ways.NONE:
        ledger.in_the_way = (WholeRuns(),)
        ledger.stopped = what(WholeRuns())
    with ledger.stopping():
        if ways in (Ways.ALL, Ways.SEARCH) and steps.begin("whole runs", 0, search.name):
            with ledger.enduring(search.name):
                search.work(ledger)
        by_bits = ways in (Ways.ALL, Ways.BITS) and ledger.open()
        if by_bits and steps.begin("whole runs", 1, bits.name):
            with ledger.enduring(bits.name):
                _by_bits(ledger, bits, proved)
    verdicts = tuple(ledger.verdict(claim) for claim in claims)
    empty = [*search.empty, *bits.empty]
    if not empty and steps.begin("whole runs", 2, VACUITY):
        with ledger.stopping(), ledger.enduring(VACUITY):
            empty += hollow(system, verdicts, deadline, seed)
    unique = tuple(dict.fromkeys(empty))
    return Settled(verdicts, unique, ledger.interrupted, tuple(ledger.failures))


def _by_bits(ledger: Ledger, bits: LiveByBits, proved: Sequence[Claim]) -> None:
    """Ask the circuit of the system, with opaque values where there are any."""
    system = ledger.system
    subject = abstractly(system) or ledger.subject
    originals = dict(zip(liveness_of(subject.system), liveness_of(system), strict=True))
    pairs = zip(claims_of(subject.system), claims_of(system), strict=True)
    known = {claim for claim in proved if claim.is_state_property}
    lemmas = tuple(lemma for lemma, claim in pairs if claim in known)
    asked = tuple(c for c, claim in originals.items() if claim in ledger.open())
    inner = Ledger(subject, ledger.bounds, ledger.deadline, asked, ledger.seed, ledger.progress)
    inner.noted = lambda verdict: _put_down(ledger, verdict, originals[verdict.claim], inner)
    bits.lemmas = lemmas
    with ledger.waiting():
        try:
            _without_lemmas_first(inner, bits)
        finally:
            for claim in inner.open():
                inner.noted(inner.verdict(claim))
            for failure in inner.failures:
                ledger.fail(failure)


def _put_down(ledger: Ledger, verdict: Verdict, claim: Claim, inner: Ledger) -> None:
    """What became known of a claim on a ledger of its own."""
    said = inner.said([verdict.claim])
    first = next(iter(verdict.obstacles), None)
    reach = Reach(Engine.BITS, None, verdict.reason, verdict.seconds, obstacle=first)
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


def _without_lemmas_first(ledger: Ledger, bits: LiveByBits) -> None:
    """Lemmas make the circuit larger, and may not be needed: ask without, and then with them.

    About a single claim that can be done at the same time: what is found without counts first.
    """
    quickly = LiveByBits(bits.pool, quick=True, empty=bits.empty)
    (_, *others), ahead = ledger.open(), None
    if bits.lemmas and not others and bits.pool.jobs > 1:
        ahead = bits.pool.hand_in("", partial(_asked, ledger, bits))
    if bits.lemmas:
        quickly.work(ledger)
    if ahead is None:
        if ledger.open():
            bits.work(ledger)
    elif not ledger.open():
        bits.pool.drop(ahead)
    elif (found := bits.pool.answer(ahead)) is not None:
        said, empty = found
        ledger.take(said)
        bits.empty += empty
    else:
        ledger.fail(Failure(bits.name, ahead.end))


def _asked(ledger: Ledger, bits: LiveByBits, tell: Progress) -> tuple[Said, list[Vacuity]]:
    """What is found in a process of its own."""
    own, alone = ledger.of(ledger.open(), tell), replace(bits, pool=Pool(1), empty=[])
    with own.stopping(), own.enduring(bits.name):
        alone.work(own)
    return own.said(ledger.open()), alone.empty


def _plainly(system: System) -> Subject:
    def judge(recording: Recording, claim: Claim, phase: Phase) -> Counterexample:
        return replayed_lasso(system, recording, claim)

    return Subject(system, judge, system)


def abstractly(system: System) -> Subject | None:
    """The system with values that merely flow made opaque, if there are any."""
    abstraction = abstracted(system.program)
    if abstraction is None:
        return None
    abstract = replace(system, program=abstraction.program)
    originals = dict(zip(liveness_of(abstract), liveness_of(system), strict=True))

    def judge(recording: Recording, claim: Claim, phase: Phase) -> Counterexample:
        real = Concretion(abstraction, system).recording(recording)
        return replayed_lasso(system, real, originals[claim])

    return Subject(abstract, judge, system)
