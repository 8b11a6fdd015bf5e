"""The codec of messages as datagrams, with large ones in pieces."""

from __future__ import annotations

from collections import OrderedDict

from msgspec import Struct, field

from koord.runtime.orders.messages import OrderMessage
from koord.runtime.protocol.handshake import HandshakeMessage
from koord.runtime.protocol.messages import RunMessage
from koord.runtime.wire.bodies import (
    FIRST_HANDSHAKE_KIND,
    AnyMessage,
    handshake_of,
    kind_and_body,
    message_of,
    order_of,
)
from koord.runtime.wire.frames import (
    FIRST_ORDER_KIND,
    HEADER_BYTES,
    KIND_AT,
    MOST_ROBOTS,
    NAME,
    ROOM,
    START_STEP,
    VERSION_AT,
    Drop,
    Drops,
    Frame,
    Proving,
    Seal,
    Version,
)

#: The longest message has so many pieces; a snapshot of a megabyte fits.
MOST_PIECES = 4096

#: What all unfinished messages together may take up.
MOST_BYTES = 16 << 20


def cut(body: bytes) -> list[bytes]:
    """Cut a message's body into pieces that fit. Raises ValueError if there would be too many."""
    if len(body) <= ROOM:
        return [body]
    pieces = [body[at : at + ROOM] for at in range(0, len(body), ROOM)]
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


def _whole(frame: Frame, assembly: Assembly, drops: Drops) -> bytes | None:
    """The body of a message, if this piece completes it; what is dropped on the way is counted."""
    before = assembly.dropped
    body = assembly.add(frame)
    if assembly.dropped != before:
        drops[Drop.UNFINISHED] += assembly.dropped - before
    if isinstance(body, Drop):
        drops[body] += 1
        return None
    return body


#: How far a datagram may be behind the newest of its sender.
WIDTH = 4096
_MASK = (1 << WIDTH) - 1


class Window(Struct):
    """A replay window of one sender: the newest number, and a bit for each of those before it.

    What was sent before the sender's latest start is never new. (R-START)
    """

    newest: int = -1
    seen: int = 0
    row: int = 0  #: so many came one after another since ``seen`` was noted, of ``newest`` then

    @property
    def start(self) -> int:
        """The highest start heard; 0: none."""
        return max(0, self.newest // START_STEP)

    def is_new(self, number: int) -> bool:
        """Return whether a datagram's number is new, and mark it as seen."""
        ahead = number - self.newest
        if ahead == 1:  # most are
            self.newest, self.row = number, self.row + 1
            return True
        if self.row:
            row = min(self.row, WIDTH)
            self.seen, self.row = ((self.seen << row) | ((1 << row) - 1)) & _MASK, 0
        if ahead > 0:
            self.seen = ((self.seen << ahead) | 1) & _MASK if ahead < WIDTH else 1
            self.newest = number
            return True
        if ahead <= -WIDTH:
            return False
        bit = 1 << -ahead
        if self.seen & bit:
            return False
        self.seen |= bit
        return True


#: Datagrams of rounds further back than this are not looked at.
LONG_PAST = 10_000


class Letter(Struct):
    """A received message, with its sender."""

    sender: int
    incarnation: int
    message: RunMessage


def seal_of(key: bytes, *, encrypts: bool) -> Seal:
    """Make a seal. Raises ImportError if it is to encrypt and ``koord[encrypt]`` is missing."""
    if not encrypts:
        return Proving(key)
    from koord.runtime.wire.encryption import Encrypting

    return Encrypting(key)


class Channel(Struct, frozen=True):
    """One robot's end of the wire: the key, the number of robots, its pid and its start."""

    key: bytes
    robots: int
    pid: int
    start: int = 1
    encrypts: bool = False

    def seal(self) -> Seal:
        """Make a seal for one direction."""
        return seal_of(self.key, encrypts=self.encrypts)


class DatagramWriter:
    """The sender's side of the wire format for one robot."""

    __slots__ = ("_number", "_pid", "_seal")

    def __init__(self, channel: Channel) -> None:
        self._seal = channel.seal()
        self._pid = channel.pid
        self._number = channel.start * START_STEP

    def start_again(self, start: int) -> None:
        """Go on with the numbers of another start. (R-START)"""
        self._number = start * START_STEP

    def datagrams(self, incarnation: int, round_: int, message: AnyMessage) -> list[bytes]:
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


#: Nobody's pid: all senders are read.
_NOBODY = -1

#: So many datagrams that were opened are remembered.
_MOST_OPENED = 256


class Opened:
    """The datagrams that robots of one process have opened, for all of them: they have one key.

    What comes to several of them is authenticated and decoded once; whether it is new to a robot,
    and whether somebody uses its name, each sees for itself.
    """

    __slots__ = ("_known", "_robots", "_seal")

    def __init__(self, channel: Channel) -> None:
        self._seal, self._robots = channel.seal(), channel.robots
        self._known: dict[bytes, tuple[Frame, RunMessage | None] | None] = {}

    def open(self, datagram: bytes) -> tuple[Frame, RunMessage | None] | None:
        """The frame, and its message if that is whole and well-formed; None: it is dropped."""
        known = self._known
        if datagram in known:
            return known[datagram]
        frame = self._seal.take_off(datagram, self._robots, _NOBODY, 0)
        found = None
        if not isinstance(frame, Drop):
            is_whole = frame.pieces == 1 and frame.piece == 0
            message = message_of(frame.kind, frame.body, self._robots) if is_whole else None
            found = frame, message
        if len(known) >= _MOST_OPENED:
            known.clear()
        known[datagram] = found
        return found


class DatagramReader:
    """The receiver's side of the wire format. ``read`` never raises, whatever the bytes."""

    __slots__ = ("_assembly", "_channel", "_opened", "_seal", "_windows", "drops", "round", "start")

    def __init__(
        self,
        channel: Channel,
        assembly: Assembly | None = None,
        opened: Opened | None = None,
    ) -> None:
        """Make a reader; other robots of this process, with the same key, share ``opened``."""
        self._opened = opened
        self.drops: Drops = Drops()
        self.round = -1  #: where this robot is
        self.start = channel.start
        self._channel = channel
        self._seal = channel.seal()
        self._windows = [Window() for _ in range(channel.robots)]
        self._assembly = assembly if assembly is not None else Assembly()

    def read(self, datagram: bytes) -> Letter | None:
        """Read a datagram; return the message that it completes, if any. Drops are counted."""
        channel, message, opened = self._channel, None, self._opened
        found = None if opened is None else opened.open(datagram)
        # Why it drops a datagram, and who uses its name, a robot says by itself.
        frame: Frame | Drop
        if found is not None and found[0].sender != channel.pid:
            frame, message = found
        else:
            frame = self._seal.take_off(datagram, channel.robots, channel.pid, self.start)
        if isinstance(frame, Drop):
            self.drops[frame] += 1
            return None
        if not self._windows[frame.sender].is_new(frame.number):
            self.drops[Drop.REPLAYED] += 1
            return None
        if frame.round < self.round - LONG_PAST:
            self.drops[Drop.OLD] += 1
            return None
        if frame.pieces == 1 and frame.piece == 0:
            body: bytes | None = frame.body
        else:
            body = _whole(frame, self._assembly, self.drops)
        if body is None:
            return None
        if message is None:
            message = message_of(frame.kind, body, channel.robots)
        if message is None:
            self.drops[Drop.MALFORMED] += 1
            return None
        return Letter(frame.sender, frame.incarnation, message)

    def start_of(self, sender: int) -> int:
        """The highest start heard from a robot; 0: none. (R-START)"""
        return self._windows[sender].start


#: What unfinished messages of a handshake may take up.
_HANDSHAKE_BYTES = 1 << 20


class HandshakeReader:
    """The receiver's side of the handshake. ``read`` never raises, whatever the bytes.

    Replays are dropped by the nonces in the messages, not here. (I-FRESH)
    """

    __slots__ = ("_assembly", "_robots", "_seal", "drops")

    def __init__(self, key: bytes, robots: int, *, encrypts: bool = False) -> None:
        self.drops: Drops = Drops()
        self._seal = seal_of(key, encrypts=encrypts)
        self._robots = robots
        self._assembly = Assembly(_HANDSHAKE_BYTES)

    def read(self, datagram: bytes) -> tuple[int, HandshakeMessage] | None:
        """Read a datagram; return the message that it completes, and its sender."""
        frame = self._seal.take_off(datagram, self._robots, _NOBODY, 0)
        if isinstance(frame, Drop):
            self.drops[frame] += 1
            return None
        body = _whole(frame, self._assembly, self.drops)
        if body is None:
            return None
        message = handshake_of(frame.kind, body)
        if message is None:
            self.drops[Drop.MALFORMED] += 1
            return None
        return frame.sender, message


class OrderReader:
    """The receiver's side of orders and of the answers to them. ``read`` never raises.

    Replays are dropped by the stamps and ids in the messages, not here. (O-STAMP) (O-ONCE)
    """

    __slots__ = ("_seal", "drops")

    def __init__(self, key: bytes, *, encrypts: bool = False) -> None:
        self.drops: Drops = Drops()
        self._seal = seal_of(key, encrypts=encrypts)

    def read(self, datagram: bytes) -> OrderMessage | None:
        """Read a datagram. An order is one, and in no pieces."""
        frame = self._seal.take_off(datagram, MOST_ROBOTS, _NOBODY, 0)
        if isinstance(frame, Drop):
            self.drops[frame] += 1
            return None
        message = order_of(frame.kind, frame.body) if frame.pieces == 1 else None
        if message is None:
            self.drops[Drop.MALFORMED] += 1
        return message


def claimed_sender(datagram: bytes) -> int | None:
    """The pid in whose name a datagram is, authentic or not; None if it is no datagram of ours."""
    if len(datagram) < HEADER_BYTES or datagram[0] != NAME:
        return None
    return int.from_bytes(datagram[3:5], "big")


_ENCRYPTS: dict[int, bool] = {Version.AUTHENTICATED: False, Version.ENCRYPTED: True}


def claims_encryption(datagram: bytes) -> bool | None:
    """Whether a datagram says that it is encrypted; None if it is of no version of ours."""
    if len(datagram) < HEADER_BYTES or datagram[0] != NAME:
        return None
    return _ENCRYPTS.get(datagram[VERSION_AT])


def is_handshake(datagram: bytes) -> bool:
    """Return whether a datagram says to be part of a handshake."""
    # What is said in each round is told by its kind alone.
    may_be = len(datagram) > KIND_AT and datagram[KIND_AT] >= FIRST_HANDSHAKE_KIND
    return may_be and datagram[KIND_AT] < FIRST_ORDER_KIND and datagram[0] == NAME
