"""Frames: the header and the proof around a piece of a message.

    name 1 | version 1 | kind 1 | sender 2 | incarnation 8 | number 8 | round 4 | piece 2 | pieces 2
    … | proof 16

The proof is BLAKE2b, keyed with a key that is made of the run's identity and the pre-shared key,
over all that comes before it: so it covers the run, the round, and the number that keeps replays
out. What is said before a run (R-JOIN) is proved with a key made of the run's name instead. A
number is that of the sender's start and a count (R-START).
"""

from __future__ import annotations

from collections import Counter
from enum import Enum
from hashlib import blake2b
from hmac import compare_digest
from struct import Struct as Layout

from msgspec import Struct

#: The first bytes of every datagram: a name and a version.
NAME, VERSION = 0x4B, 2

#: The longest datagram, so that no network on the way cuts it in pieces.
LONGEST = 1400

PROOF_BYTES = 16

_HEADER = Layout("!BBBHQQiHH")
HEADER_BYTES = _HEADER.size
KIND_AT = 2  #: where the kind stands in a datagram
ROOM = LONGEST - HEADER_BYTES - PROOF_BYTES  #: for the body
_SHORTEST = HEADER_BYTES + PROOF_BYTES

MOST_ROBOTS = 1 << 16


class Frame(Struct):
    """A piece of a message. ``number`` is that of the sender's start and its datagram."""

    kind: int
    sender: int
    incarnation: int
    number: int
    round: int
    piece: int
    pieces: int
    body: bytes


#: The datagrams of one start are numbered below this.
START_STEP = 1 << 40

#: The highest start that numbers have room for.
MOST_STARTS = (1 << 24) - 1


def run_key(shared_key: bytes, identity: bytes) -> bytes:
    """The key of one run, so that datagrams of other runs fail authentication."""
    return _derived(shared_key, identity, b"koord run")


def fleet_key(shared_key: bytes, name: str) -> bytes:
    """The key of what robots say before a run of this name. (R-JOIN)"""
    return _derived(shared_key, name.encode(), b"koord fleet")


def _derived(shared_key: bytes, of: bytes, person: bytes) -> bytes:
    if len(shared_key) > blake2b.MAX_KEY_SIZE:
        shared_key = blake2b(shared_key).digest()
    return blake2b(of, key=shared_key, digest_size=32, person=person).digest()


class Seal:
    """The codec of frames as authenticated datagrams, for one key."""

    __slots__ = ("_keyed",)

    def __init__(self, key: bytes) -> None:
        self._keyed = blake2b(digest_size=PROOF_BYTES, key=key)

    def put_on(self, frame: Frame) -> bytes:
        """Encode a frame as a datagram."""
        plain = (
            _HEADER.pack(
                NAME,
                VERSION,
                frame.kind,
                frame.sender,
                frame.incarnation,
                frame.number,
                frame.round,
                frame.piece,
                frame.pieces,
            )
            + frame.body
        )
        proof = self._keyed.copy()
        proof.update(plain)
        return plain + proof.digest()

    def take_off(self, datagram: bytes, robots: int, me: int, start: int) -> Frame | Drop:
        """Decode a datagram to a frame, or the reason for dropping it. Cheap checks come first.

        ``me`` is the robot that receives, in this ``start``; its own datagrams may come back.
        """
        size = len(datagram)
        if not _SHORTEST <= size <= LONGEST:
            return Drop.SIZE
        if datagram[0] != NAME:
            return Drop.NOT_KOORD
        if datagram[1] != VERSION:
            return Drop.VERSION
        _, _, kind, sender, incarnation, number, round_, piece, pieces = _HEADER.unpack_from(
            datagram
        )
        if sender >= robots or (sender == me and number // START_STEP == start):
            return Drop.STRANGER
        end = size - PROOF_BYTES
        proof = self._keyed.copy()
        proof.update(datagram[:end])
        if not compare_digest(proof.digest(), datagram[end:]):
            return Drop.FORGED
        if sender == me:
            return Drop.TWIN
        body = datagram[HEADER_BYTES:end]
        return Frame(kind, sender, incarnation, number, round_, piece, pieces, body)


class Drop(Enum):
    """The reasons for dropping a datagram."""

    SIZE = "too short or too long"
    NOT_KOORD = "of another protocol"
    VERSION = "of another version"
    STRANGER = "from no robot of this run"
    FORGED = "not authentic: another key, another run, or damaged"
    REPLAYED = "seen before, or from before a restart"
    TWIN = "of another process that is this robot"
    EARLIER = "of an earlier handshake"
    OLD = "of a round long past"
    FRAGMENT = "an impossible piece of a message"
    UNFINISHED = "a piece of a message that never got complete"
    MALFORMED = "authentic, and yet no message"


#: How many datagrams were dropped, and why.
Drops = Counter[Drop]
