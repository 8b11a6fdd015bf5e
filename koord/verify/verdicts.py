"""Verdicts: three-valued, with what was shown, for which system, how far, and by which engine."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from koord.semantics.configurations import Configuration, Fault
from koord.semantics.domain import Constant
from koord.semantics.recordings import Recording
from koord.syntax import core
from koord.syntax.source import Span
from koord.syntax.system import System, resized
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.engine_names import Engine
from koord.verify.obstacles import Failure, Obstacle


class Outcome(Enum):
    """The outcome of a claim, three-valued."""

    HOLDS = "holds"
    VIOLATED = "violated"
    UNKNOWN = "unknown"


class Bounds(Struct, frozen=True):
    """The bounds of a verification: rounds, and seconds for everything (None: no limit).

    ``violations`` is how many different counterexamples to look for where a claim is violated.
    ``claim_s`` is for each claim (:mod:`koord.verify.strategy.time_limits`).
    """

    rounds: int = 20
    timeout_s: float | None = None
    violations: int = 1
    claim_s: float | None = None


class Counterexample(Struct, frozen=True):
    """A counterexample: a run that breaks a claim, replayed on the exact domain, or a lasso.

    ``round`` counts from 1; 0 means INIT; of a lasso it is the last round of its loop. ``robot`` is
    whose turn broke it, None for INIT and the environment; of a lasso the one that is meant.
    ``span`` is the place in the text that is broken, or where the fault is.
    """

    recording: Recording
    round: int
    phase: ClaimPhase
    detail: str
    robot: int | None = None
    span: Span | None = None
    fault: Fault | None = None  #: of the evaluation of a property, which is false for that


class BrokenStep(Struct, frozen=True):
    """A counterexample to induction: a step that breaks a claim.

    It goes from a configuration in which all claims hold to one that breaks a claim. It is no run,
    since nobody knows whether it can be reached. Between two of its configurations is one round,
    the last up to ``phase``; ``events[k][i]`` is the position of the event that robot i runs in
    round k, or ``NO_EVENT``.
    """

    configurations: tuple[Configuration[Constant], ...]
    events: tuple[tuple[int, ...], ...]
    phase: ClaimPhase


class EnumerationResult(Struct, frozen=True):
    """The result of the search for different counterexamples.

    ``complete``: there are no more within the bound. If neither that nor a ``reason`` is said,
    there were as many as were asked for.
    """

    complete: bool
    reason: str = ""


class Verdict(Struct, frozen=True):
    """A verdict: the answer to one claim.

    ``rounds`` is how far a *holds* reaches (None: all rounds), or, if *unknown*, the last round
    through which the claim was seen to hold (None: not even INIT). ``reason`` says why an answer is
    *unknown*. ``fewest``: if *violated*, no run with fewer rounds than its counterexample breaks
    the claim; else nobody looked at all of those. A claim about every number of robots is violated
    by the run of some number of them, which is ``robots``.
    """

    claim: Claim
    outcome: Outcome
    engine: Engine
    seconds: float
    rounds: int | None = None
    counterexample: Counterexample | None = None
    fewest: bool = False
    robots: int | None = None
    reason: str = ""
    depth: int = 1  #: of an inductive proof
    others: tuple[Counterexample, ...] = ()  #: different ones, if more were asked for
    ways: EnumerationResult | None = None  #: whether there are still more, if more were asked for
    step: BrokenStep | None = None  #: why a claim that is *unknown* is not inductive
    lemmas: tuple[core.Property, ...] = ()  #: invariants that were found for the proof, unnamed
    unsaid: str = ""  #: why the invariant of a proof is not among the lemmas
    fairness: tuple[str, ...] = ()  #: kinds of it, and expectations, that a proof needs
    obstacles: tuple[Obstacle, ...] = ()  #: what stands in the way, if it is *unknown*
    kept: bool = False  #: whether it was known before, of a program that differs in nothing of it

    def broken_system(self, system: System) -> System:
        """The system of which the counterexample is a run, where ``system`` was asked about."""
        return system if self.robots is None else resized(system, self.robots)


def has_fewest(found: Counterexample, through: int | None) -> bool:
    """Return whether no earlier round breaks a claim that holds through so many (None: none)."""
    return found.recording.loop is None and found.round <= (0 if through is None else through + 1)


class Emptiness(Enum):
    """The causes of vacuity."""

    ASSUMPTIONS = "assumptions"  #: no initial configuration satisfies them all
    SUMMARIES = "summaries"  #: no external functions satisfy them all
    CONTRACTS = "contracts"  #: no run gets through some round
    EVENT = "event"  #: it cannot run
    SUPPOSITION = "supposition"  #: what an invariant supposes is never true
    UNTOUCHED = "untouched"  #: nothing that an invariant reads ever changes, or nothing breaks it

    def of(self, subject: str) -> str:
        """Name what may be empty, in words."""
        if self is Emptiness.SUPPOSITION:
            return f"what {subject} supposes"
        return f"{self.value} {subject}".rstrip()


class Vacuity(Struct, frozen=True):
    """A vacuity: a reason why verdicts say less than they seem to.

    ``subject`` is the event or the invariant, if it is about one. A vacuity that is not
    ``certain`` was seen only of the runs that were looked at: within the bound, which may be
    short, and without the longest lists.
    """

    what: Emptiness
    subject: str
    detail: str
    certain: bool
    span: Span | None = None

    @property
    def told(self) -> str:
        """What it is about, and why verdicts say less."""
        return f"{self.subject}: {self.detail}" if self.subject else self.detail


class UnsearchedGoal(Struct, frozen=True):
    """An event or supposition whose reachability is unknown, as the search was given up."""

    what: Emptiness
    subject: str


class ReachingRun(Struct, frozen=True):
    """A run that reached what should be possible (:mod:`koord.verify.vacuity.reaching_runs`).

    ``layout`` is a digest of the systems of which its values may be.
    """

    layout: str
    recording: Recording


class Substance(Struct, frozen=True):
    """What verdicts are known to be about: nobody need look for vacuities there.

    ``happens``: runs start and go on, and whatever does not belong to a claim happens. ``claims``
    are the names of those whose verdicts say something. That is so where ``every_n`` says rightly
    whether all verdicts are for every number of robots, and ``all_rounds`` for all rounds.
    """

    happens: bool = False
    claims: frozenset[str] = frozenset()
    every_n: bool = False
    all_rounds: bool = False

    def where(self, *, every_n: bool, all_rounds: bool | None = None) -> Substance:
        """The same if verdicts are as they were thought to be; else nothing."""
        fits = self.every_n is every_n and all_rounds in (None, self.all_rounds)
        return self if fits else Substance()


#: Of nothing it is known that it says something.
NOTHING_KNOWN = Substance()


class Report(Struct, frozen=True):
    """A report: all verdicts on one system; on systems of every size if ``every_n``.

    ``of_slice``: for those on states no engine was asked about more than the slice that all claims
    about states depend on. ``reaching`` are runs that reach what should be possible, as far as
    somebody looked for them.
    """

    verdicts: tuple[Verdict, ...]
    vacuities: tuple[Vacuity, ...]
    seconds: float
    interrupted: bool = False
    failures: tuple[Failure, ...] = ()
    every_n: bool = False
    unlooked: tuple[UnsearchedGoal, ...] = ()
    of_slice: bool = False
    reaching: tuple[ReachingRun, ...] = ()
    substance: Substance | None = None  #: as far as it was looked for vacuities to the end

    @property
    def lemmas(self) -> tuple[core.Property, ...]:
        """The invariants that were found for proofs, in order."""
        return tuple(dict.fromkeys(lemma for verdict in self.verdicts for lemma in verdict.lemmas))

    @property
    def is_vacuous(self) -> bool:
        """True if some vacuity is certain."""
        return any(vacuity.certain for vacuity in self.vacuities)

    @property
    def outcome(self) -> Outcome:
        """The overall outcome: violated if one claim is; else unknown if one is; else holds."""
        outcomes = {verdict.outcome for verdict in self.verdicts}
        for worst in (Outcome.VIOLATED, Outcome.UNKNOWN):
            if worst in outcomes:
                return worst
        return Outcome.HOLDS


def no_fair_run(system: System) -> Vacuity:
    """The vacuity that no run is fair, so that liveness holds for no reason."""
    detail = "no run without end does all that is expected"
    if not system.program.expectations:
        detail = "no fair run goes on for ever: each ends in a fault, or where contracts contradict"
    return Vacuity(Emptiness.ASSUMPTIONS, "", detail, certain=True)


class NotReplayedError(Exception):
    """Raised where a candidate is no run of the program, or does not break the claim."""


class OnlyOfSliceError(NotReplayedError):
    """Raised where a lasso of a slice is none of the whole program."""
