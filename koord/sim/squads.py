"""Squads: robots of one kind with their automata, controllers and vehicles, run together.

A squad advances in ticks of control. In each, every robot is told where it is, its automaton and
its controller take a step, and its vehicle moves under the command in smaller steps.
"""

from __future__ import annotations

from typing import Protocol, TypeAlias, assert_never

import numpy as np

from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.bodies import Car, Drone, Ideal
from koord.runtime.motion.course import Horizon
from koord.runtime.motion.driving import Driving, Measured, Steering
from koord.runtime.motion.flying import Flying, Reference
from koord.runtime.motion.group import Group
from koord.runtime.motion.planners import planner
from koord.runtime.motion.world import World
from koord.sim.disturbances import Delay, Disturbances, Fixes, Gusts
from koord.sim.ground import Ground
from koord.sim.kinds import Kind, Level
from koord.sim.vehicles.bicycles import Bicycles
from koord.sim.vehicles.quadrotors import PointDrones, Quadrotors
from koord.sim.vehicles.touching import Touched

Seed: TypeAlias = np.random.SeedSequence

#: Vehicles move in steps of this length.
STEP_S = 0.01

#: So many steps make a tick of control.
STEPS = 5

#: Predictive controllers take every second tick.
_PREDICTIVE_TICKS = 2

_PLAN_MOST = 4


class Squad(Protocol):
    """Robots of one kind. All arrays have a row for each robot, in the order they were given in."""

    group: Group

    def tick(self, now_s: float) -> None:
        """One step of control at a time, and the movement until the next."""
        ...

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        """The positions ``(n, 3)`` and headings that robots are told."""
        ...

    def truth(self) -> tuple[Floats, Floats]:
        """The positions ``(n, 3)`` and headings that robots have."""
        ...

    def attitude(self) -> Floats:
        """Unit quaternions ``(n, 4)``, w first."""
        ...

    @property
    def vehicles(self) -> Touching:
        """What its robots drive or fly."""
        ...


class Touching(Protocol):
    """Vehicles that may touch something; those of most levels pass through everything."""

    def touched(self, number: int) -> tuple[Touched, ...]:
        """What one of them touches."""
        ...


def squad(
    kind: Kind,
    world: World,
    start: Floats,
    heading_rad: Floats,
    seeds: list[Seed],
    ground: Ground,
) -> Squad:
    """A squad at rest at positions ``(n, 3)``. Raises KoordError for libraries that are missing.

    All squads of a run are on one ground.
    """
    group = Group(
        len(start),
        kind.body,
        world,
        planner(kind.planner, world, kind.body, kind.effort),
        kind.visit,
        [int(seed.generate_state(1)[0]) for seed in seeds],
    )
    match kind.body:
        case Car():
            return CarSquad(kind, kind.body, group, start, heading_rad, seeds, ground)
        case Drone():
            return DroneSquad(kind, kind.body, group, start, heading_rad, seeds, ground)
        case Ideal():
            return IdealSquad(kind, group, start, heading_rad)
        case _:
            assert_never(kind.body)


class CarSquad:
    """Cars, with pursuit or model-predictive control."""

    def __init__(
        self,
        kind: Kind,
        car: Car,
        group: Group,
        start: Floats,
        heading_rad: Floats,
        seeds: list[Seed],
        ground: Ground,
    ) -> None:
        self.group = group
        self.vehicles = _cars(kind.level, car, start, heading_rad, ground)
        predictive = kind.steering is Steering.PREDICTIVE
        self._every = _PREDICTIVE_TICKS if predictive else 1
        self.driving = Driving(group, kind.steering, Horizon(step_s=self._every * STEPS * STEP_S))
        noise, _ = _children(seeds)
        self._fixes = Fixes(kind.disturbances.positioning, noise, flat=True)
        self._delay = _delay(kind.disturbances, np.zeros((len(start), 2)))
        self._command: Floats = np.zeros((len(start), 2))
        self._ticks = 0

    def tick(self, now_s: float) -> None:
        position, heading = self.fixes(now_s)
        self.group.plan(position, heading, _PLAN_MOST)
        self.group.update(position, now_s)
        if self._ticks % self._every == 0:
            measured = Measured(position, heading, self.vehicles.speed)
            self._command = self.driving.command(measured, self._every * STEPS * STEP_S)
            self.group.replan(np.flatnonzero(self.driving.missed).tolist())
        self._ticks += 1
        self.vehicles.advance(self._delay.pass_on(self._command), STEP_S, STEPS)

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        return self._fixes.read(self.vehicles.position, self.vehicles.heading, now_s)

    def truth(self) -> tuple[Floats, Floats]:
        return self.vehicles.position, self.vehicles.heading

    def attitude(self) -> Floats:
        return _upright(self.vehicles.heading)


class DroneSquad:
    """Drones under cascaded control."""

    def __init__(
        self,
        kind: Kind,
        drone: Drone,
        group: Group,
        start: Floats,
        heading_rad: Floats,
        seeds: list[Seed],
        ground: Ground,
    ) -> None:
        self.group = group
        self.vehicles = _drones(kind.level, drone, start, ground)
        self.flying = Flying(group, start)
        noise, wind = _children(seeds)
        self._fixes = Fixes(kind.disturbances.positioning, noise, flat=False)
        self._gusts = Gusts(kind.disturbances.wind, wind)
        self._delay = _delay(
            kind.disturbances, np.concatenate([start, 0 * start, 0 * start], axis=1)
        )
        self._heading = np.zeros_like(heading_rad)  # drones keep their noses along x

    def tick(self, now_s: float) -> None:
        position, heading = self.fixes(now_s)
        self.group.plan(self.flying.origin(position), heading, _PLAN_MOST)
        self.group.update(position, now_s)
        reference = self.flying.command(position, STEPS * STEP_S)
        sent = np.concatenate(
            [reference.position, reference.velocity, reference.acceleration], axis=1
        )
        due = self._delay.pass_on(sent)
        # What the drone is told may be off or late: its controller aims beside by as much.
        aim = due[:, :3] - (position - self.truth()[0])
        wind = self._gusts.blow(STEPS * STEP_S)
        self.vehicles.advance(Reference(aim, due[:, 3:6], due[:, 6:]), wind, STEP_S, STEPS)

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        return self._fixes.read(self.vehicles.state.position.T, self._heading, now_s)

    def truth(self) -> tuple[Floats, Floats]:
        return self.vehicles.state.position.T, self._heading

    def attitude(self) -> Floats:
        return self.vehicles.state.attitude.T


class IdealSquad:
    """Points that are where they are to be."""

    def __init__(self, kind: Kind, group: Group, start: Floats, heading_rad: Floats) -> None:
        self.group = group
        self.vehicles = _Points()
        self.flying = Flying(group, start, waits=False)
        self._heading: Floats = heading_rad.copy()

    def tick(self, now_s: float) -> None:
        position = self.flying.rest
        self.group.plan(position, self._heading, _PLAN_MOST)
        self.group.update(position, now_s)
        velocity = self.flying.command(position, STEPS * STEP_S).velocity
        moving = (velocity[:, 0] != 0) | (velocity[:, 1] != 0)
        course = np.arctan2(velocity[:, 1], velocity[:, 0])
        self._heading = np.where(moving, course, self._heading)

    def put(self, position: Floats) -> None:
        """Be somewhere, from one moment to the next; shape ``(n, 3)``."""
        self.flying.rest = position.copy()

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        return self.truth()

    def truth(self) -> tuple[Floats, Floats]:
        return self.flying.rest, self._heading

    def attitude(self) -> Floats:
        return _upright(self._heading)


class _Points:
    """Vehicles that are not there: they touch nothing."""

    def touched(self, number: int) -> tuple[Touched, ...]:
        return ()


class Cars(Touching, Protocol):
    """Cars of any level. All arrays have a row for each."""

    position: Floats  #: of the middle of the rear axle, shape ``(n, 3)``
    heading: Floats
    speed: Floats  #: along the heading

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Go on for some steps with commanded speeds and steering angles, shape ``(n, 2)``."""
        ...


def _cars(level: Level, car: Car, start: Floats, heading_rad: Floats, ground: Ground) -> Cars:
    match level:
        case Level.SIMPLE:
            return Bicycles(car, start, heading_rad)
        case Level.FULL | Level.FAST:
            from koord.sim.vehicles.contact import CollidingCars

            return CollidingCars(car, start, heading_rad, ground.floor)
        case Level.MUJOCO:
            from koord.sim.vehicles.physics import PhysicalCars

            return PhysicalCars(car, start, heading_rad, ground.arena)
        case _:
            assert_never(level)


def _drones(level: Level, drone: Drone, start: Floats, ground: Ground) -> Quadrotors:
    match level:
        case Level.SIMPLE:
            return PointDrones(drone, start, ground.world.ground)
        case Level.FULL:
            return Quadrotors(drone, start, ground.world.ground)
        case Level.FAST:
            from koord.sim.vehicles.compiled import CompiledQuadrotors

            return CompiledQuadrotors(drone, start, ground.world.ground)
        case Level.MUJOCO:
            from koord.sim.vehicles.physics import PhysicalDrones

            return PhysicalDrones(drone, start, ground.arena)
        case _:
            assert_never(level)


def _children(seeds: list[Seed]) -> tuple[list[Seed], list[Seed]]:
    """Seeds for the noise and for the wind of each robot."""
    both = [seed.spawn(2) for seed in seeds]
    return [noise for noise, _ in both], [wind for _, wind in both]


def _delay(disturbances: Disturbances, at_first: Floats) -> Delay:
    return Delay(round(disturbances.actuation_delay_s / (STEPS * STEP_S)), at_first)


def _upright(heading_rad: Floats) -> Floats:
    zero = np.zeros_like(heading_rad)
    return np.column_stack([np.cos(heading_rad / 2), zero, zero, np.sin(heading_rad / 2)])
