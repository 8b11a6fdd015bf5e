"""A run that other processes make, made out from what they tell: the same figures and recording.

The program is run again, on what it was answered there and with the schedule that came about there;
its vehicles are where they were. So all that can be seen of a run in one process can be seen of one
in several, claims between rounds included.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from koord.runtime.deploy.running import RoundReport
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.motion.planning import Hindrance
from koord.runtime.proposals import INIT_ROUND, Decision, Proposal, rotating
from koord.runtime.robot import Host, Key, Robot, Turn
from koord.sim.fleet import Fleet
from koord.sim.processes import EnvironmentStep, RoundStory, Tick
from koord.sim.running import Cast, Simulation
from koord.sim.scene import Scene


class Followed(Simulation):
    """A run whose robots are elsewhere: :meth:`hear` what they tell, then :meth:`rounds`."""

    def __init__(
        self,
        cast: Cast,
        scene: Scene,
        *,
        keep_going: bool = False,
        heard: Callable[[Host], Host] | None = None,
        supplied: Callable[[Host], Host] | None = None,
    ) -> None:
        self._memory = memory = _Memory(len(cast.kinds))

        def remembered(host: Host) -> Host:
            answers = _Answers(memory, host)
            return answers if heard is None else heard(answers)

        self._vehicles = _Vehicles(scene)
        super().__init__(
            cast,
            scene,
            _Imposed(memory),
            keep_going=keep_going,
            heard=remembered,
            fleet=self._vehicles,
            supplied=supplied,
        )

    def hear(self, moments: Iterable[RoundReport]) -> None:
        """What a robot tells, its rounds in order."""
        for moment in moments:
            assert isinstance(moment.told, RoundStory)
            self._memory.add(moment.pid, moment.round, moment.told)

    def rounds(self, *, is_over: bool = False) -> Iterator[Decision]:
        """The rounds that all have told of by now, INIT first.

        Of a run that ``is_over`` the end of the last round may stay untold.
        """
        memory = self._memory
        if memory.round == INIT_ROUND and memory.is_decided(INIT_ROUND):
            yield self.begin()
            memory.round = 0
        while self.ending is None and memory.is_decided(memory.round):
            if not is_over and not self.goes_on:
                return
            yield self.round()
            memory.forget()

    @property
    def goes_on(self) -> bool:
        return self._memory.is_ended(self._memory.round)

    def pass_time(self) -> None:
        deltas = self._memory.deltas()
        for ticks in zip(*(delta.ticks for delta in deltas), strict=True):
            self._vehicles.place(ticks)
            self.tick(self._vehicles)
        self.host.sensed = tuple(delta.sensed for delta in deltas)


class _Memory:
    """What was told and has not been followed yet. ``round`` is the one that is."""

    def __init__(self, robots: int) -> None:
        self.round = INIT_ROUND
        self._robots = robots
        self._told: dict[int, dict[int, RoundStory]] = {}
        self._turns: dict[int, dict[int, EnvironmentStep]] = {}
        self._answers: dict[tuple[int, int, Turn, Key], Any] = {}
        self.starts: dict[tuple[int | None, str], Any] = {}

    def add(self, robot: int, number: int, told: RoundStory) -> None:
        self._told.setdefault(number, {})[robot] = told
        for ended, delta in told.turns.items():
            self._turns.setdefault(ended, {})[robot] = delta
        for (turn, asked_in, key), value in told.answers.items():
            self._answers[robot, number if asked_in is None else asked_in, turn, key] = value
        self.starts.update(told.starts)

    def is_decided(self, number: int) -> bool:
        """Whether all have told what was decided in a round."""
        return len(self._told.get(number, ())) == self._robots

    def is_ended(self, number: int) -> bool:
        """Whether all have told how a round ended."""
        return len(self._turns.get(number, ())) == self._robots

    def told(self, robot: int) -> RoundStory:
        return self._told[self.round][robot]

    def deltas(self) -> list[EnvironmentStep]:
        return [self._turns[self.round][robot] for robot in range(self._robots)]

    def delta(self, robot: int) -> EnvironmentStep:
        return self._turns[self.round][robot]

    def answer(self, robot: int, turn: Turn, key: Key) -> Any:
        return self._answers[robot, self.round, turn, key]

    def forget(self) -> None:
        """The round has been followed."""
        before = self.round - 1
        for past in (self._told, self._turns):
            past.pop(before, None)
        self._answers = {k: v for k, v in self._answers.items() if k[1] > before}
        self.round += 1


class _Answers:
    """The host that answers as was answered there. What only claims ask another host answers."""

    def __init__(self, memory: _Memory, other: Host) -> None:
        self._memory, self._other = memory, other

    def start(self, robot: int | None, name: str) -> Any:
        return self._memory.starts[robot, name]

    def read(self, robot: Robot) -> Mapping[str, Any]:
        return self._memory.delta(robot.pid).readings

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        if not key:
            return self._other.ask(turn, robot, key, function, arguments)
        return self._memory.answer(robot, turn, key)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        return self._memory.answer(robot, turn, key)


class _Imposed:
    """The schedule that came about there."""

    def __init__(self, memory: _Memory) -> None:
        self._memory = memory

    def order(self, round_: int, robots: int) -> tuple[int, ...]:
        ran = self._memory.told(0).ran
        return (*ran, *(robot for robot in rotating(round_, robots) if robot not in ran))

    def events(self, robot: Robot) -> Iterable[int] | None:
        return None

    def willing(self, robot: Robot) -> bool:
        return self._memory.told(robot.pid).had_an_event

    def hears(self, proposal: Proposal) -> bool:
        return proposal.robot in self._memory.told(proposal.robot).ran


class _Vehicles(Fleet):
    """Vehicles that are where they were told to be, in the order in which it is told."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene.world, scene.robots, scene.seed)
        self._positions, self._headings = super().positions(), super().headings()
        self._attitudes, self._reached = super().attitudes(), super().reached()
        self._given = super().paths_given()
        self._paths = {robot: np.zeros((0, 3)) for robot in range(len(scene.robots))}

    def place(self, ticks: Sequence[Tick]) -> None:
        """A tick of control is over for everybody."""
        self.ticks += 1
        self._positions = np.array([tick.position for tick in ticks])
        self._headings = np.array([tick.heading_rad for tick in ticks])
        self._attitudes = np.array([tick.attitude for tick in ticks])
        self._reached = np.array([tick.reached for tick in ticks])
        self._given = np.array([tick.given for tick in ticks], np.int64)
        for robot, tick in enumerate(ticks):
            if tick.path is not None:
                self._paths[robot] = tick.path

    def positions(self) -> Floats:
        return self._positions

    def headings(self) -> Floats:
        return self._headings

    def attitudes(self) -> Floats:
        return self._attitudes

    def reached(self) -> Bools:
        return self._reached

    def paths_given(self) -> Ints:
        return self._given

    def path(self, robot: int) -> Floats:
        return self._paths[robot]

    def touched(self, robot: int) -> tuple[tuple[Hindrance, int], ...]:
        return ()  # a process has its own robot alone: none of them touches another
