"""What a robot of a run tells, a few times a second: how it is doing, its rounds, where it was."""

from __future__ import annotations

import math
from typing import Any

from msgspec import Struct

from koord.runtime.buffers import Written
from koord.runtime.deploy.member import Member, Platform
from koord.runtime.deploy.status import RobotReport, Tally
from koord.runtime.deploy.watching import LastingState, RobotState
from koord.runtime.drivers.frames import LEVEL, Quaternion
from koord.runtime.motion.world import Point
from koord.runtime.node import Clock
from koord.runtime.proposals import INIT_ROUND, Admitted
from koord.runtime.protocol.messages import Beacon, LogEntry

#: How often a robot says how it is doing.
REPORT_S = 0.25

#: How often it notes where it is, if anybody wants to know.
POSE_S = 0.1


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
    """What a robot tells: how it is doing, its rounds and where it was since it told last.

    Where nobody wants its rounds there are its ``states`` alone.
    """

    status: RobotReport
    rounds: tuple[RoundReport, ...] = ()
    poses: tuple[PoseReport, ...] = ()
    states: tuple[LastingState, ...] = ()


class Kept(Struct, frozen=True):
    """What somebody wants to be told of a robot, besides how it is doing."""

    rounds: bool = False  #: all about them, the states when they began, too
    states: bool = False  #: those alone
    poses: bool = False  #: where it is


class Untold:
    """What a robot has seen and has not told yet, and what it has counted."""

    def __init__(self, clock: Clock, pace_s: float, keeps: Kept) -> None:
        self.tally = Tally()
        self.keeps_states = keeps.rounds or keeps.states
        self.keeps_poses = keeps.poses
        self._keeps_rounds = keeps.rounds
        self.committed_at: float | None = None  #: when its last round was
        self._clock = clock
        self._pace_s = pace_s
        self._rounds: list[RoundReport] = []
        self._states: list[LastingState] = []
        self._poses: list[PoseReport] = []
        self._pose_due_s = -math.inf
        self._path: tuple[Point, ...] = ()

    def news(self, status: RobotReport) -> News:
        """What is new since the last call."""
        news = News(status, tuple(self._rounds), tuple(self._poses), tuple(self._states))
        self._rounds.clear()
        self._poses.clear()
        self._states.clear()
        return news

    def saw(self, member: Member, entry: LogEntry, kept: Admitted | None) -> None:
        """Note a round of the robot, now that it has acted on it."""
        pid, now_s = member.robot.pid, self._clock()
        late = pid in entry.late
        took_s = 0.0
        if entry.round != INIT_ROUND:
            took_s = self._count(now_s, is_in=kept is not None, late=late)
        self.committed_at = now_s
        if self._keeps_rounds:
            event = None if kept is None or kept.event is None else kept.event
            name = None if event is None else member.robot.EVENTS[event].name
            output = tuple(member.output)
            position = member.host.position
            told, state = member.tell(entry), member.state
            member.state = None
            self._rounds.append(
                RoundReport(
                    pid, entry.round, name, position, output, late, took_s, now_s, state, told
                )
            )
        elif member.state is not None:
            self._note(member.state)
            member.state = None
        member.output.clear()

    def _note(self, state: RobotState) -> None:
        """Note the state in which a round began."""
        if not (self._states and self._states[-1].goes_on_with(state)):
            self._states.append(LastingState(state))

    def _count(self, now_s: float, *, is_in: bool, late: bool) -> float:
        """Count a round; return how long it took."""
        tally = self.tally
        tally.ran += is_in
        tally.skipped += not is_in
        tally.late += late
        if self.committed_at is None:
            return 0.0
        took_s = now_s - self.committed_at
        tally.longest_s = max(tally.longest_s, took_s)
        tally.took_s += took_s
        tally.overdue += took_s > 1.5 * self._pace_s > 0
        return took_s

    def is_at(self, pid: int, platform: Platform, now_s: float) -> None:
        """Note where the robot is, now and then."""
        if not self.keeps_poses or now_s < self._pose_due_s:
            return
        self._pose_due_s = now_s + POSE_S
        path = platform.path
        new = None if path == self._path else path
        self._path = path
        self._poses.append(PoseReport(pid, now_s, platform.position, platform.attitude, new))

    def was_at(self, pid: int, beacon: Beacon, now_s: float) -> None:
        """Note where another robot says that it was."""
        if self.keeps_poses:
            here = PoseReport(pid, now_s - beacon.age_s, beacon.position_m, LEVEL)
            self._poses.append(here)
