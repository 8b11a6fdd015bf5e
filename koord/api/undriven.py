"""What a deployment would have to make up: vehicles, ports, functions, environments. (K932)

Nothing is invented silently: what nobody drives, serves or answers is an error before the run, with
its place in the program or the configuration. (P-NOTHING-INVENTED)
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from ipaddress import IPv4Address
from typing import Generic

from msgspec import Struct
from msgspec.structs import replace

from koord.api.fitting import Fitted
from koord.runtime.configuration.model import RunConfiguration, Vehicle
from koord.runtime.drivers.driver import Addressed, Device, DriverError, DriverType
from koord.runtime.drivers.localiser import LocaliserType
from koord.runtime.drivers.registry import Made, Registry, options_of
from koord.runtime.motion.world import World
from koord.runtime.plugins.names import is_of_fleets, served_ports
from koord.runtime.ports import DONE, GOALS, PLACES, SENSED, TAKEOFF
from koord.syntax import core
from koord.syntax.core import Direction
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import Span

#: The code of a library that is not installed.
_NOT_INSTALLED = "K950"

#: The vehicle that needs no driver: a point.
_IDEAL = "IDEAL"

#: What the motion of an ideal point senses.
_OF_POINTS = frozenset({*PLACES, *DONE})


class Drivers(Struct, frozen=True):
    """What drives and locates the robots of a run; who has no entry is an ideal point.

    Who has a driver, and no localiser, is where the driver says.
    """

    made: Mapping[int, DriverType] = {}
    options: Mapping[int, Struct] = {}
    localisers: Mapping[int, LocaliserType] = {}
    localiser_options: Mapping[int, Struct] = {}


def drivers_of(
    configuration: RunConfiguration,
    drivers: Registry[DriverType],
    localisers: Registry[LocaliserType],
    *,
    drives: bool = True,
) -> tuple[Drivers, list[Diagnostic]]:
    """The drivers and localisers that a configuration names, and what is wrong with that.

    What is not installed here is an error (K950), but a warning (K954) if nobody ``drives`` yet:
    the computers of robots may have it.
    """
    robots = configuration.robots
    driven = _named(
        configuration,
        {one.pid: (_of_here(one.vehicle.driver), one.vehicle.options) for one in robots},
        drivers,
        ("driver", "options"),
        drives=drives,
    )
    located = _named(
        configuration,
        {one.pid: (one.vehicle.localiser, one.vehicle.localiser_options) for one in robots},
        localisers,
        ("localiser", "localiser_options"),
        drives=drives,
    )
    problems = [*driven.problems, *located.problems, *_confused(configuration, driven)]
    made = Drivers(driven.made, driven.options, located.made, located.options)
    return made, list(dict.fromkeys(problems))


class _Named(Struct, Generic[Made]):
    """What a registry has of the names that robots have, by their pids."""

    made: dict[int, Made]
    options: dict[int, Struct]
    problems: list[Diagnostic]


def _named(
    configuration: RunConfiguration,
    named: Mapping[int, tuple[str | None, bytes]],
    registry: Registry[Made],
    fields: tuple[str, str],
    *,
    drives: bool,
) -> _Named[Made]:
    """Look names and options up that stand in two fields of devices, or of the configuration."""
    found: _Named[Made] = _Named({}, {}, [])
    told_absent = set[str]()
    for pid, (name, given) in named.items():
        vehicle, field = configuration.robots[pid].vehicle, fields[0]
        if name is None:
            continue
        try:
            found.made[pid] = registry.load(name)
            field = fields[1]
            found.options[pid] = options_of(found.made[pid], given)
        except DriverError as error:
            where = _place(configuration, vehicle, field)
            found.problems.append(_problem(where, f"{vehicle.name}: {error.message}", error.hint))
        except KoordError as error:
            if {told.code for told in error.diagnostics} != {_NOT_INSTALLED}:
                raise
            if name not in told_absent:
                told_absent.add(name)
                where = _place(configuration, vehicle, field)
                found.problems += (_absent(told, where, name, drives) for told in error.diagnostics)
    return found


def _place(configuration: RunConfiguration, vehicle: Vehicle, field: str) -> Span:
    """Where a field of a device stands, or that of the whole configuration."""
    path, spans = (*vehicle.path, field), configuration.document.spans
    return configuration.place(*((field,) if path not in spans and (field,) in spans else path))


def _absent(told: Diagnostic, where: Span, name: str, drives: bool) -> Diagnostic:
    """The diagnostic for what a driver or localiser lacks, at its place in the configuration."""
    if drives:
        return replace(told, span=where)
    story = f"{told.message}: options of {name} are not checked"
    return Diagnostic("K954", Severity.WARNING, where, story, told.hint)


def _of_here(name: str | None) -> str | None:
    """The driver of a name; `ros` is that of the ROS that is set up here. (P-ROS-PUBLISHED)"""
    if name != "ros":
        return name
    return "ros2" if os.environ.get("ROS_VERSION") == "2" else "ros1"


def _confused(configuration: RunConfiguration, driven: _Named[DriverType]) -> Iterator[Diagnostic]:
    """Yield the vehicles that cannot be reached, and those that two robots would move."""
    owners: dict[tuple[str, str, str | None], int] = {}
    for pid, options in driven.options.items():
        made, vehicle = driven.made[pid], configuration.robots[pid].vehicle
        if not isinstance(made, Addressed):
            continue
        where = configuration.place(*vehicle.path)
        try:
            address, is_one = made.address(
                Device(pid, vehicle, World(), (0.0, 0.0, 0.0), options=options)
            )
        except DriverError as error:
            yield _problem(where, f"{vehicle.name}: {error.message}", error.hint)
            continue
        computer = None if is_one else _computer(configuration.robots[pid].address[0])
        other = owners.setdefault((str(_of_here(vehicle.driver)), address, computer), pid)
        if other != pid:
            hint = "give each its own; in names of topics `{pid}` is the robot's"
            yield _problem(where, f"robots {other} and {pid} would both move `{address}`", hint)


def _computer(ip: str) -> str:
    return "here" if IPv4Address(ip).is_loopback else ip


def undriven(fitted: Fitted) -> Iterator[Diagnostic]:
    """Yield the vehicles of moving robots that nothing drives, each once."""
    moving = [_moves(agent) for agent in fitted.program.core.agents]
    told: set[Vehicle] = set()
    for robot in fitted.configuration.robots:
        vehicle = robot.vehicle
        if vehicle.driver is not None or vehicle.type_name == _IDEAL or vehicle in told:
            continue
        if moving[fitted.kinds[robot.pid]]:
            told.add(vehicle)
            where = fitted.configuration.place(*vehicle.path, "bot_type")
            story = f"nothing drives {vehicle.name}, a {vehicle.type_name}"
            hint = "name its `driver`; or simulate all vehicles; `bot_type: IDEAL` is a point"
            yield _problem(where, story, hint)


def led_together(fitted: Fitted) -> Iterator[Diagnostic]:
    """Yield the controllers that lead all robots together, where each is by itself, once each."""
    told: set[str] = set()
    for robot in fitted.configuration.robots:
        controller = robot.vehicle.controller
        if controller is None or controller.value in told or not is_of_fleets(controller):
            continue
        told.add(controller.value)
        where = fitted.configuration.place(*robot.vehicle.path, "controller")
        story = f"the controller {controller.value} has to know where all robots are"
        yield _problem(where, story, "it is for `koord sim`, where one law leads them all")


def unserved(fitted: Fitted, drivers: Drivers, allowed: Iterable[str] = ()) -> Iterator[Diagnostic]:
    """Yield the ports of a program that nobody serves, and its models of environments.

    ``allowed`` are ports that may be made up, as ``Module.port``.
    """
    program, told = fitted.program.core, set[tuple[int, str]]()
    allows = frozenset(allowed)
    known = {port.label for agent in program.agents for port in agent.ports}
    for name in sorted(allows - known):
        names = ", ".join(sorted(known)) or "none"
        where = fitted.configuration.place()
        yield _problem(where, f"there is no port {name} to be made up", f"its ports are: {names}")
    for robot in fitted.configuration.robots:
        kind = fitted.kinds[robot.pid]
        agent, options = program.agents[kind], drivers.options.get(robot.pid)
        served: frozenset[str] = getattr(options, "ports", frozenset())
        own = served_ports(robot.vehicle.modules)
        moving = GOALS if options is None else (*GOALS, TAKEOFF)
        sensed = (_OF_POINTS if options is None else SENSED - {"pscan"}) | served
        for module in agent.modules:
            for port in (agent.ports[k] for k in module.ports):
                name = port.declaration.variable.name
                who = "an ideal point" if options is None else f"the driver of {robot.vehicle.name}"
                is_sensor = port.direction is Direction.SENSOR
                if (module.name, name) in own or port.label in allows or (kind, port.label) in told:
                    continue
                if module.environment is not None:
                    story = f"{port.label} would be made up by the model of {module.name}"
                elif is_sensor and name not in sensed:
                    story = f"{who} does not sense {port.label}"
                elif not is_sensor and name not in (*moving, *served):
                    story = f"{who} does nothing with {port.label}"
                else:
                    continue
                told.add((kind, port.label))
                hint = "let a driver serve it, or allow it to be made up, or simulate all vehicles"
                yield _problem(port.declaration.span, story, hint)


def _moves(agent: core.Agent) -> bool:
    """Return whether a program senses or sets where its robot is."""
    free = {
        agent.ports[k].declaration.variable.name
        for module in agent.modules
        if module.environment is None
        for k in module.ports
    }
    return not free.isdisjoint((*PLACES, *GOALS))


def _problem(where: Span, story: str, hint: str) -> Diagnostic:
    return Diagnostic("K932", Severity.ERROR, where, story, hint)
