"""The loop of a deployed robot, until its run is over or it is told to stop."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.buffers import Written
from koord.runtime.configuration.model import RunConfiguration
from koord.runtime.deploy.ideal import IdealHost
from koord.runtime.deploy.journal import Journal
from koord.runtime.deploy.member import DivergedError, Member
from koord.runtime.deploy.status import RobotReport, Tally, status_of
from koord.runtime.node import Clock, Peer
from koord.runtime.proposals import INIT_ROUND, Admitted
from koord.runtime.protocol.messages import LogEntry
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import fresh, returning
from koord.runtime.robot import Robot
from koord.runtime.shapes import ShapeError
from koord.runtime.transports.transport import Transport
from koord.runtime.wire.codec import RunKey

#: How often a robot says how it is doing.
REPORT_S = 0.25

#: How long a robot stays to answer others after its last round, in rounds.
LINGERING = 8


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
    journals: Path | None  #: the folder that robots write down in where they are
    unhurried_s: float = 0.1  #: as long as rounds are, for who waits, if they have no pace
    starts: Mapping[tuple[int | None, str], Any] = {}  #: by robot and attribute, if any are assumed

    @property
    def robots(self) -> int:
        return len(self.kinds)

    @property
    def owing(self) -> frozenset[int]:
        """The robots whose programs oblige them to be heard in every round. [SKIP] (R-OWED)"""
        return frozenset(pid for pid, kind in enumerate(self.kinds) if self.classes[kind].owes())

    @property
    def program(self) -> str:
        """A digest of the program, for journals."""
        text = repr([(c.SOURCE, c.SHARED, dict(c.LOCALS), dict(c.PORTS)) for c in self.classes])
        return blake2b(text.encode(), digest_size=8).hexdigest()

    def journal(self, pid: int) -> Journal | None:
        """The journal of a robot, or None."""
        if self.journals is None:
            return None
        name = blake2b(self.run.encode(), digest_size=6).hexdigest()
        return Journal(self.journals / f"{name}-{pid}.journal")


class RoundReport(Struct, frozen=True):
    """The report of a robot on one round: its event, position, output and delay."""

    pid: int
    round: int
    event: str | None
    position: tuple[float, float, float]
    output: tuple[Written, ...]
    late: bool
    took_s: float
    told: Any = None  #: what the robot tells besides (:attr:`Member.tell`)


def ideal_member(job: Job, pid: int) -> Member:
    """Make a robot without a platform."""
    host = ideal_host(job, pid)
    robot = host.program(pid, job.kinds, job.delta_s, host)
    return Member(robot, host, job.journal(pid), job.program)


def ideal_host(job: Job, pid: int) -> IdealHost:
    """Make the host of a robot without a platform."""
    place = job.configuration.robots[pid]
    return IdealHost(
        job.classes[job.kinds[pid]],
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
        make: Make = ideal_member,
    ) -> None:
        self.job = job
        self.tally = Tally()
        self.moments: list[RoundReport] = []  #: not yet taken by anyone
        self.keeps_moments = False
        self.trouble: str | None = None  #: why it had to stop
        self._clock = clock
        self._committed_at: float | None = None
        self.member = make(job, pid)
        self.member.seen = self._saw
        setup = Setup(
            job.robots,
            Timing.of(job.pace_s, job.robots, job.unhurried_s),
            owing=job.owing,
            rounds=job.rounds,
            first=job.configuration.leader,
            decide=self.member.decided,
        )
        incarnation = time.time_ns()
        journal = job.journal(pid)
        if journal is not None and journal.read() is not None:
            self.member.come_back()
            state = returning(setup, pid, incarnation)
        else:
            state = fresh(setup, pid, incarnation)
        # Robots with another program are of another run: they do not even hear each other.
        run = RunKey(f"{job.run} {job.program} {job.robots}", job.key, job.robots)
        self.peer = Peer(run, setup, state, self.member, transport, clock)

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
        if self.keeps_moments:
            event = None if kept is None or kept.event is None else kept.event
            name = None if event is None else self.member.robot.EVENTS[event].name
            output = tuple(self.member.output)
            position = self.member.host.position
            told = self.member.tell(entry)
            self.moments.append(
                RoundReport(pid, entry.round, name, position, output, late, took_s, told)
            )
        self.member.output.clear()

    @property
    def status(self) -> RobotReport:
        status = status_of(self.peer, self.member, self.tally)
        return replace(status, trouble=self.trouble)

    def run(
        self, is_told_to_stop: Callable[[], bool], report: Callable[[RobotReport], None]
    ) -> RobotReport:
        """Run until the run is over, all robots have stopped, or the robot is told to stop."""
        self.peer.start()
        next_report = self._clock()
        leave_at: float | None = None
        while True:
            try:
                self.peer.turn(REPORT_S / 4)
            except (DivergedError, ShapeError) as error:
                self.trouble = str(error)
                break
            except Exception as error:  # whatever it is: the robot stops safely, and tells
                self.trouble = described(error)
                break
            now = self._clock()
            if now >= next_report:
                next_report = now + REPORT_S
                report(self.status)
                if is_told_to_stop():
                    break
            if leave_at is None and (self.peer.node.over or self.member.all_stopped):
                leave_at = now + max(LINGERING * self.job.delta_s, 0.5)
            if leave_at is not None and now >= leave_at:
                self.member.forget()
                break
        if self.trouble is None:
            self.member.finish()
        self.member.host.holding = True  # a safe stop: nobody will tell it to go on
        self.peer.transport.close()
        return self.status
