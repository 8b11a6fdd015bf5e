"""Recordings of simulated runs: one type of data, from which all files and pictures are made.

A :class:`Header` says what is known before a run begins; the rest of a :class:`RunLog` grows at its
end only, so that it can be read while the run goes on. A run feeds a :class:`RunLogger`.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from enum import Enum, IntEnum
from typing import NamedTuple

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from koord.runtime.motion.arrays import Floats, bounded, products
from koord.runtime.motion.bodies import Look
from koord.runtime.motion.world import Point, World
from koord.runtime.proposals import Plain
from koord.runtime.shapes import Array, Enumeration, Mapping, Scalar, ScalarKind, Shape

#: Positions in metres and headings in radians, as they are kept.
Pose = NDArray[np.float32]
#: What robots did in a round: the number of the event, or one of :class:`Idle`.
Deeds = NDArray[np.int16]

#: Whose a variable is that no robot has for itself.
SHARED = -1
#: Of a change: the variable as a whole, not one of its elements.
WHOLE = -1

#: So many robots are sampled so often; of more the last counts.
_RATES_S = ((200, 0.1), (2_000, 0.2), (math.inf, 1.0))

#: The variables of so many robots are kept in every round; those of more so often that it is as if
#: so many robots kept theirs once a second. Else a recording would be larger than the run.
_FEW, _KEPT_PER_S = 100, 1_000


class LoggedHome(Enum):
    """The homes of a program's variables."""

    ALLREAD = "allread"
    ALLWRITE = "allwrite"
    LOCAL = "local"
    SENSOR = "sensor"
    ACTUATOR = "actuator"


class Idle(IntEnum):
    """The kinds of idleness of a robot that ran no event in a round."""

    SKIPPED = -1  #: nothing was enabled, or it was not willing
    BLOCKED = -2  #: it had an event to run, and another robot was in its lock class
    STOPPED = -3


class TaskState(IntEnum):
    """The states of a task."""

    OPEN = 0
    ASSIGNED = 1
    DONE = 2


class LoggedRobot(Struct, frozen=True):
    """A robot's appearance. ``agent`` is the position of its kind in ``Header.agents``."""

    name: str
    agent: int
    device: str
    look: Look
    radius_m: float
    length_m: float
    width_m: float
    middle_m: float = 0.0  #: from its position forward to its middle


class LoggedVariable(Struct, frozen=True):
    """A variable; changes name it by its position."""

    name: str
    home: LoggedHome
    shape: Shape


class LoggedAgent(Struct, frozen=True):
    """A kind of robot of the program: its events and its own variables, by position."""

    name: str
    events: tuple[str, ...]
    variables: tuple[LoggedVariable, ...]


class Header(Struct, frozen=True):
    """The data of a run that are known before it begins."""

    program: str  #: its file's name
    text: str
    delta_s: float
    seed: int
    world: World
    agents: tuple[LoggedAgent, ...]
    robots: tuple[LoggedRobot, ...]
    shared: tuple[LoggedVariable, ...]
    safety_m: float = 0.0  #: no two robots are to come nearer to each other; 0: not said
    visit_m: float = 0.2  #: a robot so near to a task is there
    differing: tuple[str, ...] = ()  #: each value that is not the text's, in words

    @property
    def sample_s(self) -> float:
        """The interval in seconds at which poses are recorded."""
        return next(rate for most, rate in _RATES_S if len(self.robots) <= most)

    @property
    def tilting(self) -> tuple[int, ...]:
        """The robots that tilt as they move."""
        return tuple(k for k, robot in enumerate(self.robots) if robot.look.tilts)

    @property
    def values_s(self) -> float:
        """The interval in seconds at which changes of variables are recorded; 0: every round."""
        count = len(self.robots)
        return 0.0 if count <= _FEW else count / _KEPT_PER_S


class LoggedChange(NamedTuple):
    """A new value of a variable, or of one element of it (``part``)."""

    robot: int  #: or SHARED
    variable: int
    part: int  #: or WHOLE
    value: Plain


class LoggedOutput(NamedTuple):
    """A robot's output to a stream."""

    robot: int
    stream: str
    text: str


class LoggedRound(Struct, frozen=True):
    """A round as robots saw it after its events; round -1 is INIT.

    ``changes`` are since the last round in which any were looked for.
    """

    number: int
    time_s: float
    deeds: Deeds
    changes: tuple[LoggedChange, ...]
    said: tuple[LoggedOutput, ...] = ()


class LoggedPath(NamedTuple):
    """A robot's new path, shape ``(k, 3)``; an empty one: it has none any more."""

    time_s: float
    robot: int
    points: Pose


class TaskChange(Struct, frozen=True):
    """A new state of a task."""

    time_s: float
    task: int
    state: TaskState
    robot: int


class LoggedViolation(Struct, frozen=True):
    """A claim that the run violated."""

    time_s: float
    claim: str
    words: str
    robots: tuple[int, ...] = ()
    place: Point | None = None


class Still(NamedTuple):
    """A robot that stands still although it has a goal: since when, and why."""

    time_s: float
    robot: int
    since_s: float
    words: str


class Declared(Struct, frozen=True):
    """The variables that a program has, by their numbers: shared ones, and those of each agent."""

    shared: tuple[int, ...]
    agents: tuple[tuple[int, ...], ...]


class LoggedReload(Struct, frozen=True):
    """A change of the program between two rounds, or an edit that was refused. [RELOAD]

    ``number`` is that of the next round. ``text`` is the new one; None: the edit was refused, and
    ``words`` say why. Else they say what was not kept.
    """

    number: int
    time_s: float
    text: str | None
    words: tuple[str, ...]
    had: Declared
    has: Declared


def changed_words(notes: tuple[str, ...]) -> str:
    """A change of the program in words, with what was not kept."""
    return "; ".join(("the program has changed", *notes))


def reload_words(entry: LoggedReload) -> str:
    """A change of the program in words, or why an edit was refused."""
    if entry.text is None:
        return "\n".join(
            ("the edited program is refused, and the one before goes on:", *entry.words)
        )
    return changed_words(entry.words)


class LogSizes(NamedTuple):
    """A point in a recording: the number of entries of each kind."""

    times: int = 0
    rounds: int = 0
    paths: int = 0
    tasks: int = 0
    violations: int = 0
    still: int = 0
    reloads: int = 0
    ended: bool = False  #: whether that is all of it


class RunLog(Struct):
    """The recording of a run. It grows at its end only; entries never change.

    Nor do numbers of variables and events: where the program changes, the header is replaced by one
    that has more of them behind its own.
    """

    header: Header
    times_s: array[float] = field(default_factory=lambda: array("d"))
    #: of each time: x, y, z, heading, roll, pitch; shape ``(n, 6)``
    poses: list[Pose] = field(default_factory=list)
    separations_m: array[float] = field(default_factory=lambda: array("f"))  #: of each time, or NaN
    rounds: list[LoggedRound] = field(default_factory=list)
    paths: list[LoggedPath] = field(default_factory=list)
    tasks: list[TaskChange] = field(default_factory=list)
    violations: list[LoggedViolation] = field(default_factory=list)
    still: list[Still] = field(default_factory=list)
    reloads: list[LoggedReload] = field(default_factory=list)
    ending: str | None = None  #: how the run ended, in words; None: it has not yet

    def since(self, start: LogSizes) -> RunLog:
        """The part of the recording after a point."""
        return RunLog(
            self.header,
            self.times_s[start.times :],
            self.poses[start.times :],
            self.separations_m[start.times :],
            self.rounds[start.rounds :],
            self.paths[start.paths :],
            self.tasks[start.tasks :],
            self.violations[start.violations :],
            self.still[start.still :],
            self.reloads[start.reloads :],
        )

    @property
    def sizes(self) -> LogSizes:
        """The present end of the recording."""
        return LogSizes(
            len(self.times_s),
            len(self.rounds),
            len(self.paths),
            len(self.tasks),
            len(self.violations),
            len(self.still),
            len(self.reloads),
            self.ending is not None,
        )

    def stacked(self) -> Pose:
        """All poses, shape ``(times, n, 6)``."""
        if not self.poses:
            return np.zeros((0, len(self.header.robots), 6), np.float32)
        return np.stack(self.poses)


#: Half of what roll and pitch are worked out from.
_TILTING = products(((1, 0, 1), (1, 2, 3)), ((1, 1, 1), (1, 2, 2)), ((1, 0, 2), (-1, 1, 3)))


def tilts_of(attitudes: Floats) -> Floats:
    """The roll and pitch of attitudes ``(n, 4)``, w first: ``(n, 2)``, in rad.

    Heading is turned about first, then pitch, then roll.
    """
    double = 2 * _TILTING.of(attitudes.T, attitudes.T)
    tilts = np.empty((len(attitudes), 2))
    tilts[:, 0] = np.arctan2(double[0], 1 - double[1])
    tilts[:, 1] = np.arcsin(bounded(double[2], -1.0, 1.0))
    return tilts


def turns_of(poses: Pose) -> Pose:
    """Poses ``(n, 6)`` as unit quaternions ``(n, 4)``, w first."""
    yaw, roll, pitch = poses[:, 3:].T / 2
    c, s = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    return np.column_stack(
        [
            c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
            c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
            c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
            s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
        ]
    )


def map_variable(header: Header) -> int | None:
    """The shared variable that is a map of the world's cells, if there is one."""
    for number, variable in enumerate(header.shared):
        match variable.shape:
            case Array(element=Enumeration(members=members), size=size):
                if size == header.world.grid.cells and {"unknown", "free"} <= set(members):
                    return number
            case Mapping(key=Scalar(kind=ScalarKind.INT), value=Scalar(kind=ScalarKind.BOOL)):
                return number
            case _:
                pass
    return None


class RunLogger:
    """A recorder, which a run feeds. Times never decrease."""

    def __init__(self, header: Header) -> None:
        self.recording = RunLog(header)
        self.sample_s = header.sample_s  #: the interval of samples
        self.next_s = -math.inf  #: when the next one is due
        self._tilting = np.array(header.tilting, np.int64)

    def is_due(self, time_s: float) -> bool:
        """Return whether a sample is due; between samples no values need be computed."""
        return time_s >= self.next_s - 1e-9

    def sample(
        self,
        time_s: float,
        positions: Floats,
        yaw: Floats,
        separation_m: float = math.nan,
        tilts: Floats | None = None,
    ) -> None:
        """Record positions ``(n, 3)``, yaw ``(n,)``, and the distance of the nearest two robots.

        ``tilts``, shape ``(k, 2)``, are roll and pitch of the robots that tilt.
        """
        pose = np.zeros((len(positions), 6), np.float32)
        pose[:, :3], pose[:, 3] = positions, yaw
        if tilts is not None and len(tilts) == len(pose):
            pose[:, 4:] = tilts
        elif tilts is not None:
            pose[self._tilting, 4:] = tilts
        self.pose(time_s, pose, separation_m)

    def pose(self, time_s: float, pose: Pose, separation_m: float) -> None:
        """Record poses, shape ``(n, 6)``, as a recording has them. They are nobody else's."""
        recording = self.recording
        recording.poses.append(pose)
        recording.separations_m.append(separation_m)
        recording.times_s.append(time_s)  # last: a reader goes by the number of times
        self.next_s = time_s + self.sample_s

    def round(
        self,
        number: int,
        time_s: float,
        deeds: Deeds,
        changes: Sequence[LoggedChange] = (),
        said: Sequence[LoggedOutput] = (),
    ) -> None:
        """Record a round: the robots' events, and the changes since the last round."""
        done = LoggedRound(number, time_s, deeds, tuple(changes), tuple(said))
        self.recording.rounds.append(done)

    def path(self, time_s: float, robot: int, points: Floats) -> None:
        """Record a robot's new path, shape ``(k, 3)``."""
        self.recording.paths.append(LoggedPath(time_s, robot, points.astype(np.float32)))

    def task(self, time_s: float, task: int, state: TaskState, robot: int) -> None:
        """Record that a task was assigned to a robot, or done by it."""
        self.recording.tasks.append(TaskChange(time_s, task, state, robot))

    def violation(
        self,
        time_s: float,
        claim: str,
        words: str,
        robots: Sequence[int] = (),
        place: Point | None = None,
    ) -> None:
        """Record a violated claim, with robots and place."""
        self.recording.violations.append(
            LoggedViolation(time_s, claim, words, tuple(robots), place)
        )

    def standing(self, time_s: float, robot: int, since_s: float, words: str) -> None:
        """Record a robot that stands still, and why."""
        self.recording.still.append(Still(time_s, robot, since_s, words))

    def reload(self, header: Header, entry: LoggedReload) -> None:
        """Record that the program changed, or did not; ``header`` has its variables and events."""
        self.recording.header = header  # first: a reader goes by the number of entries
        self.recording.reloads.append(entry)

    def end(self, words: str) -> None:
        """Record the reason for the end of the run. Nothing comes after it."""
        self.recording.ending = words
