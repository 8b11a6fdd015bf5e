"""The explicit search of the semantics as an engine: for all rounds, or a shortest run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from koord.semantics.configurations import System
from koord.semantics.findings import Claim as Searched
from koord.semantics.findings import Exhausted, OutOfBounds, Subject, Violated
from koord.semantics.finite import NotFinite
from koord.semantics.limits import Limits
from koord.semantics.search import survey
from koord.verify.bmc import Judge
from koord.verify.claims import Claim, ClaimKind, Phase
from koord.verify.solving import Deadline
from koord.verify.verdicts import Engine, Outcome, Verdict
from koord.verify.witness import NotReplayedError

_SUBJECTS = {
    ClaimKind.PROPERTY: Subject.PROPERTY,
    ClaimKind.FAULT: Subject.FAULT,
    ClaimKind.LOST_UPDATE: Subject.LOST_UPDATE,
    ClaimKind.CONTRACT: Subject.CONTRACT,
}

#: So many states are searched before another engine gets its turn; ``--engine search`` goes on.
FEW_STATES = 20_000


@dataclass(frozen=True, slots=True)
class Searching:
    """What the search said. ``states`` counts what it saw; ``reason`` is why it did not finish."""

    verdicts: dict[Claim, Verdict] = field(default_factory=dict)
    states: int = 0
    depth: int | None = None
    reason: str = ""


def exhaust(
    system: System,
    claims: Sequence[Claim],
    limits: Limits,
    deadline: Deadline,
    judge: Judge,
    progress: Callable[[str], None],
) -> Searching:
    """Verdicts on the claims from all reachable configurations, if they are few enough."""
    started = time.monotonic()
    properties = [claim.stated for claim in claims if claim.stated is not None]
    subjects = frozenset(_SUBJECTS[claim.kind] for claim in claims) - {Subject.PROPERTY}
    found = survey(
        system,
        properties,
        Limits(limits.states, limits.memory_mb, limits.rounds, deadline.at),
        subjects=subjects,
        progress=lambda states, rounds, _: progress(f"search, round {rounds}, {states} states"),
    )
    seconds = time.monotonic() - started
    violated = {each.claim: each for each in found.violated}
    verdicts: dict[Claim, Verdict] = {}
    for claim in claims:
        shown = violated.get(_searched(claim))
        if shown is not None:
            verdict = _violation(claim, shown, judge, seconds)
            if verdict is not None:
                verdicts[claim] = verdict
        elif isinstance(found.end, Exhausted):
            verdicts[claim] = Verdict(claim, Outcome.HOLDS, Engine.SEARCH, seconds)
    match found.end:
        case Exhausted(states=states, depth=depth):
            return Searching(verdicts, states, depth)
        case OutOfBounds(reason=reason, states=states, depth=depth):
            return Searching(verdicts, states, depth, f"search: {reason} through round {depth}")
        case NotFinite(reason=reason, span=span):
            return Searching(verdicts, reason=f"search: {reason} ({span})")


def _searched(claim: Claim) -> Searched:
    """A claim in the words of the search."""
    if claim.kind is ClaimKind.FAULT:
        return Searched(Subject.FAULT)
    return Searched(_SUBJECTS[claim.kind], claim.subject or claim.name)


def _violation(claim: Claim, shown: Violated, judge: Judge, seconds: float) -> Verdict | None:
    """The verdict on a claim that a run breaks, once it was replayed."""
    recording = shown.recording
    phase = Phase.INIT
    if recording.rounds:
        phase = Phase.INSIDE if recording.rounds[-1].cut else Phase.END
    try:
        counterexample = judge(recording, claim, phase)
    except NotReplayedError:
        return None
    return Verdict(claim, Outcome.VIOLATED, Engine.SEARCH, seconds, counterexample=counterexample)
