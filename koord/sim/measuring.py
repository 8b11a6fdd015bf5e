"""Metrics of a run: distances, separation, waiting, events and skips, tasks, times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from koord.runtime.engine import RoundEngine as Engine
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.motion.automaton import MotionState
from koord.runtime.motion.world import Point
from koord.runtime.proposals import Decision
from koord.runtime.robot import Robot
from koord.runtime.shapes import Array, Record
from koord.runtime.shapes import Sequence as ListOf
from koord.sim.fleet import Fleet
from koord.sim.run_log import Deeds, Idle, RunLogger, TaskState
from koord.sim.scene import Scene
from koord.sim.sensing import FleetSensors
from koord.sim.separation import Going, Nearest

#: What the field of a task is called that says which robot has it.
_OWNERS = ("assignedTo", "assignId", "carrier")

#: What so many robots did is kept until it is counted.
_KEPT = 20_000


class Near(Struct, frozen=True):
    """The least separation of a run, in metres, with its robots and time."""

    distance_m: float
    robots: tuple[int, int]
    time_s: float


class OfRobot(Struct, frozen=True):
    """The metrics of a robot. ``waited_s``: it had no goal, and had not stopped."""

    distance_m: float
    waited_s: float
    events: int
    skips: int
    blocked: int  #: rounds in which another robot was in its lock class
    tasks: int


class OfTask(Struct, frozen=True):
    """The metrics of a task: its owner, and the time of the owner's visit. None: not yet."""

    robot: int | None
    visited_s: float | None


class Figures(Struct, frozen=True):
    """The metrics of a run. ``messages`` are those that its protocol would have sent. (R-ROUND)"""

    rounds: int
    time_s: float
    robots: tuple[OfRobot, ...]
    tasks: tuple[OfTask, ...]
    nearest: Near | None
    messages: int
    digest: str

    @property
    def tasks_done(self) -> int:
        return sum(task.visited_s is not None for task in self.tasks)

    @property
    def tasks_s(self) -> float | None:
        """The time in seconds of the last task's visit; None without one, or before it."""
        times = [task.visited_s for task in self.tasks]
        known = [time for time in times if time is not None]
        return max(known) if known and len(known) == len(times) else None

    @property
    def distance_m(self) -> float:
        return sum(robot.distance_m for robot in self.robots)


class Gauge:
    """The measurement of a run in progress."""

    def __init__(self, fleet: Fleet, engine: Engine, recorder: RunLogger, scene: Scene) -> None:
        self.fleet, self.engine, self.recorder, self.scene = fleet, engine, recorder, scene
        n = len(scene.robots)
        self.going = _going(fleet.positions(), fleet.is_compiled)
        self._waited, self._events = np.zeros(n, np.int64), np.zeros(n, np.int64)
        self._skips, self._blocked = np.zeros(n, np.int64), np.zeros(n, np.int64)
        #: What was done in the last rounds, and who waited: to be counted when they are many.
        self._deeds: list[Deeds] = []
        self._waits: list[tuple[Ints, Bools]] = []
        self._most = max(1, _KEPT // max(n, 1))
        self._near: Near | None = None
        visit_m = [placed.model.visit.epsilon_m for placed in scene.robots]
        self._tasks = TaskGauge(type(engine.robots[0]), recorder, visit_m)

    def reload(self, engine: Engine) -> None:
        """Go on with the robots of another program; tasks are as they were. [RELOAD]"""
        self.engine = engine
        self._tasks.reload(type(engine.told_robots[0]))

    @property
    def has_tasks(self) -> bool:
        """Whether the program has a list of tasks."""
        return self._tasks.is_there

    @property
    def tasks(self) -> int:
        """The number of tasks."""
        return len(self._tasks.owners)

    @property
    def visited(self) -> int:
        """The number of visited tasks."""
        return sum(time is not None for time in self._tasks.visited)

    def tick(self, now_s: float, here: Floats) -> Nearest | None:
        """Record where robots are at the end of a tick, shape ``(n, 3)``; return the nearest two.

        The array stays as it is.
        """
        near = self.going.tick(here)
        if near is not None and (self._near is None or near.distance_m < self._near.distance_m):
            self._near = Near(near.distance_m, (near.one, near.other), now_s)
        return near

    def events(self, decision: Decision, deeds: Deeds) -> None:
        """Record the end of the robots' events of a round; ``deeds`` are their events."""
        if decision.fault is None:  # everybody ran or skipped
            self._deeds.append(deeds)
            if len(self._deeds) >= self._most:
                self._count()
        else:
            self._events[[taken.robot for taken in decision.ran]] += 1
            skipped = list(decision.skipped)
            self._skips[skipped] += deeds[skipped] != Idle.STOPPED
            self._blocked[skipped] += deeds[skipped] == Idle.BLOCKED
        self._tasks.note_assigned(self.engine.store.values, self.engine.round * self.scene.delta_s)

    def round(self, sensed: FleetSensors, stopped: Bools) -> None:
        """Record the end of a round, with the robots' sensors, and who has stopped."""
        self._waits.append((sensed.state, stopped))
        self._tasks.note_visits(self.going.last, self.fleet.now_s)

    def pass_idle(self, deeds: Deeds, states: Ints, stopped: Bools, idle: int) -> None:
        """Record rounds: the states of automata, a row for each; in the last ``idle`` nobody acted.

        What was done in the others has been recorded. For programs without tasks.
        """
        self._deeds += [deeds] * idle
        for of_round in states:
            self._waits.append((of_round, stopped))
        if len(self._deeds) >= self._most:
            self._count()

    def pass_ticks(
        self, times_s: Sequence[float], here: Floats, distances: Floats, nearest: Ints
    ) -> None:
        """Record ticks whose ways were added already: the nearest two of each, as ``n * a + b``."""
        self.going.moved_to(here)
        least = int(distances.argmin())
        distance_m = float(distances[least])
        if self._near is None or distance_m < self._near.distance_m:
            pair = divmod(int(nearest[least]), len(here))
            self._near = Near(distance_m, pair, times_s[least])

    def _count(self) -> None:
        """Count what is kept. The arrays are as they were."""
        if self._deeds:
            deeds = np.stack(self._deeds)
            ran = deeds >= 0
            self._events += ran.sum(0)
            self._skips += (~ran & (deeds != Idle.STOPPED)).sum(0)
            self._blocked += (deeds == Idle.BLOCKED).sum(0)
        if self._waits:
            states, stopped = (np.stack(rows) for rows in zip(*self._waits, strict=True))
            self._waited += ((states == MotionState.IDLE) & ~stopped).sum(0)
        self._deeds.clear()
        self._waits.clear()

    def figures(self, digest: str) -> Figures:
        """The metrics of the run so far."""
        self._count()
        n, delta_s = len(self.scene.robots), self.scene.delta_s
        robots = tuple(
            OfRobot(
                float(self.going.ways_m[k]),
                float(self._waited[k]) * delta_s,
                int(self._events[k]),
                int(self._skips[k]),
                int(self._blocked[k]),
                sum(
                    owner == k and visited is not None
                    for owner, visited in zip(self._tasks.owners, self._tasks.visited, strict=True)
                ),
            )
            for k in range(n)
        )
        tasks = map(OfTask, self._tasks.owners, self._tasks.visited)
        rounds = self.engine.round
        # One proposal and one acknowledgement of each robot, a decision and a commit.
        messages = (rounds + 1) * (2 * n + 2)
        time_s = rounds * delta_s
        return Figures(rounds, time_s, robots, tuple(tasks), self._near, messages, digest)


def _going(start: Floats, compiled: bool) -> Going:
    if not compiled:
        return Going(start)
    from koord.sim.gauge_kernel import CompiledGoing

    return CompiledGoing(start)


class TaskGauge:
    """The measurement of a program's tasks: who has each, and when that robot was there."""

    def __init__(self, program: type[Robot], recorder: RunLogger, visit_m: Sequence[float]) -> None:
        """``visit_m``: of each robot, how near to a task it has visited it."""
        self.owners: list[int | None] = []
        self.visited: list[float | None] = []  #: s
        self._recorder, self._visit_m = recorder, visit_m
        self._tasks = _task_list(program)
        self._values: Mapping[str, Any] = {}

    def reload(self, program: type[Robot]) -> None:
        """Go on with the list of tasks of another program."""
        self._tasks = _task_list(program)
        if self._tasks is None:
            self.owners, self.visited = [], []

    @property
    def is_there(self) -> bool:
        """Whether there is a list of tasks."""
        return self._tasks is not None

    def note_assigned(self, values: Mapping[str, Any], time_s: float) -> None:
        """Record who has tasks now, by the values of shared variables."""
        tasks = self._tasks
        if tasks is None:
            return
        self._values = values
        held = values[tasks.name]
        if held is None or held is tasks.seen:
            return
        tasks.seen = held
        for known in (self.owners, self.visited):
            known += [None] * (len(held) - len(known))
        for number, task in enumerate(held):
            if self.owners[number] is None and (task[tasks.owner] or 0) >= 0 and tasks.taken(task):
                self.owners[number] = task[tasks.owner]
                self._recorder.task(time_s, number, TaskState.ASSIGNED, task[tasks.owner])

    def note_visits(self, positions: Floats, time_s: float) -> None:
        """Record the tasks whose owners are there, positions ``(n, 3)``."""
        if self._tasks is None:
            return
        for number, owner in self._open():
            place: Point = tuple(self._values[self._tasks.name][number][0])
            away = math.dist(positions[owner].tolist(), place)
            if away <= self._visit_m[owner]:
                self.visited[number] = time_s
                self._recorder.task(time_s, number, TaskState.DONE, owner)

    def _open(self) -> Iterator[tuple[int, int]]:
        for number, owner in enumerate(self.owners):
            if owner is not None and self.visited[number] is None:
                yield number, owner


class _TaskList(Struct):
    """The shared list of tasks of a program: its name, and the owner's position in a task."""

    name: str
    owner: int
    flag: int | None
    seen: object = None

    def taken(self, task: tuple[object, ...]) -> bool:
        return self.flag is None or task[self.flag] is True


def _task_list(program: type[Robot]) -> _TaskList | None:
    """The list of tasks, if the program has one."""
    for variable in program.SHARED.variables:
        shape = variable.shape
        if isinstance(shape, Array | ListOf) and isinstance(shape.element, Record):
            names = list(getattr(shape.element.make, "_fields", ()))
            owners = [names.index(name) for name in _OWNERS if name in names]
            if owners and isinstance(shape.element.fields[0], Record):
                flag = names.index("assigned") if "assigned" in names else None
                return _TaskList(variable.name, owners[0], flag)
    return None
