"""The codec of messages as datagrams, with large ones in pieces."""

from __future__ import annotations

from collections import OrderedDict

from msgspec import Struct, field

from koord.runtime.protocol.messages import Message
from koord.runtime.wire.bodies import kind_and_body, message_of
from koord.runtime.wire.frames import ROOM, Drop, Drops, Frame, Seal, session_key

#: The longest message has so many pieces; a snapshot of a megabyte fits.
MOST_PIECES = 4096

#: What all unfinished messages together may take up.
MOST_BYTES = 16 << 20


def cut(body: bytes) -> list[bytes]:
    """Cut a message's body into pieces that fit. Raises ValueError if there would be too many."""
    pieces = [body[at : at + ROOM] for at in range(0, len(body), ROOM)] or [b""]
    if len(pieces) > MOST_PIECES:
        raise ValueError(f"a message of {len(body)} bytes is too long to be sent")
    return pieces


#: Sender, incarnation, number of the first piece, kind, pieces: equal for the pieces of a message.
Key = tuple[int, int, int, int, int]


class Unfinished(Struct):
    """A message of which some pieces are missing."""

    pieces: dict[int, bytes] = field(default_factory=dict)
    size: int = 0


class Assembly:
    """The unfinished messages of all senders; the oldest are dropped first."""

    __slots__ = ("_size", "_unfinished", "dropped", "most_bytes")

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self.most_bytes = most_bytes
        self.dropped = 0  #: pieces of messages that gave way
        self._unfinished: OrderedDict[Key, Unfinished] = OrderedDict()
        self._size = 0

    @property
    def size(self) -> int:
        """The bytes held by unfinished messages."""
        return self._size

    def add(self, frame: Frame) -> bytes | Drop | None:
        """Add a piece; return the whole body if it was the last one missing, else None."""
        pieces, piece = frame.pieces, frame.piece
        if not piece < pieces <= MOST_PIECES or frame.number < piece:
            return Drop.FRAGMENT
        if pieces == 1:
            return frame.body
        if len(frame.body) != ROOM and piece + 1 < pieces:
            return Drop.FRAGMENT
        key = (frame.sender, frame.incarnation, frame.number - piece, frame.kind, pieces)
        message = self._unfinished.setdefault(key, Unfinished())
        if piece not in message.pieces:
            message.pieces[piece] = frame.body
            message.size += len(frame.body)
            self._size += len(frame.body)
        if len(message.pieces) == pieces:
            self._forget(key)
            return b"".join(message.pieces[k] for k in range(pieces))
        while self._size > self.most_bytes:
            self.dropped += len(self._forget(next(iter(self._unfinished))).pieces)
        return None

    def _forget(self, key: Key) -> Unfinished:
        message = self._unfinished.pop(key)
        self._size -= message.size
        return message


#: How far a datagram may be behind the newest of its sender.
WIDTH = 4096
_MASK = (1 << WIDTH) - 1


class Window(Struct):
    """A replay window of one sender: the newest number, and a bit for each of those before it."""

    incarnation: int = 0
    newest: int = -1
    seen: int = 0

    def is_new(self, incarnation: int, number: int) -> bool:
        """Return whether a datagram's number is new, and mark it as seen."""
        if incarnation != self.incarnation:
            if incarnation < self.incarnation:
                return False
            self.incarnation, self.newest, self.seen = incarnation, number, 1
            return True
        ahead = number - self.newest
        if ahead > 0:
            self.seen = ((self.seen << ahead) | 1) & _MASK if ahead < WIDTH else 1
            self.newest = number
            return True
        bit = 1 << -ahead
        if ahead <= -WIDTH or self.seen & bit:
            return False
        self.seen |= bit
        return True


#: Datagrams of rounds further back than this are not looked at.
LONG_PAST = 10_000


class Letter(Struct):
    """A received message, with its sender."""

    sender: int
    incarnation: int
    message: Message


class RunKey(Struct, frozen=True):
    """The identity of a run: its id, its key, and the number of robots."""

    id: str
    key: bytes
    robots: int


class DatagramWriter:
    """The sender's side of the wire format for one robot."""

    __slots__ = ("_number", "_pid", "_seal")

    def __init__(self, run: RunKey, pid: int) -> None:
        self._seal = Seal(session_key(run.key, run.id))
        self._pid = pid
        self._number = 0

    def datagrams(self, incarnation: int, round_: int, message: Message) -> list[bytes]:
        """Encode a message as datagrams; ``round_`` is where the sender is."""
        kind, body = kind_and_body(message)
        pieces = cut(body)
        datagrams = []
        for piece, part in enumerate(pieces):
            frame = Frame(
                kind, self._pid, incarnation, self._number, round_, piece, len(pieces), part
            )
            datagrams.append(self._seal.put_on(frame))
            self._number += 1
        return datagrams


class DatagramReader:
    """The receiver's side of the wire format. ``read`` never raises, whatever the bytes."""

    __slots__ = ("_assembly", "_pid", "_robots", "_seal", "_windows", "drops", "round")

    def __init__(self, run: RunKey, pid: int, assembly: Assembly | None = None) -> None:
        self.drops: Drops = Drops()
        self.round = -1  #: where this robot is
        self._seal = Seal(session_key(run.key, run.id))
        self._pid = pid
        self._robots = run.robots
        self._windows = [Window() for _ in range(run.robots)]
        self._assembly = assembly if assembly is not None else Assembly()

    def read(self, datagram: bytes) -> Letter | None:
        """Read a datagram; return the message that it completes, if any. Drops are counted."""
        frame = self._seal.take_off(datagram, self._robots, self._pid)
        if isinstance(frame, Drop):
            self.drops[frame] += 1
            return None
        if not self._windows[frame.sender].is_new(frame.incarnation, frame.number):
            self.drops[Drop.REPLAYED] += 1
            return None
        if frame.round < self.round - LONG_PAST:
            self.drops[Drop.OLD] += 1
            return None
        letter = self._opened(frame)
        if isinstance(letter, Drop):
            self.drops[letter] += 1
            return None
        return letter

    def _opened(self, frame: Frame) -> Letter | Drop | None:
        before = self._assembly.dropped
        body = self._assembly.add(frame)
        if self._assembly.dropped != before:
            self.drops[Drop.UNFINISHED] += self._assembly.dropped - before
        if body is None or isinstance(body, Drop):
            return body
        message = message_of(frame.kind, body, self._robots)
        if message is None:
            return Drop.MALFORMED
        return Letter(frame.sender, frame.incarnation, message)
