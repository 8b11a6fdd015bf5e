"""Verdicts from all reachable configurations: for all rounds, or for runs of few rounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from msgspec import Struct, field
from msgspec.structs import replace

from koord.semantics.recordings import Recording
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimKind, ClaimPhase
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.explicit.cost import COMPILED_FROM
from koord.verify.engines.explicit.finiteness import NotFinite
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, GoalKind, OutOfBounds, Violated
from koord.verify.engines.explicit.property_checks import SearchGoal as Searched
from koord.verify.engines.explicit.search import begun
from koord.verify.ledger import Judge
from koord.verify.obstacles import Beyond, Obstacle, Values
from koord.verify.verdicts import Counterexample, Outcome, Verdict
from koord.verify.witness import NotReplayedError

_SUBJECTS = {
    ClaimKind.PROPERTY: GoalKind.PROPERTY,
    ClaimKind.FAULT: GoalKind.FAULT,
    ClaimKind.LOST_UPDATE: GoalKind.LOST_UPDATE,
    ClaimKind.CONTRACT: GoalKind.CONTRACT,
}


class SearchResults(Struct):
    """The results of a search: verdicts, ``states`` counted, ``reason`` why it did not end.

    ``unreplayed`` are claims with a violation that did not replay, each with the reason.
    """

    verdicts: dict[Claim, Verdict] = field(default_factory=dict)
    unreplayed: dict[Claim, str] = field(default_factory=dict)
    states: int = 0
    depth: int | None = None
    reason: str = ""
    obstacle: Obstacle | None = None


def exhaust(
    system: System,
    claims: Sequence[Claim],
    limits: Limits,
    deadline: Deadline,
    judge: Judge,
    progress: Callable[[str], None],
    said: SearchResults | None = None,
    *,
    compiled_from: int | None = COMPILED_FROM,
) -> SearchResults:
    """Decide the claims on all reachable configurations, if they are few enough.

    They are written into ``said`` as they come: what was found counts, however the search ends.
    Behind ``compiled_from`` states machine code is used where there is any; None: it is not.
    """
    said = said if said is not None else SearchResults()
    started = time.monotonic()
    properties = [claim.stated for claim in claims if claim.stated is not None]
    subjects = frozenset(_SUBJECTS[claim.kind] for claim in claims) - {GoalKind.PROPERTY}
    search = begun(
        system,
        properties,
        Limits(limits.states, limits.memory_mb, limits.rounds, deadline.at),
        subjects=subjects,
        compiled_from=compiled_from,
        progress=lambda states, rounds, _: progress(f"search, round {rounds}, {states} states"),
    )
    if isinstance(search, NotFinite):
        said.reason = f"search: {search.reason} ({search.span})"
        said.obstacle = in_the_way(search)
        return said
    asked = {_searched(claim): claim for claim in claims}
    try:
        for shown in search.violations():
            claim = asked.get(shown.claim)
            if claim is None:
                continue
            try:
                said.verdicts[claim] = _violation(claim, shown, judge, time.monotonic() - started)
            except NotReplayedError as error:
                said.unreplayed[claim] = f"search: a candidate violation did not replay: {error}"
    finally:
        _conclude(said, search.end, claims, time.monotonic() - started)
    return said


def _conclude(
    said: SearchResults,
    end: Exhausted | OutOfBounds | NotFinite,
    claims: Sequence[Claim],
    seconds: float,
) -> None:
    """Set the verdicts of claims without violation when the search ends."""
    match end:
        case Exhausted(states=states, depth=depth):
            said.states, said.depth = states, depth
            for claim in claims:
                if claim not in said.verdicts and claim not in said.unreplayed:
                    said.verdicts[claim] = Verdict(claim, Outcome.HOLDS, Engine.SEARCH, seconds)
        case OutOfBounds(reason=reason, states=states, depth=depth):
            said.states, said.depth = states, depth
            where = "at the start" if depth is None else f"through round {depth}"
            said.reason = f"search: {reason} {where}"
        case NotFinite(reason=reason, span=span):
            said.reason = f"search: {reason} ({span})"
            said.obstacle = in_the_way(end)


def in_the_way(found: NotFinite) -> Obstacle:
    """The obstacle of a search: the values that it could not enumerate."""
    if found.name:
        return Values(Engine.SEARCH, (found.name,))
    return Beyond(Engine.SEARCH, found.reason)


def _searched(claim: Claim) -> Searched:
    """A claim as a goal of the search."""
    if claim.kind is ClaimKind.FAULT:
        return Searched(GoalKind.FAULT)
    return Searched(_SUBJECTS[claim.kind], claim.subject or claim.name)


def _violation(claim: Claim, shown: Violated, judge: Judge, seconds: float) -> Verdict:
    """The verdict on a claim that a run violates, after replay. Raises NotReplayedError."""
    recording = shown.recording
    phase = ClaimPhase.INIT
    if recording.rounds:
        phase = ClaimPhase.INSIDE if recording.rounds[-1].cut else ClaimPhase.END
    counterexample = None
    if phase is ClaimPhase.END and claim.looked_at(ClaimPhase.MIDDLE):
        counterexample = _without_the_environment(recording, claim, judge)
    if counterexample is None:
        counterexample = judge(recording, claim, phase)
    # It goes round by round.
    return Verdict(
        claim, Outcome.VIOLATED, Engine.SEARCH, seconds, counterexample=counterexample, fewest=True
    )


def _without_the_environment(
    recording: Recording, claim: Claim, judge: Judge
) -> Counterexample | None:
    """The run without the environment's last turn, if its program turns break the claim already.

    The search looks at the ends of rounds; whoever reads a run wants to know whose turn broke it.
    """
    last = replace(recording.rounds[-1], readings=(), cut=True)
    try:
        cut = replace(recording, rounds=(*recording.rounds[:-1], last))
        return judge(cut, claim, ClaimPhase.MIDDLE)
    except NotReplayedError:
        return None
