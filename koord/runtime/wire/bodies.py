"""Bodies of messages: one kind and one type each, checked by msgspec on decoding."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, assert_never

import msgspec

from koord.runtime.encoding import decoder, encode
from koord.runtime.orders.messages import (
    BOOT_BYTES,
    ID_BYTES,
    OrderMessage,
    Reply,
    Request,
    Stamp,
)
from koord.runtime.protocol.handshake import (
    NONCE_BYTES,
    RUN_BYTES,
    HandshakeMessage,
    Join,
    Refused,
    Roll,
    Running,
)
from koord.runtime.protocol.messages import (
    Acknowledge,
    Ask,
    Beacon,
    Candidacy,
    Canvass,
    Committed,
    Decide,
    Hello,
    History,
    Open,
    Overruled,
    Propose,
    Recovery,
    RecoveryAnswer,
    RunMessage,
    Snapshot,
    Support,
    Tentative,
    Vote,
)
from koord.runtime.wire.frames import FIRST_ORDER_KIND, MOST_STARTS


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
    RECOVERY = 15
    RECOVERY_ANSWER = 16
    BEACON = 17
    JOIN = 32
    ROLL = 33
    RUNNING = 34
    REFUSED = 35
    REQUEST = 48
    REPLY = 49


#: Messages of this kind and above are said before a run, and proved with another key.
FIRST_HANDSHAKE_KIND = MessageKind.JOIN


assert FIRST_ORDER_KIND == MessageKind.REQUEST

#: All that goes into frames.
AnyMessage = RunMessage | HandshakeMessage | OrderMessage

_KINDS: dict[type[AnyMessage], MessageKind] = {
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
    Recovery: MessageKind.RECOVERY,
    RecoveryAnswer: MessageKind.RECOVERY_ANSWER,
    Beacon: MessageKind.BEACON,
    Join: MessageKind.JOIN,
    Roll: MessageKind.ROLL,
    Running: MessageKind.RUNNING,
    Refused: MessageKind.REFUSED,
    Request: MessageKind.REQUEST,
    Reply: MessageKind.REPLY,
}
_TYPES = {kind: type_ for type_, kind in _KINDS.items()}


#: The decoders of all kinds, by number, each made when it is first used.
#: A kind is a byte, which need not be one of ours.
_DECODERS: list[msgspec.msgpack.Decoder[Any] | None] = [None] * 256


def _decoder(kind: int) -> msgspec.msgpack.Decoder[Any]:
    """Make the decoder of a kind. Raises ValueError for the number of none."""
    made = _DECODERS[kind] = decoder(_TYPES[MessageKind(kind)])
    return made


def kind_and_body(message: AnyMessage) -> tuple[MessageKind, bytes]:
    """Encode a message to its kind and body."""
    return _KINDS[type(message)], encode(message)


def message_of(kind: int, body: bytes, robots: int) -> RunMessage | None:
    """Decode a message of a run from a whole body; None if it is malformed."""
    if kind >= FIRST_HANDSHAKE_KIND:
        return None
    message: RunMessage | None = _decoded(kind, body)
    if message is None or type(message) is Acknowledge:
        return message  # these first: there is one for each robot in each round
    return message if _fits(message, robots) else None


def handshake_of(kind: int, body: bytes) -> HandshakeMessage | None:
    """Decode a message of a handshake from a whole body; None if it is malformed."""
    if not FIRST_HANDSHAKE_KIND <= kind < FIRST_ORDER_KIND:
        return None
    message: HandshakeMessage | None = _decoded(kind, body)
    return message if message is not None and _is_well_formed(message) else None


def order_of(kind: int, body: bytes) -> OrderMessage | None:
    """Decode an order or the answer to one from a whole body; None if it is malformed."""
    if kind < FIRST_ORDER_KIND:
        return None
    message: OrderMessage | None = _decoded(kind, body)
    if message is None or len(message.id) != ID_BYTES or not _is_moment(message.stamp):
        return None
    said_at_s = message.said_at_s if isinstance(message, Request) else 0.0
    return message if math.isfinite(said_at_s) else None


def _is_moment(stamp: Stamp | None) -> bool:
    return stamp is None or (len(stamp.boot) == BOOT_BYTES and math.isfinite(stamp.at_s))


def _decoded(kind: int, body: bytes) -> Any:
    try:
        return (_DECODERS[kind] or _decoder(kind)).decode(body)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


def _is_well_formed(message: HandshakeMessage) -> bool:
    """Return whether nonces and identities have the right lengths."""
    match message:
        case Join(nonce=nonce, heard=heard, run=run):
            lengths = (len(heard) in (0, NONCE_BYTES), len(run) in (0, RUN_BYTES))
            return len(nonce) == NONCE_BYTES and all(lengths)
        case Roll(nonces=nonces):
            return all(len(nonce) == NONCE_BYTES for nonce in nonces)
        case Running(nonce=nonce, run=run, incarnation=incarnation, start=start):
            ranges = 0 <= incarnation < 1 << 63 and 0 <= start < MOST_STARTS
            return ranges and len(nonce) == NONCE_BYTES and len(run) in (0, RUN_BYTES)
        case Refused(nonce=nonce):
            return len(nonce) == NONCE_BYTES
        case _:
            assert_never(message)


def _fits(message: RunMessage, robots: int) -> bool:
    """Return whether the robots that a message names exist."""
    match message:
        case Committed(pause_s=pause_s):
            return 0.0 <= pause_s < 1e6
        case Decide(entry=entry) | History(entry=entry):
            for taken in entry.decision.ran:
                if not 0 <= taken.robot < robots:
                    return False
            return all([0 <= admission.robot < robots for admission in entry.admitted])
        case Propose(proposal=proposal):
            return 0 <= proposal.robot < robots
        case RecoveryAnswer(tentative=Tentative(entry=entry)):
            return _fits(History(0, entry), robots)
        case Snapshot(roster=roster, last_ran=last_ran):
            return len(roster) == len(last_ran) == robots
        case _:
            return True
