"""One robot's end of the handshake: before its run, and for those that come late. (R-JOIN)"""

from __future__ import annotations

import secrets
import socket
from collections import Counter, OrderedDict
from collections.abc import Callable

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.node import Clock
from koord.runtime.protocol.handshake import (
    NO_RUN,
    NONCE_BYTES,
    Differs,
    Enter,
    EnterLate,
    HandshakeMessage,
    Higher,
    Join,
    Known,
    Outcome,
    OutOfStep,
    Party,
    Refused,
    Roll,
    Running,
    Say,
    StartedTwice,
    TurnedAway,
    answer,
    call_the_roll,
    differing,
    followed,
    join,
    receive,
    waiting,
)
from koord.runtime.transports.transport import Transport
from koord.runtime.wire.codec import (
    Channel,
    DatagramWriter,
    HandshakeReader,
    claimed_sender,
    claims_encryption,
    is_handshake,
)
from koord.runtime.wire.frames import MOST_STARTS, Drop, Drops

#: How often a robot says that it is here: the leader, and the others.
_LEADER_EVERY_S, _OTHERS_EVERY_S = 0.2, 0.5

#: Of more robots than this each says it less often.
_MANY = 64

#: How long a robot repeats what it has noticed of another.
_NOTED_S = 3.0

#: So many datagrams that are not authentic are no accident.
_SEVERAL = 3

#: One start of a robot is not answered more often than this, and so many are remembered.
_ANSWER_EVERY_S = 0.05
_MOST_STARTS_HEARD = 1024

#: A robot that was heard so long ago, and not since, may have been started again.
_GONE_S = 1.0


def drawn() -> bytes:
    """A nonce that nobody has drawn before."""
    return secrets.token_bytes(NONCE_BYTES)


#: What ends a handshake for a robot.
Ending = Enter | EnterLate | TurnedAway


def knock(party: Party, address: tuple[str, int]) -> None:
    """Say Join to whoever has a robot's address already, so that it names this process too.

    (R-NAME) Raises OSError.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        for datagram in _writer(party).datagrams(0, 0, join(party, waiting(party))):
            own.sendto(datagram, address)


def _writer(party: Party) -> DatagramWriter:
    """The writer of one start; receivers tell pieces of messages apart by its number."""
    start = secrets.randbelow(MOST_STARTS)
    channel = Channel(party.fleet_key, party.robots, party.pid, start, party.encrypts)
    return DatagramWriter(channel)


class _StartHeard(Struct):
    """A start of a robot, as one in the run hears of it. ``is_let_in``: it was answered Running."""

    first_at: float
    answered_at: float = -1.0
    is_let_in: bool = False


class Seen(Struct, frozen=True):
    """Another robot, as it was heard of last before a run."""

    at_s: float
    differs: tuple[str, ...]  #: what it runs otherwise
    is_in_run: bool = False


class _Note(Struct):
    """A remark on another robot, and when it was last true."""

    text: str
    at: float


class Joining:
    """The handshake of one robot, over a transport. ``ending`` is how it ended, if it has."""

    def __init__(
        self, party: Party, transport: Transport, clock: Clock, run: bytes = NO_RUN
    ) -> None:
        """Begin a handshake; ``run`` is the one of the robot's journal."""
        self.party = party
        self.ending: Ending | None = None
        self.nonces: tuple[bytes, ...] = ()  #: the roll of the run, if it is known
        self.higher: Callable[[int], None] = _ignored
        self.seen: dict[int, Seen] = {}  #: by :meth:`look`
        self._state = waiting(party, run)
        self._transport = transport
        self._clock = clock
        self._writer = _writer(party)
        self._reader = HandshakeReader(party.fleet_key, party.robots, encrypts=party.encrypts)
        self._next_at = clock()
        self._notes: dict[tuple[str, int], _Note] = {}
        self._doubtful: Counter[tuple[str, int]] = Counter()
        self._starts: OrderedDict[bytes, _StartHeard] = OrderedDict()

    # --- before the run -------------------------------------------------------------------------

    def turn(self, most_s: float) -> list[bytes]:
        """Say Join if it is time, and wait at most ``most_s`` seconds for datagrams.

        Returns those that are of runs, and not of handshakes.
        """
        self.wake()
        wait_s = max(0.0, self._next_at - self._clock())
        others = []
        for datagram in self._transport.receive(min(most_s, wait_s)):
            if is_handshake(datagram):
                self.hear(datagram)
                continue
            others.append(datagram)
            if claims_encryption(datagram) is (not self.party.encrypts):
                self.doubt(datagram)  # those who are in a run answer nobody they cannot read
        return others

    def wake(self) -> None:
        """Say Join, if it is time. (R-JOIN)"""
        now = self._clock()
        if now < self._next_at:
            return
        party = self.party
        often_s = _LEADER_EVERY_S if party.is_leader else _OTHERS_EVERY_S
        self._next_at = now + often_s * max(1.0, party.robots / _MANY)
        self._say(None, join(party, self._state))
        if self._state.run == NO_RUN:
            self._state, outcomes = call_the_roll(party, self._state)
            self._do(outcomes)

    def look(self, most_s: float) -> list[bytes]:
        """Look for the others, and take part in nothing yet. (P-PREFLIGHT)

        Others hear from this robot, and nobody counts it: it says Join without the leader's nonce.
        Returns datagrams of runs, as :meth:`turn` does.
        """
        now = self._clock()
        if now >= self._next_at:
            self._next_at = now + _OTHERS_EVERY_S * max(1.0, self.party.robots / _MANY)
            self._say(None, Join(self.party.nonce, b"", NO_RUN, self.party.fingerprint))
        others = []
        for datagram in self._transport.receive(min(most_s, max(0.0, self._next_at - now))):
            if is_handshake(datagram):
                self._see(datagram)
            else:
                others.append(datagram)
        return others

    @property
    def goes_on(self) -> bool:
        """True if there is a run to go on with, for which a majority will do. (R-RESUME)"""
        return self._state.run != NO_RUN or any(one.is_in_run for one in self.seen.values())

    def _see(self, datagram: bytes) -> None:
        heard = self._read(datagram)
        if heard is None:
            return
        sender, message = heard
        match message:
            case Join(nonce=nonce) if sender == self.party.pid:
                if nonce != self.party.nonce:
                    self._do((StartedTwice(sender),))
                return
            case Join(fingerprint=theirs) | Refused(fingerprint=theirs) if theirs:
                self.seen[sender] = Seen(self._clock(), differing(self.party.fingerprint, theirs))
            case Running(run=run):
                self.seen[sender] = Seen(self._clock(), (), is_in_run=run != NO_RUN)
            case _:
                self.seen[sender] = Seen(self._clock(), (), is_in_run=isinstance(message, Roll))

    def hear(self, datagram: bytes) -> None:
        """Process a datagram of a handshake, as a robot that is in no run, or back in its own."""
        heard = self._read(datagram)
        if heard is None or self.ending is not None:
            return
        sender, message = heard
        outcomes = self._received(sender, message)
        if not isinstance(message, Join) or message.fingerprint == self.party.fingerprint:
            self._notes.pop(("differs", sender), None)
        self._do(outcomes)

    def others(self, most_s: float) -> list[bytes]:
        """Wait at most ``most_s`` seconds, and return the datagrams that are of runs."""
        came = self._transport.receive(most_s)
        return [datagram for datagram in came if not is_handshake(datagram)]

    def say_roll(self) -> None:
        """Say who is in the run, as the leader that is in it itself by now. (R-ROLL)"""
        if self.party.is_leader and self.nonces:
            self._say(None, Roll(self.nonces))

    def missing(self) -> tuple[int, ...]:
        """The robots that the handshake waits for, as far as this robot can know."""
        party, state = self.party, self._state
        if party.is_leader:
            there = {robot for robot, nonce in enumerate(state.nonces) if nonce is not None}
            return tuple(sorted(set(range(party.robots)) - there - {party.pid}))
        return () if state.heard else (party.leader,)

    # --- in the run -----------------------------------------------------------------------------

    def answer(
        self, datagram: bytes, known: Callable[[int], tuple[Known, float | None] | None]
    ) -> None:
        """Process a datagram of a handshake, as a robot that is in a run. (R-RUNNING)

        ``known`` says what this robot knows of another, and when it was heard in the run, None if
        never; None if this robot knows nothing yet.
        """
        heard = self._read(datagram)
        if heard is None:
            return
        sender, message = heard
        if not isinstance(message, Join) or sender == self.party.pid:
            self._do(self._received(sender, message))
            return
        self._state = followed(self.party, self._state, sender, message)
        now, of_sender, start = self._clock(), known(sender), self._start_heard(message)
        if of_sender is None or now - start.answered_at < _ANSWER_EVERY_S:
            self.drops[Drop.EARLIER] += 1
            return  # so a flood of old Joins makes no flood of answers
        about, heard_at = of_sender
        # Who runs something else is told so at once, whoever it is.
        is_same = message.fingerprint == self.party.fingerprint
        is_new = is_same and not start.is_let_in and message.run != self._state.run
        is_twin = is_new and heard_at is not None and heard_at > start.first_at
        if is_new and not is_twin and heard_at is not None and now - heard_at < _GONE_S:
            return  # it may be there still, as another process
        start.answered_at, start.is_let_in = now, not is_twin
        about = replace(about, is_heard=is_twin)
        self._do(answer(self.party, self._state.run, self.nonces, sender, message, about))

    def _start_heard(self, message: Join) -> _StartHeard:
        start = self._starts.setdefault(message.nonce, _StartHeard(self._clock()))
        if len(self._starts) > _MOST_STARTS_HEARD:
            self._starts.popitem(last=False)
        return start

    # --- what is noticed ------------------------------------------------------------------------

    def doubt(self, datagram: bytes) -> None:
        """Note that a datagram in a robot's name cannot be read. (R-NAME)"""
        robot = claimed_sender(datagram)
        if robot is None or robot == self.party.pid or not 0 <= robot < self.party.robots:
            return
        what, story = "key", f"robot {robot} has another key, or somebody uses its name"
        if claims_encryption(datagram) is (not self.party.encrypts):
            here, there = ("on", "off") if self.party.encrypts else ("off", "on")
            what, story = (
                "encryption",
                f"robot {robot} has encryption {there}, and this robot has it {here}; "
                "`network: {encrypt: …}` has to be the same for all",
            )
        self._doubtful[what, robot] += 1
        if self._doubtful[what, robot] >= _SEVERAL:
            self._note(what, robot, story)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was noticed in the last seconds, for people to read."""
        now = self._clock()
        return tuple(
            note.text for _, note in sorted(self._notes.items()) if now - note.at < _NOTED_S
        )

    @property
    def drops(self) -> Drops:
        """The datagrams of handshakes that were dropped, by reason."""
        return self._reader.drops

    def _received(self, sender: int, message: HandshakeMessage) -> tuple[Outcome, ...]:
        """Take a message in, and count it if it is of another handshake. (I-FRESH)"""
        self._state, outcomes = receive(self.party, self._state, sender, message)
        if not outcomes and not isinstance(message, Join):
            self.drops[Drop.EARLIER] += 1
        return outcomes

    def _note(self, what: str, robot: int, text: str) -> None:
        self._notes[what, robot] = _Note(text, self._clock())

    def _read(self, datagram: bytes) -> tuple[int, HandshakeMessage] | None:
        before = self._unreadable
        heard = self._reader.read(datagram)
        if self._unreadable > before:
            self.doubt(datagram)
        return heard

    @property
    def _unreadable(self) -> int:
        drops = self._reader.drops
        return drops[Drop.FORGED] + drops[Drop.ENCRYPTED] + drops[Drop.UNENCRYPTED]

    def _say(self, to: int | None, message: HandshakeMessage) -> None:
        for datagram in self._writer.datagrams(0, 0, message):
            if to is None:
                self._transport.tell(datagram)
            else:
                self._transport.send(to, datagram)

    def _do(self, outcomes: tuple[Outcome, ...]) -> None:
        for outcome in outcomes:
            match outcome:
                case Say(to=to, message=message):
                    self._say(to, message)
                case Enter(nonces=nonces):
                    self.nonces, self.ending = nonces, outcome
                case EnterLate() | TurnedAway():
                    self._notes.clear()
                    self.ending = outcome
                case Differs(robot=robot, fingerprint=theirs):
                    what = "; ".join(differing(self.party.fingerprint, theirs))
                    self._note("differs", robot, f"robot {robot} runs something else ({what})")
                case StartedTwice(robot=robot):
                    self._note("twice", robot, f"two processes say that they are robot {robot}")
                case OutOfStep(robot=robot, run=run):
                    self._note("run", robot, self._out_of_step(robot, run))
                case Higher(start=start):
                    self.higher(start)

    def _out_of_step(self, robot: int, run: bytes) -> str:
        if run == NO_RUN:
            return (
                f"robot {robot} has no journal of the run that this robot would go on with; "
                "to begin another run, start all robots with --fresh"
            )
        return (
            f"robot {robot} is in a run ({run.hex()[:8]}) that this robot has no journal of; "
            "to begin another run, start all robots with --fresh"
        )


def _ignored(start: int) -> None:
    """Ignore a start that was heard: this robot has not begun its own."""
