"""Frames: the header and the proof around a piece of a message.

    name 1 | version 1 | kind 1 | sender 2 | incarnation 8 | number 8 | round 4 | piece 2 | pieces 2
    … | proof 16

The proof is BLAKE2b, keyed with a key that is made of the run's identity and the pre-shared key,
over all that comes before it: so it covers the run, the round, and the number that keeps replays
out. What is said before a run (R-JOIN) is proved with a key made of the run's name instead. A
number is that of the sender's start and a count (R-START). The other version of the format, in
which bodies are encrypted, is :mod:`koord.runtime.wire.encryption`'s.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from enum import Enum, IntEnum
from hashlib import blake2b
from hmac import compare_digest
from struct import Struct as Layout
from typing import ClassVar

from msgspec import Struct

#: The first byte of every datagram.
NAME = 0x4B


class Version(IntEnum):
    """The second byte of every datagram: its format. Numbers are never reused."""

    AUTHENTICATED = 2
    ENCRYPTED = 3  #: as well


#: The longest datagram, so that no network on the way cuts it in pieces.
LONGEST = 1400

PROOF_BYTES = 16
SALT_BYTES = 16  #: of encrypted datagrams

_HEADER = Layout("!BBBHQQiHH")
HEADER_BYTES = _HEADER.size
VERSION_AT, KIND_AT = 1, 2  #: where they stand in a datagram

#: Messages of this kind and above are orders of people, and the answers to them. (O-BESIDE)
FIRST_ORDER_KIND = 48
ROOM = LONGEST - HEADER_BYTES - SALT_BYTES - PROOF_BYTES  #: for the body, encrypted or not
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


def order_key(shared_key: bytes) -> bytes:
    """The key of what people say to robots, whatever runs. (O-KEY)"""
    return _derived(shared_key, b"", b"koord orders")


def is_order(datagram: bytes) -> bool:
    """Return whether a datagram says to be an order of people, or the answer to one."""
    # What is said in each round is told by its kind alone.
    may_be = len(datagram) > KIND_AT and datagram[KIND_AT] >= FIRST_ORDER_KIND
    return may_be and datagram[0] == NAME


def _derived(shared_key: bytes, of: bytes, person: bytes) -> bytes:
    if len(shared_key) > blake2b.MAX_KEY_SIZE:
        shared_key = blake2b(shared_key).digest()
    return blake2b(of, key=shared_key, digest_size=32, person=person).digest()


class Seal(ABC):
    """The codec of frames as authenticated datagrams, for one key."""

    __slots__ = ()

    VERSION: ClassVar[Version]
    _BEGINNING: ClassVar[bytes]

    def __init_subclass__(cls) -> None:
        cls._BEGINNING = bytes((NAME, cls.VERSION))

    @abstractmethod
    def _closed(self, header: bytes, number: int, body: bytes) -> bytes:
        """Return a datagram with this header."""

    @abstractmethod
    def _opened(self, datagram: bytes, sender: int, number: int) -> bytes | None:
        """Return the body of a datagram; None if it is not authentic."""

    def put_on(self, frame: Frame) -> bytes:
        """Encode a frame as a datagram."""
        header = _HEADER.pack(
            NAME,
            self.VERSION,
            frame.kind,
            frame.sender,
            frame.incarnation,
            frame.number,
            frame.round,
            frame.piece,
            frame.pieces,
        )
        return self._closed(header, frame.number, frame.body)

    def take_off(self, datagram: bytes, robots: int, me: int, start: int) -> Frame | Drop:
        """Decode a datagram to a frame, or the reason for dropping it. Cheap checks come first.

        ``me`` is the robot that receives, in this ``start``; its own datagrams may come back.
        """
        if not _SHORTEST <= len(datagram) <= LONGEST:
            return Drop.SIZE
        if not datagram.startswith(self._BEGINNING):
            if datagram[0] != NAME:
                return Drop.NOT_KOORD
            return _OTHER_VERSIONS.get(datagram[VERSION_AT], Drop.VERSION)
        _, _, kind, sender, incarnation, number, round_, piece, pieces = _HEADER.unpack_from(
            datagram
        )
        if sender >= robots or (sender == me and number // START_STEP == start):
            return Drop.STRANGER
        body = self._opened(datagram, sender, number)
        if body is None:
            return Drop.FORGED
        if sender == me:
            return Drop.TWIN
        return Frame(kind, sender, incarnation, number, round_, piece, pieces, body)


class Proving(Seal):
    """The seal that authenticates, and hides nothing."""

    __slots__ = ("_keyed",)

    VERSION = Version.AUTHENTICATED

    def __init__(self, key: bytes) -> None:
        self._keyed = blake2b(digest_size=PROOF_BYTES, key=key)

    def _closed(self, header: bytes, number: int, body: bytes) -> bytes:
        said = header + body
        proof = self._keyed.copy()
        proof.update(said)
        return said + proof.digest()

    def _opened(self, datagram: bytes, sender: int, number: int) -> bytes | None:
        end = len(datagram) - PROOF_BYTES
        proof = self._keyed.copy()
        proof.update(datagram[:end])
        if not compare_digest(proof.digest(), datagram[end:]):
            return None
        return datagram[HEADER_BYTES:end]


class Drop(Enum):
    """The reasons for dropping a datagram."""

    CROWDED = "too many at once"
    SIZE = "too short or too long"
    NOT_KOORD = "of another protocol"
    VERSION = "of another version"
    ENCRYPTED = "encrypted, unlike this robot's"
    UNENCRYPTED = "not encrypted, unlike this robot's"
    STRANGER = "from no robot of this run"
    FORGED = "not authentic: another key, another run, or damaged"
    REPLAYED = "seen before, or from before a restart"
    TWIN = "of another process that is this robot"
    EARLIER = "of an earlier handshake"
    NO_RUN = "before this robot was in a run"
    OLD = "of a round long past"
    FRAGMENT = "an impossible piece of a message"
    UNFINISHED = "a piece of a message that never got complete"
    MALFORMED = "authentic, and yet no message"
    STALE = "an order that was said too long ago"


#: What robots send of which some encrypt and others do not.
_OTHER_VERSIONS: dict[int, Drop] = {
    Version.AUTHENTICATED: Drop.UNENCRYPTED,
    Version.ENCRYPTED: Drop.ENCRYPTED,
}

#: How many datagrams were dropped, and why.
Drops = Counter[Drop]
