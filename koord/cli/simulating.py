"""What is to be simulated: a program in a scene."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, TypeVar

from msgspec import Struct

from koord.api.programs import Program
from koord.cli.fitting import NO_FILE, size_of
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.watching import Sort, Watched, watched
from koord.runtime.configuration.model import Configuration
from koord.sim.claims import Checked, Watching
from koord.sim.hosting import ANSWERED, SENSED, plain_name
from koord.sim.running import Cast, Simulation
from koord.sim.scene import Scene
from koord.syntax import core
from koord.syntax.collector import uncollected
from koord.syntax.core import Direction
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.problem import Problem
from koord.syntax.source import whole_file
from koord.syntax.walk import nodes

if TYPE_CHECKING:
    from koord.cli.simulated_traces import Tracing
    from koord.runtime.robot import Host
    from koord.sim.following import Followed

Run = TypeVar("Run", bound=Simulation)

#: A run ends after so long: of a program that can stop, and of one that cannot.
_LONG_S, _ENDLESS_S = 600.0, 120.0


class Job(Struct, frozen=True):
    """A program in a scene. ``given`` are the values of params."""

    loaded: Program
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
        program, source = self.loaded.core, self.loaded.source
        differing = self.problem.differing
        return Cast(source.name, source.text, loaded(compiled(program)), self.kinds, differing)

    @property
    def by_chance(self) -> tuple[str, ...]:
        """What no world answers, by name: chance does."""
        return gaps_of(self.loaded.core)

    def supplied(self) -> Callable[[Host], Host] | None:
        """What answers what no world does, if the program leaves that open. Raises KoordError."""
        program = self.loaded.core
        starts = bool(program.assumptions) and not _is_placed(program)
        if not starts and not self.by_chance:
            return None
        from koord.api.fallback_host import Fallback
        from koord.syntax.system import System

        system = System(program, self.kinds, self.delta_s)
        return Fallback.of(system, self.scene.seed, starts=starts)

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
        program, scene = self.loaded.core, self.scene
        cast = self.cast()
        checked: list[Checked] = []

        def heard(world: Host) -> Host:
            host = world
            if summaries:
                checked.append(Checked(world))
                host = checked[0]
            return host if tracing is None else tracing.hear(host, world)

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
        events = tuple(e.effect for agent in self.loaded.core.agents for e in agent.events)
        stops = any(isinstance(node, core.Stop | core.TryStop) for node in nodes(events))
        return _LONG_S if stops else _ENDLESS_S

    def _cure(self) -> str:
        """What to do if a run does not begin as it should."""
        if not _is_placed(self.loaded.core):
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


def gaps_of(program: core.Program) -> tuple[str, ...]:
    """The functions and sensors of a program that nothing in a simulated world answers."""
    functions = (plain_name(function.name) for function in program.externals)
    ports = (
        agent.ports[position]
        for agent in program.agents
        for module in agent.modules
        if module.environment is None
        for position in module.ports
    )
    found = [name for name in functions if name not in ANSWERED]
    found += [
        port.label
        for port in ports
        if port.direction is Direction.SENSOR and port.declaration.variable.name not in SENSED
    ]
    return tuple(dict.fromkeys(found))


def _is_placed(program: core.Program) -> bool:
    """Whether a program speaks of where robots or tasks are, of which worlds say how it starts."""
    names = {port.declaration.variable.name for agent in program.agents for port in agent.ports}
    return not names.isdisjoint(SENSED) or size_of(program) is not None
