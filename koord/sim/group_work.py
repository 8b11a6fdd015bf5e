"""What a process does that has the programs of a group of robots.

It has a copy of the whole run, of which it goes on with the turns of its robots alone. The world
stays in the first process, which tells of each round what was decided and what is sensed.
"""

from __future__ import annotations

import os
import pickle
import signal
from collections.abc import Iterable, Mapping
from multiprocessing.connection import Connection
from typing import Any, Protocol

from koord.runtime.columns.parts import PartedEngine
from koord.runtime.platform.world_host import WAYS
from koord.runtime.ports import plain_name
from koord.runtime.robot import Forwarding, Host, Key, Robot, Turn
from koord.sim.group_messages import Messages, Query, Sensed, Step, Turns, flat, unpacked
from koord.sim.hosting import Hosted
from koord.sim.reading import Reader


class Run(Protocol):
    """The run that is there when processes are forked."""

    @property
    def world(self) -> Hosted:
        """The host that the world is."""
        ...

    @property
    def claims_host(self) -> Host:
        """Whom programs ask in the end."""
        ...

    @property
    def parted(self) -> PartedEngine: ...

    @property
    def reads_at_once(self) -> bool:
        """Whether sensors are read of all robots at once."""
        ...

    @property
    def reads_elsewhere(self) -> bool:
        """Whether robots read for themselves, because chance or their models answer, too."""
        ...

    @property
    def is_heard(self) -> bool:
        """Whether somebody wants to be told of all that robots ask."""
        ...


def work(run: Run, pids: Iterable[int], messages: Messages, wire: Connection) -> None:
    """Make the turns of some robots until the first process is gone, or has no more rounds."""
    group = _Group(run, tuple(pids))
    try:
        while True:
            try:
                turns: object = group.turns()
            except Exception as error:  # it is told where the run is
                turns = _sendable(error)
            wire.send_bytes(messages.encoded(turns))
            for step in Messages.decoded(wire.recv_bytes()):
                sensed = group.follow(step)
                if sensed is not None:
                    wire.send_bytes(messages.encoded(sensed))
    except (EOFError, OSError):
        os._exit(0)


def deafen() -> None:
    """Leave Ctrl-C to the first process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _sendable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever it is made of
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


class _Group:
    """The programs of a group of robots."""

    def __init__(self, run: Run, pids: tuple[int, ...]) -> None:
        self._run, self._pids, self._engine = run, pids, run.parted
        self._host = _Noted(run.claims_host, is_heard=run.is_heard)
        self._engine.host = self._host
        self._as_deeds = run.parted.fleet is not None
        for pid in pids:
            self._engine.told_robots[pid].host = self._host
        self._engine.keep_to(pids)
        if not run.reads_elsewhere:
            self._host.given = {}
        self._engine.reader = None
        if run.reads_at_once:
            self._engine.reader = Reader(run.world, self._host.read, pids).read

    def turns(self) -> Turns:
        made = self._engine.turns(as_deeds=self._as_deeds)
        turned = [flat(turn) for turn in made.turned]
        return Turns(self._engine.round, turned, made.deeds, self._host.noted())

    def follow(self, step: Step) -> Sensed | None:
        """Act on a round that was decided, and take the environment's turn."""
        run, engine, host = self._run, self._engine, self._host
        self._as_deeds = step.as_deeds
        engine.follow(step.decision)
        run.world.sensed = unpacked(step.sensed, run.world.sensed)
        run.world.given = step.served
        run.world.library.begin_round()
        if not run.reads_elsewhere:
            host.given = step.readings
        host.readings = {}
        engine.environment_turn()
        return Sensed(host.readings, host.noted()) if run.reads_elsewhere else None


class _Noted(Forwarding):
    """A host of which is noted what robots asked it, and what they read."""

    def __init__(self, host: Host, *, is_heard: bool) -> None:
        super().__init__(host)
        self.given: Mapping[int, Mapping[str, Any]] | None = None  #: readings, if others read
        self.readings: dict[int, Mapping[str, Any]] = {}
        self._is_heard = is_heard
        self._noted: list[Query] = []

    def noted(self) -> list[Query]:
        """The queries since the last call."""
        noted, self._noted = self._noted, []
        return noted

    def read(self, robot: Robot) -> Mapping[str, Any]:
        if self.given is not None:
            return self.given[robot.pid]
        readings = self.readings[robot.pid] = self.host.read(robot)
        return readings

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        answer = self.host.ask(turn, robot, key, function, arguments)
        if self._is_heard or turn is Turn.ENV:
            self._noted.append(Query(turn, robot, key, function, arguments, answer))
        else:
            # Of ways the watchman wants to know whether there is one, of others whether it is free.
            name = plain_name(function)
            if name in WAYS:
                self._noted.append(Query(turn, robot, key, function, arguments, answer[:1]))
            elif name == "pathsClear":
                self._noted.append(Query(turn, robot, key, function, (), answer))
        return answer

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        answer = self.host.choose(turn, robot, key, low, high)
        if self._is_heard or turn is Turn.ENV:
            self._noted.append(Query(turn, robot, key, None, (low, high), answer))
        return answer
