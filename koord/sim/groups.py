"""Runs whose programs are in several processes, each with a group of robots.

The first process has one of the groups and the world, decides rounds, and watches and records as
alone: so runs are the same, to the last bit. A round is one message to each other process, and one
back. With a ``patience`` who is late there skips, as on a network. (decision record 0112)
"""

from __future__ import annotations

import signal
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from msgspec import Struct, field

from koord.runtime.columns.parts import DeedTurns, PartedEngine, PartTurns, Turned
from koord.runtime.proposals import Decision
from koord.runtime.robot import Forwarding, Host, Key, Robot, Turn
from koord.sim.group_messages import Messages, Query, Sensed, Step, Turns, whole
from koord.sim.group_work import deafen, work
from koord.sim.hosting import Hosted
from koord.sim.reading import Reader
from koord.sim.running import Cast, Ending, SilentError, Simulation
from koord.sim.scene import Scene
from koord.syntax.forking import FORKING

#: Machine code that a run goes over to within so many rounds is made before processes are forked.
_SOON_ROUNDS = 16

#: A process that does not end by itself within this time is killed.
_PATIENCE_S = 1.0


class Group(Struct, eq=False):
    """The process of a group of robots. ``owed`` is what it is told as soon as it has time."""

    pids: tuple[int, ...]
    process: BaseProcess
    wire: Connection
    never_late: bool
    is_busy: bool = True
    owed: list[Step] = field(default_factory=list)


class GroupedSimulation(Simulation):
    """A simulation in so many ``processes`` at most, this one included; never more than robots.

    Robots of other processes that have not made their turns within ``patience_s`` of being asked
    skip; None: nobody is late. Where nothing can be forked, this process does everything.
    """

    def __init__(
        self,
        cast: Cast,
        scene: Scene,
        *,
        processes: int,
        patience_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
        keep_going: bool = False,
        heard: Callable[[Host], Host] | None = None,
        supplied: Callable[[Host], Host] | None = None,
    ) -> None:
        memories: list[_Told] = []
        self.is_heard = False

        def wrapped(world: Host) -> Host:
            told = _Told(world)
            memories.append(told)
            host = told if heard is None else heard(told)
            self.is_heard = host is not told
            return host

        super().__init__(
            cast,
            scene,
            keep_going=keep_going,
            heard=wrapped,
            supplied=supplied,
            engine=_parted,
        )
        assert isinstance(self.engine, PartedEngine)
        self.parted, (told,) = self.engine, memories
        self.reads_elsewhere = supplied is not None or self.parted.has_models
        self.reads_at_once = not (self.is_heard or self.reads_elsewhere)
        if self.reads_at_once:
            self.parted.reader = Reader(self.host, told.read).read
        self._groups = _Groups(self, told, processes, patience_s, clock)

    @property
    def world(self) -> Hosted:
        return self.host

    @property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """The robots of each process, this one first; none if it has all of them."""
        others = [group.pids for group in self._groups.all]
        return (self._groups.own, *others) if others else ()

    @property
    def processes(self) -> tuple[BaseProcess, ...]:
        """The other processes."""
        return tuple(group.process for group in self._groups.all)

    @property
    def late(self) -> int:
        """Proposals that came too late for their rounds."""
        return self._groups.late

    @property
    def died(self) -> tuple[int, ...]:
        """The robots whose processes were ended."""
        return self._groups.died

    def begin(self) -> Decision:
        decision = super().begin()
        if self.ending is None:
            self._groups.begin()
        return decision

    def environment_turn(self) -> None:
        self._groups.environment_turn()

    def end(self, ending: Ending) -> None:
        super().end(ending)
        self._groups.close()

    def close(self) -> None:
        """End the processes."""
        self._groups.close()


def _parted(cast: Cast, delta_s: float, host: Host) -> PartedEngine:
    return PartedEngine(cast.classes, cast.kinds, delta_s, host, cast.turns)


class _Groups:
    """The processes of a run, seen from the first one."""

    def __init__(
        self,
        run: GroupedSimulation,
        told: _Told,
        most: int,
        patience_s: float | None,
        clock: Callable[[], float],
    ) -> None:
        self.all: list[Group] = []  #: the other processes
        self.own: tuple[int, ...] = ()  #: the robots of this one
        self.late = 0
        self.died: tuple[int, ...] = ()
        self._run, self._told, self._most = run, told, most
        self._patience_s, self._clock = patience_s, clock
        self._messages = Messages(run.cast.classes)
        self._asked_s = clock()

    def begin(self) -> None:
        """Fork the processes, after INIT: they know all that was said and drawn there."""
        if "fork" not in get_all_start_methods():
            return
        run, engine = self._run, self._run.parted
        engine.prepare(_SOON_ROUNDS)
        robots = engine.told_robots
        count = min(self._most, len(robots))
        bounds = [len(robots) * k // count for k in range(count + 1)]
        self.own, *others = [tuple(range(low, high)) for low, high in pairwise(bounds)]
        for pids in others:
            never_late = run.reads_elsewhere or any(robots[pid].owes() for pid in pids)
            self.all.append(self._forked(pids, never_late=never_late))
        elsewhere = frozenset(pid for pids in others for pid in pids)
        self._told.elsewhere = elsewhere
        self._told.readers = elsewhere if run.reads_elsewhere else frozenset()
        if others:
            engine.keep_to(self.own, self.collect)
        self._asked_s = self._clock()

    def _forked(self, pids: tuple[int, ...], *, never_late: bool) -> Group:
        context = get_context("fork")
        # Ctrl-C must not reach it before it is deaf to it.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            with FORKING, warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # of threads of libraries
                ours, theirs = context.Pipe()
                others = [*(group.wire for group in self.all), ours]
                process = context.Process(
                    target=_work,
                    args=(self._run, pids, self._messages, theirs, others),
                    name=f"robots {pids[0]} to {pids[-1]}",
                    daemon=True,
                )
                process.start()
                theirs.close()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return Group(pids, process, ours, never_late)

    def close(self) -> None:
        """End the processes; those that are at work are killed."""
        for group in self.all:
            group.wire.close()
        for group in self.all:
            with FORKING:
                group.process.join(0.0 if group.is_busy else _PATIENCE_S)
                if group.process.is_alive():
                    group.process.kill()
                    group.process.join()

    # --- rounds -----------------------------------------------------------------------------------

    def collect(self) -> PartTurns:
        """The turns of those who propose in the open round. Raises SilentError."""
        until_s = None if self._patience_s is None else self._asked_s + self._patience_s
        told = self._told
        turned: list[Turned] = []
        deeds: list[DeedTurns] = []
        told.answers.clear()
        for group in self.all:
            turns = self._turns(group, None if group.never_late else until_s)
            if turns is not None:
                self._hear(turns.queries)
                turned += map(whole, turns.turned)
                deeds += turns.deeds
        return PartTurns(turned, deeds)

    def environment_turn(self) -> None:
        """Tell what was decided, and take the environment's turn. Raises SilentError."""
        run, engine, told = self._run, self._run.parted, self._told
        if not self.all:
            engine.environment_turn()
            return
        told.answers.clear()
        told.readings = {}
        if not run.reads_elsewhere:
            engine.environment_turn()
            if engine.ended is None:
                self._tell(told.readings)
            return
        served = {pid: run.host.served(pid) for pid in run.host.told_more}
        self._tell({}, served)
        for group in self.all:
            sensed = self._received(group)
            assert isinstance(sensed, Sensed)
            told.readings |= sensed.readings
            told.remember(sensed.queries)
        engine.environment_turn()

    def _hear(self, queries: Sequence[Query]) -> None:
        """Let whoever listens to robots' hosts hear what they asked."""
        self._told.remember(queries)
        host = self._run.parted.host
        for query in queries:
            turn, robot, key, function, arguments, _ = query
            if function is None:
                low, high = arguments
                host.choose(turn, robot, key, low, high)
            else:
                host.ask(turn, robot, key, function, arguments)

    def _turns(self, group: Group, until_s: float | None) -> Turns | None:
        """A group's turns of the open round; None if they are not there in time."""
        while True:
            if until_s is not None and not group.wire.poll(max(0.0, until_s - self._clock())):
                return None
            turns = self._taken(group)
            if turns.round == self._run.parted.round:
                return turns
            self._send(group)

    def _taken(self, group: Group) -> Turns:
        """The turns that a group has made. What was too late is counted."""
        turns = self._received(group)
        group.is_busy = False
        assert isinstance(turns, Turns)
        if turns.round != self._run.parted.round:
            self.late += len(turns.turned) + sum(len(deed.pids) for deed in turns.deeds)
        return turns

    def _tell(
        self,
        readings: Mapping[int, Mapping[str, Any]],
        served: Mapping[int, dict[str, Any]] | None = None,
    ) -> None:
        """Tell all of the last decision, and of what is sensed now."""
        run = self._run
        has_code = run.parted.fleet is not None
        step = Step.of(run.decision, run.host.sensed, readings, served, as_deeds=has_code)
        self._asked_s = self._clock()
        for group in self.all:
            group.owed.append(step)
            with suppress(SilentError):  # the round is over without it: the next one is not
                if group.is_busy and group.wire.poll():
                    self._taken(group)
            if not group.is_busy:
                self._send(group)

    def _send(self, group: Group) -> None:
        """Tell a process all that it is owed; it makes its next turns then."""
        group.is_busy = True
        with suppress(OSError):  # it is gone: that is noticed where its turns are wanted
            group.wire.send_bytes(self._messages.encoded(group.owed))
        group.owed.clear()

    def _received(self, group: Group) -> object:
        try:
            told = Messages.decoded(group.wire.recv_bytes())
        except (EOFError, OSError):
            group.process.join(_PATIENCE_S)
            dead = [one for one in self.all if one is group or not one.process.is_alive()]
            self.died = tuple(pid for one in dead for pid in one.pids)
            raise SilentError from None
        if isinstance(told, Exception):
            raise told
        return told


def _work(
    run: GroupedSimulation,
    pids: tuple[int, ...],
    messages: Messages,
    wire: Connection,
    others: Sequence[Connection],
) -> None:
    for other in others:
        other.close()  # else nobody would see that it is gone
    deafen()
    work(run, pids, messages, wire)


class _Told(Forwarding):
    """The world, and what robots were answered and read in other processes.

    What no robot asks, because a claim mentions it, is asked here, without a key.
    """

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.elsewhere: frozenset[int] = frozenset()  #: who is in other processes
        self.readers: frozenset[int] = frozenset()  #: who reads there
        self.readings: dict[int, Mapping[str, Any]] = {}
        self.answers: dict[tuple[Turn, int, Key], Any] = {}

    def remember(self, queries: Sequence[Query]) -> None:
        """Note what robots were answered."""
        for query in queries:
            self.answers[query.turn, query.robot, query.key] = query.answer

    def read(self, robot: Robot) -> Mapping[str, Any]:
        if robot.pid in self.readers:
            return self.readings[robot.pid]
        readings = self.readings[robot.pid] = self.host.read(robot)
        return readings

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        if key and robot in self.elsewhere:
            return self.answers[turn, robot, key]
        return self.host.ask(turn, robot, key, function, arguments)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        if robot in self.elsewhere:
            return self.answers[turn, robot, key]
        return self.host.choose(turn, robot, key, low, high)
