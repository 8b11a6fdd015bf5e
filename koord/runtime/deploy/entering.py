"""The way of a robot into a run: new, late, or back with its journal. (R-JOIN) (R-RESUME)"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial

from koord.runtime.deploy.job import CannotTakePartError, Job, Make
from koord.runtime.deploy.joining import Joining
from koord.runtime.deploy.journal import (
    DamagedError,
    Entered,
    InUseError,
    Recollection,
    Start,
)
from koord.runtime.deploy.news import REPORT_S, Untold
from koord.runtime.deploy.resuming import come_back, enter
from koord.runtime.encoding import text_digest
from koord.runtime.node import Clock, Peer
from koord.runtime.protocol.handshake import (
    NO_RUN,
    Enter,
    EnterLate,
    Known,
    TurnedAway,
    differing,
)
from koord.runtime.protocol.messages import FIRST_INCARNATION, Beacon, incarnation_above
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import Rejoining, State, fresh, returning
from koord.runtime.transports.transport import Transport
from koord.runtime.wire.codec import Channel
from koord.runtime.wire.frames import Drop, run_key

#: How long a robot that cannot write its journal waits before it tries again.
_AGAIN_S = 0.5


class Entrance:
    """A robot on its way into a run, with its journal. Once it is in, it has a ``peer`` there."""

    def __init__(
        self, job: Job, pid: int, transport: Transport, clock: Clock, make: Make, untold: Untold
    ) -> None:
        """Make the robot, and read its journal. Raises CannotTakePartError."""
        self.peer: Peer | None = None  #: None: it is in no run yet
        self.run_id = NO_RUN
        self.remarks: list[str] = []
        self._job, self._pid, self._make = job, pid, make
        self._transport, self._clock, self._untold = transport, clock, untold
        self._is_back = False  #: with its journal
        self._has_started_again = False
        self._new_member()
        self._journal = job.journal(pid)
        kept = self._recollected()
        self.joining = Joining(
            job.party(pid), transport, clock, NO_RUN if kept is None else kept.entered.run
        )
        self._pending: Callable[[], None] | None = None
        if kept is not None:
            self._pending = partial(self._come_back, kept)
        self._pending_at = clock()

    def _new_member(self) -> None:
        """Make the robot, as it is before its first round."""
        job, pid = self._job, self._pid
        self.member = member = self._make(job, pid)
        member.seen = partial(self._untold.saw, member)
        member.tells_states = self._untold.keeps_states
        if job.watched is not None:
            member.watch(job.watched, len(job.classes))
            member.is_alone = not job.is_local
        self._setup = Setup(
            job.robots,
            Timing.of(job.pace_s, job.robots, job.unhurried_s),
            owing=job.owing,
            rounds=job.rounds,
            first=job.configuration.leader,
            decide=member.decided,
        )

    def look(self, wait_s: float) -> None:
        """Hear who is there and enter no run, in so much time. (P-PREFLIGHT)"""
        self._drop(self.joining.look(wait_s))

    def turn(self, wait_s: float) -> None:
        """Take the next step of the handshake, in so much time. Raises CannotTakePartError."""
        peer = self.peer
        if self._pending is not None:
            self._try(self._pending)
        elif peer is None:
            self._drop(self.joining.turn(wait_s))
        elif self._is_back and peer.node.state.holding is not None:
            self.joining.wake()
        ending = self.joining.ending
        if ending is None or not (peer is None or self._is_back):
            return
        self.joining.ending = None
        if isinstance(ending, TurnedAway):
            raise self._turned_away(ending)
        self._try(partial(self._enter, ending))

    def _recollected(self) -> Recollection | None:
        """What the journal says, if it is of this program and can be used.

        Raises CannotTakePartError.
        """
        journal = self._journal
        if journal is None:
            return None
        try:
            kept = journal.read()
        except DamagedError as error:
            self.remarks.append(f"its journal is damaged: {error}")
            return None
        except InUseError:
            story = f"another process is robot {self._pid}, and has its journal in use"
            hint = "stop it first, or say another --pid"
            raise CannotTakePartError(story, hint, str(journal.path)) from None
        except OSError as error:
            story = f"the journal cannot be read: {error.strerror}"
            hint = "say another folder with --state, or make it readable"
            raise CannotTakePartError(story, hint, str(journal.path)) from None
        if kept is None or self._job.insists:
            return None
        entered = kept.entered
        program, _, key = entered.fingerprint.partition(" ")
        here, _, key_here = self._print.partition(" ")
        if (entered.pid, program) != (self._pid, here):
            self.remarks.append("its journal is of another program or robot: not used")
        elif key != key_here:
            self.remarks.append("its journal is of a run with another key: not used")
        else:
            return kept
        return None

    @property
    def _print(self) -> str:
        """What a journal has to be of: the program, and the key, if it outlasts this process."""
        return f"{text_digest(repr(self._job.fingerprint), 16)} {self._job.key_print}"

    def _come_back(self, kept: Recollection) -> None:
        """Go on with the run of the journal. (R-RESUME)"""
        assert self._journal is not None
        self.member.run = kept.entered.run
        try:
            state, start = come_back(self._setup, self.member, self._journal, kept)
        except DamagedError as error:
            self.remarks.append(f"its journal is damaged: {error}")
            self._new_member()
            self.joining = Joining(self.joining.party, self._transport, self._clock)
            return
        self.joining.nonces = kept.entered.nonces
        self.joining.higher = self._start_again
        self._is_back = True
        self._begin(kept.entered.run, state, start)

    def _enter(self, ending: Enter | EnterLate) -> None:
        """Enter a run: from its beginning, or as one that has lost its journal."""
        start, incarnation = 1, FIRST_INCARNATION
        nonces: tuple[bytes, ...] = ()
        match ending:
            case Enter(run=run, nonces=roll):
                nonces = roll
                state = fresh(self._setup, self._pid)
            case EnterLate(run=run):
                self._set_aside()
                self.member.mute = True
                start = ending.start + 1
                drawn_ = int.from_bytes(self.joining.party.nonce, "big")
                incarnation = incarnation_above(ending.incarnation, drawn_)
                state = returning(self._setup, self._pid, incarnation)
        self.member.run = run
        entered = Entered(run, self._pid, self._print, incarnation, nonces)
        enter(self.member, self._journal, entered, start)
        self._begin(run, state, start)

    def _set_aside(self) -> None:
        """Make room for another run than that of the journal. (R-LATE)"""
        if self._journal is not None:
            self._journal.set_aside()
        if self._is_back:
            self.remarks.append("its journal is of another run: set aside")
            self._is_back = False
            self._new_member()

    def _begin(self, run: bytes, state: State, start: int) -> None:
        job = self._job
        self.run_id = run
        key = run_key(job.key, run)
        channel = Channel(key, job.robots, self._pid, start, job.encrypts)
        self.peer = peer = Peer(
            channel, self._setup, state, self.member, self._transport, self._clock
        )
        peer.on_handshake = lambda datagram: self.joining.answer(datagram, self._known)
        peer.on_beacon = self._hear
        peer.start()
        self.joining.say_roll()

    def _hear(self, sender: int, beacon: Beacon) -> None:
        now_s = self._clock()
        self.member.host.hear(sender, beacon, now_s)
        if not self._job.is_local:  # nobody else tells of that robot here
            self._untold.was_at(sender, beacon, now_s)

    def _known(self, robot: int) -> tuple[Known, float | None] | None:
        """What this robot knows of another, and when it was heard. (R-RUNNING)"""
        peer = self.peer
        if peer is None or isinstance(peer.node.state.office, Rejoining):
            return None
        known = Known(peer.node.state.roster[robot], peer.start_of(robot), is_heard=False)
        return known, peer.heard_at.get(robot)

    def _start_again(self, heard: int) -> None:
        """Go on with a higher start than one that was heard. (R-START)

        The first time it may be of this very number, from before the disk was an old one; later it
        is what this process itself has said.
        """
        peer = self.peer
        if peer is None or heard < peer.start_number + self._has_started_again:
            return
        self._has_started_again = True
        if self._journal is not None:
            with suppress(OSError):  # the next start takes one above it all the same
                self._journal.add(Start(heard + 1))
        peer.start_again(heard + 1)

    def _drop(self, datagrams: list[bytes]) -> None:
        """Count what is of runs while this robot is in none: what matters is said again."""
        if datagrams:
            self.joining.drops[Drop.NO_RUN] += len(datagrams)

    def _try(self, action: Callable[[], None]) -> None:
        """Enter a run; if the journal cannot be written, try again later. (R-SAVE)"""
        now = self._clock()
        if now < self._pending_at:
            self._drop(self.joining.others(min(REPORT_S / 4, self._pending_at - now)))
            return
        try:
            action()
        except OSError as error:
            self._pending, self._pending_at = action, now + _AGAIN_S
            self.member.unwritable = error.strerror or str(error)
        else:
            self._pending, self.member.unwritable = None, None

    def _turned_away(self, ending: TurnedAway) -> CannotTakePartError:
        if ending.fingerprint is None:
            return CannotTakePartError(
                f"robot {self._pid} is to begin a new run, and the others are in one",
                "leave --fresh out: the robot then joins their run; or start all robots again",
            )
        what = "; ".join(differing(self._job.fingerprint, ending.fingerprint))
        return CannotTakePartError(
            f"robot {self._pid} runs something else than robot {ending.by}: {what}",
            "give all robots the same program, params, configuration and version of koord",
        )

    def close(self) -> None:
        """Let go of the journal."""
        if self._journal is not None:
            self._journal.close()
