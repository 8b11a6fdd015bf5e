"""Which engine is asked what, cheapest first; and one report of what they said."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial

from koord.semantics.configurations import System
from koord.semantics.machine import NotFiniteError
from koord.semantics.search.limits import Limits
from koord.semantics.traces.recording import Recording
from koord.verify.abstraction import abstracted
from koord.verify.bmc import Bounded, Judge
from koord.verify.claims import Claim, ClaimKind, Phase, claims_of, liveness_of
from koord.verify.concretion import Concretion
from koord.verify.exhaustive import FEW_STATES, exhaust
from koord.verify.induction import prove
from koord.verify.sightings import seen_to_run
from koord.verify.solving import Deadline, Effort
from koord.verify.verdicts import (
    Bounds,
    Counterexample,
    Engine,
    Outcome,
    Report,
    Vacuity,
    Verdict,
)
from koord.verify.witness import replayed, simplified

#: How many rounds an inductive step may span.
MAX_DEPTH = 3

#: What inductive attempts may cost before other engines get their turn: about so many seconds.
PROOF_S = 30.0

#: What the search for events that never run may cost, after random runs of so many seconds.
IDLE_S = 10.0
RUNS_S = 2.0


class Choice(Enum):
    """Which engines may answer."""

    AUTO = "auto"
    BMC = "bmc"
    SEARCH = "search"
    INDUCTION = "induction"


@dataclass(slots=True)
class _Session:
    """The state of one verification: what is open, and why."""

    subject: _Subject
    bounds: Bounds
    seed: int
    progress: Callable[[str], None]
    deadline: Deadline
    claims: list[Claim]
    verdicts: dict[Claim, Verdict] = field(default_factory=dict)
    reasons: dict[Claim, str] = field(default_factory=dict)
    bounded: Bounded | None = None
    searched: dict[Claim, int] = field(default_factory=dict)  #: rounds that the search finished

    @property
    def system(self) -> System:
        return self.subject.system

    def open(self) -> list[Claim]:
        return [claim for claim in self.claims if claim not in self.verdicts]

    def proved(self) -> list[Claim]:
        return [c for c, v in self.verdicts.items() if v.outcome is Outcome.HOLDS]


def verify(
    system: System,
    bounds: Bounds,
    choice: Choice = Choice.AUTO,
    *,
    names: Sequence[str] = (),
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> Report:
    """Verdicts on all claims about a system, or on the named ones.

    Claims that are not named still serve as lemmas. Ctrl-C ends it with what is known so far.
    """
    started = time.monotonic()
    deadline = Deadline.after(bounds.timeout_s)
    ask = partial(_ask, bounds=bounds, choice=choice, seed=seed, progress=progress)
    subject = _abstract_subject(system) or _plain_subject(system)
    asked = ask(subject, deadline)
    given = dict(zip(claims_of(system), asked.verdicts, strict=True))
    interrupted, vacuities = asked.interrupted, asked.vacuities
    if subject.system is not system and asked.spurious and not asked.interrupted:
        # Opaque values let something happen that real ones do not: look at those.
        again = ask(_plain_subject(system), deadline)
        interrupted = again.interrupted
        for claim, verdict in zip(given, again.verdicts, strict=True):
            if given[claim].outcome is Outcome.UNKNOWN:
                given[claim] = verdict
    verdicts = tuple(
        replace(verdict, claim=claim)
        for claim, verdict in given.items()
        if not names or claim.name in names
    )
    live = tuple(
        Verdict(_live(p.name), Outcome.UNKNOWN, Engine.NONE, 0.0, reason=_NO_LIVENESS)
        for p in liveness_of(system)
        if not names or p.name in names
    )
    seconds = time.monotonic() - started
    return Report(verdicts + live, vacuities, seconds, interrupted)


@dataclass(frozen=True, slots=True)
class _Subject:
    """What the engines work on, and who replays what they find."""

    system: System
    judge: Judge
    original: System  #: without opaque values


@dataclass(frozen=True, slots=True)
class _Asked:
    """The verdicts on a subject's claims, in order."""

    verdicts: tuple[Verdict, ...]
    vacuities: tuple[Vacuity, ...]
    interrupted: bool
    spurious: bool


def _plain_subject(system: System) -> _Subject:
    return _Subject(system, partial(_judged, system), system)


def _judged(system: System, recording: Recording, claim: Claim, phase: Phase) -> Counterexample:
    """The counterexample of a recording that breaks a claim, as simple as can be."""
    replayed(system, recording, claim, phase)
    return replayed(system, simplified(system, recording, claim), claim, phase)


def _abstract_subject(system: System) -> _Subject | None:
    """The system with values that merely flow made opaque, if there are any."""
    abstraction = abstracted(system.program)
    if abstraction is None:
        return None
    abstract = replace(system, program=abstraction.program)
    originals = dict(zip(claims_of(abstract), claims_of(system), strict=True))

    def judge(recording: Recording, claim: Claim, phase: Phase) -> Counterexample:
        real = Concretion(abstraction, system).recording(recording)
        return _judged(system, real, originals[claim], phase)

    return _Subject(abstract, judge, system)


def _ask(
    subject: _Subject,
    deadline: Deadline,
    *,
    bounds: Bounds,
    choice: Choice,
    seed: int,
    progress: Callable[[str], None],
) -> _Asked:
    claims = list(claims_of(subject.system))
    session = _Session(subject, bounds, seed, progress, deadline, claims)
    interrupted = False
    vacuities: tuple[Vacuity, ...] = ()
    try:
        _run(session, choice)
        vacuities = _vacuities(session)
    except NotFiniteError as error:
        session.reasons |= dict.fromkeys(session.open(), str(error))
    except KeyboardInterrupt:
        interrupted = True
        session.reasons |= dict.fromkeys(session.open(), "interrupted")
    for claim in session.open():
        session.verdicts[claim] = _open_verdict(session, claim, choice)
    spurious = session.bounded is not None and bool(session.bounded.unreplayed)
    verdicts = tuple(session.verdicts[claim] for claim in claims)
    return _Asked(verdicts, vacuities, interrupted, spurious)


_NO_LIVENESS = "liveness is not decided by the engines of this version"


def _live(name: str) -> Claim:
    return Claim(name, ClaimKind.PROPERTY)


def _run(session: _Session, choice: Choice) -> None:
    if choice in (Choice.AUTO, Choice.INDUCTION):
        _by_induction(session)
    if choice in (Choice.AUTO, Choice.SEARCH) and session.open():
        few = Limits(states=FEW_STATES) if choice is Choice.AUTO else Limits()
        _by_search(session, few)
    if choice in (Choice.AUTO, Choice.BMC) and session.open():
        _by_unrolling(session, session.bounds.rounds)


def _by_unrolling(session: _Session, rounds: int) -> None:
    """Bounded model checking through so many rounds."""
    if session.bounded is None:
        session.bounded = Bounded(session.system, session.subject.judge, session.seed)
    session.verdicts |= session.bounded.check(
        session.open(),
        session.proved(),
        rounds,
        session.deadline,
        lambda round_: session.progress(f"bmc, round {round_} of {session.bounds.rounds}"),
    )


def _by_induction(session: _Session) -> None:
    """Inductive proofs over one round, then two, …: for every number of rounds."""
    effort = Effort.of_seconds(PROOF_S)
    for depth in range(1, MAX_DEPTH + 1):
        # A step of ``depth`` rounds proves what holds in the first ``depth - 1`` rounds too.
        _by_unrolling(session, depth - 1)
        assert session.bounded is not None
        # What is not known to hold in those rounds is neither to be proved nor to be assumed.
        claims = [c for c in session.open() if c not in session.bounded.unreplayed]
        if not claims or session.bounded.reason:
            return
        session.progress(f"induction over {depth} round{'s' if depth > 1 else ''}")
        result = prove(
            session.system,
            claims,
            session.proved(),
            session.deadline,
            effort,
            depth=depth,
            seed=session.seed,
        )
        session.verdicts |= result.proved
        session.reasons |= result.reasons
        if not session.open() or session.deadline.passed() or effort.left <= 0:
            return


def _by_search(session: _Session, limits: Limits) -> None:
    """All configurations one by one, where they are few."""
    if session.system is not session.subject.original:
        reason = "search: positions or paths have infinitely many values"
        session.reasons |= {claim: reason for claim in session.open()}
        return
    found = exhaust(
        session.system,
        session.open(),
        limits,
        session.deadline,
        session.subject.judge,
        session.progress,
    )
    session.verdicts |= found.verdicts
    for claim in session.open():
        session.reasons[claim] = found.unreplayed.get(claim, found.reason)
        if found.depth is not None and claim not in found.unreplayed:
            session.searched[claim] = found.depth


def _open_verdict(session: _Session, claim: Claim, choice: Choice) -> Verdict:
    """What to say of a claim that nobody violated or proved."""
    bounded = session.bounded
    if bounded is None or choice in (Choice.INDUCTION, Choice.SEARCH):
        reason = session.reasons.get(claim, "not decided")
        depth = session.searched.get(claim)
        engine = Engine.NONE if depth is None else Engine.SEARCH
        enough = depth is not None and depth >= session.bounds.rounds
        outcome = Outcome.HOLDS if enough else Outcome.UNKNOWN
        return Verdict(claim, outcome, engine, 0.0, depth, reason="" if enough else reason)
    reached, reason = bounded.completed, bounded.reason
    if claim in bounded.unreplayed:
        reason, reached = bounded.unreplayed[claim]
    if not reason and reached is not None and reached >= session.bounds.rounds:
        if not bounded.limits:
            return Verdict(claim, Outcome.HOLDS, Engine.BMC, bounded.seconds, rounds=reached)
        reason = f"not covered: {'; '.join(bounded.limits)}"
    reason = reason or session.reasons.get(claim, "not decided")
    return Verdict(claim, Outcome.UNKNOWN, Engine.BMC, bounded.seconds, reached, reason=reason)


def _vacuities(session: _Session) -> tuple[Vacuity, ...]:
    """Assumptions that contradict each other, and events that can never run within the bound."""
    found: list[Vacuity] = []
    deadline, effort = session.deadline, Effort.of_seconds(IDLE_S)
    bounded = session.bounded or Bounded(session.system, session.subject.judge, session.seed)
    if not bounded.start_possible(deadline, effort):
        return (Vacuity("assumptions", "no initial configuration satisfies them all"),)
    session.progress("looking for events that never run")
    rounds = session.bounds.rounds
    seen: set[tuple[int, int]] = set()
    if session.system is session.subject.original:
        # Making up positions and paths that meet assumptions can cost more than it spares.
        seen = seen_to_run(session.system, rounds, deadline.sooner(RUNS_S), session.seed)
    idle = bounded.idle_events(seen, rounds, deadline, effort)
    if idle.stuck is not None:
        return (Vacuity("contracts", f"no run gets through round {idle.stuck + 1}"),)
    for kind, position in sorted(idle.events):
        name = session.system.program.agents[kind].events[position].name
        found.append(Vacuity("event", f"{name} cannot run within {rounds} rounds"))
    return tuple(found)
