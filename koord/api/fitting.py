"""Fitting: the check of a program and a configuration together.

What can be wrong with a configuration by itself is found where it is read. Here it is seen whether
it suits a program: params, kinds of robots, planners, and where robots and tasks are.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.api.programs import (
    CheckReport,
    Loadable,
    Program,
    Text,
    Value,
    checked,
    exact,
    no_program,
    source_of,
)
from koord.api.results import ArgumentError
from koord.api.robots import Seconds, delta_of, fleet_of, system_of
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.configuration.model import RunConfiguration, Scatter, params
from koord.runtime.configuration.scenes import in_scene, read_scene, run_of
from koord.runtime.motion.libraries import SIM
from koord.runtime.motion.world import Point, World
from koord.runtime.ports import SIMULATED
from koord.syntax import core
from koord.syntax.collector import uncollected
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.elaboration.settings import ParamValue, Settings
from koord.syntax.problem import Problem
from koord.syntax.source import Source, Span, whole_file
from koord.syntax.system import System, dealt
from koord.syntax.types import POS, ArrayType, ListType, RecordType, Type

if TYPE_CHECKING:
    from koord.sim.scene import Scene

#: So many tasks there are where nobody says how many.
_TASKS = 20

#: So many elaborated programs are kept: with tasks and without, of two swept values.
_KEPT = 4

#: What stands for the file of a configuration where there is none.
NO_FILE = "(none)"

_DEFAULT = """\
agents:
{agents}
devices:
    car: {{bot_type: CAR, planner: RRT_CAR}}
    drone: {{bot_type: QUAD, planner: RRT_DRONE}}
world: {{}}
"""


#: What functions of the API take as a configuration; None is the one beside the program's file.
Configurable: TypeAlias = RunConfiguration | Text | None


class FitRequest(Struct, frozen=True):
    """A request to run a program with a configuration (None: the plainest that suits the program).

    ``robots`` is another number of robots than the configuration's, ``delta_s`` another length of a
    round in seconds, ``seed`` what places hang on that nobody gives; None means as configured, or
    as the program states. ``located``: vehicles say where robots begin, where drivers have them.
    """

    source: Source
    configuration: RunConfiguration | None
    properties: tuple[Source, ...]
    params: Mapping[str, ParamValue]
    delta_s: Fraction | None = None
    robots: int | None = None
    seed: int | None = None
    located: bool = False


class Fitted(Struct, frozen=True):
    """A program with a configuration that suits it. ``kinds`` are those of the robots."""

    program: Program
    configuration: RunConfiguration  #: its δ is set
    kinds: tuple[int, ...]
    placed: Scene | None  #: None where the libraries that scenes are made with are not installed
    warnings: tuple[Diagnostic, ...] = ()

    @property
    def scene(self) -> Scene:
        """Robots and tasks in their world; it needs the simulation's libraries."""
        assert self.placed is not None, "who simulates has what scenes are made with"
        return self.placed

    @property
    def delta_s(self) -> Fraction:
        """The length of a round in seconds, as exact as a double can be written."""
        length = self.configuration.delta_s if self.placed is None else self.placed.delta_s
        return Fraction(repr(length))

    @property
    def problem(self) -> Problem:
        """The program with its robots and settings: the subject of a run."""
        return self.program.problem(self.kinds, self.delta_s)


def fit_request(
    program: Loadable,
    config: Configurable,
    params: Mapping[str, Value] | None,
    robots: int | None,
    seed: int | None,
    delta_s: Seconds,
    *,
    located: bool = False,
) -> FitRequest:
    """Make a request from the arguments of an API function. Raises KoordError."""
    chosen = {name: exact(value) for name, value in (params or {}).items()}
    properties: tuple[Source, ...] = ()
    if isinstance(program, Program):
        source, properties = program.source, program.properties
        chosen = {**program.settings.params, **chosen}
    else:
        source = source_of(program)
    if config is None:
        config = beside(source.name, ".yaml")
    if config is not None and not isinstance(config, RunConfiguration):
        config = read_configuration(config)
    length = delta_of(delta_s)
    return FitRequest(source, config, properties, chosen, length, robots, seed, located)


def read_configuration(
    text: Text, site: Text | None = None, scene: Text | None = None
) -> RunConfiguration:
    """Read a configuration from a file or a text. Raises KoordError with every mistake.

    What it does not say may be in another one, the ``site``: world, positions, network, safety, ...
    of the place where robots are (P-SITE). So a configuration is used as it stands, anywhere. The
    file of a ``scene`` of the published simulator says where robots begin (P-SCENE).
    """
    read = load_configuration(source_of(text), None if site is None else source_of(site))
    return read if scene is None else in_scene(read, read_scene(source_of(scene)))


def configuration_of_scene(scene: Text) -> RunConfiguration:
    """The configuration of a run with the robots of a scene, by itself. Raises KoordError."""
    return run_of(read_scene(source_of(scene)))


def beside(path: str, suffix: str) -> str | None:
    """The file next to another with the same name and another suffix, if it exists."""
    other = Path(path).with_suffix(suffix)
    return str(other) if other.is_file() and str(other) != path else None


def can_be_placed() -> bool:
    """Return whether the libraries are installed that check positions."""
    return all(find_spec(name) is not None for name in SIM)


@uncollected()
def fit(request: FitRequest) -> Fitted:
    """Fit program and configuration. Raises KoordError with all that does not suit."""
    found: list[Diagnostic] = []
    try:
        return _fitted(request, found)
    except ArgumentError:
        raise
    except KoordError as error:
        raise KoordError(tuple(dict.fromkeys((*found, *error.diagnostics)))) from None


def seeded(request: FitRequest) -> FitRequest:
    """A request that says the seed which it would get. Raises KoordError as :func:`fit`."""
    return replace(request, seed=fit(request).scene.seed)


def configured(
    request: FitRequest, found: list[Diagnostic]
) -> tuple[core.Program, RunConfiguration, dict[str, ParamValue]]:
    """The program, with the configuration that its scene is made of, and the values of its params.

    Nothing of it hangs on the seed. Findings are added to a list, other errors raised.
    """
    given = request.configuration
    chosen = dict(request.params)
    places: dict[str, Span] = {}
    if given is not None:
        found += given.warnings
        own = params(given)
        of = given.document.name_place
        places = {k: of(("params", k)) for k in own if k not in chosen}
        chosen = {**own, **chosen}
    program = elaborated(request, Settings(chosen, places=places)).core
    configuration = given or _default(program, request.robots)
    configuration = _with_tasks(configuration, program, sized="tasks" in chosen)
    return program, _with_delta(configuration, program, request.delta_s), chosen


def _fitted(request: FitRequest, found: list[Diagnostic]) -> Fitted:
    """As :func:`fit`; findings are added to a list, and other errors raised."""
    given = request.configuration
    program, configuration, chosen = configured(request, found)
    described = [robot.kind for robot in configuration.robots]
    found += _kinds(program, described, configuration.name)[1]
    made = _scene(configuration, program, request)
    roles = made.roles if made is not None else described
    kinds, problems = _kinds(program, roles, configuration.name)
    found += problems
    if given is not None and request.delta_s is None and not problems:
        found += _unlike(configuration, program, kinds if request.robots is None else None)
    if made is not None:
        if landmarks_of(program) is not None:
            found += _unplanned(configuration)
            found += _unplaced(configuration, request.robots)
        configuration = replace(configuration, world=made.world)
    tasks = configuration.world.tasks if configuration.world is not None else ()
    chosen |= _sizes(request, program, chosen, len(tasks))
    where = tuple((Fraction(x), Fraction(y), Fraction(z)) for x, y, z in tasks)
    whole = elaborated(request, Settings(chosen, where or None))
    if any(one.severity is Severity.ERROR for one in found):
        raise KoordError(())
    return Fitted(whole, configuration, kinds, made, tuple(found))


#: What was elaborated last in each thread: runs of one kind ask for the same several times.
_LAST = threading.local()


def elaborated(request: FitRequest, chosen: Settings) -> Program:
    """Elaborate the program with these values. Raises KoordError."""
    # Values as texts: what is equal in Python (1, True) is not the same, and settings may change.
    values = {name: repr(value) for name, value in chosen.params.items()}
    key = (request.source, request.properties, values, chosen.tasks, dict(chosen.places))
    known: deque[tuple[object, CheckReport]] | None = getattr(_LAST, "known", None)
    if known is None:
        known = _LAST.known = deque(maxlen=_KEPT)
    report = next((made for asked, made in known if asked == key), None)
    if report is None:
        report = checked(request.source, chosen, request.properties)
        known.append((key, report))
    if report.program is None:
        none = () if report.errors else (no_program(request.source.name),)
        raise KoordError((*report.diagnostics, *none))
    return report.program


def _sizes(
    request: FitRequest, program: core.Program, chosen: Mapping[str, ParamValue], tasks: int
) -> dict[str, ParamValue]:
    """The param for the number of tasks, unless it is set, with the configuration's number.

    Which one it is shows when it is changed.
    """
    size = task_count(program)
    if size is None or size == tasks or not tasks:
        return {}
    for given in program.parameters:
        if given.value != size or given.name in chosen:
            continue
        more: dict[str, ParamValue] = {given.name: tasks}
        changed = checked(request.source, Settings({**chosen, **more}), request.properties).program
        if changed is not None and task_count(changed.core) == tasks:
            return more
    return {}


def _scene(
    configuration: RunConfiguration, program: core.Program, request: FitRequest
) -> Scene | None:
    """Robots and tasks in their world; None where the libraries are not installed."""
    if not can_be_placed():
        return None
    from koord.sim.scene import scene

    landmarks = landmarks_of(program)
    return scene(configuration, request.seed, request.robots, landmarks, located=request.located)


def _unplanned(configuration: RunConfiguration) -> Iterator[Diagnostic]:
    """Yield a warning for each device that is described without a planner."""
    for vehicle in dict.fromkeys(robot.vehicle for robot in configuration.robots):
        path, usual = vehicle.path, vehicle.type.planners[0].value
        described = bool(path) and path[0] in ("device", "devices")
        if vehicle.planner is None and described and path in configuration.document.spans:
            story = f"it is not said how {vehicle.name} plans its paths: {usual} is taken"
            hint = f"write planner: {usual}"
            yield Diagnostic("K949", Severity.WARNING, configuration.place(*path), story, hint)


def _unplaced(configuration: RunConfiguration, robots: int | None) -> Iterator[Diagnostic]:
    """Yield a warning where it is said where some robots begin, and of others not."""
    given = configuration.robots
    count = len(given) if robots is None else robots
    placed = [robot for robot in given[:count] if robot.position is not None]
    if placed and len(placed) < count:
        story = f"it is said where {len(placed)} of {count} robots begin: others do so anywhere"
        hint = "give all a `position`, or none, if they may begin in any order"
        place = configuration.place(*placed[-1].path)
        yield Diagnostic("K949", Severity.WARNING, place, story, hint)


def landmarks_of(program: core.Program) -> tuple[Point, ...] | None:
    """The places that a program names; None if it moves nobody."""
    from koord.sim.bounds import moves, places_of

    return tuple(places_of(program)) if moves(program) else None


def _default(program: core.Program, robots: int | None) -> RunConfiguration:
    """The default configuration: cars and drones in turn, or as the kinds' names suggest.

    Without a number, there are the robots that the program states, or the usual ones.
    """
    lines = []
    for pid, kind in enumerate(system_of(program, fleet_of(robots), None).kinds):
        name = program.agents[kind].name
        device = ("car", "drone")[pid % 2]
        if name:
            device = "car" if "car" in name.lower() else "drone"
        of = f", kind: {name}" if name else ""
        lines.append(f"    - {{pid: {pid}, on_device: {device}{of}}}")
    from koord.sim.bounds import places_of, widened
    from koord.sim.scene import inner

    made = load_configuration(Source(NO_FILE, _DEFAULT.format(agents="\n".join(lines))))
    # However far away a program sends its robots, they begin in the arena of the paper.
    scatter = replace(made.scatter, start=inner(World()))
    world = widened(World(), tuple(places_of(program)))
    return replace(made, world=world, scatter=scatter, bounded=True)


def _with_tasks(
    configuration: RunConfiguration, program: core.Program, *, sized: bool
) -> RunConfiguration:
    """The configuration with tasks for a program's list of them, if it has none itself."""
    size, scatter = task_count(program), configuration.scatter
    if size is None or scatter.tasks or (configuration.world and configuration.world.tasks):
        return configuration
    count = size if sized or configuration.name != NO_FILE else _TASKS
    return replace(configuration, scatter=Scatter(count, scatter.start))


def _with_delta(
    configuration: RunConfiguration, program: core.Program, delta_s: Fraction | None
) -> RunConfiguration:
    """The configuration with δ as requested, as it says itself, or as the program states."""
    if delta_s is not None:
        return replace(configuration, delta_s=float(delta_s))
    if configuration.delta_s is None:
        return replace(configuration, delta_s=float(program.instance.used_delta_s))
    return configuration


def _unlike(
    configuration: RunConfiguration, program: core.Program, kinds: Sequence[int] | None
) -> tuple[Diagnostic, ...]:
    """Warnings where a configuration differs from the program's instance. It takes precedence.

    ``kinds`` are those of its robots, or None where it is not the configuration that says how many
    there are.
    """
    meant, found = program.instance, []
    if meant.kinds and kinds is not None and Counter(meant.kinds) != Counter(kinds):
        here = System(program, tuple(kinds)).fleet
        found.append((("agents",), System(program, meant.kinds).fleet, f"here are {here}"))
    delta_s = configuration.delta_s
    if meant.delta_s is not None and delta_s is not None and float(meant.delta_s) != delta_s:
        found.append((("delta",), f"δ = {float(meant.delta_s):g} s", f"it is {delta_s:g} s here"))
    return tuple(
        Diagnostic(
            "K936",
            Severity.WARNING,
            configuration.place(*path),
            f"the program is meant for {wanted}; {other}",
            "what was verified for the one need not hold of the other",
        )
        for path, wanted, other in found
    )


def _kinds(
    program: core.Program, roles: Sequence[str | None], file: str
) -> tuple[tuple[int, ...], tuple[Diagnostic, ...]]:
    """The kind of each robot: as configured, or dealt round-robin; with diagnostics."""
    names = [agent.name for agent in program.agents]
    if all(role is None for role in roles):
        return dealt(program, len(roles)).kinds, ()
    cure = f"its kinds are {', '.join(names)}"
    if names == [""]:
        cure = "its robots are of one kind, which has no name: leave `kind` out"
    problems = tuple(
        Diagnostic(
            "K932",
            Severity.ERROR,
            whole_file(file),
            f"robot {pid} is of kind {role}, which the program does not have",
            cure,
        )
        for pid, role in enumerate(roles)
        if role not in names
    )
    return tuple(names.index(role) if role in names else 0 for role in roles), problems


def task_count(program: core.Program) -> int | None:
    """The length of a program's list of tasks; 0 for any length, None without a list.

    That of a list whose length an assumption fixes is known.
    """
    for entry in program.allwrite:
        match entry.variable.type:
            case ArrayType(element=element, size=int() as size) if _is_task(element):
                return size
            case ListType(element=element) if _is_task(element):
                return entry.length or 0
            case _:
                pass
    return None


def is_placed(program: core.Program) -> bool:
    """Return whether a program reads positions or tasks, whose starts a world determines."""
    names = {port.declaration.variable.name for agent in program.agents for port in agent.ports}
    return not names.isdisjoint(SIMULATED) or task_count(program) is not None


def _is_task(type_: Type) -> bool:
    """Return whether a type is a task: a record that begins with a position."""
    return isinstance(type_, RecordType) and bool(type_.fields) and type_.fields[0][1] == POS


def slack_of(fitted: Fitted, *, is_exact: bool = False) -> Fraction:
    """By how much what is watched may be off, in metres: points are where they are to be."""
    return Fraction(0) if is_exact else Fraction(repr(fitted.scene.slack_m))
