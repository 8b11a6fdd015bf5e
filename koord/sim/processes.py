"""One robot of a simulated fleet in a process of its own: its vehicle, its library, its program.

What a process does not have is the others: they are heard of, and not met. Where no two vehicles
touch, a robot moves as it does among the others in one process, to the last bit. A robot tells all
that its program left open and how its vehicle moved (:class:`RoundStory`): from that the run is
made out (:mod:`.following`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from msgspec import Struct, field

from koord.runtime.deploy.member import Member
from koord.runtime.deploy.running import Job
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.world import Point
from koord.runtime.protocol.entries import LogEntry
from koord.runtime.robot import Host, Key, Robot, Turn
from koord.sim.fleet import Fleet, Sensed
from koord.sim.running import Cast, host_of
from koord.sim.scene import Scene


class Tick(Struct, frozen=True):
    """Where a vehicle is when a tick of control is over."""

    position: Point
    heading_rad: float
    attitude: tuple[float, float, float, float]
    reached: bool
    given: int  #: how many paths it was given up to now
    path: Floats | None  #: the last of them, shape ``(k, 3)``, if it is new


class EnvironmentStep(Struct, frozen=True):
    """The environment's turn of one robot: how it moved, and what it read at the end of it."""

    ticks: tuple[Tick, ...]
    sensed: Sensed
    readings: Mapping[str, Any]


#: Which of a robot's turns asked, in which round (None: the one that is told of), and what.
Question: TypeAlias = tuple[Turn, int | None, Key]


class RoundStory(Struct):
    """What a robot tells of a round: all that its program left open since it told last.

    ``ran`` are the robots that were let through, in the order in which they were, and
    ``had_an_event`` is whether this one had run an event that it wanted to be let through with.
    ``turns`` are the environment's turns by the round that they end.
    """

    starts: dict[tuple[int | None, str], Any] = field(default_factory=dict)
    answers: dict[Question, Any] = field(default_factory=dict)
    turns: dict[int, EnvironmentStep] = field(default_factory=dict)
    ran: tuple[int, ...] = ()
    had_an_event: bool = False


class SimulatedBody:
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
        """Whether the robot was told to stay where it is."""
        return self._holding

    @holding.setter
    def holding(self, is_held: bool) -> None:
        if is_held != self._holding:
            (self._fleet.hold if is_held else self._fleet.release)(self._pid)
        self._holding = is_held

    @property
    def sensed(self) -> Sensed:
        """What the robot knows of itself."""
        return self._vehicle.sensed[self._pid]

    def told(self) -> RoundStory:
        """All that there is to tell since the last time."""
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
    """Makes the robots of a run, each where its process is."""

    cast: Cast
    scene: Scene
    supplied: Callable[[Host], Host] | None = None

    def __call__(self, job: Job, pid: int) -> Member:
        body = SimulatedBody(self.cast, self.scene, pid, self.supplied)
        robot = job.classes[job.kinds[pid]](pid, job.kinds, job.delta_s, body)
        member = Member(robot, body, job.journal(pid), job.program)

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
