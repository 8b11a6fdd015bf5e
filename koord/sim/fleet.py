"""The fleet: all simulated robots of a run, and their clock.

Time is counted in ticks of control and moves on when it is told to: nothing here waits, and nothing
reads a clock. Equal seeds and equal orders give equal runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Protocol

import numpy as np
from msgspec import Struct

from koord.runtime.lazily import Lazily
from koord.runtime.motion.arrays import Bools, Floats, Ints, lengths
from koord.runtime.motion.bodies import Level
from koord.runtime.motion.geometry import as_path
from koord.runtime.motion.group import TAKEOFF_M, TICK_S
from koord.runtime.motion.planning import Hindrance, Plight
from koord.runtime.motion.world import Point, World
from koord.runtime.platform.rising import RISEN
from koord.runtime.plugins.calls import PlugInError
from koord.sim.disturbances import spawned
from koord.sim.run_log import tilts_of
from koord.sim.sensing import FleetSensors
from koord.sim.squads import (
    DeviceModel,
    Engines,
    FusedSquad,
    Seed,
    Squad,
    TickingSquad,
    is_compiled,
    is_fused,
    is_ticking,
    reseed,
    squad,
)
from koord.sim.vehicles.points import PointSquad

_HINDRANCES = tuple(Hindrance)

#: A path of an aircraft on the ground that begins so near is joined from above there.
_BESIDE_M = 0.5


class Placed(Struct, frozen=True):
    """A robot at the start of a run: model, position in metres, heading in rad."""

    model: DeviceModel
    start: Point
    heading_rad: float = 0.0


class Passing(Protocol):
    """Who may do without the fleet at ticks that nobody looks at."""

    def is_looked_at(self, time_s: float) -> bool:
        """Return whether somebody looks at the fleet itself at a tick."""
        ...

    def passed(self, time_s: float, positions: Floats) -> None:
        """Note where robots were, shape ``(n, 3)``, at a tick that nobody looks at."""
        ...


class Fleet:
    """A fleet of robots in a world; those of one model run together. Robots are numbered in order.

    With ``only`` one of them is simulated, as it would be among the others, and nobody else is
    there: so each process of a run simulates its own robot. So many ``planners`` are processes that
    plan meanwhile.
    """

    def __init__(
        self,
        world: World,
        robots: Sequence[Placed],
        seed: int = 0,
        only: int | None = None,
        planners: int = 0,
    ) -> None:
        self.world, self.robots, self.ticks = world, tuple(robots), 0
        self._only = only
        whole = np.random.SeedSequence(seed)
        engines = self._engines = Engines(world, planners)
        self._squads: list[tuple[Squad, Ints]] = []
        self._where: list[tuple[int, int]] = [(0, 0)] * len(robots)
        models = dict.fromkeys(robot.model for robot in robots)
        for model in models:
            members = [
                k for k, robot in enumerate(robots) if robot.model == model and only in (None, k)
            ]
            if not members:
                continue
            for row, member in enumerate(members):
                self._where[member] = len(self._squads), row
            start = np.array([robots[k].start for k in members], dtype=np.float64)
            if model.body.ON_GROUND:
                start[:, 2] = world.ground
            heading = np.array([robots[k].heading_rad for k in members], dtype=np.float64)
            made = squad(model, start, heading, _seeds(whole, members), engines)
            self._squads.append((made, np.array(members)))
        #: Squads that make several ticks at once, if all do, and none has to wait for another.
        self._ticking: list[tuple[TickingSquad, Ints]] = [
            (made, numbers) for made, numbers in self._squads if is_ticking(made)
        ]
        if len(self._ticking) < len(self._squads) or _touch(models):
            self._ticking = []
        #: Squads that do it in one call. One that has all robots has the fleet's arrays.
        self._fused = [made for made, _ in self._ticking if is_fused(made)]
        self._tilting: tuple[Ints | None, list[tuple[Squad, Ints]]] = None, []
        self._is_one = len(self._fused) == len(self._squads) == 1 and only is None
        #: Whether robots move by machine code, so that what is measured of them may be, too.
        self.is_compiled = any(map(is_compiled, models))
        #: What aircraft on the ground were told to do once they fly, whose programs say when.
        self._waiting: dict[int, Point | tuple[Point, ...] | None] = {}
        self._flying: set[int] = set()  #: aircraft that were told to take off, or to land
        asked = self.robots if only is None else (self.robots[only],) * len(self.robots)
        self._planners = tuple(robot.model.planner for robot in asked)

    def reseed(self, seed: int) -> None:
        """Let all chance to come hang on another seed: noise, wind, and plans."""
        whole = np.random.SeedSequence(seed)
        for members, numbers in self._squads:
            reseed(members, _seeds(whole, numbers.tolist()))

    # --- time -----------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        return self.ticks * TICK_S

    def advance_to(
        self,
        time_s: float,
        watch: Callable[[Fleet], None] | None = None,
        passing: Passing | None = None,
    ) -> None:
        """Advance in whole ticks up to a time in seconds; ``watch`` is called after every tick.

        If somebody is ``passing``, and robots can make several ticks at once, ``watch`` is called
        at the last and at those that are looked at; of others only positions are told.
        """
        last = math.floor(time_s / TICK_S + 1e-6)
        while self.ticks < last:
            if passing is None or not self._ticking:
                self._tick()
            else:
                self._ticks_until(last, passing)
            if watch is not None:
                watch(self)

    def _tick(self) -> None:
        for members, numbers in self._squads:
            try:
                members.tick(self.now_s)
            except PlugInError as error:
                raise error.of(int(numbers[error.row])) from error
        self.ticks += 1

    def _ticks_until(self, last: int, passing: Passing) -> None:
        """Make ticks up to one that is looked at, or the last."""
        times_s = [self.now_s]
        while self.ticks + len(times_s) < last:
            time_s = (self.ticks + len(times_s)) * TICK_S
            if passing.is_looked_at(time_s):
                break
            times_s.append(time_s)
        ways = []
        for members, numbers in self._ticking:
            try:
                ways.append(members.ticks(times_s))
            except PlugInError as error:
                raise error.of(int(numbers[error.row])) from error
        for k, time_s in enumerate(times_s[1:]):
            passing.passed(time_s, self._placed([of_squad[k] for of_squad in ways]))
        self.ticks += len(times_s)

    def stage(
        self, time_s: float, place: Callable[[float], Floats], watch: Callable[[Fleet], None]
    ) -> None:
        """Advance, and place robots at each tick; only point robots can be placed."""
        last = math.floor(time_s / TICK_S + 1e-6)
        while self.ticks < last:
            self.ticks += 1
            where = place(min(self.now_s, time_s))
            for members, numbers in self._squads:
                assert isinstance(members, PointSquad)
                members.put(where[numbers])
            watch(self)

    def plan_with(self, planners: int) -> None:
        """Let so many processes plan meanwhile, from the first plan on."""
        self._engines.workers.count = planners

    def close(self) -> None:
        """End the processes that plan; a fleet that goes on plans without."""
        self._engines.workers.close()

    # --- orders ---------------------------------------------------------------------------------

    def wait_for_takeoff(self, robot: int) -> None:
        """Let a robot that flies stay on the ground until it is told to take off. (P-TAKEOFF)"""
        if not self.robots[robot].model.body.ON_GROUND:
            self._waiting.setdefault(robot, None)

    def follow(self, robot: int, path: Sequence[Point]) -> None:
        """Let a robot follow a path, shape ``(k, 3)``; an empty one leaves it where it is."""
        if robot in self._waiting:
            self._waiting[robot] = tuple(path)
            return
        above = self._above(robot)
        if above is not None:
            here, up = above
            beside = len(path) > 0 and math.dist(path[0][:2], here[:2]) >= _BESIDE_M
            path = [here, up, *path[not beside :]]
        self._follow(robot, path)

    def _follow(self, robot: int, path: Sequence[Point]) -> None:
        members, row = self._at(robot)
        position, heading = members.fixes(self.now_s)
        members.group.follow(row, as_path(path), float(heading[row]), position[row])

    def go_to(self, robot: int, target: Point) -> None:
        """Let a robot find a path to a target and follow it."""
        if robot in self._waiting:
            self._waiting[robot] = target
            return
        members, row = self._at(robot)
        above = self._above(robot)
        if above is None:
            members.group.go_to(row, target)
        else:
            here, up = above
            way = members.group.way(row, up, target)
            self._follow(robot, [here, up] if way is None else [here, *map(_point, way.tolist())])
            if way is None:
                members.group.fail(row, target)

    def go_to_all(self, targets: Mapping[int, Point]) -> None:
        """Let some robots find paths to targets, as :meth:`go_to` does one."""
        by_squad: dict[int, dict[int, Point]] = {}
        for robot, target in targets.items():
            if robot in self._waiting or robot in self._flying:
                self.go_to(robot, target)
            else:
                index, row = self._where[robot]
                by_squad.setdefault(index, {})[row] = target
        for index, of_squad in by_squad.items():
            self._squads[index][0].group.go_to_all(of_squad)

    def take_off(self, robot: int, up: bool) -> None:
        """Let a robot that flies take off, and then go where it was sent; or land. (P-TAKEOFF)

        It rises straight up first, and lands straight down where it is.
        """
        if self.robots[robot].model.body.ON_GROUND:
            return
        self._flying.add(robot)
        if not up:
            self._waiting[robot] = None
            x, y, z = self._fix(robot)
            self._follow(robot, [(x, y, z), (x, y, self.world.ground)])
            return
        match self._waiting.pop(robot, None):
            case (float(x), float(y), float(z)):
                self.go_to(robot, (x, y, z))
            case tuple(path):
                self.follow(robot, path)
            case None if (above := self._above(robot)) is not None:
                self._follow(robot, above)
            case None:
                pass

    def _above(self, robot: int) -> tuple[Point, Point] | None:
        """The way up from where a robot is that takes off; None if it has risen, or need not."""
        if robot not in self._flying:
            return None
        x, y, z = self._fix(robot)
        high = self.world.ground + TAKEOFF_M
        low = self.world.ground + RISEN * TAKEOFF_M
        return None if z >= low else ((x, y, z), (x, y, high))

    def _fix(self, robot: int) -> Point:
        members, row = self._at(robot)
        x, y, z = members.fixes(self.now_s)[0][row].tolist()
        return x, y, z

    def hold(self, robot: int) -> None:
        """Let a robot stay where it is until released."""
        members, row = self._at(robot)
        members.group.hold(row)

    def release(self, robot: int) -> None:
        """Let a robot resume what holding interrupted."""
        members, row = self._at(robot)
        members.group.release(row)

    def stop(self, robot: int) -> None:
        """Stop a robot for good."""
        members, row = self._at(robot)
        members.group.stop(row)

    @property
    def squads(self) -> Sequence[tuple[Squad, Ints]]:
        """The squads, with the numbers of their robots."""
        return self._squads

    @property
    def is_whole(self) -> bool:
        """Whether all robots are simulated."""
        return self._only is None

    @property
    def only_squad(self) -> FusedSquad | None:
        """The squad that has all robots, if it makes several ticks in one call."""
        return self._fused[0] if self._is_one else None

    # --- what is seen ---------------------------------------------------------------------------

    def sensed(self) -> FleetSensors:
        """The motion sensors of all robots now."""
        if self._is_one:
            return self._sensed_of(self._fused[0])
        n = len(self.robots)
        position, heading, short = np.empty((n, 3)), np.empty(n), np.empty(n)
        reached, state = np.empty(n, np.bool_), np.empty(n, np.int64)
        plights: dict[int, Plight] = {}
        for members, numbers in self._squads:
            # Who is alone in its fleet answers for everybody.
            rows = numbers if self._only is None else slice(None)
            group, automata = members.group, members.group.automata
            fix, heading[rows] = members.fixes(self.now_s)
            position[rows], reached[rows], state[rows] = fix, automata.reached, automata.state
            left = lengths(fix - group.routes.end) - group.visit.epsilon_m
            short[rows] = np.maximum(left, 0.0)
            if group.plights and self._only is None:
                plights |= {int(numbers[row]): one for row, one in group.plights.items()}
            elif group.plights:
                plights = dict.fromkeys(range(n), group.plights[0])
        return FleetSensors(position, heading, reached, state, short, self._planners, plights)

    def _sensed_of(self, members: FusedSquad) -> FleetSensors:
        """The same of a squad that has all robots."""
        group, automata = members.group, members.group.automata
        position, heading = members.fixes(self.now_s)
        states = automata.reached.copy(), automata.state.copy(), members.short_m()
        return FleetSensors(position, heading, *states, self._planners, dict(group.plights))

    def positions(self) -> Floats:
        """The positions of robots in metres, shape ``(n, 3)``."""
        if self._is_one:
            return self._fused[0].truth()[0]
        return self._placed([members.truth()[0] for members, _ in self._squads])

    def headings(self) -> Floats:
        """The headings of robots in rad, shape ``(n,)``. They are nobody else's to write to."""
        if self._is_one:
            return self._fused[0].truth()[1]
        found = np.empty(len(self.robots))
        for members, numbers in self._squads:
            found[numbers] = members.truth()[1]
        return found

    def reached(self) -> Bools:
        """A mask of the robots that have reached their goals."""
        found = np.empty(len(self.robots), np.bool_)
        for members, numbers in self._squads:
            found[numbers] = members.group.automata.reached
        return found

    def attitudes(self) -> Floats:
        """The attitudes of robots as unit quaternions, w first, shape ``(n, 4)``."""
        return self._gathered(lambda members: members.attitude(), 4)

    def tilts(self, robots: Ints) -> Floats:
        """The roll and pitch of some robots in rad, shape ``(k, 2)``."""
        if self._is_one and len(robots) == len(self.robots):
            return self._fused[0].tilts()
        if robots is not self._tilting[0]:  # it is the same at each tick
            asked = {self._where[robot][0] for robot in robots.tolist()}
            self._tilting = robots, [self._squads[k] for k in sorted(asked)]
        found = np.empty((len(self.robots), 2))
        for members, numbers in self._tilting[1]:
            found[numbers] = self._tilts_of(members)
        return found[robots]

    def _tilts_of(self, members: Squad) -> Floats:
        for one in self._fused:
            if one is members:
                return one.tilts()
        return tilts_of(members.attitude())

    def path(self, robot: int) -> Floats:
        """The path that a robot follows, shape ``(k, 3)``."""
        members, row = self._at(robot)
        return members.group.path(row)

    def paths(self, robots: Ints) -> list[Floats]:
        """The paths that some robots follow, each of shape ``(k, 3)``."""
        if len(self._squads) > 1 or self._only is not None:
            return [self.path(robot) for robot in robots.tolist()]
        return self._squads[0][0].group.paths(robots)

    def touched(self, robot: int) -> tuple[tuple[Hindrance, int], ...]:
        """The contacts of a robot's vehicle: with robots, obstacles, or the edge of the world."""
        members, row = self._at(robot)
        of = {id(members.vehicles): numbers for members, numbers in self._squads}
        found = [
            (one.what, int(of[id(one.others)][one.number]) if one.others else one.number)
            for one in members.vehicles.touched(row)
        ]
        return tuple(sorted(found, key=lambda one: (_HINDRANCES.index(one[0]), one[1])))

    def paths_given(self) -> Ints:
        """The number of paths that each robot was given, shape ``(n,)``."""
        found = np.empty(len(self.robots), np.int64)
        for members, numbers in self._squads:
            found[numbers] = members.group.routes.given
        return found

    def _at(self, robot: int) -> tuple[Squad, int]:
        index, row = self._where[robot]
        return self._squads[index][0], row

    def _placed(self, places: Sequence[Floats]) -> Floats:
        """The places of all robots, by those of squads. They are nobody else's to write to."""
        return places[0] if self._is_one else self._joined(places, 3)

    def _gathered(self, read: Callable[[Squad], Floats], width: int) -> Floats:
        return self._joined([read(members) for members, _ in self._squads], width)

    def _joined(self, parts: Sequence[Floats], width: int) -> Floats:
        """What squads have of each of their robots, for all robots in their order."""
        found = np.empty((len(self.robots), width))
        for (_, numbers), part in zip(self._squads, parts, strict=True):
            found[numbers] = part
        return found


def _touch(models: Collection[DeviceModel]) -> bool:
    """Return whether vehicles of several models may touch, so that time passes for all at once."""
    driving = [model for model in models if model.body.ON_GROUND]
    return len(driving) > 1 or any(model.level is Level.MUJOCO for model in models)


def _seeds(whole: Seed, members: Sequence[int]) -> Sequence[Seed]:
    """The seeds of a squad's robots: each has that of its number, whatever squad it is in."""
    return Lazily(len(members), lambda row: spawned(whole, members[row]))


def _point(place: list[float]) -> Point:
    x, y, z = place
    return x, y, z
