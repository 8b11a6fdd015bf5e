"""Setup of simulations: a program in a scene, with monitors of its claims."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, TypeVar

from msgspec import Struct
from msgspec.structs import replace

import koord.api.sim_libraries  # noqa: F401
from koord.api.fitting import NO_FILE, Fitted, is_placed, slack_of
from koord.machine import is_installed
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.compile.watching import Watched, WatchedKind, watched
from koord.runtime.configuration.reading import problem
from koord.runtime.platform.world_host import ANSWERED
from koord.runtime.ports import SIMULATED, plain_name
from koord.sim.claims import Checked, Watching
from koord.sim.running import Cast, Claims, NextProgram, Simulation, Striding
from koord.syntax import core
from koord.syntax.collector import uncollected
from koord.syntax.core import Direction
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import whole_file
from koord.syntax.walk import nodes

if TYPE_CHECKING:
    from koord.runtime.plugins.calls import PlugIn
    from koord.runtime.robot import Host, Robot

Run = TypeVar("Run", bound=Simulation)

#: A run ends after so long: of a program that can stop, and of one that cannot.
_LONG_S, _ENDLESS_S = 600.0, 120.0

#: Of starts that a program does not assume, so many are told.
_MOST_TOLD = 10


def cast(
    fitted: Fitted,
    classes: tuple[type[Robot], ...] | None = None,
    claims: Watched | None = None,
) -> Cast:
    """The program, compiled: to these classes, if it is known already; and its claims with it."""
    program, source = fitted.program.core, fitted.program.source
    differing = fitted.problem.differing
    classes = loaded(compiled(program)) if classes is None else classes
    turns = LazyTurns(program, claims)
    return Cast(source.name, source.text, classes, fitted.kinds, differing, turns)


class Built(Struct, frozen=True):
    """A program and its claims, compiled."""

    cast: Cast
    claims: Watched


def build(fitted: Fitted) -> Built:
    """Compile a program and its claims, as :func:`simulation` needs them."""
    claims = watched(fitted.program.core, slack_of(fitted))
    made = cast(fitted, claims=claims)
    _check_radio(fitted, made)
    return Built(made, claims)


def _check_radio(fitted: Fitted, made: Cast) -> None:
    """Refuse rounds by radio if they wait for every robot. Raises KoordError. [SKIP]"""
    if not fitted.scene.radio.carries_rounds or not any(one.owes() for one in made.classes):
        return
    where = fitted.configuration.place("radio", "agreement")
    story = "robots out of reach would keep all others waiting"
    hint = "rounds wait for programs with urgent events, or models that may fault: agree everywhere"
    raise KoordError((problem(where, story, hint),))


def fallback(fitted: Fitted) -> Callable[[Host], Host] | None:
    """The fallback host for queries that no world answers, if there are any. Raises KoordError."""
    program = fitted.program.core
    starts = bool(program.assumptions) and not is_placed(program)
    if not starts and not unanswered(fitted):
        return None
    from koord.api import fallback_host
    from koord.syntax.system import System

    system = System(program, fitted.kinds, fitted.delta_s)
    names = [frozenset("_".join(port) for port in one) for one in _served(fitted)]
    return fallback_host.fallback(system, fitted.scene.seed, starts=starts, served=names)


class _Hearing:
    """The host of a program: the world's, with summaries checked, and heard by a recording."""

    def __init__(self, check_summaries: bool, tracing: Callable[[Host, Host], Host] | None) -> None:
        self._checks, self._tracing = check_summaries, tracing
        self._checked: list[Checked] = []

    def __call__(self, world: Host) -> Host:
        host = world
        if self._checks:
            self._checked.append(Checked(world))
            host = self._checked[0]
        return host if self._tracing is None else self._tracing(host, world)

    def holding(self, claims: Watched, run: Simulation) -> list[Checked]:
        """The checks of summaries, held against claims from now on."""
        for one in self._checked:
            one.hold(claims, run)
        return self._checked


@uncollected()
def simulation(
    fitted: Fitted,
    kind: Callable[..., Run],
    *,
    keep_going: bool = False,
    check_summaries: bool = False,
    tracing: Callable[[Host, Host], Host] | None = None,
    built: Built | None = None,
    kernels: bool = True,
) -> Run:
    """Make the simulation of a program in its scene, with monitors; of summaries if requested.

    ``kind`` makes it of a cast and a scene; ``tracing`` makes of the host of the
    program, and of the world's, the one that is to be heard instead. ``built`` is what
    :func:`build` makes, if it is known already. Without ``kernels`` compiled robots make all turns,
    and no machine code does. Raises KoordError.
    """
    heard = _Hearing(check_summaries, tracing)
    built = build(fitted) if built is None else built
    supplied, claims = fallback(fitted), built.claims
    cast = built.cast if kernels else replace(built.cast, turns=None)
    made = kind(cast, fitted.scene, keep_going=keep_going, heard=heard, supplied=supplied)
    made.claims.append(Watching(claims, made))
    if cast.turns is not None and is_installed():
        made.striding = _striding
    made.claims.extend(heard.holding(claims, made))
    return made


def next_program(
    fitted: Fitted,
    built: Built,
    words: tuple[str, ...],
    *,
    check_summaries: bool = False,
    kernels: bool = True,
    tracing: Callable[[Host, Host], Host] | None = None,
) -> NextProgram:
    """Another program for a run in progress, as :func:`simulation` has the first. [RELOAD]

    Raises KoordError.
    """
    heard = _Hearing(check_summaries, tracing)

    def claims(run: Simulation) -> list[Claims]:
        return [Watching(built.claims, run), *heard.holding(built.claims, run)]

    cast = built.cast if kernels else replace(built.cast, turns=None)
    return NextProgram(cast, heard, fallback(fitted), claims, words)


def _striding(run: Simulation) -> Striding | None:
    from koord.sim.strides import Strides

    return Strides.of(run)


def watch(simulation: Simulation, program: core.Program, slack: Fraction) -> Watched:
    """Monitor all claims of a program in a run, with a slack in metres."""
    claims = watched(program, slack)
    simulation.claims.append(Watching(claims, simulation))
    return claims


def limit_s(fitted: Fitted, rounds: int | None, time_s: float | None) -> float:
    """The time limit in simulated seconds: as requested, or as suits the program."""
    given = [] if rounds is None else [rounds * fitted.scene.delta_s]
    given += [] if time_s is None else [time_s]
    if given:
        return min(given)
    events = tuple(e.effect for agent in fitted.program.core.agents for e in agent.events)
    stops = any(isinstance(node, core.Stop | core.TryStop) for node in nodes(events))
    return _LONG_S if stops else _ENDLESS_S


def _served(fitted: Fitted) -> list[frozenset[tuple[str, str]]]:
    """The modules and ports of each robot that plug-ins serve. Raises KoordError."""
    of: dict[int, frozenset[tuple[str, str]]] = {}
    for robot in fitted.scene.robots:
        if id(robot.model) not in of:
            of[id(robot.model)] = _ports(robot.model.modules)
    return [of[id(robot.model)] for robot in fitted.scene.robots]


def _ports(named: tuple[tuple[str, PlugIn], ...]) -> frozenset[tuple[str, str]]:
    if not named:
        return frozenset()
    from koord.runtime.plugins.names import served_ports  # it asks what is installed

    return served_ports(named)


def unanswered(fitted: Fitted) -> tuple[str, ...]:
    """The functions and sensors of a program that no simulated world answers, nor a plug-in."""
    program, served = fitted.program.core, frozenset.intersection(*_served(fitted))
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
        if port.direction is Direction.SENSOR
        and port.declaration.variable.name not in SIMULATED
        and tuple(port.label.split(".")) not in served
    ]
    return tuple(dict.fromkeys(found))


# --- how a run begins -----------------------------------------------------------------------------


def check_can_begin(fitted: Fitted) -> None:
    """Check that a run may begin with program and configuration. Raises KoordError. (K934)"""
    check_begun(fitted, begin(fitted))


def begin(fitted: Fitted, built: Built | None = None, *, kernels: bool = True) -> Simulation:
    """Let a run begin, and no further. Raises KoordError."""
    begun = simulation(fitted, Simulation, built=built, kernels=kernels)
    begun.begin()
    begun.fleet.close()
    return begun


def check_begun(fitted: Fitted, simulation: Simulation) -> None:
    """Check that a run began as the program assumes. Raises KoordError. (K934)"""
    configuration = fitted.configuration
    problems = []
    for broken in simulation.broken:
        if broken.sort != WatchedKind.ASSUMPTION.value:
            continue
        place = configuration.place()
        if configuration.name == NO_FILE:
            place = whole_file("the scene")
        elif broken.robots:
            pid = broken.robots[0]
            robot = configuration.robots[pid if pid < len(configuration.robots) else 0]
            place = configuration.place(*robot.path)
        who = f" of robot{'s' * (len(broken.robots) > 1)} " if broken.robots else ""
        who += " and ".join(map(str, broken.robots))
        story = f"the run does not begin as the program assumes: {broken.claim}{who}"
        hint = f"it is {broken.words}; {_cure(fitted)}"
        problems.append(Diagnostic("K934", Severity.ERROR, place, story, hint))
    if problems:
        raise KoordError(tuple(problems[:_MOST_TOLD]))


def _cure(fitted: Fitted) -> str:
    """The hint for a run that cannot begin."""
    if not is_placed(fitted.program.core):
        return "give the variables that it speaks of an initial value"
    if fitted.configuration.name == NO_FILE:
        return "name a configuration that says where robots are, with `position`"
    return "say where robots are with `position`"
