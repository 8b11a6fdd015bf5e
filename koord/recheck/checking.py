"""A certificate rechecked: every obligation made anew and put to the other solver."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum

from koord.recheck.certificate import Certificate, Given, Opened, opened
from koord.recheck.commands import NotACommandError, harmless
from koord.recheck.obligations import Obligation, Obligations
from koord.recheck.settling import Settled, Settling
from koord.recheck.solving import Answer, Session, TextError, answer_of
from koord.recheck.terms import Terms
from koord.recheck.values import NotRecheckedError, Values
from koord.syntax.source import NOWHERE, Span

#: What one question may take, in seconds.
QUESTION_S = 20.0

#: What a script that came with the certificate may take.
SECOND_OPINION_S = 10.0


class Outcome(Enum):
    """Whether a certificate holds what it promises."""

    CONFIRMED = "confirmed"  #: every obligation is met
    REFUTED = "refuted"  #: an obligation is not: the invariant does not prove itself
    UNKNOWN = "unknown"  #: an obligation was not settled, or a construct is not rechecked


@dataclass(frozen=True, slots=True)
class Opinion:
    """What the solver says of a script that came with the certificate; None: it cannot be read."""

    name: str
    answer: Answer | None


@dataclass(frozen=True, slots=True)
class Rechecked:
    """The verdict, with each obligation. ``span`` is the construct that is not rechecked."""

    outcome: Outcome
    settled: tuple[Settled, ...]
    opinions: tuple[Opinion, ...]
    seconds: float
    reason: str = ""
    span: Span = NOWHERE


@dataclass(slots=True)
class _Clock:
    """When to stop: a moment, or never."""

    at: float | None

    def left(self, most: float) -> float:
        return most if self.at is None else min(most, self.at - time.monotonic())


def recheck(
    certificate: Certificate,
    timeout_s: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> Rechecked:
    """Settle the obligations of a certificate. Raises KoordError if it is damaged.

    Raises MissingSolverError without cvc5.
    """
    started = time.monotonic()
    clock = _Clock(None if timeout_s is None else started + timeout_s)
    session = Session.start(seed)
    settled: list[Settled] = []
    reason, span = "", NOWHERE
    try:
        it = opened(certificate)
        for one in _Pass(it, session, clock, progress).settled():
            settled.append(one)
            if one.answer is Answer.SAT:
                break
    except NotRecheckedError as error:
        reason, span = error.reason, error.span
    opinions = tuple(
        _opinion(given, clock, progress) for given in certificate.given if clock.left(1.0) > 0
    )
    outcome, why = _outcome(settled, opinions, reason)
    seconds = time.monotonic() - started
    return Rechecked(outcome, tuple(settled), opinions, seconds, why, span)


def _outcome(
    settled: Sequence[Settled], opinions: Sequence[Opinion], reason: str
) -> tuple[Outcome, str]:
    for one in settled:
        if one.answer is Answer.SAT:
            return Outcome.REFUTED, f"{one.name}: {one.claim} does not follow"
    for opinion in opinions:
        if opinion.answer is Answer.SAT:
            return (
                Outcome.REFUTED,
                f"the script {opinion.name!r} in the certificate can be satisfied",
            )
    if reason:
        return Outcome.UNKNOWN, reason
    for one in settled:
        if one.answer is Answer.UNKNOWN:
            return Outcome.UNKNOWN, f"{one.name}: {one.claim or 'not settled'} (no answer in time)"
    return Outcome.CONFIRMED, ""


@dataclass(slots=True)
class _Pass:
    """One way through the obligations, and back to those that were too much at first."""

    it: Opened
    session: Session
    clock: _Clock
    progress: Callable[[str], None]
    _derived: list[str] = field(default_factory=list)

    def settled(self) -> Iterator[Settled]:
        world = self.it.world
        values = Values(Terms(), world.robots, world.sealed)
        obligations = Obligations(world, self.it.claims, values, self.it.consequences)
        settling = Settling(
            values, self.session, lambda: self.clock.left(QUESTION_S), self.progress
        )
        for obligation in obligations:
            one = settling.settled(obligation)
            if one.answer is Answer.UNKNOWN and self._derives(obligations, settling, one.claim):
                exact = obligation.attempts[-1]()
                one = settling.exactly(obligation.name, exact, self._derived)
            yield one

    def _derives(self, obligations: Obligations, settling: Settling, name: str) -> bool:
        """Whether the claim that is open follows from the others, so that they alone count."""
        claims = self.it.claims
        claim = next((c for c in claims if c.name == name and c.stated is not None), None)
        if claim is None or name in self._derived:
            return name in self._derived
        others = [
            c
            for c in claims
            if c is not claim and c.name not in self._derived and c.depth <= claim.depth
        ]
        derivation: Obligation = obligations.derivation(claim, others)
        attempt = derivation.attempts[-1]()
        if settling.exactly(derivation.name, attempt).answer is Answer.UNSAT:
            self._derived.append(name)
            return True
        return False


def _opinion(given: Given, clock: _Clock, progress: Callable[[str], None]) -> Opinion:
    progress(f"enclosed: {given.name}")
    try:
        answer = answer_of(harmless(given.smt2), clock.left(SECOND_OPINION_S))
    except (TextError, NotACommandError):
        return Opinion(given.name, None)
    return Opinion(given.name, answer)
