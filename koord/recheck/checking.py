"""The recheck of a certificate: every obligation is made anew and given to the other solver."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum

from msgspec import Struct, field
from msgspec.structs import replace

from koord.recheck import instances
from koord.recheck.certificate import REWRITE, Certificate
from koord.recheck.claims import NO_START, ClaimKind, Obligation
from koord.recheck.every_number import EveryNumber
from koord.recheck.meaning import (
    CertifiedArguments,
    CertifiedProblem,
    InductiveArgument,
    Statement,
    meant,
    opened,
)
from koord.recheck.obligations import Discharged, Obligations, Settling
from koord.recheck.progress import ProgressObligations
from koord.recheck.progress_meaning import ProgressArguments, progress_arguments
from koord.recheck.script import NotACommandError, SanitisedScript, harmless
from koord.recheck.solving import (
    SolverAnswer,
    SolverEndedError,
    SolverSession,
    TextError,
    answer_of,
    read,
)
from koord.recheck.sorts import NotRecheckedError
from koord.recheck.terms import Terms
from koord.recheck.values import Values
from koord.recheck.world import Instance
from koord.syntax.diagnostics import Diagnostic, KoordError, refusal
from koord.syntax.source import NOWHERE, Span

#: What one question may take, in seconds.
QUESTION_S = 20.0

#: What a script that came with the certificate may take.
SECOND_OPINION_S = 10.0


class RecheckOutcome(Enum):
    """The outcome of a recheck."""

    CONFIRMED = "confirmed"  #: every obligation is met
    REFUTED = "refuted"  #: an obligation is not: the invariant does not prove itself
    UNKNOWN = "unknown"  #: an obligation was not settled, or a construct is not rechecked


class ScriptAnswer(Struct, frozen=True):
    """The solver's answer on a script that came with the certificate, with a reason."""

    name: str
    answer: SolverAnswer
    reason: str = ""


class CheckedPart(Struct, frozen=True):
    """The result of the obligations about some robots, or about any number of them.

    ``span`` is the construct that is not rechecked.
    """

    outcome: RecheckOutcome
    settled: tuple[Discharged, ...]
    reason: str = ""
    span: Span = NOWHERE

    @property
    def hollow(self) -> tuple[str, ...]:
        """The reasons why less is shown than it seems: unsatisfiable hypotheses."""
        return tuple(dict.fromkeys(one.hollow for one in self.settled if one.hollow))[:1]


class Rechecked(Struct, frozen=True):
    """The verdict of a recheck, its subject, and its premises.

    ``everyone`` is about every number of robots, where that is claimed; ``here`` about those of the
    certificate, where that is not all that is claimed, or not shown. ``runs`` is about whole runs
    of every number of robots, given what ``everyone`` is about.
    """

    about: CertifiedProblem
    outcome: RecheckOutcome
    everyone: CheckedPart | None
    runs: CheckedPart | None
    here: CheckedPart | None
    opinions: tuple[ScriptAnswer, ...]
    seconds: float
    reason: str = ""
    span: Span = NOWHERE

    @property
    def settled(self) -> tuple[Discharged, ...]:
        return tuple(one for part in self.parts for one in part.settled)

    @property
    def parts(self) -> tuple[CheckedPart, ...]:
        """The parts that there are."""
        parts = (self.everyone, self.runs, self.here)
        return tuple(part for part in parts if part is not None)

    @property
    def hollow(self) -> tuple[str, ...]:
        """The reasons why less is shown than it seems."""
        return tuple(dict.fromkeys(why for part in self.parts for why in part.hollow))

    def shown(self) -> tuple[tuple[Statement, ...], tuple[Statement, ...]]:
        """The confirmed statements, for every number of robots and for the certificate's."""
        everyone: tuple[Statement, ...] = ()
        here: tuple[Statement, ...] = ()
        if self.outcome is not RecheckOutcome.REFUTED:
            of_runs = [s for s in self.about.statements if s.claimed.kind is ClaimKind.LIVENESS]
            of_rounds = [s for s in self.about.statements if s not in of_runs]
            if _is_confirmed(self.everyone):
                everyone = tuple(s for s in of_rounds if s.claimed.everyone)
                # What whole runs are like rests on what holds in every round.
                everyone += tuple(of_runs) if _is_confirmed(self.runs) else ()
            if _is_confirmed(self.here):
                here = tuple(s for s in of_rounds if s not in everyone)
        return everyone, here


def _is_confirmed(part: CheckedPart | None) -> bool:
    return part is not None and part.outcome is RecheckOutcome.CONFIRMED


class _Work(Struct, frozen=True):
    """The seed, deadline and listeners with which obligations are settled."""

    seed: int
    ends_at: float  #: as :func:`time.monotonic` counts
    progress: Callable[[str], None]
    waiting: Callable[[], None]

    def session(self) -> SolverSession:
        return SolverSession.start(self.seed, waiting=self.waiting)

    def left(self, most: float = QUESTION_S) -> float:
        return min(most, self.ends_at - time.monotonic())


def recheck(
    certificate: Certificate,
    timeout_s: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
    waiting: Callable[[], None] = lambda: None,
) -> Rechecked:
    """Settle the obligations of a certificate. Raises KoordError if it is damaged.

    ``waiting`` is called ten times in a second while the solver works; what it raises ends that.
    Raises MissingSolverError without cvc5.
    """
    started = time.monotonic()
    ends_at = math.inf if timeout_s is None else started + timeout_s
    work = _Work(seed, ends_at, progress, waiting)
    everyone: CheckedPart | None = None
    runs: CheckedPart | None = None
    here: CheckedPart | None = None
    about = meant(certificate)
    try:
        it = opened(certificate, about)
        proofs = progress_arguments(certificate, about)
    except NotRecheckedError as error:
        here = CheckedPart(RecheckOutcome.UNKNOWN, (), error.reason, error.span)
        scripts = _read(certificate, work)
    else:
        scripts = _read(certificate, work)
        everyone, here = _argued(certificate, it, work)
        runs = None if proofs is None else _part(_of_runs(proofs, work))
    opinions = tuple(_opinion(name, script, work) for name, script in scripts)
    return _joined(about, (everyone, runs, here), opinions, time.monotonic() - started)


def _argued(
    certificate: Certificate, it: CertifiedArguments, work: _Work
) -> tuple[CheckedPart | None, CheckedPart | None]:
    """Settle the claims for every number of robots, and those for the certificate's."""
    everyone = here = None
    if it.everyone is not None:
        everyone = _part(_for_everyone(it.everyone, work))
    if not _is_confirmed(everyone) or not all(one.everyone for one in certificate.claims):
        with work.session() as session:
            here = _part(_Pass(it.here, session, work).settled())
    return everyone, here


def _part(settling: Iterator[Discharged]) -> CheckedPart:
    """Settle obligations one after the other."""
    settled: list[Discharged] = []
    try:
        for one in settling:
            settled.append(one)
            if one.answer is SolverAnswer.SAT:
                reason = f"{one.name}: {one.claim} does not follow"
                return CheckedPart(RecheckOutcome.REFUTED, tuple(settled), reason)
    except NotRecheckedError as error:
        return CheckedPart(RecheckOutcome.UNKNOWN, tuple(settled), error.reason, error.span)
    except SolverEndedError as error:
        return CheckedPart(RecheckOutcome.UNKNOWN, tuple(settled), str(error))
    for one in settled:
        if one.answer is SolverAnswer.UNKNOWN:
            reason = f"{one.name}: {one.claim or 'not settled'} (no answer in time)"
            return CheckedPart(RecheckOutcome.UNKNOWN, tuple(settled), reason)
    return CheckedPart(RecheckOutcome.CONFIRMED, tuple(settled))


def _for_everyone(it: InductiveArgument, work: _Work) -> Iterator[Discharged]:
    """Settle the obligations for every number of robots."""
    values = Values(Terms(), None, it.world.sealed)
    looked = False
    with work.session() as session:
        settling = Settling(values, session, work.left, work.progress)
        for obligation in EveryNumber(it.world, it.claims, values, it.consequences):
            work.progress(f"any number of robots: {obligation.name}")
            with _named(obligation):
                one = settling.weighed(instances.settled(settling, obligation), obligation)
            if one.answer is not SolverAnswer.UNSAT and not looked:
                looked = True
                yield from _refuted_by_few(it, work)
            yield one


def _of_runs(proofs: ProgressArguments, work: _Work) -> Iterator[Discharged]:
    """Settle the obligations about whole runs, of any number of robots. [T-PROGRESS]"""
    for proof in proofs.proofs:
        values = Values(Terms(), None, proofs.world.sealed)
        everyone = EveryNumber(proofs.world, proofs.claims, values)
        with work.session() as session:
            settling = Settling(values, session, work.left, work.progress)
            for obligation in ProgressObligations(everyone, proof):
                work.progress(f"whole runs: {obligation.name}")
                with _named(obligation):
                    yield instances.settled(settling, obligation)


@contextmanager
def _named(obligation: Obligation) -> Iterator[None]:
    """Within the context, a solver that crashes does so in the name of an obligation."""
    try:
        yield
    except SolverEndedError as error:
        raise SolverEndedError(f"{obligation.name}: {error}") from error


#: With so few robots a claim about every number of them is looked at that is not shown at once.
_FEW = (1, 2, 3)


def _refuted_by_few(it: InductiveArgument, work: _Work) -> Iterator[Discharged]:
    """Settle the claims for a few robots: failure there refutes them for every number."""
    if len(it.world.program.agents) > 1:
        return
    for robots in _FEW:
        world = Instance(it.world.program, (0,) * robots, it.world.delta_s)
        few = InductiveArgument(world, it.claims, it.consequences)
        with work.session() as session:
            found = _part(_Pass(few, session, work).settled())
        if found.outcome is RecheckOutcome.REFUTED:
            last = found.settled[-1]
            yield replace(
                last, name=f"with {robots} robot{'' if robots == 1 else 's'}, {last.name}"
            )


def _joined(
    about: CertifiedProblem,
    each: tuple[CheckedPart | None, CheckedPart | None, CheckedPart | None],
    opinions: tuple[ScriptAnswer, ...],
    seconds: float,
) -> Rechecked:
    def found(outcome: RecheckOutcome, reason: str = "", span: Span = NOWHERE) -> Rechecked:
        return Rechecked(about, outcome, *each, opinions, seconds, reason, span)

    parts = [part for part in each if part is not None]
    for part in parts:
        if part.outcome is RecheckOutcome.REFUTED:
            return found(RecheckOutcome.REFUTED, part.reason)
    for opinion in opinions:
        if opinion.answer is SolverAnswer.SAT:
            reason = f"the script {opinion.name!r} in the certificate can be satisfied"
            return found(RecheckOutcome.REFUTED, reason)
    for part in parts:
        if part.outcome is RecheckOutcome.UNKNOWN:
            return found(RecheckOutcome.UNKNOWN, part.reason, part.span)
    for opinion in opinions:
        if opinion.answer is SolverAnswer.UNKNOWN:
            reason = f"the script {opinion.name!r} in the certificate: {opinion.reason}"
            return found(RecheckOutcome.UNKNOWN, reason)
    return found(RecheckOutcome.CONFIRMED)


class _Pass(Struct):
    """A pass through the obligations, with a second attempt at those too hard at first."""

    it: InductiveArgument
    session: SolverSession
    work: _Work
    _derived: list[str] = field(default_factory=list)

    def settled(self) -> Iterator[Discharged]:
        world = self.it.world
        values = Values(Terms(), world.robots, world.sealed)
        obligations = Obligations(world, self.it.claims, values, self.it.consequences)
        settling = Settling(values, self.session, self.work.left, self.work.progress)
        for obligation in obligations:
            with _named(obligation):
                one = settling.settled(obligation)
                if one.answer is SolverAnswer.UNKNOWN and self._derives(
                    obligations, settling, one.claim
                ):
                    exact = obligation.attempts[-1]()
                    one = settling.exactly(obligation.name, exact, self._derived)
                one = settling.weighed(one, obligation)
            obligations.nothing_begins = obligations.nothing_begins or one.hollow == NO_START
            yield one

    def _derives(self, obligations: Obligations, settling: Settling, name: str) -> bool:
        """Return whether an open claim follows from the others, so that only they count."""
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
        if settling.exactly(derivation.name, attempt).answer is SolverAnswer.UNSAT:
            self._derived.append(name)
            return True
        return False


def _read(certificate: Certificate, work: _Work) -> list[tuple[str, SanitisedScript]]:
    """Read the scripts of a certificate. Raises KoordError (K941) with each that is none."""
    scripts: list[tuple[str, SanitisedScript]] = []
    problems: list[Diagnostic] = []
    for given in certificate.given:
        work.progress(f"reading: {given.name}")
        try:
            script = harmless(given.smt2)
            read(script, work.waiting)
        except SolverEndedError:
            pass  # which is told when it is asked
        except (TextError, NotACommandError) as error:
            message = f"the script {given.name!r} cannot be read: {error}"
            problems += refusal("K941", certificate.name, message, REWRITE).diagnostics
            continue
        scripts.append((given.name, script))
    if problems:
        raise KoordError(tuple(problems))
    return scripts


def _opinion(name: str, script: SanitisedScript, work: _Work) -> ScriptAnswer:
    work.progress(f"enclosed: {name}")
    left = work.left(SECOND_OPINION_S)
    if left <= 0:
        return ScriptAnswer(name, SolverAnswer.UNKNOWN, "there was no time left to ask")
    try:
        answer = answer_of(script, left, work.waiting)
    except SolverEndedError as error:
        return ScriptAnswer(name, SolverAnswer.UNKNOWN, str(error))
    return ScriptAnswer(name, answer, "no answer in time" if answer is SolverAnswer.UNKNOWN else "")
