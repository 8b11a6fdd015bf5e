"""Observation of a simulated run for its recording.

What has changed is found by identity: values of compiled programs never change (decision record
0012), so one that is the same object as before is the same value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from operator import itemgetter
from typing import Any, Protocol

import numpy as np

from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.engine import Ended, RoundEngine, Shown
from koord.runtime.motion.arrays import Floats, Ints
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.world import World
from koord.runtime.proposals import INIT_ROUND, Decision, Plain
from koord.runtime.robot import Robot, Status
from koord.runtime.shapes import (
    Array,
    Enumeration,
    PerRobot,
    Record,
    Scalar,
    ScalarKind,
    Shape,
    to_plain,
)
from koord.runtime.shapes import Sequence as ListOf
from koord.runtime.store import AgreedStore
from koord.sim.fleet import Placed
from koord.sim.reloading import Numbering
from koord.sim.run_log import (
    SHARED,
    WHOLE,
    Deeds,
    Header,
    Idle,
    LoggedAgent,
    LoggedChange,
    LoggedHome,
    LoggedOutput,
    LoggedRobot,
    LoggedVariable,
    Pose,
    RunLogger,
)

#: Paths are looked at so often; programs may give new ones in every round.
_PATHS_S = 0.2
#: The same where there are many robots.
_PATHS_OF_MANY_S, _MANY = 1.0, 100


def header_of(
    program: str,
    text: str,
    classes: Sequence[type[Robot]],
    kinds: Sequence[int],
    world: World,
    robots: Sequence[Placed],
    *,
    delta_s: float,
    seed: int,
    safety_m: float = 0.0,
    devices: Sequence[str] = (),
    differing: tuple[str, ...] = (),
) -> Header:
    """The header of a run; ``kinds[i]`` is the position of robot i's class in ``classes``."""
    agents = tuple(
        LoggedAgent(one.__name__, tuple(event.name for event in one.EVENTS), tuple(_own(one)))
        for one in classes
    )
    shared = tuple(
        LoggedVariable(v.name, LoggedHome.ALLREAD if v.is_allread else LoggedHome.ALLWRITE, v.shape)
        for v in classes[0].SHARED.variables
    )
    recorded = tuple(
        _recorded(pid, kinds[pid], devices[pid] if pid < len(devices) else None, placed.model.body)
        for pid, placed in enumerate(robots)
    )
    visit_m = max((placed.model.visit.epsilon_m for placed in robots), default=0.2)
    return Header(
        program,
        text,
        delta_s,
        seed,
        world,
        agents,
        recorded,
        shared,
        safety_m,
        visit_m,
        differing,
    )


class EngineView(Protocol):
    """What an observer sees of the rounds of a run."""

    @property
    def robots(self) -> Sequence[Robot]: ...
    @property
    def store(self) -> AgreedStore: ...
    @property
    def shown(self) -> Sequence[Shown]: ...
    @property
    def round(self) -> int: ...
    @property
    def ended(self) -> Ended | None: ...


class FleetView(Protocol):
    """What an observer sees of robots in the world; rows are robots."""

    @property
    def now_s(self) -> float: ...
    def positions(self) -> Floats: ...
    def headings(self) -> Floats: ...
    def tilts(self, robots: Ints) -> Floats: ...
    def paths_given(self) -> Ints: ...
    def paths(self, robots: Ints) -> Iterable[Floats]: ...


class Observer:
    """An observer that feeds a recorder with the ticks of a fleet and the rounds of an engine."""

    def __init__(self, recorder: RunLogger, engine: EngineView, fleet: FleetView) -> None:
        self.recorder, self.fleet = recorder, fleet
        header = recorder.recording.header
        #: How variables and events are counted in the recording; None: as the program does.
        self._numbering: Numbering | None = None
        self._look_at(engine, header)
        self._given = np.zeros(len(header.robots), np.int64)
        self._paths_s = _PATHS_S if len(header.robots) <= _MANY else _PATHS_OF_MANY_S
        self._paths_due_s = -math.inf
        self._values_s, self._values_due_s = header.values_s, -math.inf
        self._shown = 0
        self._tilting = np.array(header.tilting, np.int64)

    def _look_at(self, engine: EngineView, header: Header) -> None:
        """Look at a program, whose variables the header has; all of them are new."""
        self.engine = engine
        self._shared = [(v, _plain_element(v.shape)) for v in header.shared]
        own = [
            (
                _reading([v.name for v in agent.variables]),
                [_plain_of(v.shape) for v in agent.variables],
            )
            for agent in header.agents
        ]
        #: Of each robot: what reads its variables, and what makes each of them plain.
        self._own = [own[robot.agent] for robot in header.robots]
        self._were: list[Sequence[Any]] = [[None] * len(plain) for _, plain in self._own]
        self._were_shared: list[Any] = [None] * len(header.shared)

    def reload(self, engine: EngineView, header: Header, numbering: Numbering) -> None:
        """Go on with another program, which has the header. [RELOAD]

        What it has of the one before is no change, unless its value is another.
        """
        before, own, shared = self._numbering, self._were, self._were_shared
        self._look_at(engine, header)
        self._numbering, self._values_due_s = numbering, -math.inf
        had = None if before is None else before.declared
        kinds = numbering.agents.tolist()
        for pid, kind in enumerate(kinds):
            numbers = range(len(own[pid])) if had is None else had.agents[kind]
            known = dict(zip(numbers, own[pid], strict=True))
            self._were[pid] = [known.get(k) for k in numbering.declared.agents[kind]]
        known = dict(zip(range(len(shared)) if had is None else had.shared, shared, strict=True))
        self._were_shared = [known.get(k) for k in numbering.declared.shared]

    def begun(self, decision: Decision) -> None:
        """Record the end of INIT."""
        self.tick(self.fleet)
        self.round(decision.round, deeds_of(decision, self.engine.robots))

    def tick(self, fleet: FleetView, separation_m: float = math.nan) -> None:
        """Record the end of a tick. ``separation_m`` is that of the two nearest robots."""
        now_s = fleet.now_s
        if not self.recorder.is_due(now_s):
            return
        tilts = fleet.tilts(self._tilting) if len(self._tilting) else None
        here = fleet.positions(), fleet.headings()
        self.recorder.sample(now_s, *here, separation_m, tilts)
        if now_s >= self._paths_due_s - 1e-9:
            self._paths_due_s = now_s + self._paths_s
            self._paths(fleet, now_s)

    def _paths(self, fleet: FleetView, now_s: float) -> None:
        """Record the paths that were given since somebody looked."""
        given = fleet.paths_given()
        robots = np.flatnonzero(given != self._given)
        for robot, points in zip(robots.tolist(), fleet.paths(robots), strict=True):
            self.recorder.path(now_s, robot, points)
        self._given = given

    def pass_ticks(
        self, fleet: FleetView, times_s: Sequence[float], poses: Pose, separations_m: Floats
    ) -> None:
        """Record ticks, shape ``(ticks, n, 6)``, between which nobody was given another path."""
        is_known = False
        for time_s, pose, separation_m in zip(times_s, poses, separations_m.tolist(), strict=True):
            if not self.recorder.is_due(time_s):
                continue
            self.recorder.pose(time_s, pose, separation_m)
            if time_s >= self._paths_due_s - 1e-9:
                self._paths_due_s = time_s + self._paths_s
                if not is_known:
                    self._paths(fleet, time_s)
                is_known = True

    def round(self, number: int, deeds: Deeds, time_s: float | None = None) -> None:
        """Record a round after its decision, before the environment's turn.

        ``time_s`` is when that was, if not as virtual time goes by.
        """
        if time_s is None:
            time_s = max(number, 0) * self.recorder.recording.header.delta_s
        changes: list[LoggedChange] = []
        if time_s >= self._values_due_s - 1e-9:
            self._values_due_s = time_s + self._values_s
            changes = self._changes()
        shown = self.engine.shown[self._shown :]
        self._shown += len(shown)
        if self._numbering is not None:
            deeds = self._numbering.deeds(deeds)
        self.recorder.round(number, time_s, deeds, changes, [*_said(shown)])

    def pass_idle(self, first: int, rounds: int) -> None:
        """Record rounds from the first on in which nobody acted, and no variable changed."""
        recorder, deeds = self.recorder, nothing(len(self._own))
        delta_s, is_known = recorder.recording.header.delta_s, False
        for number in range(first, first + rounds):
            time_s = max(number, 0) * delta_s
            if time_s < self._values_due_s - 1e-9:
                recorder.round(number, time_s, deeds)
            elif is_known:
                self._values_due_s = time_s + self._values_s
                recorder.round(number, time_s, deeds)
            else:  # what has changed before
                self.round(number, deeds, time_s)
                is_known = True

    def end(self, words: str) -> None:
        """Record the end of the run, with its reason and the last values."""
        number, recording = self.engine.round, self.recorder.recording
        changes = self._changes()
        ended_within = bool(recording.rounds) and recording.rounds[-1].number == number
        if ended_within:
            deeds = recording.rounds[-1].deeds
        else:
            stopped = [robot.status is Status.STOPPED for robot in self.engine.robots]
            deeds = np.where(stopped, Idle.STOPPED, Idle.SKIPPED).astype(np.int16)
        time_s = number * recording.header.delta_s
        if changes or not ended_within:
            self.recorder.round(number, time_s, deeds, changes)
        ended = self.engine.ended
        if ended is not None:
            whose = () if ended.robot is None else (ended.robot,)
            story = f"{ended.fault.kind.value} at {ended.fault.place}"
            self.recorder.violation(time_s, "fault", story, whose)
        self.recorder.end(words)

    def _changes(self) -> list[LoggedChange]:
        """The changed variables, as the recording counts them."""
        changes = [*self._shared_changes(), *self._own_changes()]
        if self._numbering is not None:
            changes = list(map(self._numbering.change, changes))
        return changes

    def _own_changes(self) -> list[LoggedChange]:
        """The changed variables of a robot. Has to be fast: for each robot in each round."""
        changes = []
        engine, touched = self.engine, None
        if isinstance(engine, ColumnEngine):
            touched = engine.touched()
            robots: Sequence[Robot] = engine.told_robots
        else:
            robots = engine.robots
        for pid in range(len(robots)) if touched is None else touched:
            read, plain = self._own[pid]
            now = read(robots[pid].__dict__)
            for number, (value, before) in enumerate(zip(now, self._were[pid], strict=True)):
                if value is not before and value != before:
                    changes.append(LoggedChange(pid, number, WHOLE, plain[number](value)))
            self._were[pid] = now
        return changes

    def _shared_changes(self) -> list[LoggedChange]:
        changes = []
        values, were = self.engine.store.values, self._were_shared
        for number, (variable, plain) in enumerate(self._shared):
            value, before = values[variable.name], were[number]
            if value is before:
                continue
            were[number] = value
            if plain is not None and before is not None and len(before) == len(value or ()):
                for part, (old, new) in enumerate(zip(before, value, strict=True)):
                    if old is not new and old != new:
                        changes.append(LoggedChange(SHARED, number, part, plain(new)))
            elif value != before:
                whole = to_plain(variable.shape, value)
                changes.append(LoggedChange(SHARED, number, WHOLE, whole))
        return changes


def _reading(names: Sequence[str]) -> Callable[[Mapping[str, Any]], Sequence[Any]]:
    """What reads the values of some names."""
    if len(names) > 1:
        return itemgetter(*names)
    return lambda values: [values[name] for name in names]


def deeds_in(decision: Decision, engine: RoundEngine) -> Deeds:
    """The same as :func:`deeds_of`, of what an engine knows of its robots.

    Rounds in which nobody does anything have one array, which is nobody's to write to.
    """
    if engine.is_idle(decision):
        return nothing(len(engine.told_robots))
    idle = engine.idle(decision) if isinstance(engine, ColumnEngine) else None
    if idle is None:
        return deeds_of(decision, engine.told_robots)
    had_events, stopped = idle
    deeds = np.full(len(stopped), int(Idle.SKIPPED), np.int16)
    deeds[had_events] = Idle.BLOCKED
    deeds[stopped] = Idle.STOPPED
    for taken in decision.ran:
        if taken.event is not None:
            deeds[taken.robot] = taken.event
    return deeds


@cache
def nothing(robots: int) -> Deeds:
    """The deeds of so many robots that skip."""
    return np.full(robots, int(Idle.SKIPPED), np.int16)


def deeds_of(decision: Decision, robots: Sequence[Robot]) -> Deeds:
    """The event, or kind of idleness, of each robot in a decided round; in INIT all are skips."""
    deeds = np.full(len(robots), int(Idle.SKIPPED), np.int16)
    if decision.round == INIT_ROUND:
        return deeds
    blocked, stopped = [], []
    for k in decision.skipped:
        robot = robots[k]
        if robot.status is Status.STOPPED:
            stopped.append(k)
        elif robot.had_an_event:
            blocked.append(k)
    deeds[blocked], deeds[stopped] = Idle.BLOCKED, Idle.STOPPED
    for taken in decision.ran:
        if taken.event is not None:
            deeds[taken.robot] = taken.event
    return deeds


def _plain_of(shape: Shape) -> Callable[[Any], Plain]:
    """A version of :func:`to_plain` specialised to one shape."""
    match shape:
        case Scalar() | Enumeration():
            return _as_it_is
        case Record(fields=fields) if all(isinstance(field, Scalar) for field in fields):
            return _flat
        case _:
            return partial(to_plain, shape)


def _as_it_is(value: Any) -> Plain:
    return value  # type: ignore[no-any-return]


def _flat(value: Any) -> Plain:
    return None if value is None else tuple(value)


def _plain_element(shape: Shape) -> Callable[[Any], Plain] | None:
    """The same for an element of a list or array; None for shapes without elements."""
    if isinstance(shape, Array | PerRobot | ListOf):
        return _plain_of(shape.element)
    return None


def _own(one: type[Robot]) -> Iterator[LoggedVariable]:
    """Yield a robot's own variables, except its position and scans, which poses record."""
    for name, shape in one.LOCALS.items():
        yield LoggedVariable(name, LoggedHome.LOCAL, shape)
    for name, shape in one.PORTS.items():
        if name in one.MODELLED:
            yield LoggedVariable(name, LoggedHome.SENSOR, shape)
        elif name not in one.SENSORS:
            yield LoggedVariable(name, LoggedHome.ACTUATOR, shape)
        elif not _is_measured(shape):
            yield LoggedVariable(name, LoggedHome.SENSOR, shape)


def _is_measured(shape: Shape) -> bool:
    """Return whether values of a shape are lengths only, which change with every measurement."""
    match shape:
        case Scalar(kind=kind):
            return kind is ScalarKind.FLOAT
        case Record(fields=fields):
            return any(map(_is_measured, fields))
        case Array(element=element) | ListOf(element=element):
            return _is_measured(element)
        case _:
            return False


def _recorded(pid: int, agent: int, device: str | None, body: Body) -> LoggedRobot:
    look = body.LOOK
    return LoggedRobot(
        f"robot {pid}", agent, device or look.name, look, body.radius_m, *body.outline_m
    )


def _said(shown: Sequence[Shown]) -> Iterator[LoggedOutput]:
    for one in shown:
        for written in one.written:
            yield LoggedOutput(one.robot, written.stream, " ".join(map(str, written.values)))


__all__ = ["Observer", "deeds_in", "deeds_of", "header_of", "nothing"]
