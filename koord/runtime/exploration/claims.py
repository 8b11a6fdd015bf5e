"""The protocol's invariants (specs/protocol/README.md), on committed and accepted entries.

They look at the entries and messages themselves and not at how the machine came by them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from msgspec import Struct

from koord.runtime.proposals import INIT_ROUND, Attempt, Proposal
from koord.runtime.protocol.messages import (
    Acknowledge,
    Candidacy,
    Decide,
    Held,
    LogEntry,
    Message,
    Propose,
    Vote,
)
from koord.runtime.protocol.setup import Setup
from koord.runtime.protocol.state import Coordinator, Durable, State

#: What a robot proposes for a round, whenever and in whichever incarnation it is asked.
ProposalOf = Callable[[int, int], Proposal]


class BrokenInvariant(Struct, frozen=True):
    """A violated invariant: its id, and a description."""

    claim: str
    story: str


class InvariantViolation(Struct, frozen=True):
    """A violated invariant, with the transitions that lead to it."""

    broken: BrokenInvariant
    story: tuple[str, ...]


def one_winner(entry: LogEntry, proposal_of: ProposalOf) -> Iterable[BrokenInvariant]:
    """Yield a violation if a lock class has two winners in a round. (I-ONE-WINNER)"""
    taken: set[int] = set()
    for robot, attempt in _let_through(entry, proposal_of):
        locks = set() if attempt is None else set(attempt.locks)
        if entry.round != INIT_ROUND and taken & locks:
            story = f"round {entry.round}: {robot} enters a taken class, {sorted(taken & locks)}"
            yield BrokenInvariant("I-ONE-WINNER", story)
        taken |= locks


def valid(entry: LogEntry, proposal_of: ProposalOf) -> Iterable[BrokenInvariant]:
    """Yield violations: robots that run what they did not propose, or skip wrongly. (I-VALID)"""
    taken: set[int] = set()
    for robot, attempt in _let_through(entry, proposal_of):
        if attempt is None or robot in entry.late:
            yield BrokenInvariant(
                "I-VALID", f"round {entry.round}: {robot} did not propose what it runs"
            )
        else:
            taken |= set(attempt.locks)
    for robot in entry.decision.skipped:
        attempts = proposal_of(robot, entry.round).attempts
        free = any(taken.isdisjoint(attempt.locks) for attempt in attempts)
        if free and robot not in entry.late and entry.decision.fault is None:
            yield BrokenInvariant("I-VALID", f"round {entry.round}: {robot} skips without a reason")


def _let_through(entry: LogEntry, proposal_of: ProposalOf) -> Iterable[tuple[int, Attempt | None]]:
    for one in entry.decision.ran:
        attempts = proposal_of(one.robot, entry.round).attempts
        found = next((a for a in attempts if (a.event, a.asked) == (one.event, one.asked)), None)
        yield one.robot, found


def agree(first: LogEntry, second: LogEntry) -> Iterable[BrokenInvariant]:
    """Yield a violation unless two entries committed for one round agree. (I-AGREE)"""
    if first != second:
        yield BrokenInvariant(
            "I-AGREE", f"round {first.round}: both {first} and {second} are committed"
        )


class Accepted(Struct, frozen=True):
    """An acknowledgement of an entry, with its epoch, robot and incarnation."""

    epoch: int
    robot: int
    incarnation: int


def acted_rightly(
    setup: Setup, held: Held, roster: Sequence[int], accepted: Iterable[Accepted]
) -> Iterable[BrokenInvariant]:
    """Yield a violation unless a majority of ``roster`` accepted the entry in one epoch. (I-ACT)"""
    admitted = {admission.robot for admission in held.entry.admitted}
    by_epoch: dict[int, set[int]] = {}
    for one in accepted:
        if roster[one.robot] == one.incarnation and one.robot not in admitted:
            # The coordinator holds what it sends.
            by_epoch.setdefault(one.epoch, {setup.coordinator(one.epoch)}).add(one.robot)
    most = max((len(robots) for robots in by_epoch.values()), default=1)
    if most < setup.majority:
        yield BrokenInvariant(
            "I-ACT", f"round {held.round} is committed, and {most} robots accepted it"
        )


def lasting(state: State, committed: Sequence[Held]) -> Iterable[BrokenInvariant]:
    """Yield committed entries that the coordinator of a later epoch lacks. (I-LASTING)

    ``committed`` have the epochs in which that was first known.
    """
    if not isinstance(state.office, Coordinator):
        return
    for held in committed:
        if state.promised <= held.epoch or state.round > held.round:
            continue
        mine = state.tentative
        if mine is None or mine.digest != held.digest:
            story = f"coordinator {state.pid} of epoch {state.promised} lacks round {held.round}"
            yield BrokenInvariant("I-LASTING", story)


def saved(
    message: Message, incarnation: int, state: State, disk: Durable
) -> Iterable[BrokenInvariant]:
    """Yield a violation if a message speaks of what is not on its sender's disk. (I-SAVED)

    What is committed is on the disks of others.
    """
    match message:
        case Vote(epoch=epoch) | Candidacy(epoch=epoch):
            kept = disk.promised >= epoch
        case Acknowledge(epoch=epoch, round=round_, digest=mark):
            held = disk.tentative is not None and disk.tentative.digest == mark
            kept = disk.promised >= epoch and (held or state.round > round_)
        case Decide(epoch=epoch, entry=entry):
            held = disk.tentative is not None and disk.tentative.entry == entry
            kept = disk.promised >= epoch and (held or state.round > entry.round)
        case Propose(proposal=proposal):
            kept = disk.mine == proposal or disk.round > proposal.round
        case _:
            kept = True
    if not kept or disk.incarnation != incarnation:
        yield BrokenInvariant("I-SAVED", f"{state.pid} says what its disk does not: {message}")
