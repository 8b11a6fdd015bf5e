"""The hash of a run: who ran which event in each round, and where robots were, to the last bit.

What a simulated run leaves behind: one type of data that all files and pictures are made of.

A :class:`Header` says what is known before a run begins; the rest of a :class:`RunLog` grows at
its end only, so that it can be read while the run goes on. A run feeds a :class:`RunLogger`.
"""

from __future__ import annotations

import hashlib
import math
from array import array
from collections.abc import Sequence
from enum import Enum, IntEnum
from typing import NamedTuple

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from koord.runtime.motion.arrays import Floats, Ints, bounded, products
from koord.runtime.motion.bodies import Look
from koord.runtime.motion.world import Point, World
from koord.runtime.proposals import Decision, Plain
from koord.runtime.shapes import Array, Enumeration, Mapping, Scalar, ScalarKind, Shape

#: Of a robot that skipped, and of one that began.
SKIPPED, BEGAN = -1, -2


def events_of(decision: Decision, robots: int) -> Ints:
    """The position of the event that each robot ran."""
    events = np.full(robots, SKIPPED, np.int64)
    for taken in decision.ran:
        events[taken.robot] = BEGAN if taken.event is None else taken.event
    return events


class Digest:
    """Rounds in order; of each what robots did, and where they were when it was decided."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def note(self, round_: int, events: Ints) -> None:
        """What robots ran in a round, by the position of the event, shape ``(n,)``."""
        self._hash.update(np.int64(round_).tobytes())
        self._hash.update(events.tobytes())

    def place(self, positions: Floats) -> None:
        """Where robots were, shape ``(n, 3)``."""
        self._hash.update(np.ascontiguousarray(positions, dtype=np.float64).tobytes())

    def hexdigest(self) -> str:
        """The hash so far."""
        return self._hash.hexdigest()


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
    """Where a variable of a program lives."""

    ALLREAD = "allread"
    ALLWRITE = "allwrite"
    LOCAL = "local"
    SENSOR = "sensor"
    ACTUATOR = "actuator"


class Idle(IntEnum):
    """What a robot did in a round that ran no event."""

    SKIPPED = -1  #: nothing was enabled, or it was not willing
    BLOCKED = -2  #: it had an event to run, and another robot was in its lock class
    STOPPED = -3


class TaskState(IntEnum):
    """How far a task is."""

    OPEN = 0
    ASSIGNED = 1
    DONE = 2


class LoggedRobot(Struct, frozen=True):
    """A robot as it is drawn. ``agent`` is the position of its kind in ``Header.agents``."""

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
    """A kind of robot of the program: its events and what it has for itself, by position."""

    name: str
    events: tuple[str, ...]
    variables: tuple[LoggedVariable, ...]


class Header(Struct, frozen=True):
    """What is known of a run before it begins."""

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
        """How often poses are kept."""
        return next(rate for most, rate in _RATES_S if len(self.robots) <= most)

    @property
    def tilting(self) -> tuple[int, ...]:
        """The robots that tilt as they move."""
        return tuple(k for k, robot in enumerate(self.robots) if robot.look.tilts)

    @property
    def values_s(self) -> float:
        """How often changes of variables are kept; 0: in every round."""
        count = len(self.robots)
        return 0.0 if count <= _FEW else count / _KEPT_PER_S


class LoggedChange(NamedTuple):
    """A variable, or one element of it (``part``), has a new value."""

    robot: int  #: or SHARED
    variable: int
    part: int  #: or WHOLE
    value: Plain


class LoggedOutput(NamedTuple):
    """What a robot wrote to a stream."""

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
    """A robot has a new path, shape ``(k, 3)``; an empty one: it has none any more."""

    time_s: float
    robot: int
    points: Pose


class TaskChange(Struct, frozen=True):
    """A task has come further."""

    time_s: float
    task: int
    state: TaskState
    robot: int


class LoggedViolation(Struct, frozen=True):
    """A claim that the run broke."""

    time_s: float
    claim: str
    words: str
    robots: tuple[int, ...] = ()
    place: Point | None = None


class Still(NamedTuple):
    """A robot was seen to stand still although it is to go somewhere: since when, and why."""

    time_s: float
    robot: int
    since_s: float
    words: str


class LogSizes(NamedTuple):
    """How much of a run is recorded."""

    times: int = 0
    rounds: int = 0
    paths: int = 0
    tasks: int = 0
    violations: int = 0
    still: int = 0
    ended: bool = False  #: whether that is all of it


class RunLog(Struct):
    """A run. Everything but the header grows at its end; nothing that stands in it changes."""

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
    ending: str | None = None  #: how the run ended, in words; None: it has not yet

    def since(self, start: LogSizes) -> RunLog:
        """What was recorded after so much."""
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
        )

    @property
    def sizes(self) -> LogSizes:
        """How much is recorded by now."""
        return LogSizes(
            len(self.times_s),
            len(self.rounds),
            len(self.paths),
            len(self.tasks),
            len(self.violations),
            len(self.still),
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
    """Roll and pitch of attitudes ``(n, 4)``, w first: ``(n, 2)``. Heading is turned about first,
    then pitch, then roll.
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
    """What a run feeds. Times never go back."""

    def __init__(self, header: Header) -> None:
        self.recording = RunLog(header)
        self._sample_s, self._next_s = header.sample_s, -math.inf
        self._tilting = np.array(header.tilting, np.int64)

    def is_due(self, time_s: float) -> bool:
        """Whether a sample is wanted now; between samples nothing need be worked out."""
        return time_s >= self._next_s - 1e-9

    def sample(
        self,
        time_s: float,
        positions: Floats,
        yaw: Floats,
        separation_m: float = math.nan,
        attitudes: Floats | None = None,
    ) -> None:
        """Where robots are, shapes ``(n, 3)`` and ``(n,)``, and how near the nearest two are.

        ``attitudes``, shape ``(n, 4)``, are wanted where robots tilt.
        """
        recording = self.recording
        pose = np.zeros((len(positions), 6), np.float32)
        pose[:, :3], pose[:, 3] = positions, yaw
        if attitudes is not None and len(self._tilting):
            pose[self._tilting, 4:] = tilts_of(attitudes[self._tilting])
        recording.poses.append(pose)
        recording.separations_m.append(separation_m)
        recording.times_s.append(time_s)  # last: a reader goes by the number of times
        self._next_s = time_s + self._sample_s

    def round(
        self,
        number: int,
        time_s: float,
        deeds: Deeds,
        changes: Sequence[LoggedChange] = (),
        said: Sequence[LoggedOutput] = (),
    ) -> None:
        """What robots did, and what is different since the last round."""
        done = LoggedRound(number, time_s, deeds, tuple(changes), tuple(said))
        self.recording.rounds.append(done)

    def path(self, time_s: float, robot: int, points: Floats) -> None:
        """A robot is to follow a path, shape ``(k, 3)``."""
        self.recording.paths.append(LoggedPath(time_s, robot, points.astype(np.float32)))

    def task(self, time_s: float, task: int, state: TaskState, robot: int) -> None:
        """A task was assigned to a robot, or done by it."""
        self.recording.tasks.append(TaskChange(time_s, task, state, robot))

    def violation(
        self,
        time_s: float,
        claim: str,
        words: str,
        robots: Sequence[int] = (),
        place: Point | None = None,
    ) -> None:
        """A claim was broken by some robots at a place."""
        self.recording.violations.append(
            LoggedViolation(time_s, claim, words, tuple(robots), place)
        )

    def standing(self, time_s: float, robot: int, since_s: float, words: str) -> None:
        """A robot stands still, and why."""
        self.recording.still.append(Still(time_s, robot, since_s, words))

    def end(self, words: str) -> None:
        """How the run ended. Nothing comes after it."""
        self.recording.ending = words
