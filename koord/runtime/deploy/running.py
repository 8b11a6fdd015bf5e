"""The loop of a deployed robot, until its run is over or it is told to stop."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from functools import partial
from hashlib import blake2b
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.buffers import Written
from koord.runtime.compile.watching import Watched
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.deploy.ideal import IdealHost
from koord.runtime.deploy.joining import Joining, drawn
from koord.runtime.deploy.journal import (
    DamagedError,
    Entered,
    InUseError,
    Journal,
    Recollection,
    Start,
)
from koord.runtime.deploy.looking import SETTLING_S, Lookout, fleet_checks
from koord.runtime.deploy.member import LANDING_S, DivergedError, Member, Platform
from koord.runtime.deploy.preflight import Check
from koord.runtime.deploy.resuming import come_back, enter
from koord.runtime.deploy.status import RobotReport, Tally, added, gathering, status_of
from koord.runtime.deploy.watching import RobotState
from koord.runtime.drivers.frames import LEVEL, Quaternion
from koord.runtime.encoding import text_digest
from koord.runtime.guardian.events import Order
from koord.runtime.motion.world import Point
from koord.runtime.node import Clock, Peer
from koord.runtime.orders.hearing import Body, Hearer, Obeyed
from koord.runtime.proposals import INIT_ROUND, Admitted
from koord.runtime.protocol.events import Reason
from koord.runtime.protocol.handshake import (
    NO_RUN,
    Enter,
    EnterLate,
    Fingerprint,
    Known,
    Party,
    TurnedAway,
    differing,
)
from koord.runtime.protocol.messages import FIRST_INCARNATION, Beacon, LogEntry, incarnation_above
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import Rejoining, State, fresh, returning
from koord.runtime.robot import Robot
from koord.runtime.shapes import ShapeError
from koord.runtime.transports.transport import Transport
from koord.runtime.wire.codec import Channel
from koord.runtime.wire.frames import Drop, fleet_key, order_key, run_key
from koord.syntax.diagnostics import Diagnostic
from koord.version import __version__

#: How often a robot says how it is doing.
REPORT_S = 0.25

#: How often it notes where it is, if anybody wants to know.
POSE_S = 0.1

#: How long a robot stays to answer others after its last round, in rounds.
LINGERING = 8


#: A vehicle that could not be told to stop is told again after so long.
_RETRY_S = 0.05

#: How long a robot that cannot write its journal waits before it tries again.
_AGAIN_S = 0.5


class CannotTakePartError(Exception):
    """Raised where a robot cannot take part in a run, with a cure. (R-NAME)

    ``file`` is the journal, if that is why.
    """

    def __init__(self, message: str, hint: str, file: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.file = file

    def __reduce__(self) -> tuple[type[CannotTakePartError], tuple[str, str, str]]:
        return type(self), (self.message, self.hint, self.file)


def print_of(key: bytes, run: str) -> str:
    """A digest by which a key is known again, in runs of this name."""
    return blake2b(b"journal", key=fleet_key(key, run), digest_size=16).hexdigest()


class Job(Struct, frozen=True):
    """A run, as all of its robots know it."""

    classes: tuple[type[Robot], ...]
    kinds: tuple[int, ...]
    configuration: RunConfiguration
    key: bytes
    run: str
    delta_s: float
    pace_s: float  #: how often rounds begin: δ, or 0 for as fast as it goes
    rounds: int | None
    journals: Path | None  #: the folder of the robots' journals
    unhurried_s: float = 0.1  #: as long as rounds are, for who waits, if they have no pace
    starts: Mapping[tuple[int | None, str], Any] = {}  #: by robot and attribute, if any are assumed
    program: Fingerprint = ()  #: what the robots run, by name, as texts
    insists: bool = False  #: on a new run, whatever journals say
    key_print: str = ""  #: of a key that outlasts this process: journals of others do not count
    warnings: tuple[Diagnostic, ...] = ()  #: of the key
    waits: bool = False  #: for people, who look at robots before anything is armed (P-PREFLIGHT)
    is_local: bool = False  #: all robots are processes of one machine
    platforms: Callable[[Job, int], Platform] | None = None  #: None: all robots are ideal points
    watched: Watched | None = None  #: the claims that are watched

    def platform(self, pid: int) -> Platform:
        """Make the platform of a robot. Raises CannotTakePartError."""
        return ideal_host(self, pid) if self.platforms is None else self.platforms(self, pid)

    def program_of(self, pid: int) -> type[Robot]:
        """The compiled program of a robot."""
        return self.classes[self.kinds[pid]]

    @property
    def robots(self) -> int:
        return len(self.kinds)

    @property
    def owing(self) -> frozenset[int]:
        """The robots whose programs oblige them to be heard in every round. [SKIP] (R-OWED)"""
        return frozenset(pid for pid, kind in enumerate(self.kinds) if self.classes[kind].owes())

    @property
    def encrypts(self) -> bool:
        """Whether what robots say is encrypted."""
        return self.configuration.talk.encrypts

    @property
    def fingerprint(self) -> Fingerprint:
        """What all robots have to have in common. (R-JOIN)"""
        several = len(self.classes) > 1  # else the name of the only kind is the file's
        names = ", ".join(self.classes[kind].__name__ for kind in self.kinds) if several else ""
        return (
            ("koord", __version__),
            *self.program,
            ("robots", f"{self.robots} ({names})" if several else str(self.robots)),
            ("delta", f"{self.delta_s:g} s"),
            ("pace", f"{self.pace_s:g} s"),
            ("rounds", "no end" if self.rounds is None else str(self.rounds)),
            ("leader_pid", str(self.configuration.leader)),
            ("encryption", "on" if self.encrypts else "off"),
            *((("starts", self._starts_digest),) if self.starts else ()),
        )

    @property
    def _starts_digest(self) -> str:
        text = repr(sorted(self.starts.items(), key=repr))
        return text_digest(text, 8)

    def party(self, pid: int) -> Party:
        """A robot's part in the handshake, at a new start."""
        key = fleet_key(self.key, self.run)
        leader = self.configuration.leader
        return Party(
            pid,
            self.robots,
            leader,
            drawn(),
            self.fingerprint,
            key,
            self.insists,
            self.encrypts,
        )

    def journal(self, pid: int) -> Journal | None:
        """The journal of a robot, or None."""
        if self.journals is None:
            return None
        name = text_digest(self.run, 6)
        return Journal(self.journals / f"{name}-{pid}.journal", syncs=not self.is_local)


class RoundReport(Struct, frozen=True):
    """The report of a robot on one round: its event, position, output and delay."""

    pid: int
    round: int
    event: str | None
    position: tuple[float, float, float]
    output: tuple[Written, ...]
    late: bool
    took_s: float
    at_s: float = 0.0  #: of the robot's clock
    state: RobotState | None = None  #: when the round began, if that is to be told
    told: Any = None  #: what the robot tells besides (:attr:`Member.tell`)


class PoseReport(Struct, frozen=True):
    """The report of a robot on where it was."""

    pid: int
    at_s: float  #: of the robot's clock
    position: Point
    attitude: Quaternion
    path: tuple[Point, ...] | None = None  #: that it follows; None: the same as before


class News(Struct, frozen=True):
    """What a robot tells: how it is doing, its rounds and where it was since it told last."""

    status: RobotReport
    rounds: tuple[RoundReport, ...] = ()
    poses: tuple[PoseReport, ...] = ()


def member_of(job: Job, pid: int) -> Member:
    """Make a robot on its platform. Raises CannotTakePartError."""
    host = job.platform(pid)
    return Member(job.program_of(pid)(pid, job.kinds, job.delta_s, host), host)


def ideal_host(job: Job, pid: int) -> IdealHost:
    """Make the host of a robot without a platform."""
    place = job.configuration.robots[pid]
    return IdealHost(
        job.program_of(pid),
        pid,
        job.robots,
        job.delta_s,
        job.configuration.seed,
        place.position,
        place.vehicle.speed_mps,
        job.configuration.world,
        job.starts,
    )


#: Makes a robot of a run.
Make = Callable[[Job, int], Member]


def described(error: Exception) -> str:
    """An error that nobody expected, in a line, with its place."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"


class Runner:
    """A robot of a run. ``report`` gets its status now and then, ``seen`` each of its rounds."""

    def __init__(
        self,
        job: Job,
        pid: int,
        transport: Transport,
        clock: Clock = time.monotonic,
        make: Make = member_of,
    ) -> None:
        self.job = job
        self.tally = Tally()
        self.keeps_rounds = False
        self.keeps_poses = False
        self._rounds: list[RoundReport] = []  #: not yet told to anyone
        self._poses: list[PoseReport] = []
        self._pose_due_s = -math.inf
        self._path: tuple[Point, ...] = ()
        self.trouble: str | None = None  #: why it had to stop
        self.peer: Peer | None = None  #: None: it is in no run yet
        self.run_id = NO_RUN
        self._pid = pid
        self._transport = transport
        self._clock = clock
        self._committed_at: float | None = None
        self._make = make
        self._is_back = False  #: with its journal
        self._has_started_again = False
        self._remarks: list[str] = []
        self._new_member()
        self._journal = job.journal(pid)
        self._waits = job.waits
        self._begun_at = clock()
        self._due_at: float | None = None  #: when the platform's next tick was due
        self._late_s = 0.0
        kept = self._recollected()
        party, run = job.party(pid), NO_RUN if kept is None else kept.entered.run
        self.joining = Joining(party, transport, clock, run)
        self._pending: Callable[[], None] | None = None
        if kept is not None:
            self._pending = partial(self._come_back, kept)
        self._pending_at = clock()
        channel = Channel(order_key(job.key), job.robots, pid, encrypts=job.encrypts)
        self.hearer = Hearer(channel, Body(self._obey, self._state), clock, time.time)

    def _new_member(self) -> None:
        """Make the robot, as it is before its first round."""
        job, pid = self.job, self._pid
        self.member = self._make(job, pid)
        self.member.seen = self._saw
        if job.watched is not None:
            self.member.watch(job.watched, len(job.classes))
            self.member.is_alone = not job.is_local
        self._setup = Setup(
            job.robots,
            Timing.of(job.pace_s, job.robots, job.unhurried_s),
            owing=job.owing,
            rounds=job.rounds,
            first=job.configuration.leader,
            decide=self.member.decided,
        )

    # --- the way into a run ---------------------------------------------------------------------

    def _recollected(self) -> Recollection | None:
        """What the journal says, if it is of this program and can be used.

        Raises CannotTakePartError.
        """
        journal = self._journal
        if journal is None:
            return None
        try:
            kept = journal.read()
            if kept is None or self.job.insists:
                return None
            entered = kept.entered
            program, _, key = entered.fingerprint.partition(" ")
            here, _, key_here = self._print.partition(" ")
            if (entered.pid, program) != (self._pid, here):
                self._remarks.append("its journal is of another program or robot: not used")
                return None
            if key != key_here:
                self._remarks.append("its journal is of a run with another key: not used")
                return None
        except DamagedError as error:
            self._remarks.append(f"its journal is damaged: {error}")
            return None
        except InUseError:
            story = f"another process is robot {self._pid}, and has its journal in use"
            hint = "stop it first, or say another --pid"
            raise CannotTakePartError(story, hint, str(journal.path)) from None
        except OSError as error:
            story = f"the journal cannot be read: {error.strerror}"
            hint = "say another folder with --state, or make it readable"
            raise CannotTakePartError(story, hint, str(journal.path)) from None
        return kept

    @property
    def _print(self) -> str:
        """What a journal has to be of: the program, and the key, if it outlasts this process."""
        return f"{text_digest(repr(self.job.fingerprint), 16)} {self.job.key_print}"

    def _come_back(self, kept: Recollection) -> None:
        """Go on with the run of the journal. (R-RESUME)"""
        assert self._journal is not None
        self.member.run = kept.entered.run
        try:
            state, start = come_back(self._setup, self.member, self._journal, kept)
        except DamagedError as error:
            self._remarks.append(f"its journal is damaged: {error}")
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
            self._remarks.append("its journal is of another run: set aside")
            self._is_back = False
            self._new_member()

    def _begin(self, run: bytes, state: State, start: int) -> None:
        job = self.job
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
        if self.keeps_poses and not self.job.is_local:  # nobody else tells of that robot here
            here = PoseReport(sender, now_s - beacon.age_s, beacon.position_m, LEVEL)
            self._poses.append(here)

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

    def _join(self, wait_s: float) -> None:
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
        what = "; ".join(differing(self.job.fingerprint, ending.fingerprint))
        return CannotTakePartError(
            f"robot {self._pid} runs something else than robot {ending.by}: {what}",
            "give all robots the same program, params, configuration and version of koord",
        )

    def _saw(self, entry: LogEntry, kept: Admitted | None) -> None:
        pid, tally, now = self.member.robot.pid, self.tally, self._clock()
        late = pid in entry.late
        took_s = 0.0
        if entry.round != INIT_ROUND:
            tally.ran += kept is not None
            tally.skipped += kept is None
            tally.late += late
            if self._committed_at is not None:
                took_s = now - self._committed_at
                tally.longest_s = max(tally.longest_s, took_s)
                tally.took_s += took_s
                tally.overdue += took_s > 1.5 * self.job.pace_s > 0
        self._committed_at = now
        if self.keeps_rounds:
            event = None if kept is None or kept.event is None else kept.event
            name = None if event is None else self.member.robot.EVENTS[event].name
            output = tuple(self.member.output)
            position = self.member.host.position
            told, state = self.member.tell(entry), self.member.state
            self.member.state = None
            self._rounds.append(
                RoundReport(
                    pid, entry.round, name, position, output, late, took_s, now, state, told
                )
            )
        self.member.output.clear()

    @property
    def status(self) -> RobotReport:
        if self.peer is None:
            status = gathering(self._pid, self.joining.missing())
        else:
            status = status_of(self.peer, self.member, self.tally)
        joining = ((drop.value, n) for drop, n in self.joining.drops.items())
        crowded = self._transport.dropped
        orders = ((drop.value, n) for drop, n in self.hearer.drops.items())
        crowds = [(Drop.CROWDED.value, crowded)] if crowded else []
        drops = added(status.drops, joining, orders, crowds)
        notes = (*self._remarks, *self.joining.notes, *self.member.host.remarks)
        if self.member.unwritable is not None:
            status = replace(status, holding=Reason.UNWRITABLE)
            notes = (*notes, f"its journal cannot be written: {self.member.unwritable}")
        return replace(
            status,
            trouble=self.trouble,
            notes=notes,
            checks=self._checks(),
            run=self.run_id.hex()[:8],
            drops=tuple(drops.items()),
        )

    def news(self) -> News:
        """What is new since the last call."""
        rounds, poses = tuple(self._rounds), tuple(self._poses)
        self._rounds.clear()
        self._poses.clear()
        return News(self.status, rounds, poses)

    def run(
        self, is_told_to_stop: Callable[[], bool], report: Callable[[News], None]
    ) -> RobotReport:
        """Run until the run is over, all robots have stopped, or the robot is told to stop.

        Raises CannotTakePartError.
        """
        next_report = self._clock()
        leave_at: float | None = None
        while True:
            try:
                self.step()
            except CannotTakePartError:
                self._stop()
                raise
            except (DivergedError, ShapeError) as error:
                self.trouble = str(error)
                break
            except Exception as error:  # whatever it is: the robot stops safely, and tells
                self.trouble = described(error)
                break
            now = self._clock()
            if now >= next_report:
                next_report = now + REPORT_S
                report(self.news())
                if is_told_to_stop():
                    break
            if leave_at is None and (self._is_over or self.member.all_stopped):
                leave_at = now + max(LINGERING * self.job.delta_s, 0.5)
            if leave_at is not None and now >= leave_at:
                self.member.forget()
                break
        if self.trouble is None:
            self.member.finish()
        self._stop()
        return self.status

    def step(self) -> None:
        """Take a step: of the handshake, or of the run. Raises CannotTakePartError."""
        wait_s = self._tick()
        if self._waits:
            self._drop(self.joining.look(wait_s))
            return
        self._join(wait_s)
        if self.peer is not None:
            self.peer.turn(wait_s)

    def go(self) -> None:
        """Take part in the run: people have looked at the robot. (P-PREFLIGHT)"""
        self._waits = False

    def _checks(self) -> tuple[Check, ...]:
        if not self._waits:
            return ()
        now = self._clock()
        since_s = now - self._begun_at
        looked = Lookout(since_s, self._late_s, self.joining, self.hearer, now)
        return (*fleet_checks(looked), *self.member.host.checks())

    def _heed(self) -> None:
        """Hear what people say, whatever state the robot is in. (O-BESIDE) (O-AT-ONCE)"""
        for visit in self._transport.visits():
            answer = self.hearer.hear(visit.datagram)
            if answer is not None:
                visit.answer(answer)
        if self.hearer.alive_at_s is not None:
            self.member.host.alive(self.hearer.alive_at_s)

    def _obey(self, order: Order) -> Obeyed:
        return self.member.host.order(order, self._clock())

    def _state(self) -> str:
        return self.member.host.state

    def _tick(self) -> float:
        """Let the platform take its step; return how long there is until the next, at most."""
        self._heed()
        now, at = self._clock(), self._committed_at
        age_s = None if at is None else now - at
        host = self.member.host
        if self._due_at is not None and now - self._begun_at > SETTLING_S / 2:
            self._late_s = max(self._late_s, now - self._due_at)
        due_s = self._due_at = host.tick(now, age_s, self.member.holding)
        if self.keeps_poses:
            self._note_pose(now)
        beacon = None if self.peer is None else host.beacon(self._clock())
        if beacon is not None and self.peer is not None:
            self.peer.tell(beacon)
        return min(REPORT_S / 4, max(0.0, due_s - self._clock()))

    def _note_pose(self, now_s: float) -> None:
        """Note where the robot is, now and then."""
        if now_s < self._pose_due_s:
            return
        self._pose_due_s = now_s + POSE_S
        platform = self.member.host
        path = platform.path
        new = None if path == self._path else path
        self._path = path
        pid = self.member.robot.pid
        self._poses.append(PoseReport(pid, now_s, platform.position, platform.attitude, new))

    @property
    def _is_over(self) -> bool:
        return self.peer is not None and self.peer.node.over

    def _stop(self) -> None:
        """Come to a safe stop: nobody will tell the robot to go on. (P-START) (P-LAST-STOP)"""
        host = self.member.host
        host.holding = True
        end_s = self._clock() + LANDING_S
        is_told = False
        while self._clock() < end_s:
            try:
                if not is_told:
                    host.stop(self._clock())
                    is_told = True
                if host.is_at_rest:
                    break
                wait_s = self._tick()
            except Exception as error:  # the next tick may get through
                self.trouble = self.trouble or described(error)
                wait_s = _RETRY_S
            self._transport.receive(wait_s)
        with ExitStack() as stack:  # whatever one of them raises, the others are closed
            if self._journal is not None:
                stack.callback(self._journal.close)
            stack.callback(self._transport.close)
            stack.callback(self._let_go)

    def _let_go(self) -> None:
        try:
            self.member.host.close()
        except Exception as error:  # whatever a driver does at its end
            self.trouble = self.trouble or described(error)
