"""Bodies of messages: one kind and one type each, checked by msgspec on decoding."""

from __future__ import annotations

from enum import IntEnum
from functools import cache
from typing import Any, assert_never

import msgspec

from koord.runtime.encoding import (
    FlatDecision,
    FlatProposal,
    NotPlainError,
    big_int,
    decision_of,
    encode,
    flat_decision,
    flat_proposal,
    proposal_of,
)
from koord.runtime.protocol.messages import (
    Acknowledge,
    Admission,
    Ask,
    Candidacy,
    Canvass,
    Committed,
    Decide,
    Hello,
    History,
    LastRun,
    LogEntry,
    Message,
    Open,
    Overruled,
    Position,
    Propose,
    Snapshot,
    Support,
    Vote,
)


class MessageKind(IntEnum):
    """The kinds of messages in frames. Numbers are never reused."""

    PROPOSE = 1
    DECIDE = 2
    ACKNOWLEDGE = 3
    COMMITTED = 4
    OPEN = 5
    ASK = 6
    HISTORY = 7
    SNAPSHOT = 8
    CANVASS = 9
    SUPPORT = 10
    CANDIDACY = 11
    VOTE = 12
    OVERRULED = 13
    HELLO = 14


FlatEntry = tuple[FlatDecision, bytes, tuple[tuple[int, int], ...], tuple[int, ...]]
FlatRan = tuple[int, int | None]

_TYPES: dict[MessageKind, Any] = {
    MessageKind.PROPOSE: FlatProposal,
    MessageKind.DECIDE: tuple[int, FlatEntry],
    MessageKind.ACKNOWLEDGE: tuple[int, int, bytes, bool],
    MessageKind.COMMITTED: tuple[int, int, bytes, float],
    MessageKind.OPEN: tuple[int, int, bytes],
    MessageKind.ASK: tuple[int],
    MessageKind.HISTORY: tuple[int, FlatEntry, bool],
    MessageKind.SNAPSHOT: tuple[
        int, int, bytes, tuple[int, ...], tuple[FlatRan | None, ...], bytes, bool
    ],
    MessageKind.CANVASS: tuple[int, int, int],
    MessageKind.SUPPORT: tuple[int],
    MessageKind.CANDIDACY: tuple[int, int, int],
    MessageKind.VOTE: tuple[int],
    MessageKind.OVERRULED: tuple[int],
    MessageKind.HELLO: tuple[bool],
}


@cache
def _decoder(kind: MessageKind) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(_TYPES[kind], ext_hook=big_int)


def kind_and_body(message: Message) -> tuple[MessageKind, bytes]:
    """Encode a message to its kind and body."""
    kind, flat = _flat(message)
    return kind, encode(flat)


def message_of(kind: int, body: bytes, robots: int) -> Message | None:
    """Decode a message from a whole body; None if it is malformed."""
    try:
        known = MessageKind(kind)
        message = _message(known, _decoder(known).decode(body))
    except (msgspec.MsgspecError, NotPlainError, ValueError, RecursionError):
        return None
    return message if _fits(message, robots) else None


def _flat(message: Message) -> tuple[MessageKind, tuple[Any, ...]]:
    match message:
        case Propose(proposal=proposal):
            return MessageKind.PROPOSE, flat_proposal(proposal)
        case Decide(epoch=epoch, entry=entry):
            return MessageKind.DECIDE, (epoch, _flat_entry(entry))
        case Acknowledge(epoch=epoch, round=round_, digest=digest, again=again):
            return MessageKind.ACKNOWLEDGE, (epoch, round_, digest, again)
        case Committed(epoch=epoch, round=round_, digest=digest, pause_s=pause_s):
            return MessageKind.COMMITTED, (epoch, round_, digest, float(pause_s))
        case Open(epoch=epoch, round=round_, chain=chain):
            return MessageKind.OPEN, (epoch, round_, chain)
        case Ask(round=round_):
            return MessageKind.ASK, (round_,)
        case History(epoch=epoch, entry=entry, last=last):
            return MessageKind.HISTORY, (epoch, _flat_entry(entry), last)
        case Snapshot():
            last_ran = tuple(r if r is None else (r.round, r.event) for r in message.last_ran)
            return MessageKind.SNAPSHOT, (
                message.epoch,
                message.round,
                message.chain,
                message.roster,
                last_ran,
                message.store,
                message.ended,
            )
        case Canvass(epoch=epoch, position=at):
            return MessageKind.CANVASS, (epoch, at.round, at.epoch)
        case Candidacy(epoch=epoch, position=at):
            return MessageKind.CANDIDACY, (epoch, at.round, at.epoch)
        case Support(epoch=epoch):
            return MessageKind.SUPPORT, (epoch,)
        case Vote(epoch=epoch):
            return MessageKind.VOTE, (epoch,)
        case Overruled(epoch=epoch):
            return MessageKind.OVERRULED, (epoch,)
        case Hello(empty=empty):
            return MessageKind.HELLO, (empty,)
        case _:
            assert_never(message)


def _message(kind: MessageKind, flat: Any) -> Message:
    match kind:
        case MessageKind.PROPOSE:
            return Propose(proposal_of(flat))
        case MessageKind.DECIDE:
            return Decide(flat[0], _entry(flat[1]))
        case MessageKind.ACKNOWLEDGE:
            return Acknowledge(*flat)
        case MessageKind.COMMITTED:
            return Committed(*flat)
        case MessageKind.OPEN:
            return Open(*flat)
        case MessageKind.ASK:
            return Ask(*flat)
        case MessageKind.HISTORY:
            return History(flat[0], _entry(flat[1]), flat[2])
        case MessageKind.SNAPSHOT:
            epoch, round_, chain, roster, last_ran, store, ended = flat
            ran = tuple(None if one is None else LastRun(*one) for one in last_ran)
            return Snapshot(epoch, round_, chain, roster, ran, store, ended)
        case MessageKind.CANVASS:
            return Canvass(flat[0], Position(flat[1], flat[2]))
        case MessageKind.CANDIDACY:
            return Candidacy(flat[0], Position(flat[1], flat[2]))
        case MessageKind.SUPPORT:
            return Support(*flat)
        case MessageKind.VOTE:
            return Vote(*flat)
        case MessageKind.OVERRULED:
            return Overruled(*flat)
        case MessageKind.HELLO:
            return Hello(*flat)
        case _:
            assert_never(kind)


def _flat_entry(entry: LogEntry) -> FlatEntry:
    admitted = tuple((a.robot, a.incarnation) for a in entry.admitted)
    return flat_decision(entry.decision), entry.previous, admitted, entry.late


def _entry(flat: FlatEntry) -> LogEntry:
    decision, previous, admitted, late = flat
    return LogEntry(decision_of(decision), previous, tuple(Admission(*a) for a in admitted), late)


def _fits(message: Message, robots: int) -> bool:
    """Return whether the robots that a message names exist."""
    match message:
        case Decide(entry=entry) | History(entry=entry):
            named = [taken.robot for taken in entry.decision.ran]
            named += [admission.robot for admission in entry.admitted]
            return all(0 <= robot < robots for robot in named)
        case Propose(proposal=proposal):
            return 0 <= proposal.robot < robots
        case Snapshot(roster=roster, last_ran=last_ran):
            return len(roster) == len(last_ran) == robots
        case Committed(pause_s=pause_s):
            return 0.0 <= pause_s < 1e6
        case _:
            return True
