"""The decision of a round: who is let through, in which order, and what becomes of the store."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from koord.runtime.proposals import (
    INIT_ROUND,
    Attempt,
    Decision,
    Faulted,
    Proposal,
    Taken,
    Write,
)


def decide(round_: int, proposals: Mapping[int, Proposal], order: Iterable[int]) -> Decision:
    """Let robots through, in an order, at most one per lock class. [EVENT-TRANS] [ATOMIC]

    ``order`` names every robot of the run once. A robot without a proposal skips: a late message
    is a SKIP. One that is not let through with any of its attempts skips as well, after all that
    are; so whatever class keeps it out was taken before its turn. A fault ends the round where it
    happens: neither those let through before it nor the robot itself are asked to undo anything,
    for a faulted run has no next round. A model of the environment that faulted did so before the
    round, so that nobody runs in it. [SKIP] [FAULT] [ENV-TRANS]
    """
    stumbled = _stumbled(round_, proposals)
    if stumbled is not None:
        return Decision(round_, (), (), (), fault=stumbled)
    taken: set[int] = set()
    ran: list[Taken] = []
    skipped: list[int] = []
    writes: list[Write] = []
    for robot in order:
        proposal = proposals.get(robot)
        attempt = _let_through(proposal, taken) if proposal is not None else None
        if attempt is None:
            skipped.append(robot)
            continue
        if attempt.fault is not None:
            faulted = Faulted(robot, attempt.event, attempt.fault)
            return Decision(round_, tuple(ran), tuple(skipped), tuple(writes), fault=faulted)
        taken.update(attempt.locks)
        ran.append(Taken(robot, attempt.event, attempt.asked))
        writes += attempt.writes
    return Decision(round_, tuple(ran), tuple(skipped), tuple(writes))


def _stumbled(round_: int, proposals: Mapping[int, Proposal]) -> Faulted | None:
    """The first robot whose model faulted at the end of the round before."""
    if round_ == INIT_ROUND:
        return None
    for robot in sorted(proposals):
        for attempt in proposals[robot].attempts:
            if attempt.event is None and attempt.fault is not None:
                return Faulted(robot, None, attempt.fault)
    return None


def _let_through(proposal: Proposal, taken: set[int]) -> Attempt | None:
    for attempt in proposal.attempts:
        if taken.isdisjoint(attempt.locks):
            return attempt
    return None


def rotating(round_: int, robots: int) -> tuple[int, ...]:
    """The order in which everybody is first once in so many rounds as there are robots."""
    first = round_ % robots if robots else 0
    return (*range(first, robots), *range(first))
