"""What becomes of a round, given the proposals that are there. (R-DECIDE)"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from koord.runtime.proposals import INIT_ROUND, Attempt, Decision, Faulted, Proposal, Taken, Write


def ranked(round_: int, robots: int) -> tuple[int, ...]:
    """The order of the robots in a round. It rotates, so that nobody always comes last."""
    first = max(round_, 0) % robots
    return (*range(first, robots), *range(first))


def decide(round_: int, proposals: Sequence[Proposal | None]) -> Decision:
    """The decision of a round: who runs, in which order, and what is written.

    ``proposals[i]`` is robot i's; a robot without one skips, as one that is late does [T-SKIP]. In
    their order, robots get the first of their attempts none of whose lock classes is taken.
    [EVENT-TRANS] [ATOMIC]
    """
    robots = len(proposals)
    order = ranked(round_, robots)
    faulted = _first_fault(order, proposals)
    if faulted is not None:
        others = tuple(i for i in range(robots) if i != faulted.robot)
        return Decision(round_, (), others, (), fault=faulted)
    taken: set[int] = set()
    ran: list[Taken] = []
    writes: list[Write] = []
    for robot in order:
        attempt = _let_through(proposals[robot], round_, taken)
        if attempt is None:
            continue
        if round_ != INIT_ROUND:  # an atomic block in INIT excludes nobody [INIT]
            taken.update(attempt.locks)
        ran.append(Taken(robot, attempt.event, attempt.asked))
        writes += attempt.writes
    through = {one.robot for one in ran}
    skipped = tuple(i for i in range(robots) if i not in through)
    return Decision(round_, tuple(ran), skipped, tuple(writes))


def _first_fault(order: Iterable[int], proposals: Sequence[Proposal | None]) -> Faulted | None:
    """A fault ends the run, whether or not the event would have got its locks. [FAULT]"""
    for robot in order:
        proposal = proposals[robot]
        for attempt in () if proposal is None else proposal.attempts:
            if attempt.fault is not None:
                return Faulted(robot, attempt.event, attempt.fault)
    return None


def _let_through(proposal: Proposal | None, round_: int, taken: set[int]) -> Attempt | None:
    """The first attempt of a proposal that can have its lock classes."""
    for attempt in () if proposal is None else proposal.attempts:
        if round_ == INIT_ROUND or taken.isdisjoint(attempt.locks):
            return attempt
    return None
