"""Squads: robots of one device with their automata, controllers and vehicles, run together.

A squad advances in ticks of control. In each, every robot is told where it is, its automaton and
its controller take a step, and its vehicle moves under the command in smaller steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, TypeAlias, TypeGuard, assert_never

import numpy as np
from msgspec import Struct, field

from koord.machine import is_installed
from koord.runtime.lazily import Lazily
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.automaton import Visit
from koord.runtime.motion.bodies import (
    Body,
    Car,
    DifferentialDrive,
    Drone,
    Level,
    Pace,
    PlannerName,
    Steering,
    type_of,
)
from koord.runtime.motion.driving import Legs, Measured
from koord.runtime.motion.group import TICK_S, Group
from koord.runtime.motion.planners import planner
from koord.runtime.motion.planning import PlanningEffort, Touched
from koord.runtime.motion.routes import Routes
from koord.runtime.motion.workers import Workers
from koord.runtime.motion.world import World
from koord.runtime.plugins.calls import PlugIn
from koord.sim.disturbances import Delay, Disturbances, Fixes, spawned
from koord.sim.vehicles.wheels import Hull, Rolling

if TYPE_CHECKING:
    from koord.sim.vehicles.contact import Floor
    from koord.sim.vehicles.physics import Arena

Seed: TypeAlias = np.random.SeedSequence

#: Vehicles move in steps of this length.
STEP_S = 0.01

#: So many steps make a tick of control.
STEPS = round(TICK_S / STEP_S)


class DeviceModel(Struct, frozen=True):
    """The simulation model of a device, as in the configuration. Its robots make a squad."""

    body: Body
    planner: PlannerName | PlugIn
    level: Level = Level.FULL
    steering: Steering = Steering.PREDICTIVE
    visit: Visit = field(default_factory=Visit)
    disturbances: Disturbances = field(default_factory=Disturbances)
    effort: PlanningEffort = field(default_factory=PlanningEffort)
    plan_takes_s: float = 0.0  #: from asking a planner for a way until the way is there
    controller: PlugIn | None = None
    modules: tuple[tuple[str, PlugIn], ...] = ()  #: of the program, and what serves them
    ignores_height: bool = False  #: it goes to the place on the ground below its goals


def is_compiled(model: DeviceModel) -> bool:
    """Return whether a model's robots move by machine code: with llvmlite all but points do."""
    level = model.level
    if not isinstance(model.body, Drone | Car | DifferentialDrive):
        return False
    return level is Level.FAST or (level is Level.FULL and is_installed())


class Engines:
    """The physics engines that all vehicles of a run share, so that they can touch each other.

    An engine is made when the first vehicle wants it. Raises KoordError if its library is missing.
    And the processes, ``planners`` of them, that plan for all robots.
    """

    def __init__(self, world: World, planners: int = 0) -> None:
        self.world, self.workers = world, Workers(planners)

    @cached_property
    def floor(self) -> Floor:
        """Contact in the plane, for vehicles of level ``full`` that drive."""
        from koord.sim.vehicles.contact import Floor

        return Floor(self.world)

    @cached_property
    def arena(self) -> Arena:
        """Contact in space, for all vehicles of level ``mujoco``."""
        from koord.sim.vehicles.physics import Arena

        return Arena(self.world)


class VehicleSetup(Struct, frozen=True):
    """The parameters of vehicles at rest at positions ``start``, shape ``(n, 3)``."""

    model: DeviceModel
    start: Floats
    heading_rad: Floats
    engines: Engines


class SquadSetup(VehicleSetup, frozen=True):
    """The parameters of a squad."""

    group: Group
    noise: Sequence[Seed]  #: of each robot
    wind: Sequence[Seed]  #: of each robot

    def delay(self, at_first: Floats) -> Delay:
        """The delay line of commands, filled with initial ones."""
        delay_s = self.model.disturbances.actuation_delay_s
        return Delay(round(delay_s / (STEPS * STEP_S)), at_first)


class Touching(Protocol):
    """Vehicles that may have contacts; those of most levels pass through everything."""

    def touched(self, number: int) -> tuple[Touched, ...]:
        """The contacts of a vehicle."""
        ...


class Squad(Protocol):
    """A squad: robots of one device. Arrays have a row for each robot, in the given order."""

    group: Group

    def tick(self, now_s: float) -> None:
        """Make one step of control, and the movement until the next."""
        ...

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        """The measured positions ``(n, 3)`` and headings."""
        ...

    def truth(self) -> tuple[Floats, Floats]:
        """The true positions ``(n, 3)`` and headings."""
        ...

    def attitude(self) -> Floats:
        """The attitudes as unit quaternions ``(n, 4)``, w first."""
        ...

    @property
    def vehicles(self) -> Touching:
        """The vehicles of the robots."""
        ...

    def reseed(self, noise: Sequence[Seed], wind: Sequence[Seed]) -> None:
        """Let what disturbs each robot hang on other seeds from now on."""
        ...


class TickingSquad(Squad, Protocol):
    """A squad that can make several ticks, if its vehicles touch none of other squads'."""

    def ticks(self, times_s: Sequence[float]) -> Sequence[Floats]:
        """Make a tick at each time, and return where robots are after it, shape ``(n, 3)``.

        The arrays stay as they are.
        """
        ...


class FusedSquad(TickingSquad, Protocol):
    """A squad that makes several ticks in one call.

    Arrays that it gives stay as they are, and are nobody's to write to.
    """

    def tilts(self) -> Floats:
        """The roll and pitch of robots, shape ``(n, 2)``."""
        ...

    def short_m(self) -> Floats:
        """How far each robot is from where it would count as at the end of its route."""
        ...


def is_ticking(squad: Squad) -> TypeGuard[TickingSquad]:
    """Return whether a squad can make several ticks."""
    return hasattr(squad, "ticks")


def is_fused(squad: TickingSquad) -> TypeGuard[FusedSquad]:
    """Return whether a squad makes several ticks in one call."""
    return hasattr(squad, "tilts") and hasattr(squad, "short_m")


def squad(
    model: DeviceModel, start: Floats, heading_rad: Floats, seeds: Sequence[Seed], engines: Engines
) -> Squad:
    """A squad at rest at positions ``(n, 3)``, of a type in the table of vehicles.

    Raises KoordError for libraries that are missing.
    """
    body, world = model.body, engines.world
    group = Group(
        len(start),
        body,
        world,
        planner(model.planner, world, body, model.effort, is_quick=is_installed()),
        model.visit,
        _planning(seeds),
        takes_s=model.plan_takes_s,
        # A planner of a lab's own may remember what it did.
        workers=None if isinstance(model.planner, PlugIn) else engines.workers,
        routes=_routes(body),
    )
    setup = SquadSetup(model, start, heading_rad, engines, group, *_disturbing(seeds))
    made: Squad = import_module(type_of(body).simulator).squad(setup)
    return made


def _routes(body: Body) -> Callable[[int, Pace], Routes]:
    """What makes routes: those of cars are measured by machine code where there is llvmlite."""
    if not (body.pace.reverses and is_installed()):
        return Routes
    from koord.runtime.motion.compiled_routes import routes_of_cars

    return routes_of_cars


def reseed(squad: Squad, seeds: Sequence[Seed]) -> None:
    """Let all chance to come in a squad hang on other seeds, one for each robot."""
    squad.group.reseed(_planning(seeds))
    squad.reseed(*_disturbing(seeds))


def _planning(seeds: Sequence[Seed]) -> Sequence[int]:
    """What plans of robots with these seeds hang on."""
    return Lazily(len(seeds), lambda row: int(seeds[row].generate_state(1)[0]))


def _disturbing(seeds: Sequence[Seed]) -> tuple[Sequence[Seed], Sequence[Seed]]:
    """What noise and wind of robots with these seeds hang on."""
    return (
        Lazily(len(seeds), lambda row: spawned(seeds[row], 0)),
        Lazily(len(seeds), lambda row: spawned(seeds[row], 1)),
    )


class Wheeled(Touching, Protocol):
    """Vehicles that drive on the ground. All arrays have a row for each."""

    @property
    def position(self) -> Floats:
        """The positions in metres, shape ``(n, 3)``."""
        ...

    @property
    def heading(self) -> Floats: ...

    @property
    def speed(self) -> Floats:
        """The speeds along the heading, in m/s."""
        ...

    def advance(self, command: Floats, dt_s: float, steps: int) -> None:
        """Advance some steps under commands, shape ``(n, 2)``."""
        ...


def wheeled(setup: VehicleSetup, told: Rolling, hull: Hull) -> Wheeled:
    """Vehicles on wheels at the level of their device; ``told`` is their model without contact."""
    match setup.model.level:
        case Level.SIMPLE:
            return told
        case Level.FULL | Level.FAST:
            return in_contact(told, hull, setup.engines.floor)
        case Level.MUJOCO:
            from koord.sim.vehicles.physics import PhysicalWheels

            return PhysicalWheels(told, setup.engines.arena)
        case _:
            assert_never(setup.model.level)


def in_contact(told: Rolling, hull: Hull, floor: Floor) -> Wheeled:
    """Vehicles in contact in the plane, by machine code where there is llvmlite."""
    if not is_installed():
        from koord.sim.vehicles.contact import Colliding

        return Colliding(told, hull, floor)
    from koord.sim.vehicles.compiled_contact import compiled

    return compiled(told, hull, floor)


class Tracker(Protocol):
    """The law by which vehicles on the ground follow the routes of their group."""

    legs: Legs

    def command(self, measured: Measured, dt_s: float) -> Floats:
        """Commands for the next step, shape ``(n, 2)``."""
        ...


def tracker(setup: SquadSetup, usual: Callable[[], Tracker]) -> Tracker:
    """The law of a squad: that of its controller if its device names one. Raises PlugInError."""
    if setup.model.controller is None:
        return usual()
    from koord.runtime.plugins.loading import fleet_driving

    return fleet_driving(setup.model.controller, setup.group)


class WheeledSquad:
    """A squad of ground vehicles under a tracker, which acts at every ``every``-th tick."""

    def __init__(
        self, setup: SquadSetup, vehicles: Wheeled, tracker: Tracker, every: int = 1
    ) -> None:
        self.group, self.vehicles, self.tracker = setup.group, vehicles, tracker
        self._fixes = Fixes(setup.model.disturbances.positioning, setup.noise, flat=True)
        self._command: Floats = np.zeros((len(setup.start), 2))
        self._delay = setup.delay(self._command)
        self._every, self._ticks = every, 0

    def plan(self, now_s: float) -> None:
        """Plan ways to targets, as the next tick does first. For what is measured exactly."""
        position, heading = self.fixes(now_s)
        self.group.plan(position, heading, now_s)

    def tick(self, now_s: float) -> None:
        position, heading = self.fixes(now_s)
        self.group.plan(position, heading, now_s)
        self._track(position, heading, now_s, acts=self._ticks % self._every == 0)
        self._ticks += 1
        self.vehicles.advance(self._delay.pass_on(self._command), STEP_S, STEPS)

    def ticks(self, times_s: Sequence[float]) -> list[Floats]:
        """Make a tick at each time, and return where vehicles are after it, shape ``(n, 3)``."""
        found = []
        for now_s in times_s:
            self.tick(now_s)
            found.append(self.vehicles.position.copy())
        return found

    def _track(self, position: Floats, heading: Floats, now_s: float, *, acts: bool) -> None:
        """Step the automata, and let the tracker command if it acts now."""
        self.group.update(position, now_s)
        if acts:
            measured = Measured(position, heading, self.vehicles.speed)
            self._command = self.tracker.command(measured, self._every * STEPS * STEP_S)
            self.group.replan(np.flatnonzero(self.tracker.legs.missed).tolist())

    def fixes(self, now_s: float) -> tuple[Floats, Floats]:
        return self._fixes.read(self.vehicles.position, self.vehicles.heading, now_s)

    def truth(self) -> tuple[Floats, Floats]:
        return self.vehicles.position, self.vehicles.heading

    def reseed(self, noise: Sequence[Seed], wind: Sequence[Seed]) -> None:
        self._fixes.reseed(noise)  # there is no wind on the ground

    def attitude(self) -> Floats:
        return upright(self.vehicles.heading)


def upright(heading_rad: Floats) -> Floats:
    """The attitudes of upright robots: unit quaternions ``(n, 4)``, w first."""
    zero = np.zeros_like(heading_rad)
    return np.column_stack([np.cos(heading_rad / 2), zero, zero, np.sin(heading_rad / 2)])
