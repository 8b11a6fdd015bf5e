"""Who is asked about whole runs, cheapest first; what is said of them in one place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

from koord.semantics.configurations import System
from koord.semantics.domain import NumberTooLongError
from koord.semantics.machine import NotFiniteError
from koord.semantics.patience import OutOfPatienceError
from koord.semantics.search.limits import FEW_STATES, Limits
from koord.semantics.traces.recording import Recording
from koord.verify.abstraction import abstracted
from koord.verify.claims import Claim, Phase, claims_of, liveness_of
from koord.verify.concretion import Concretion
from koord.verify.ledger import Ledger, Subject, Works
from koord.verify.live.bits import LiveByBits
from koord.verify.live.lassos import replayed_lasso
from koord.verify.live.search import LiveBySearch
from koord.verify.solving import Deadline
from koord.verify.verdicts import Bounds, Counterexample, Vacuity, Verdict


class Ways(Enum):
    """Which engines may answer."""

    ALL = "all"
    SEARCH = "search"
    BITS = "bits"
    NONE = "none"


_BITS = (Ways.ALL, Ways.BITS)


@dataclass(frozen=True, slots=True)
class Settled:
    """Verdicts on all liveness claims, in order, and what makes them say less."""

    verdicts: tuple[Verdict, ...]
    vacuities: tuple[Vacuity, ...] = ()
    interrupted: bool = False


def settled(
    system: System,
    bounds: Bounds,
    ways: Ways,
    deadline: Deadline,
    *,
    proved: Sequence[Claim] = (),
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> Settled:
    """Ask about everything that a program claims of whole runs.

    ``proved`` are claims that hold in every round: proofs may rely on them.
    """
    claims = liveness_of(system)
    if not claims:
        return Settled(())
    few = Limits(states=FEW_STATES) if ways is Ways.ALL else Limits()
    search = LiveBySearch(few)
    asked: list[tuple[Subject, Works]] = []
    if ways in (Ways.ALL, Ways.SEARCH):
        asked.append((_plainly(system), search))
    abstract = (abstractly(system) or _plainly(system)) if ways in _BITS else _plainly(system)
    lemmas = zip(claims_of(abstract.system), claims_of(system), strict=True)
    known = {claim for claim in proved if claim.is_state_property}
    bits = LiveByBits(tuple(lemma for lemma, claim in lemmas if claim in known))
    if ways in _BITS:
        asked.append((abstract, bits))
    ledger = Ledger(_plainly(system), bounds, deadline, claims, seed, progress)
    if not asked:
        ledger.stopped = "liveness is decided by search, and by bits"
    interrupted = False
    try:
        for subject, engine in asked:
            if ledger.open():
                ledger.subject = subject
                engine.work(ledger)
    except NotFiniteError as error:
        ledger.stopped = str(error)
    except NumberTooLongError as error:
        ledger.stopped = error.diagnostics[0].message
    except OutOfPatienceError:
        ledger.stopped = "timeout"
    except KeyboardInterrupt:
        interrupted = True
        ledger.stopped = "interrupted"
    verdicts = tuple(ledger.verdict(claim) for claim in claims)
    empty = tuple(dict.fromkeys([*search.empty, *bits.empty]))
    return Settled(verdicts, empty, interrupted)


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
        return replayed_lasso(system, real, originals.get(claim, claim))

    return Subject(abstract, judge, system)
