"""Messages to datagrams, and datagrams to messages or reasons why not."""

from __future__ import annotations

from msgspec import Struct

from koord.runtime.protocol.messages import Message
from koord.runtime.wire.bodies import kind_and_body, message_of
from koord.runtime.wire.frames import Drop, Drops, Frame, Seal, session_key
from koord.runtime.wire.pieces import Assembly, Window, cut

#: Datagrams of rounds further back than this are not looked at.
LONG_PAST = 10_000


class Letter(Struct):
    """A message with who sent it."""

    sender: int
    incarnation: int
    message: Message


class RunKey(Struct, frozen=True):
    """What all robots of a run share: its id, its key, how many they are."""

    id: str
    key: bytes
    robots: int


class DatagramWriter:
    """What one robot sends."""

    __slots__ = ("_number", "_pid", "_seal")

    def __init__(self, run: RunKey, pid: int) -> None:
        self._seal = Seal(session_key(run.key, run.id))
        self._pid = pid
        self._number = 0

    def datagrams(self, incarnation: int, round_: int, message: Message) -> list[bytes]:
        """A message in as many datagrams as it takes; ``round_`` is where the sender is."""
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
    """What one robot receives. ``read`` never raises, whatever the bytes."""

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
        """The message that a datagram completes, if it does; what is dropped is counted."""
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
