"""From the files and flags of ``koord sim`` to what is to be simulated: a program in a scene."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from koord.cli.arguments import AS_STATED, Fleet, settings
from koord.cli.diagnostics import Report
from koord.cli.files import DASH, read_program
from koord.cli.inputs import LoadedProgram, Reading, no_program
from koord.cli.systems import kinds_by_role, suited, system_of, unlike
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.watching import Sort, Watched, watched
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.configuration.model import Configuration, Scatter
from koord.runtime.motion.world import World
from koord.sim.bounds import moves, places_of, widened
from koord.sim.claims import Checked, Watching
from koord.sim.hosting import ANSWERED, SENSED, plain_name
from koord.sim.running import Cast, Simulation
from koord.sim.scene import Scene, params, scene
from koord.syntax import core
from koord.syntax.collector import uncollected
from koord.syntax.core import Direction
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.elaborate.settings import ParamValue, Settings
from koord.syntax.load import load
from koord.syntax.problem import Problem
from koord.syntax.source import Source, whole_file
from koord.syntax.types import POS, ArrayType, ListType, RecordType, Type
from koord.syntax.walk import nodes

if TYPE_CHECKING:
    from koord.cli.simulated_traces import Tracing
    from koord.runtime.robot import Host
    from koord.sim.following import Followed

Run = TypeVar("Run", bound=Simulation)

#: So many tasks there are where nobody says how many.
_TASKS = 20

#: A run ends after so long: of a program that can stop, and of one that cannot.
_LONG_S, _ENDLESS_S = 600.0, 120.0

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


@dataclass(frozen=True, slots=True)
class Job:
    """A program in a scene. ``given`` are the values of params."""

    loaded: LoadedProgram
    configuration: Configuration
    scene: Scene
    kinds: tuple[int, ...]

    @property
    def delta_s(self) -> Fraction:
        """The length of a round, as exact as a double can be written."""
        return Fraction(repr(self.scene.delta_s))

    @property
    def problem(self) -> Problem:
        """What the run is a run of."""
        return self.loaded.problem(self.kinds, self.delta_s)

    @property
    def slack(self) -> Fraction:
        """By how much numbers may be off in claims."""
        return Fraction(repr(self.scene.slack_m))

    def cast(self) -> Cast:
        """The program, compiled."""
        program, source = self.loaded.program, self.loaded.source
        differing = self.problem.differing
        return Cast(source.name, source.text, loaded(compiled(program)), self.kinds, differing)

    @property
    def by_chance(self) -> tuple[str, ...]:
        """What no world answers, by name: chance does."""
        return gaps_of(self.loaded.program)

    def supplied(self) -> Callable[[Host], Host] | None:
        """What answers what no world does, if the program leaves that open. Raises KoordError."""
        program = self.loaded.program
        starts = bool(program.assumptions) and not _is_placed(program)
        if not starts and not self.by_chance:
            return None
        from koord.cli.supplying import Supplying
        from koord.semantics.configurations import System

        system = System(program, self.kinds, self.delta_s)
        return Supplying.of(system, self.scene.seed, starts=starts)

    def simulation(
        self, *, keep_going: bool = False, summaries: bool = False, tracing: Tracing | None = None
    ) -> Simulation:
        """The program in its scene, with all that it claims watched, ``summaries`` if asked for."""
        return self._watched(Simulation, keep_going, summaries, tracing)

    def followed(
        self, *, keep_going: bool = False, summaries: bool = False, tracing: Tracing | None = None
    ) -> Followed:
        """The same for a run that other processes make."""
        from koord.sim.following import Followed

        return self._watched(Followed, keep_going, summaries, tracing)

    @uncollected()
    def _watched(
        self, kind: type[Run], keep_going: bool, summaries: bool, tracing: Tracing | None
    ) -> Run:
        program, scene = self.loaded.program, self.scene
        cast = self.cast()
        checked: list[Checked] = []

        def heard(host: Host) -> Host:
            if summaries:
                checked.append(Checked(host))
                host = checked[0]
            return host if tracing is None else tracing.hear(host)

        made = kind(cast, scene, keep_going=keep_going, heard=heard, supplied=self.supplied())
        claims = watching(made, program, self.slack)
        for one in checked:
            one.hold(claims, made)
            made.claims.append(one)
        return made

    def begun(self) -> Simulation:
        """The run after INIT, to see whether it may begin so."""
        made = self.simulation()
        made.begin()
        return made

    def limit_s(self, rounds: int | None, time_s: float | None) -> float:
        """How long a run may take in simulated time: as asked for, or as suits the program."""
        given = [] if rounds is None else [rounds * self.scene.delta_s]
        given += [] if time_s is None else [time_s]
        if given:
            return min(given)
        events = tuple(e.effect for agent in self.loaded.program.agents for e in agent.events)
        stops = any(isinstance(node, core.Stop | core.TryStop) for node in nodes(events))
        return _LONG_S if stops else _ENDLESS_S

    def _cure(self) -> str:
        """What to do if a run does not begin as it should."""
        if not _is_placed(self.loaded.program):
            return "give the variables that it speaks of an initial value"
        if self.configuration.name == NO_FILE:
            return "name a configuration that says where robots are, with `position`"
        return "say where robots are with `position`"

    def check_start(self, simulation: Simulation) -> None:
        """Raises KoordError if the run does not begin as the program assumes. (K934)"""
        problems = []
        for broken in simulation.broken:
            if broken.sort != Sort.ASSUMPTION.value:
                continue
            name = self.configuration.name
            span = whole_file("the scene" if name == NO_FILE else name)
            place = self.configuration.place()
            if broken.robots:
                place = self.configuration.place(*self.configuration.robots[0].path)
                pid = broken.robots[0]
                if pid < len(self.configuration.robots):
                    place = self.configuration.place(*self.configuration.robots[pid].path)
            who = f" of robot{'s' * (len(broken.robots) > 1)} " if broken.robots else ""
            who += " and ".join(map(str, broken.robots))
            story = f"the run does not begin as the program assumes: {broken.claim}{who}"
            hint = f"it is {broken.words}; {self._cure()}"
            problems.append(
                Diagnostic("K934", Severity.ERROR, span if name == NO_FILE else place, story, hint)
            )
        if problems:
            raise KoordError(tuple(problems[:10]))


def watching(simulation: Simulation, program: core.Program, slack: Fraction) -> Watched:
    """Have all that a program claims watched in a run, with so much slack."""
    claims = watched(program, slack)
    simulation.claims.append(Watching(claims, simulation))
    return claims


@dataclass(frozen=True, slots=True)
class Asked:
    """What is to be simulated, as far as flags say so."""

    source: Source
    configuration: Configuration | None  #: None: the plainest that suits the program
    properties: tuple[Source, ...]
    params: Mapping[str, ParamValue]
    delta_s: Fraction | None = None  #: None: as the configuration says, or the program

    @uncollected()
    def job(self, report: Report, robots: int | None, seed: int | None) -> Job | None:
        """The job, for so many robots and with that seed; None if there are errors in the report.

        Raises KoordError.
        """
        before = report.errors
        chosen = dict(self.params)
        if self.configuration is not None:
            chosen = {**params(self.configuration), **chosen}
        program = self._elaborated(report, Settings(chosen))
        if program is None:
            return None
        configuration = self.configuration or _default(program, robots)
        configuration = _with_tasks(configuration, program, sized="tasks" in chosen)
        configuration = suited(configuration, program, self.delta_s)
        places = tuple(places_of(program)) if moves(program) else None
        made = scene(configuration, seed, robots, places)
        kinds, problems = kinds_by_role(program, made.roles, configuration.name)
        report.add(problems)
        if self.configuration is not None and self.delta_s is None and not problems:
            report.add(unlike(configuration, program, kinds if robots is None else None))
        tasks = made.world.tasks
        chosen |= self._sizes(program, chosen, len(tasks))
        given = tuple((Fraction(x), Fraction(y), Fraction(z)) for x, y, z in tasks)
        reading = Reading(Settings(chosen, given or None), self.properties)
        program = self._elaborated(report, reading.settings)
        if program is None or report.errors > before:
            return None
        return Job(LoadedProgram(self.source, program, reading), configuration, made, kinds)

    def _elaborated(self, report: Report, chosen: Settings) -> core.Program | None:
        before = report.errors
        elaborated = load(self.source, chosen, self.properties)
        if elaborated.program is None:
            report.add(elaborated.diagnostics, self.source, *self.properties)
            if report.errors == before:
                report.add((no_program(self.source.name),))
        return elaborated.program

    def _sizes(
        self, program: core.Program, chosen: Mapping[str, ParamValue], tasks: int
    ) -> dict[str, ParamValue]:
        """The param that says how many tasks there are, if nobody has set it: as many as there are.

        Which one it is shows when it is changed.
        """
        size = _size(program)
        if size is None or size == tasks or not tasks:
            return {}
        for given in program.parameters:
            if given.value != size or given.name in chosen:
                continue
            more: dict[str, ParamValue] = {given.name: tasks}
            changed = load(self.source, Settings({**chosen, **more}), self.properties).program
            if changed is not None and _size(changed) == tasks:
                return more
        return {}


def asked(arguments: argparse.Namespace, report: Report) -> Asked | None:
    """What the flags ask for; what is wrong with the files goes to the report."""
    try:
        source = read_program(arguments.file).source
        properties = tuple(read_program(path).source for path in arguments.properties)
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    configuration = None
    path = arguments.config if arguments.config is not None else _beside(arguments.file)
    if path is not None:
        try:
            text = read_program(path).source
        except KoordError as error:
            report.add(error.diagnostics)
            return None
        report.add((), text)
        try:
            configuration = load_configuration(text)
        except KoordError as error:
            report.add(error.diagnostics, text)
            return None
    chosen = settings(arguments.settings)
    return Asked(source, configuration, properties, chosen, arguments.delta)


def _beside(path: str) -> str | None:
    """The configuration that lies beside a program and has its name, if there is one."""
    beside = Path(path).with_suffix(".yaml")
    return str(beside) if path != DASH and beside.is_file() else None


def _default(program: core.Program, robots: int | None) -> Configuration:
    """Cars and drones in turn, or what the kinds of robots of a program are called after.

    Without a number, there are the robots that the program states, or the usual ones.
    """
    fleet = AS_STATED if robots is None else Fleet(robots)
    lines = []
    for pid, kind in enumerate(system_of(program, fleet, None).kinds):
        name = program.agents[kind].name
        device = ("car", "drone")[pid % 2]
        if name:
            device = "car" if "car" in name.lower() else "drone"
        of = f", kind: {name}" if name else ""
        lines.append(f"    - {{pid: {pid}, on_device: {device}{of}}}")
    made = load_configuration(Source(NO_FILE, _DEFAULT.format(agents="\n".join(lines))))
    return replace(made, world=widened(World(), tuple(places_of(program))), bounded=True)


def _with_tasks(
    configuration: Configuration, program: core.Program, *, sized: bool
) -> Configuration:
    """Tasks for a program that has a list of them, if the configuration has none."""
    size, scatter = _size(program), configuration.scatter
    if size is None or scatter.tasks or (configuration.world and configuration.world.tasks):
        return configuration
    count = size if sized or configuration.name != NO_FILE else _TASKS
    return replace(configuration, scatter=Scatter(count, scatter.start))


def gaps_of(program: core.Program) -> tuple[str, ...]:
    """The functions and sensors of a program that nothing in a simulated world answers."""
    functions = (plain_name(function.name) for function in program.externals)
    sensors = (
        (module, agent.ports[position])
        for agent in program.agents
        for module in agent.modules
        if module.environment is None
        for position in module.ports
    )
    found = [name for name in functions if name not in ANSWERED]
    found += [
        f"{module.name}.{port.declaration.variable.name}"
        for module, port in sensors
        if port.direction is Direction.SENSOR and port.declaration.variable.name not in SENSED
    ]
    return tuple(dict.fromkeys(found))


def _is_placed(program: core.Program) -> bool:
    """Whether a program speaks of where robots or tasks are, of which worlds say how it starts."""
    names = {port.declaration.variable.name for agent in program.agents for port in agent.ports}
    return not names.isdisjoint(SENSED) or _size(program) is not None


def _size(program: core.Program) -> int | None:
    """How many tasks a program has a list of; 0 for a list of any length, None without a list.

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


def _is_task(type_: Type) -> bool:
    """A task is a record that begins with a place."""
    return isinstance(type_, RecordType) and bool(type_.fields) and type_.fields[0][1] == POS
