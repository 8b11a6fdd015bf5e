"""Scenes: simulated runs made from configurations and a seed.

Every mistake is told with its place in the file. (K931)
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from koord.runtime.configuration.forms import Agreement, RadioForm
from koord.runtime.configuration.model import RobotPlace, RunConfiguration, Vehicle
from koord.runtime.configuration.reading import problem
from koord.runtime.motion.automaton import Visit
from koord.runtime.motion.bodies import Body
from koord.runtime.motion.checks import WorldPart, start_complaints, world_complaints
from koord.runtime.motion.clearance import Clearance, clearance_of
from koord.runtime.motion.field import field
from koord.runtime.motion.planning import PlanningEffort
from koord.runtime.motion.world import Point, World
from koord.sim.bounds import world_of
from koord.sim.disturbances import Disturbances, Positioning, Wind
from koord.sim.fleet import Placed
from koord.sim.lidar import Lidar
from koord.sim.radio import Radio
from koord.sim.squads import DeviceModel
from koord.syntax.core import USUAL_DELTA_S
from koord.syntax.diagnostics import Diagnostic, KoordError

#: How far from its path a robot may be.
TRACKING_M = 0.15

#: By how much vehicles may be off in properties and contracts; points are off by rounding alone.
SLACK_M, POINT_SLACK_M = 0.2, 1e-6

#: Tasks of drones are at least so high above the ground, and so far below the top of the world.
_HIGH_M, _BELOW_TOP_M = 1.0, 0.5

#: So many places are looked at for a task.
_DRAWS = 200

#: What is clear by less than this may not be: robots do not stand exactly where they are to.
_ROUNDING_M = 0.05

#: Tasks and starts are at least so far from walls and obstacles.
_FROM_WALLS_M = 0.7


class Scene(Struct, frozen=True):
    """A world with robots in it. ``names[i]`` is the device of robot i, ``roles[i]`` its agent."""

    world: World
    robots: tuple[Placed, ...]
    names: tuple[str, ...]
    roles: tuple[str | None, ...]
    scanners: Mapping[int, Lidar]
    clearance: Clearance
    slack_m: float
    delta_s: float
    seed: int
    radio: Radio = Radio()

    @property
    def safety_m(self) -> float:
        """The least distance in metres that robots have to keep; 0: none."""
        return self.clearance.safety_m


def scene(
    configuration: RunConfiguration,
    seed: int | None = None,
    robots: int | None = None,
    landmarks: Sequence[Point] | None = None,
    *,
    located: bool = False,
) -> Scene:
    """Make the scene of a configuration, with another seed or number of robots if given.

    ``landmarks`` are the places that a program names, None if it moves nobody. Those of ``located``
    robots say themselves where they begin, as far as drivers have them. Of more robots than
    the configuration has, those to come are like the first. Raises KoordError.
    """
    seed = configuration.seed if seed is None else seed
    places = _as_many(configuration.robots, robots)
    problems: list[Diagnostic] = []
    models: dict[Vehicle, DeviceModel] = {}
    for place in places:
        if place.vehicle not in models:
            models[place.vehicle] = device_model(place.vehicle)
    problems += _led_apart(configuration, models)
    if problems:
        raise KoordError(tuple(problems))
    world = world_of(configuration, landmarks, len(places), located=located)
    _refuse(configuration, world_complaints(world), places)
    bodies = [models[place.vehicle].body for place in places]
    clearance = clearance_of(bodies, TRACKING_M, world.ground)
    if configuration.monitor.safety is not None:
        clearance = replace(clearance, safety_m=configuration.monitor.safety)
    draw = np.random.default_rng(np.random.SeedSequence((seed, 1)))
    starts = _starts(configuration, world, places, bodies, clearance, draw)
    _refuse(configuration, start_complaints(world, [*zip(bodies, starts, strict=True)]), places)
    more = _scattered(world, bodies, configuration.scatter.tasks, clearance, draw)
    ideal = all(body.IS_EXACT for body in bodies)
    slack = configuration.monitor.slack
    scanners = {
        place.pid: Lidar(form.beams, form.range, form.noise)
        for place in places
        if (form := place.vehicle.simulation.scanner) is not None
    }
    return Scene(
        replace(world, tasks=(*world.tasks, *more)),
        tuple(
            Placed(models[place.vehicle], start, place.heading_rad)
            for place, start in zip(places, starts, strict=True)
        ),
        tuple(place.vehicle.name for place in places),
        tuple(place.kind for place in places),
        scanners,
        clearance,
        slack if slack is not None else POINT_SLACK_M if ideal else SLACK_M,
        float(USUAL_DELTA_S) if configuration.delta_s is None else configuration.delta_s,
        seed,
        _radio(configuration.radio),
    )


def _radio(form: RadioForm) -> Radio:
    """The radios of a form; without a range everybody hears everybody. [ENV-RANGE]"""
    range_m = math.inf if form.range is None else form.range
    return Radio(range_m, form.agreement is Agreement.CONNECTED)


def _as_many(robots: tuple[RobotPlace, ...], count: int | None) -> tuple[RobotPlace, ...]:
    if count is None:
        return robots
    return tuple(
        robots[pid]
        if pid < len(robots)
        else replace(robots[pid % len(robots)], pid=pid, position=None)
        for pid in range(count)
    )


# --- vehicles -------------------------------------------------------------------------------------


def device_model(vehicle: Vehicle) -> DeviceModel:
    """The simulation model of a vehicle."""
    form, planner = vehicle.simulation, vehicle.planner or vehicle.type.planners[0]
    noise, wind, visit = form.noise, form.wind, form.visit
    return DeviceModel(
        vehicle.body,
        planner,
        form.level,
        form.steering,
        Visit(visit.epsilon, visit.dwell),
        Disturbances(
            Positioning(noise.position, noise.heading, noise.rate),
            form.delay,
            Wind(wind.mean, wind.gust, wind.calm),
        ),
        PlanningEffort(form.effort.steps, form.effort.star_steps),
        form.planning.takes,
        vehicle.controller,
        vehicle.modules,
        vehicle.ignores_height,
    )


def _led_apart(
    configuration: RunConfiguration, models: Mapping[Vehicle, DeviceModel]
) -> Iterator[Diagnostic]:
    """Yield a problem for each controller that leads robots which do not stay among themselves."""
    for vehicle, model in models.items():
        if model.controller is None or len(models) == 1:
            continue
        from koord.runtime.plugins.names import is_of_fleets  # it asks what is installed

        if is_of_fleets(model.controller):
            story = f"the controller {model.controller.value} does not know the robots that are no"
            where = configuration.place(*vehicle.path, "controller")
            yield problem(where, f"{story} {vehicle.name}", "let all robots be of one device")


# --- where robots and tasks are -------------------------------------------------------------------


def _starts(
    configuration: RunConfiguration,
    world: World,
    places: Sequence[RobotPlace],
    bodies: Sequence[Body],
    clearance: Clearance,
    draw: np.random.Generator,
) -> list[Point]:
    """The start positions of robots: as configured, else random, apart from the others."""
    starts: list[Point | None] = [
        None if place.position is None else _on_plane(place.position, body, world)
        for place, body in zip(places, bodies, strict=True)
    ]
    taken = [start for start in starts if start is not None]
    if len(taken) == len(starts):
        return taken
    box = configuration.scatter.start
    apart = clearance.safety_m + 2 * clearance.resting_m + 0.05
    for k, (start, body) in enumerate(zip(starts, bodies, strict=True)):
        if start is not None:
            continue
        found = _free_place(world, body, box, np.array(taken).reshape(-1, 3), apart, draw)
        if found is None:
            story = f"there is no room for {len(places)} robots, {apart:.2f} m from each other"
            hint = "make the world larger, or give the robots a `position`"
            raise KoordError((problem(configuration.place("world", "start"), story, hint),))
        starts[k] = found
        taken.append(found)
    return [start for start in starts if start is not None]


def _on_plane(position: Point, body: Body, world: World) -> Point:
    """A start from two coordinates: on the ground."""
    x, y, z = position
    return x, y, max(z, world.ground) if body.ON_GROUND else z


def _free_place(
    world: World,
    body: Body,
    box: tuple[Point, Point] | None,
    taken: np.ndarray[Any, np.dtype[np.float64]],
    apart_m: float,
    draw: np.random.Generator,
) -> Point | None:
    """A random place in a box, or on the ground of the world, apart from those taken."""
    low, high = box if box is not None else inner(world)
    flat = body.ON_GROUND
    free = field(world, flat=flat)
    for _ in range(2000):
        x, y, z = draw.uniform(low, high).tolist()
        z = world.ground if flat else z
        if free.clearance(x, y, z) < min(body.radius_m, 0.3):
            continue
        gap = np.linalg.norm(taken - np.array([x, y, z]), axis=1)
        if gap.min(initial=np.inf) > apart_m:
            return x, y, z
    return None


def inner(world: World) -> tuple[Point, Point]:
    """The ground of the world without a margin at its walls."""
    margin = [min(_FROM_WALLS_M, (b - a) / 4) for a, b in zip(world.low, world.high, strict=True)]
    (x0, y0, z), (x1, y1, _) = world.low, world.high
    dx, dy, _ = margin
    return (x0 + dx, y0 + dy, z), (x1 - dx, y1 - dy, z)


def _scattered(
    world: World,
    bodies: Sequence[Body],
    count: int,
    clearance: Clearance,
    draw: np.random.Generator,
) -> list[Point]:
    """Random tasks in the world: for each robot in turn one that it can do.

    Those in the air are so high that who waits there is clear of all that drive below, and tasks
    are so far apart, if there is room, that who waits at one is clear of who comes to another:
    else robots that have nothing left to do could keep the others from what is left to them.
    """
    (x0, y0, ground), (x1, y1, _) = inner(world)
    top = max(world.high[2] - _BELOW_TOP_M, ground)
    clear = clearance.safety_m + clearance.tracking_m + clearance.resting_m
    low = min(ground + max(_HIGH_M, clear + _ROUNDING_M), top)
    found: list[Point] = []
    fields = {flat: field(world, flat=flat) for flat in {body.ON_GROUND for body in bodies}}
    for number in range(count):
        flat = bodies[number % len(bodies)].ON_GROUND
        free = fields[flat]
        best, widest = (0.0, 0.0, low), -math.inf
        for _ in range(_DRAWS):
            x, y = draw.uniform((x0, y0), (x1, y1)).tolist()
            place = (x, y, ground if flat else float(draw.uniform(low, top)))
            if free.clearance(*place) < _FROM_WALLS_M / 2:
                continue
            gap = math.inf
            for other in found:
                gap = min(gap, math.dist(place, other))
                if gap <= widest:  # one that is as far from all was drawn before
                    break
            else:
                best, widest = place, gap
            if gap > clear + _ROUNDING_M:
                break
        found.append(best)
    return found


# --- what cannot be -------------------------------------------------------------------------------


def _refuse(configuration: RunConfiguration, complaints: Any, places: Sequence[RobotPlace]) -> None:
    """Refuse a scene with geometric problems. Raises KoordError, with places in the file."""
    problems = []
    for complaint in complaints:
        match complaint.part:
            case WorldPart.BOUNDS:
                span = configuration.place("world", "bounds")
            case WorldPart.OBSTACLE:
                span = configuration.place("world", "obstacles", complaint.index)
            case WorldPart.TASK:
                span = configuration.place("world", "tasks", complaint.index)
            case _:
                span = configuration.place(*places[complaint.index].path)
        who = f"robot {complaint.index}: " if complaint.part is WorldPart.ROBOT else ""
        problems.append(problem(span, f"{who}{complaint.message}"))
    if problems:
        raise KoordError(tuple(problems[:100]))
