"""The simulated fleet as the host of compiled programs.

A round's environment turn has two parts: :meth:`Hosted.pass_time` hands the robots' actuators to
the fleet and lets δ pass; then every robot reads its sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from koord.runtime.drivers.frames import turned
from koord.runtime.drivers.setpoints import Sensed
from koord.runtime.motion.library import Library
from koord.runtime.motion.world import Point
from koord.runtime.platform.sensors import MotionSensors
from koord.runtime.platform.world_host import WorldHost
from koord.runtime.ports import is_in_range, is_set
from koord.runtime.robot import Robot
from koord.sim.fleet import Fleet, Passing
from koord.sim.lidar import Scanner
from koord.sim.radio import Radio, Reception
from koord.sim.sensing import FleetSensors

#: Radios by which everybody hears everybody.
_ALL_HEARD = Radio()


class Hosted(WorldHost):
    """The host of all robots of a run. ``scanners[i]`` is that of robot i, if it has one."""

    def __init__(
        self,
        classes: Sequence[type[Robot]],
        kinds: Sequence[int],
        fleet: Fleet,
        library: Library,
        seed: int = 0,
        scanners: Mapping[int, Scanner] | None = None,
        radio: Radio = _ALL_HEARD,
    ) -> None:
        super().__init__(classes, kinds, fleet.world, library, seed)
        self.fleet = fleet
        for robot, kind in enumerate(self.kinds):
            if any(is_takeoff for _, _, is_takeoff in self._goals[kind]):
                fleet.wait_for_takeoff(robot)
        self.scanners = dict(scanners or {})
        self._noise = self._noise_by(seed)
        self.reception = Reception(radio, fleet.positions())
        #: What plug-ins and radios tell robots, where another process has them.
        self.given: Mapping[int, dict[str, Any]] | None = None
        #: what robots know of themselves
        self.sensed: FleetSensors = fleet.sensed()

    def take_on(self, classes: Sequence[type[Robot]]) -> None:
        super().take_on(classes)
        #: Of each kind of robot, the port that says where it goes, if that is all it is told.
        self._only_target = [
            goals[0][0] if len(goals) == 1 and not any(goals[0][1:]) else None
            for goals in self._goals
        ]
        #: The sensors of each kind of robot that say who is in range. [ENV-RANGE]
        self._ranging = [
            [name for name in one.SENSORS if is_in_range(name, one.PORTS[name])]
            for one in self.classes
        ]

    def reseed(self, seed: int) -> None:
        super().reseed(seed)
        self._noise = self._noise_by(seed)
        self.fleet.reseed(seed)

    def _noise_by(self, seed: int) -> dict[int, np.random.Generator]:
        """What the noise of scanners is drawn from, by robot."""
        return {
            robot: np.random.default_rng(np.random.SeedSequence((seed, robot, 2)))
            for robot in self.scanners
        }

    def pass_time(
        self,
        robots: Sequence[Robot],
        time_s: float,
        watch: Callable[[Fleet], None] | None = None,
        passing: Passing | None = None,
    ) -> None:
        """Pass new orders of robots to the fleet, then advance to ``time_s`` seconds.

        Robots whose actuators are as they were may be left out. ``watch`` and ``passing`` are as in
        :meth:`.Fleet.advance_to`.
        """
        self.take_orders(robots)
        self.library.begin_round()
        self.fleet.advance_to(time_s, watch, passing)
        if self.reception.radio.carries_rounds or any(self._ranging):
            self.reception.measure(self.fleet.positions())
        self.sensed = self.fleet.sensed()

    def take_orders(self, robots: Sequence[Robot]) -> None:
        """Pass new orders of robots to the fleet: at once of all who are only sent to places."""
        targets: dict[int, Point] = {}
        for robot in robots:
            name, pid = self._only_target[robot.KIND], robot.pid
            if name is None or pid in self.modules:
                self.order(robot)
                continue
            value = vars(robot)[name]
            if self._is_new(pid, name, value) and is_set(value):
                targets[pid] = self._goal(pid, value)
        if targets:
            self.fleet.go_to_all(targets)

    @property
    def told_more(self) -> list[int]:
        """The robots that sense what their vehicles do not: plug-ins serve it, or a radio."""
        of_kinds = enumerate(self.kinds)
        return [robot for robot, kind in of_kinds if robot in self.modules or self._ranging[kind]]

    def ranging(self, robot: int) -> Sequence[str]:
        """The sensors of a robot that say who is in range."""
        return self._ranging[self.kinds[robot]]

    def heard_by(self, robot: int, name: str) -> tuple[bool, ...]:
        """What a sensor says that says who is in range."""
        if self.given is not None:
            heard: tuple[bool, ...] = self.given[robot][name]
            return heard
        return self.reception.heard(robot)

    def start(self, robot: int | None, name: str) -> Any:
        if robot is not None and name in self._ranging[self.kinds[robot]]:
            return self.served(robot)[name]
        return super().start(robot, name)

    def pass_idle(self, rounds: int, ticks: int) -> None:
        """Note rounds without orders, and the ticks that the fleet has made in them."""
        for _ in range(rounds):
            self.library.begin_round()
        self.fleet.ticks += ticks
        self.sensed = self.fleet.sensed()

    def served(self, robot: int) -> dict[str, Any]:
        if self.given is not None:
            return self.given.get(robot, {})
        heard = self.reception.heard
        found = {name: heard(robot) for name in self._ranging[self.kinds[robot]]}
        return found | super().served(robot)

    def sensors(self, robot: int) -> MotionSensors:
        return self.sensed[robot]

    def scan(self, robot: int) -> tuple[Point, ...]:
        scanner = self.scanners.get(robot)
        if scanner is None:
            return ()
        sensed = self.sensed[robot]
        return scanner.scan(sensed.psn, sensed.heading_rad, self._noise[robot])

    def whereabouts(self, robot: int) -> tuple[Sensed, float]:
        seen, now_s = self.sensed[robot], self.fleet.now_s
        return Sensed(seen.psn, turned(seen.heading_rad), (0.0, 0.0, 0.0), now_s), now_s

    def follow(self, robot: int, path: Sequence[Point]) -> None:
        self.fleet.follow(robot, path)

    def go_to(self, robot: int, target: Point) -> None:
        self.fleet.go_to(robot, target)

    def take_off(self, robot: int, up: bool) -> None:
        self.fleet.take_off(robot, up)
