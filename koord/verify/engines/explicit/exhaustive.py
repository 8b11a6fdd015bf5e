"""Verdicts from all reachable configurations: for all rounds, or for runs of few rounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence

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
from koord.verify.engines.explicit.search import Progress, Search, begun
from koord.verify.ledger import Judge
from koord.verify.obstacles import Beyond, Obstacle, Values
from koord.verify.verdicts import Counterexample, NotReplayedError, Outcome, Verdict

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

    def of(self, claims: Sequence[Claim]) -> SearchResults:
        """The results on some claims."""
        verdicts = {c: v for c, v in self.verdicts.items() if c in claims}
        unreplayed = {c: reason for c, reason in self.unreplayed.items() if c in claims}
        return replace(self, verdicts=verdicts, unreplayed=unreplayed)


class ClaimSearch(Struct):
    """A search of some claims. Asked again it goes on where a limit ended it.

    What was said of a claim by then stands, so that what did not replay is not taken to hold.
    """

    system: System
    claims: tuple[Claim, ...]
    search: Search | NotFinite | None = None  #: None: it was not begun
    said: SearchResults = field(default_factory=SearchResults)
    is_at_work: bool = False  #: whether it was left while it was looking at something

    def has(self, system: System, claims: Sequence[Claim]) -> bool:
        """Return whether these claims are among those that it searches, and it can go on."""
        if self.is_at_work or (isinstance(self.search, Search) and self.search.is_compiled):
            return False
        return system == self.system and set(claims) <= set(self.claims)

    @property
    def is_exhausted(self) -> bool:
        """Return whether it has looked at all configurations, so that it only has to say so."""
        search = self.search
        return isinstance(search, Search) and isinstance(search.end, Exhausted)

    def keep(self, claims: Collection[Claim]) -> None:
        """Search for these alone: somebody else knows of the others."""
        left_out = [claim for claim in self.claims if claim not in claims]
        self.claims = tuple(claim for claim in self.claims if claim in claims)
        if isinstance(self.search, Search):
            self.search.leave_out(map(_searched, left_out))

    def work(
        self,
        system: System,
        limits: Limits,
        deadline: Deadline,
        judge: Judge,
        progress: Callable[[str], None],
        *,
        compiled_from: int | None = COMPILED_FROM,
    ) -> SearchResults:
        """Search within limits, and within the budget of a system, which is else the same.

        Where Python has cost more than ``compiled_from`` machine code is used, if there is any;
        None: it is not.
        """
        started, said = time.monotonic(), self.said
        limits = Limits(limits.states, limits.memory_mb, limits.rounds, deadline.at)

        def tell(states: int, rounds: int, _: int) -> None:
            progress(f"search, round {rounds}, {states} states")

        if isinstance(self.search, Search):
            self.search.resume(system.budget, limits, tell, compiled_from)
        else:
            self.search = self._begun(system, limits, tell, compiled_from)
        search = self.search
        if isinstance(search, NotFinite):
            said.reason = f"search: {search.reason} ({search.span})"
            said.obstacle = in_the_way(search)
            return said
        asked = {_searched(claim): claim for claim in self.claims}
        said.reason, self.is_at_work = "", True
        try:
            for shown in search.violations():
                claim = asked.get(shown.claim)
                if claim is None:
                    continue
                seconds = time.monotonic() - started
                try:
                    said.verdicts[claim] = _violation(claim, shown, judge, seconds)
                except NotReplayedError as error:
                    reason = f"search: a candidate violation did not replay: {error}"
                    said.unreplayed[claim] = reason
        finally:
            _conclude(said, search.end, self.claims, time.monotonic() - started)
        self.is_at_work = False
        return said

    def _begun(
        self, system: System, limits: Limits, tell: Progress, compiled_from: int | None
    ) -> Search | NotFinite:
        properties = [claim.stated for claim in self.claims if claim.stated is not None]
        subjects = frozenset(_SUBJECTS[claim.kind] for claim in self.claims)
        return begun(
            system,
            properties,
            limits,
            subjects=subjects - {GoalKind.PROPERTY},
            compiled_from=compiled_from,
            progress=tell,
        )


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
    """
    search = ClaimSearch(system, tuple(claims), said=SearchResults() if said is None else said)
    return search.work(system, limits, deadline, judge, progress, compiled_from=compiled_from)


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
