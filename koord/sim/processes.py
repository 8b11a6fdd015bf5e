"""One robot of a simulated fleet in a process of its own: its vehicle, its library, its program.

What a process does not have is the others: they are heard of, and not met. Where no two vehicles
touch, a robot moves as it does among the others in one process, to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from koord.runtime.deploy.member import Member
from koord.runtime.deploy.running import Job
from koord.runtime.motion.world import Point
from koord.runtime.robot import Key, Robot, Turn
from koord.sim.fleet import Fleet
from koord.sim.running import Cast, host_of
from koord.sim.scene import Scene


class SimulatedBody:
    """The host of one robot: at each reading of its sensors, δ has passed."""

    def __init__(self, cast: Cast, scene: Scene, pid: int) -> None:
        self._pid, self._delta_s, self._rounds = pid, scene.delta_s, 0
        self._fleet = Fleet(scene.world, scene.robots, scene.seed, only=pid)
        self._host = host_of(cast, scene, self._fleet)
        self._holding = False
        self.position: Point = self._truth()

    @property
    def holding(self) -> bool:
        """Whether the robot was told to stay where it is."""
        return self._holding

    @holding.setter
    def holding(self, is_held: bool) -> None:
        if is_held != self._holding:
            (self._fleet.hold if is_held else self._fleet.release)(self._pid)
        self._holding = is_held

    def start(self, robot: int | None, name: str) -> Any:
        return self._host.start(robot, name)

    def read(self, robot: Robot) -> Mapping[str, Any]:
        self._rounds += 1
        self._host.pass_time([robot], self._rounds * self._delta_s)
        self.position = self._truth()
        return self._host.read(robot)

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        return self._host.ask(turn, robot, key, function, arguments)

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        return self._host.choose(turn, robot, key, low, high)

    def _truth(self) -> Point:
        x, y, z = self._fleet.positions()[self._pid].tolist()
        return x, y, z


@dataclass(frozen=True, slots=True)
class Maker:
    """Makes the robots of a run, each where its process is."""

    cast: Cast
    scene: Scene

    def __call__(self, job: Job, pid: int) -> Member:
        body = SimulatedBody(self.cast, self.scene, pid)
        robot = job.classes[job.kinds[pid]](pid, job.kinds, job.delta_s, body)
        return Member(robot, body, job.journal(pid), job.program)
