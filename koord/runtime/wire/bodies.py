"""Bodies of messages: one kind and one type each, checked by msgspec on decoding."""

from __future__ import annotations

from enum import IntEnum
from functools import cache
from typing import Any

import msgspec

from koord.runtime.encoding import decoder, encode
from koord.runtime.protocol.messages import (
    Acknowledge,
    Ask,
    Candidacy,
    Canvass,
    Committed,
    Decide,
    Hello,
    History,
    Message,
    Open,
    Overruled,
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


_KINDS: dict[type[Message], MessageKind] = {
    Propose: MessageKind.PROPOSE,
    Decide: MessageKind.DECIDE,
    Acknowledge: MessageKind.ACKNOWLEDGE,
    Committed: MessageKind.COMMITTED,
    Open: MessageKind.OPEN,
    Ask: MessageKind.ASK,
    History: MessageKind.HISTORY,
    Snapshot: MessageKind.SNAPSHOT,
    Canvass: MessageKind.CANVASS,
    Support: MessageKind.SUPPORT,
    Candidacy: MessageKind.CANDIDACY,
    Vote: MessageKind.VOTE,
    Overruled: MessageKind.OVERRULED,
    Hello: MessageKind.HELLO,
}
_TYPES = {kind: type_ for type_, kind in _KINDS.items()}


@cache
def _decoder(kind: MessageKind) -> msgspec.msgpack.Decoder[Any]:
    return decoder(_TYPES[kind])


def kind_and_body(message: Message) -> tuple[MessageKind, bytes]:
    """Encode a message to its kind and body."""
    return _KINDS[type(message)], encode(message)


def message_of(kind: int, body: bytes, robots: int) -> Message | None:
    """Decode a message from a whole body; None if it is malformed."""
    try:
        message: Message = _decoder(MessageKind(kind)).decode(body)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
    return message if _fits(message, robots) else None


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
