"""Which engine is asked what, cheapest first; and one report of what they said."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, assert_never

from koord.semantics.configurations import System
from koord.semantics.patience import Patience
from koord.semantics.search.limits import FEW_STATES, Limits
from koord.semantics.traces.recording import Recording
from koord.verify.abstraction import abstracted
from koord.verify.claims import Claim, Phase, claims_of, liveness_of
from koord.verify.concretion import Concretion
from koord.verify.engines import ByGlance, ByInduction, BySearch, ByUnrolling
from koord.verify.every_n.engine import ByEveryN, ByInference
from koord.verify.every_n.proving import SPARING
from koord.verify.ledger import Ledger, Subject, Works
from koord.verify.solving import Deadline
from koord.verify.vacuity import vacuities
from koord.verify.varieties import others
from koord.verify.verdicts import Bounds, Counterexample, Outcome, Report, Vacuity, Verdict
from koord.verify.witness import replayed, simplified

if TYPE_CHECKING:
    from koord.verify.horn.engine import BySpacer
    from koord.verify.live.settling import Settled


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
    progress: Callable[[str], None] = lambda text: None,
    interrupted: Callable[[], bool] = lambda: False,
) -> Report:
    """Verdicts on all claims about a system, or on the named ones.

    Claims that are not named still serve as lemmas. If verdicts on all claims are ``known``, of
    what they leave open the named ones alone are asked. KeyboardInterrupt ends it with what is
    known so far, and so does ``interrupted``, which is asked now and then.
    """

    def is_over() -> bool:
        if interrupted():
            raise KeyboardInterrupt
        return deadline.passed()

    started = time.monotonic()
    deadline = Deadline.after(bounds.timeout_s)
    system = replace(system, patience=Patience(is_over))
    ask = partial(_ask, bounds=bounds, choice=choice, seed=seed, progress=progress)
    subject = _abstract_subject(system) or _plain_subject(system)
    before = _before(system, known, names) if known else None
    asked = ask(subject, deadline, known=before)
    given, cut = asked.verdicts, asked.interrupted
    if subject.is_abstract and asked.suspected is not None and not cut:
        # Opaque values let something happen that real ones do not: look at those.
        again = ask(_plain_subject(system), deadline, known=asked)
        given, cut = again.verdicts, again.interrupted
    every = [
        replace(verdict, claim=claim)
        for claim, verdict in zip(claims_of(system), given, strict=True)
    ]
    verdicts = tuple(v for v in every if not names or v.claim.name in names)
    vacuities = asked.vacuities
    if any(not names or claim.name in names for claim in liveness_of(system)):
        held = [v for v in every if v.outcome is Outcome.HOLDS and v.rounds is None]
        live = _of_whole_runs(
            system, bounds, None if cut else choice, deadline, names, held, seed, progress
        )
        verdicts += live.verdicts
        vacuities, cut = vacuities + live.vacuities, cut or live.interrupted
    seconds = time.monotonic() - started
    every_n = choice is Choice.EVERY_N
    return Report(verdicts, vacuities, seconds, cut, every_n=every_n)


@dataclass(frozen=True, slots=True)
class _Asked:
    """The verdicts on a subject's claims, in order.

    ``suspected`` is the last round in which something seemed violated and was not. ``left`` are
    the positions of claims that are left as they are, known or not.
    """

    verdicts: tuple[Verdict, ...]
    vacuities: tuple[Vacuity, ...]
    interrupted: bool
    suspected: int | None
    left: frozenset[int] = frozenset()


def _before(system: System, known: Sequence[Verdict], names: Sequence[str]) -> _Asked:
    """What is known already, where nobody asks about claims that are not named."""
    verdicts = {verdict.claim: verdict for verdict in known}
    claims = claims_of(system)
    left = frozenset(n for n, claim in enumerate(claims) if claim.name not in names)
    return _Asked(tuple(verdicts[claim] for claim in claims), (), False, None, left)


def _plain_subject(system: System) -> Subject:
    return Subject(system, partial(_judged, system), system)


def _judged(system: System, recording: Recording, claim: Claim, phase: Phase) -> Counterexample:
    """The counterexample of a recording that breaks a claim, as simple as can be."""
    replayed(system, recording, claim, phase)
    return replayed(system, simplified(system, recording, claim), claim, phase)


def _abstract_subject(system: System) -> Subject | None:
    """The system with values that merely flow made opaque, if there are any."""
    abstraction = abstracted(system.program)
    if abstraction is None:
        return None
    abstract = replace(system, program=abstraction.program)
    originals = dict(zip(claims_of(abstract), claims_of(system), strict=True))

    def judge(recording: Recording, claim: Claim, phase: Phase) -> Counterexample:
        real = Concretion(abstraction, system).recording(recording)
        return _judged(system, real, originals[claim], phase)

    return Subject(abstract, judge, system)


def _ask(
    subject: Subject,
    deadline: Deadline,
    *,
    known: _Asked | None = None,
    bounds: Bounds,
    choice: Choice,
    seed: int,
    progress: Callable[[str], None],
) -> _Asked:
    """Verdicts on the claims about a subject.

    Of ``known`` ones only the unknown are asked, suspected rounds first; what is empty is known.
    """
    claims = claims_of(subject.system)
    ledger = Ledger(subject, bounds, deadline, claims, seed, progress)
    left = known.left if known is not None else frozenset()
    for n, verdict in enumerate(known.verdicts if known is not None else ()):
        if verdict.outcome is not Outcome.UNKNOWN or n in left:
            ledger.settle({claims[n]: replace(verdict, claim=claims[n])})
    asked = ledger.open()
    unrolling = ByUnrolling()
    empty: tuple[Vacuity, ...] = ()
    with ledger.stopping():
        if known is not None and known.suspected is not None:
            # What is proved narrows down what functions may answer, to answers that often do not
            # replay: without it others are found.
            suspected = min(known.suspected, bounds.rounds)
            ByUnrolling(relying=False).through(ledger, suspected)
            unrolling.through(ledger, suspected)
        in_turn = engines(choice, unrolling)
        while ledger.open() and (engine := next(in_turn, None)) is not None:
            engine.work(ledger)
        _find_others(ledger, asked)
        if known is None:
            empty = vacuities(ledger)
    verdicts = tuple(ledger.verdict(claim) for claim in claims)
    return _Asked(verdicts, empty, ledger.interrupted, unrolling.suspected, left)


def _find_others(ledger: Ledger, asked: Sequence[Claim]) -> None:
    """As many different counterexamples to each claim as were asked for."""
    wanted = ledger.bounds.violations - 1
    for claim, verdict in list(ledger.verdicts.items()):
        if claim not in asked:
            continue
        if wanted > 0 and verdict.counterexample is not None:
            ledger.progress(f"other ways to break {claim.name}")
            found = tuple(islice(others(ledger, claim, verdict.counterexample), wanted))
            ledger.settle({claim: replace(verdict, others=found)})


def engines(choice: Choice, unrolling: ByUnrolling) -> Iterator[Works]:
    """The engines that a choice asks, in turn, cheapest first.

    Each is loaded when its turn comes: most questions are answered before.
    """
    match choice:
        case Choice.AUTO:
            # A proof for every number of robots is one for this number.
            yield ByEveryN(SPARING)
            yield ByInduction(unrolling)
            yield BySearch(Limits(states=FEW_STATES))
            yield _by_bits(sparing=True)
            yield ByGlance(unrolling)
            spacer = _by_spacer(sparing=True)
            yield spacer
            # Of what holds, invariants for every number of robots say more.
            yield ByInference(SPARING)
            yield _kept_back(spacer)
            yield unrolling
        case Choice.EVERY_N:
            yield ByEveryN()
            yield ByInference()
        case Choice.INDUCTION:
            yield ByInduction(unrolling)
        case Choice.SEARCH:
            yield BySearch(Limits())
        case Choice.BITS:
            yield _by_bits()
        case Choice.ABC:
            yield _by_bits(abc=True)
        case Choice.SPACER:
            yield _by_spacer()
        case Choice.BMC:
            yield unrolling
        case _:
            assert_never(choice)


def _by_bits(*, sparing: bool = False, abc: bool = False) -> Works:
    from koord.verify.bits.engine import ByBits

    return ByBits(sparing=sparing, abc=abc)


def _by_spacer(*, sparing: bool = False) -> BySpacer:
    from koord.verify.horn.engine import SPARING_S, BySpacer

    return BySpacer(SPARING_S, waits=True) if sparing else BySpacer()


def _kept_back(spacer: BySpacer) -> Works:
    from koord.verify.horn.engine import KeptBack

    return KeptBack(spacer)


def _of_whole_runs(
    system: System,
    bounds: Bounds,
    choice: Choice | None,
    deadline: Deadline,
    names: Sequence[str],
    held: Sequence[Verdict],
    seed: int,
    progress: Callable[[str], None],
) -> Settled:
    """Verdicts on what is claimed of whole runs, by the engines that can tell."""
    from koord.verify.live.settling import Ways, settled

    ways = {
        Choice.AUTO: Ways.ALL,
        Choice.SEARCH: Ways.SEARCH,
        Choice.BITS: Ways.BITS,
        Choice.ABC: Ways.BITS,
    }
    asked = ways.get(choice, Ways.NONE) if choice is not None else Ways.NONE
    proved = [verdict.claim for verdict in held]
    return settled(
        system, bounds, asked, deadline, names=names, proved=proved, seed=seed, progress=progress
    )
