"""A program and a configuration together: the one check of both, for all commands that take them.

What can be wrong with a configuration by itself is found where it is read. Here it is seen whether
it suits a program: params, kinds of robots, planners, and where robots and tasks are.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from koord.api.programs import Program, no_program
from koord.api.robots import AS_STATED, Fleet, system_of
from koord.cli.arguments import settings
from koord.cli.diagnostics import Report
from koord.cli.files import DASH, read_program
from koord.cli.systems import kinds_by_role, suited, unlike
from koord.runtime.configuration.checking import load as load_configuration
from koord.runtime.configuration.model import Configuration, Scatter
from koord.runtime.configuration.params import params
from koord.runtime.motion.libraries import SIM
from koord.runtime.motion.world import World
from koord.syntax import core
from koord.syntax.collector import uncollected
from koord.syntax.diagnostics import KoordError
from koord.syntax.elaboration.settings import ParamValue, Settings
from koord.syntax.load import load
from koord.syntax.source import Source, Span
from koord.syntax.types import POS, ArrayType, ListType, RecordType, Type

if TYPE_CHECKING:
    from koord.cli.simulating import Job
    from koord.sim.scene import Scene

#: So many tasks there are where nobody says how many.
_TASKS = 20

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


class Fitted(Struct, frozen=True):
    """A program with a configuration that suits it. ``kinds`` are those of the robots."""

    loaded: Program
    configuration: Configuration
    kinds: tuple[int, ...]
    scene: Scene | None  #: None where the libraries that scenes are made with are not installed


class Asked(Struct, frozen=True):
    """What is to be run, as far as flags say so."""

    source: Source
    configuration: Configuration | None  #: None: the plainest that suits the program
    properties: tuple[Source, ...]
    params: Mapping[str, ParamValue]
    delta_s: Fraction | None = None  #: None: as the configuration says, or the program

    def job(self, report: Report, robots: int | None, seed: int | None) -> Job | None:
        """What is to be simulated, for so many robots and with that seed, as :meth:`fitted`.

        Raises KoordError.
        """
        from koord.cli.simulating import Job

        found = self.fitted(report, robots, seed)
        if found is None:
            return None
        assert found.scene is not None, "who simulates has what scenes are made with"
        return Job(found.loaded, found.configuration, found.scene, found.kinds)

    @uncollected()
    def fitted(
        self, report: Report, robots: int | None = None, seed: int | None = None
    ) -> Fitted | None:
        """Program and configuration together; None if there are errors in the report.

        Raises KoordError.
        """
        before = report.errors
        chosen = dict(self.params)
        places: dict[str, Span] = {}
        if self.configuration is not None:
            own = params(self.configuration)
            of = self.configuration.document.name_place
            places = {k: of(("params", k)) for k in own if k not in chosen}
            chosen = {**own, **chosen}
        program = self._elaborated(report, Settings(chosen, places=places))
        if program is None:
            return None
        configuration = self.configuration or _default(program, robots)
        configuration = _with_tasks(configuration, program, sized="tasks" in chosen)
        configuration = suited(configuration, program, self.delta_s)
        described = [robot.kind for robot in configuration.robots]
        report.add(kinds_by_role(program, described, configuration.name)[1])
        made = _scene(configuration, program, seed, robots)
        roles = made.roles if made is not None else described
        kinds, problems = kinds_by_role(program, roles, configuration.name)
        report.add(problems)
        if self.configuration is not None and self.delta_s is None and not problems:
            report.add(unlike(configuration, program, kinds if robots is None else None))
        if made is not None:
            configuration = replace(configuration, world=made.world)
        tasks = configuration.world.tasks if configuration.world is not None else ()
        chosen |= self._sizes(program, chosen, len(tasks))
        given = tuple((Fraction(x), Fraction(y), Fraction(z)) for x, y, z in tasks)
        settings = Settings(chosen, given or None)
        program = self._elaborated(report, settings)
        if program is None or report.errors > before:
            return None
        loaded = Program(self.source, program, settings, self.properties)
        return Fitted(loaded, configuration, kinds, made)

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
        size = size_of(program)
        if size is None or size == tasks or not tasks:
            return {}
        for given in program.parameters:
            if given.value != size or given.name in chosen:
                continue
            more: dict[str, ParamValue] = {given.name: tasks}
            changed = load(self.source, Settings({**chosen, **more}), self.properties).program
            if changed is not None and size_of(changed) == tasks:
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
    path = arguments.config if arguments.config is not None else beside(arguments.file, ".yaml")
    if path is not None:
        configuration = read_configuration(path, report)
        if configuration is None:
            return None
    chosen = settings(arguments.settings)
    return Asked(source, configuration, properties, chosen, arguments.delta)


def beside(path: str, suffix: str) -> str | None:
    """The file that lies beside another and has its name, but for how it ends, if there is one."""
    other = Path(path).with_suffix(suffix)
    return str(other) if path != DASH and other.is_file() and str(other) != path else None


def read_configuration(path: str, report: Report) -> Configuration | None:
    """The configuration in a file; what is wrong goes to the report."""
    try:
        source = read_program(path).source
    except KoordError as error:
        report.add(error.diagnostics)
        return None
    report.add((), source)
    try:
        return load_configuration(source)
    except KoordError as error:
        report.add(error.diagnostics)
        return None


def check_alone(configuration: Configuration) -> None:
    """All that can be seen of a configuration without a program. Raises KoordError."""
    params(configuration)
    if can_be_placed():
        from koord.sim.scene import scene

        scene(replace(configuration, delta_s=configuration.delta_s or 1.0))


def check_start(found: Fitted | None) -> None:
    """Whether a run may begin as program and configuration have it. Raises KoordError. (K934)"""
    if found is not None and found.scene is not None:
        from koord.cli.simulating import Job

        job = Job(found.loaded, found.configuration, found.scene, found.kinds)
        job.check_start(job.begun())


def can_be_placed() -> bool:
    """Whether the libraries are there that look at where things are."""
    return all(find_spec(name) is not None for name in SIM)


def _scene(
    configuration: Configuration, program: core.Program, seed: int | None, robots: int | None
) -> Scene | None:
    """Robots and tasks in their world; None where the libraries for that are not installed."""
    if not can_be_placed():
        return None
    from koord.sim.bounds import moves, places_of
    from koord.sim.scene import scene

    landmarks = tuple(places_of(program)) if moves(program) else None
    return scene(configuration, seed, robots, landmarks)


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
    from koord.sim.bounds import places_of, widened
    from koord.sim.scene import inner

    made = load_configuration(Source(NO_FILE, _DEFAULT.format(agents="\n".join(lines))))
    # However far away a program sends its robots, they begin in the arena of the paper.
    scatter = replace(made.scatter, start=inner(World()))
    world = widened(World(), tuple(places_of(program)))
    return replace(made, world=world, scatter=scatter, bounded=True)


def _with_tasks(
    configuration: Configuration, program: core.Program, *, sized: bool
) -> Configuration:
    """Tasks for a program that has a list of them, if the configuration has none."""
    size, scatter = size_of(program), configuration.scatter
    if size is None or scatter.tasks or (configuration.world and configuration.world.tasks):
        return configuration
    count = size if sized or configuration.name != NO_FILE else _TASKS
    return replace(configuration, scatter=Scatter(count, scatter.start))


def size_of(program: core.Program) -> int | None:
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
