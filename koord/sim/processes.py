"""Distributed simulation: robots in processes of their own, and the run made of reports.

What a process does not have is the others: they are heard of, and not met. Where no two vehicles
touch, a robot moves as it does among the others in one process, to the last bit. A robot tells all
that its program left open and how its vehicle moved (:class:`RoundStory`): from that the run is
made out.

The program is run again, on what it was answered there and with the schedule that came about there;
its vehicles are where they were. So all that can be seen of a run in one process can be seen of one
in several, claims between rounds included.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct, field

from koord.runtime.deploy.job import Job
from koord.runtime.deploy.member import Member, Untimed
from koord.runtime.deploy.news import RoundReport
from koord.runtime.motion.arrays import Bools, Floats, Ints
from koord.runtime.motion.planning import Hindrance
from koord.runtime.motion.world import Point
from koord.runtime.platform.sensors import MotionSensors
from koord.runtime.proposals import INIT_ROUND, Decision, Proposal, rotating
from koord.runtime.protocol.messages import LogEntry
from koord.runtime.robot import Host, Key, Robot, Turn
from koord.sim.fleet import Fleet
from koord.sim.run_log import tilts_of
from koord.sim.running import Cast, Simulation, host_of
from koord.sim.scene import Scene
from koord.sim.sensing import FleetSensors


class Tick(Struct, frozen=True):
    """The state of a vehicle at the end of a tick of control."""

    position: Point
    heading_rad: float
    attitude: tuple[float, float, float, float]
    reached: bool
    given: int  #: how many paths it was given up to now
    path: Floats | None  #: the last of them, shape ``(k, 3)``, if it is new


class EnvironmentStep(Struct, frozen=True):
    """The environment's turn of one robot: its movement, and its sensors at the end."""

    ticks: tuple[Tick, ...]
    sensed: MotionSensors
    readings: Mapping[str, Any]


#: Which of a robot's turns asked, in which round (None: the one that is told of), and what.
Question: TypeAlias = tuple[Turn, int | None, Key]


class RoundStory(Struct):
    """A robot's report on a round: all inputs of its program since the last report.

    ``ran`` are the robots that were let through, in the order in which they were, and
    ``had_an_event`` is whether this one had run an event that it wanted to be let through with.
    ``turns`` are the environment's turns by the round that they end.
    """

    starts: dict[tuple[int | None, str], Any] = field(default_factory=dict)
    answers: dict[Question, Any] = field(default_factory=dict)
    turns: dict[int, EnvironmentStep] = field(default_factory=dict)
    ran: tuple[int, ...] = ()
    had_an_event: bool = False


class SimulatedBody(Untimed):
    """The host of one robot: at each reading of its sensors, δ has passed."""

    def __init__(
        self, cast: Cast, scene: Scene, pid: int, supplied: Callable[[Host], Host] | None = None
    ) -> None:
        self._pid, self._delta_s, self._rounds = pid, scene.delta_s, 0
        self._fleet = Fleet(scene.world, scene.robots, scene.seed, only=pid)
        self._vehicle = host_of(cast, scene, self._fleet)
        self._host: Host = self._vehicle if supplied is None else supplied(self._vehicle)
        self._holding = False
        self._given = 0
        self._ticks: list[Tick] = []
        self._told = RoundStory()
        x, y, z = self._fleet.positions()[pid].tolist()
        self.position: Point = (x, y, z)

    @property
    def holding(self) -> bool:
        """True if the robot is held in place."""
        return self._holding

    @holding.setter
    def holding(self, is_held: bool) -> None:
        if is_held != self._holding:
            (self._fleet.hold if is_held else self._fleet.release)(self._pid)
        self._holding = is_held

    @property
    def sensed(self) -> MotionSensors:
        """The motion sensors of the robot."""
        return self._vehicle.sensed[self._pid]

    def told(self) -> RoundStory:
        """The report of all inputs since the last one."""
        told, self._told = self._told, RoundStory()
        return told

    def start(self, robot: int | None, name: str) -> Any:
        value = self._told.starts[robot, name] = self._host.start(robot, name)
        return value

    def read(self, robot: Robot) -> Mapping[str, Any]:
        ended = self._rounds
        self._rounds += 1
        self._vehicle.pass_time([robot], self._rounds * self._delta_s, self._tick)
        self.position = self._ticks[-1].position if self._ticks else self.position
        readings = self._host.read(robot)
        self._told.turns[ended] = EnvironmentStep(tuple(self._ticks), self.sensed, readings)
        self._ticks.clear()
        return readings

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        value = self._host.ask(turn, robot, key, function, arguments)
        self._told.answers[self._question(turn, key)] = value
        return value

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        value = self._host.choose(turn, robot, key, low, high)
        self._told.answers[self._question(turn, key)] = value
        return value

    def _question(self, turn: Turn, key: Key) -> Question:
        # Models ask right behind the reading that ends their round.
        return turn, self._rounds - 1 if turn is Turn.ENV else None, key

    def _tick(self, fleet: Fleet) -> None:
        pid = self._pid
        x, y, z = fleet.positions()[pid].tolist()
        w, i, j, k = fleet.attitudes()[pid].tolist()
        given = int(fleet.paths_given()[pid])
        path = fleet.path(pid) if given != self._given else None
        self._given = given
        heading, reached = float(fleet.headings()[pid]), bool(fleet.reached()[pid])
        self._ticks.append(Tick((x, y, z), heading, (w, i, j, k), reached, given, path))


class RobotMaker(Struct, frozen=True):
    """A factory of the robots of a run, called in each robot's process."""

    cast: Cast
    scene: Scene
    supplied: Callable[[Host], Host] | None = None

    def __call__(self, job: Job, pid: int) -> Member:
        body = SimulatedBody(self.cast, self.scene, pid, self.supplied)
        robot = job.classes[job.kinds[pid]](pid, job.kinds, job.delta_s, body)
        member = Member(robot, body)

        def tell(entry: LogEntry) -> RoundStory:
            decision = entry.decision
            last = job.rounds is not None and entry.round + 1 >= job.rounds
            if decision.fault is None and (last or member.all_stopped):
                # Nobody proposes any more, and the end of the round is to be seen.
                robot.evolve(body.read(robot))
            told = body.told()
            told.ran = tuple(taken.robot for taken in decision.ran)
            if decision.fault is not None and decision.fault.robot is not None:
                told.ran = (*told.ran, decision.fault.robot)
            told.had_an_event = member.has_proposed(entry.round) and robot.had_an_event
            return told

        member.tell = tell
        return member


class Followed(Simulation):
    """A simulation reconstructed from reports: :meth:`hear` takes them, :meth:`rounds` runs on."""

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
        """Take a robot's reports, its rounds in order."""
        for moment in moments:
            assert isinstance(moment.told, RoundStory)
            self._memory.add(moment.pid, moment.round, moment.told)

    def rounds(self, *, is_over: bool = False) -> Iterator[Decision]:
        """Yield the rounds that all robots have reported by now, INIT first.

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
        self.host.sensed = FleetSensors.of([delta.sensed for delta in deltas])


class _Memory:
    """The reports not yet reconstructed. ``round`` is the next one."""

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
        """Return whether all robots have reported the decision of a round."""
        return len(self._told.get(number, ())) == self._robots

    def is_ended(self, number: int) -> bool:
        """Return whether all robots have reported the end of a round."""
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
        """Drop the reports of a reconstructed round."""
        before = self.round - 1
        for past in (self._told, self._turns):
            past.pop(before, None)
        self._answers = {k: v for k, v in self._answers.items() if k[1] > before}
        self.round += 1


class _Answers:
    """The host that answers as reported. Queries of claims alone go to another host."""

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
    """The schedule as reported."""

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
    """A fleet whose vehicles are placed as reported."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene.world, scene.robots, scene.seed)
        self._positions, self._headings = super().positions(), super().headings()
        self._attitudes, self._reached = super().attitudes(), super().reached()
        self._given = super().paths_given()
        self._paths = {robot: np.zeros((0, 3)) for robot in range(len(scene.robots))}

    def place(self, ticks: Sequence[Tick]) -> None:
        """Place all vehicles for a tick of control."""
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

    def tilts(self, robots: Ints) -> Floats:
        return tilts_of(self._attitudes[robots])

    def reached(self) -> Bools:
        return self._reached

    def paths_given(self) -> Ints:
        return self._given

    def path(self, robot: int) -> Floats:
        return self._paths[robot]

    def touched(self, robot: int) -> tuple[tuple[Hindrance, int], ...]:
        return ()  # a process has its own robot alone: none of them touches another
