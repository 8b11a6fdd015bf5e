"""Live reloading: an edited program goes on where robots are, at the next round. [RELOAD]"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol

from msgspec import Struct
from msgspec.structs import replace

from koord.api.edits import Edit, Edits
from koord.api.fitting import Fitted
from koord.api.progress import Listener
from koord.api.sim_report import ProgramReloaded
from koord.api.sim_setup import Built
from koord.api.sim_trace import TracedProgram, Tracing, system_of
from koord.refinement.translation import Translation, to_plain, to_storage, to_value
from koord.runtime.compile.naming import PythonNames
from koord.runtime.engine import Resumed, RoundEngine
from koord.runtime.robot import Host, Status, Turn
from koord.runtime.robot import Robot as Running
from koord.runtime.shapes import Shape, from_plain
from koord.semantics.configurations import NO_EVENT, Configuration
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.oracle import Key, NoOracle, Oracle, Phase
from koord.semantics.recordings import Concrete, Reached
from koord.semantics.reloading import Correspondence, Fate, Unkept, correspondence, reloaded
from koord.semantics.rounds import IllegalStepError
from koord.semantics.storage import Cell, Storage, contents
from koord.sim.run_log import changed_words
from koord.sim.running import NextProgram, Simulation
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.diagnostics import Diagnostic, KoordError, Severity
from koord.syntax.source import whole_file
from koord.syntax.system import System


class Next(Protocol):
    """What makes another program for a run, of what it is fitted with, compiled, and notes."""

    def __call__(
        self,
        fitted: Fitted,
        built: Built,
        words: tuple[str, ...],
        *,
        tracing: Callable[[Host, Host], Host] | None,
    ) -> NextProgram: ...


class Reloading:
    """What lets a run go on with edited programs."""

    def __init__(
        self,
        fitted: Fitted,
        simulation: Simulation,
        edits: Edits,
        make: Next,
        tell: Listener,
        tracing: Tracing | None,
        *,
        asks: bool = False,
    ) -> None:
        """Make what looks for edits between rounds; ``make`` makes other programs for the run.

        If it ``asks``, an edit that drops values is taken when it is saved again as it is.
        """
        self.fitted, self._simulation, self._edits, self._tell = fitted, simulation, edits, tell
        self._make, self._tracing, self._asks = make, tracing, asks
        simulation.striding, simulation.waits = None, True

    def between_rounds(self) -> None:
        """Go on with another program, if the one that runs was edited. Raises no KoordError."""
        simulation = self._simulation
        if simulation.is_over:
            return
        edit = self._edits.take(simulation.engine.round)
        if edit is None:
            return
        if edit.fitted is None or edit.built is None:
            self._refuse(edit, edit.diagnostics)
            return
        if self._asks and not edit.agreed:
            dropped = self._dropped(edit.fitted)
            if dropped:
                self._edits.put_back(edit)
                self._refuse(edit, (_question(edit, dropped),))
                return
        try:
            notes = self._go_on(edit.fitted, edit.built)
        except IllegalStepError as error:
            place = whole_file(edit.sources[0].name)
            hint = "the program that runs goes on; end the run, and begin another one"
            story = f"the edited program cannot go on here: {error.reason}"
            self._refuse(edit, (Diagnostic("K957", Severity.ERROR, place, story, hint),))
        except KoordError as error:
            self._refuse(edit, error.diagnostics)
        else:
            warnings = edit.fitted.program.warnings
            self._tell(
                ProgramReloaded(
                    changed_words(notes),
                    simulation.engine.round,
                    accepted=True,
                    notes=notes,
                    diagnostics=warnings,
                    sources=edit.sources,
                )
            )

    def _refuse(self, edit: Edit, diagnostics: tuple[Diagnostic, ...]) -> None:
        errors = [one for one in diagnostics if one.severity is Severity.ERROR]
        self._simulation.refuse(tuple(f"{one.span}: {one.message}" for one in errors))
        self._tell(
            ProgramReloaded(
                "the edited program is refused; the one before goes on",
                self._simulation.engine.round,
                accepted=False,
                diagnostics=diagnostics,
                sources=edit.sources,
            )
        )

    def _dropped(self, fitted: Fitted) -> list[str]:
        """The variables whose values an edited program does not keep."""
        new = replace(self.fitted, program=fitted.program, kinds=fitted.kinds)
        try:
            match = correspondence(system_of(self.fitted), system_of(new))
        except IllegalStepError:
            return []  # which is told when it is tried
        return [one.name for one in match.unkept if one.fate is not Fate.NEW]

    def _go_on(self, fitted: Fitted, built: Built) -> tuple[str, ...]:
        """Go on with a program. Raises IllegalStepError and KoordError where it cannot."""
        simulation, old = self._simulation, self.fitted
        # Robots stay where they are, and their world what it is: of the new one only its program.
        fitted = replace(old, program=fitted.program, kinds=fitted.kinds)
        before, after = system_of(old), system_of(fitted)
        match = correspondence(before, after)
        notes = tuple(notes_of(match, after.program))
        names = PythonNames(before.program)
        configuration = Translation(before, names).configuration(simulation.engine)
        traced, finished = None, None
        if self._tracing is not None:
            traced = TracedProgram(fitted, Reached(before, configuration))
            finished = self._tracing.finished(simulation)
        hear = None if traced is None else traced.hear
        program = self._make(fitted, built, notes, tracing=hear)
        shown = simulation.engine.shown

        def resume(engine: RoundEngine) -> Resumed:
            translation = Translation(after, PythonNames(after.program))
            inputs = _HostInputs(engine, translation)
            found = reloaded(DOUBLES, before, after, configuration, inputs).configuration
            return resumed(found, translation, engine, shown)

        simulation.reload(program, resume)
        if self._tracing is not None and traced is not None and finished is not None:
            self._tracing.go_on(traced, finished, simulation)
        self.fitted = fitted
        return notes


def _question(edit: Edit, dropped: Sequence[str]) -> Diagnostic:
    names = ", ".join(f"`{name}`" for name in dropped)
    story = f"the edited program would drop what is in {names}"
    hint = "save it again as it is to go on with it all the same; the program that runs goes on"
    return Diagnostic("K959", Severity.ERROR, whole_file(edit.sources[0].name), story, hint)


# --- words ----------------------------------------------------------------------------------------


def notes_of(match: Correspondence, program: core.Program) -> Iterable[str]:
    """What is not kept, in words."""
    for one in match.unkept:
        whose = f" of {one.agent}" if one.agent else ""
        name = f"{one.name}{whose}"
        start = "starts" if one.is_set else "is unset"
        match one.fate:
            case Fate.NEW:
                yield f"{name} is new and {start}{_why_unset(one, program)}"
            case Fate.RETYPED:
                yield f"{name} is of another type and {start} anew{_why_unset(one, program)}"
            case Fate.MOVED:
                yield f"{name} is {one.home.value} now and {start} anew{_why_unset(one, program)}"
            case Fate.GONE:
                yield f"{name} is gone"


def _why_unset(one: Unkept, program: core.Program) -> str:
    if one.is_set or not any(agent.init for agent in program.agents) or one.home is Home.PORT:
        return ""
    return " (init: is not run again)"


# --- values ---------------------------------------------------------------------------------------


def resumed(
    configuration: Configuration[Constant],
    translation: Translation,
    engine: RoundEngine,
    shown: Sequence[Any],
) -> Resumed:
    """What robots of an engine hold in a configuration."""
    system, names, robots = translation.system, translation.names, engine.told_robots
    program = system.program
    layout = {one.name: one.shape for one in type(robots[0]).SHARED.variables}
    store = configuration.store
    shared = _attributes(
        [*program.allread, *program.allwrite],
        (*store.allread, *store.allwrite),
        names,
        None,
        layout,
        system,
    )
    own = []
    for robot, state in zip(robots, configuration.robots, strict=True):
        agent, kind = system.agent(robot.pid), system.kinds[robot.pid]
        entries = [*agent.locals, *(port.declaration for port in agent.ports)]
        shapes = {**robot.LOCALS, **robot.PORTS}
        own.append(_attributes(entries, (*state.locals, *state.ports), names, kind, shapes, system))
    return Resumed(
        configuration.round,
        shared,
        own,
        [Status(state.status) for state in configuration.robots],
        [None if state.ran == NO_EVENT else int(state.ran) for state in configuration.robots],
        shown,
    )


def _attributes(
    entries: Sequence[core.Declaration],
    storages: Sequence[Storage[Constant]],
    names: PythonNames,
    kind: int | None,
    shapes: Mapping[str, Shape],
    system: System,
) -> dict[str, Any]:
    """The values of variables by their attributes."""
    found = {}
    for entry, storage in zip(entries, storages, strict=True):
        name = names.attribute(entry.variable, kind)
        found[name] = from_plain(shapes[name], _plain(storage), system.robots, unset=True)
    return found


def _plain(storage: Storage[Constant]) -> Any:
    """Storage as plain data: None where it is unset."""
    if isinstance(storage, Cell):
        return to_plain(storage.value) if storage.is_set else None
    return tuple(map(_plain, storage.parts))


class _HostInputs(Struct, frozen=True):
    """What starts when another program goes on, as its robots' host says."""

    engine: RoundEngine
    translation: Translation

    def start(self, declaration: core.Declaration, robot: int | None) -> Concrete:
        variable, names = declaration.variable, self.translation.names
        of = self.engine.told_robots[0 if robot is None else robot]
        kind = self.translation.system.kinds[of.pid]
        name = names.attribute(variable, None if robot is None else kind)
        value = of.start_shared(name) if robot is None else of.start(name)
        return _value(value, declaration, self.translation.system.robots)

    def sensor(self, robot: int, port: core.Port) -> Concrete:
        raise AssertionError(port.label)

    def oracle(self, phase: Phase, robot: int) -> Oracle[Constant]:
        return _HostOracle(self.engine.told_robots[robot], self.translation)


def _value(value: Any, declaration: core.Declaration, robots: int) -> Concrete:
    type_ = declaration.variable.own_type
    found, _ = contents(DOUBLES, to_storage(value, type_, robots), type_)
    return found


class _HostOracle(NoOracle):
    """What external functions answer in initial values."""

    def __init__(self, robot: Running, translation: Translation) -> None:
        self._robot, self._translation = robot, translation

    def external(self, function: core.External, key: Key, arguments: tuple[Any, ...]) -> Any:
        plain = tuple(map(to_plain, arguments))
        answer = self._robot.host.ask(Turn.INIT, self._robot.pid, key, function.name, plain)
        shape, robots = self._robot.EXTERNALS[function.name], self._translation.system.robots
        return to_value(from_plain(shape, answer, robots), function.result.type)

    def vouches_for(self, function: core.External) -> bool:
        return True
