"""Tracing hosts: runs on any host as traces, by observing its answers. [TRACE]

A simulator's host knows a world, and nothing of recordings. What only the rules ask, because a
summary, a contract or an assumption mentions it, is asked of the same host when the run is over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from msgspec.structs import replace

from koord.refinement.completion import Completing, PutOffError, with_summaries
from koord.refinement.running import Compiled, CompiledRun, Recorder, ended_in, opening_order
from koord.refinement.translation import PHASES, Translation, to_plain, to_value
from koord.runtime.engine import RoundEngine
from koord.runtime.proposals import INIT_ROUND, Decision
from koord.runtime.robot import Host, Key, Robot, Turn
from koord.runtime.shapes import Shape, from_plain
from koord.semantics.recordings import (
    Answer,
    Concrete,
    Opening,
    Reached,
    Reading,
    Recording,
    Round,
    Start,
)
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import System
from koord.traces.trace import Sources, Trace

#: Is told of what a host gave in a turn.
Tell: TypeAlias = Callable[[Turn, Start | Reading | Answer], None]


class TracingHost:
    """A host that forwards to another, and reports each start, reading and answer.

    ``shapes`` are those of the answers of external functions.
    """

    def __init__(
        self, host: Host, translation: Translation, shapes: Mapping[str, Shape], tell: Tell
    ) -> None:
        self.host, self.translation, self.shapes, self.tell = host, translation, shapes, tell

    def start(self, robot: int | None, name: str) -> Any:
        value = self.host.start(robot, name)
        self.tell(Turn.INIT, self.translation.start(robot, name, value))
        return value

    def read(self, robot: Robot) -> Mapping[str, Any]:
        given = self.host.read(robot)
        readings = {name: given.get(name, getattr(robot, name)) for name in robot.SENSORS}
        for name, value in readings.items():
            plain = from_plain(robot.PORTS[name], value, robot.numAgents)
            self.tell(Turn.ENV, self.translation.reading(robot.pid, name, plain))
        return readings

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        answer = self.host.ask(turn, robot, key, function, arguments)
        external, given = self.translation.question(function, arguments)
        value = self.answer(external, answer)
        self.tell(turn, Answer(PHASES[turn], robot, key, function, given, value))
        return answer

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        value = self.host.choose(turn, robot, key, low, high)
        self.tell(turn, Answer(PHASES[turn], robot, key, None, (), value))
        return value

    def answer(self, external: core.External, answer: Any) -> Concrete:
        """Record a host's answer of a function."""
        shape, robots = self.shapes[external.name], self.translation.system.robots
        return to_value(from_plain(shape, answer, robots), external.result.type)


class TracedFleet(TracingHost):
    """The tracing host of a whole fleet. The recorded run is :meth:`ran`.

    ``world`` is who answers what only the rules ask: in the end the same host.
    """

    def __init__(
        self,
        made: Compiled,
        system: System,
        host: Host,
        world: Host | None = None,
        before: Reached | None = None,
    ) -> None:
        """Trace a fleet; one that goes on from ``before``, if that is given. [RELOAD]"""
        shapes = {name: s for one in made.classes for name, s in one.EXTERNALS.items()}
        super().__init__(host, Translation(system, made.names), shapes, self._note)
        self.system = system
        self.world = host if world is None else world
        self._starts: dict[tuple[Home, int, int | None], Start] = {}
        self._readings: list[Reading] = []
        self._answers: list[Answer] = []
        first = None if before is None else before.configuration.round
        self._recorder = Recorder(made, self.translation, first)
        self._before = before
        self._completing = Completing(system, self._lasting, before)
        self._complete: list[Round] = []  #: the rounds with all answers, as far as they are known
        self._complete_opening: Opening | None = None

    def _note(self, turn: Turn, given: Start | Reading | Answer) -> None:
        match given:
            case Start():
                self._starts[given.home, given.slot, given.robot] = given
            case Reading():
                self._readings.append(given)
            case Answer():
                self._answers.append(given)

    # --- the run ----------------------------------------------------------------------------------

    @property
    def is_begun(self) -> bool:
        """True if INIT is over."""
        return bool(self._recorder.configurations)

    def heard(self, decision: Decision, fleet: RoundEngine) -> None:
        """Record the end of INIT or of a round, or its cut by a fault."""
        readings, answers = tuple(self._readings), tuple(self._answers)
        self._readings, self._answers = [], []
        if decision.round == INIT_ROUND:
            order = opening_order(decision, self.system.robots)
            starts = tuple(self._starts.values())
            self._recorder.begun(Opening(order, starts, answers), fleet)
        else:
            self._recorder.round(decision, readings, answers, fleet)

    def resumed(self, fleet: RoundEngine) -> None:
        """Record that the program goes on, instead of INIT. [RELOAD]"""
        answers, self._answers = tuple(self._answers), []
        self._recorder.begun(Opening((), tuple(self._starts.values()), answers), fleet)

    def so_far(
        self,
        fleet: RoundEngine,
        sources: Sources,
        shapes: Mapping[str, Shape],
        *,
        whole: bool = False,
    ) -> Trace:
        """The run up to the last finished round; to its end, if that is the ``whole`` run.

        ``shapes`` are those of the answers of functions that no robot asks. Raises KoordError.
        """
        self.shapes = {**shapes, **self.shapes}
        if self._complete_opening is None:
            self._complete_opening = self._completing.opening(self._recorder.opening)
        rounds = self._recorder.rounds
        known = rounds if whole else [one for one in rounds if not one.cut]
        self._complete += map(self._completing.round, known[len(self._complete) :])
        recording = Recording(self._complete_opening, tuple(self._complete))
        return self._recorder.trace(sources, recording, fleet)

    def ran(self, fleet: RoundEngine, sources: Sources, shapes: Mapping[str, Shape]) -> CompiledRun:
        """The run, completed by the answers that the rules ask for. Raises KoordError."""
        trace = self.so_far(fleet, sources, shapes, whole=True)
        if self._completing.put_off:
            recorded = Recording(self._recorder.opening, tuple(self._recorder.rounds))
            bare = replace(trace, recording=recorded)
            trace = with_summaries(bare, self._library, before=self._before)
        return ended_in(trace, fleet.ended)

    # --- inside -----------------------------------------------------------------------------------

    def _library(
        self, external: core.External, arguments: tuple[Concrete, ...], robot: int | None
    ) -> Concrete:
        """The host's answer to a query that only the rules make."""
        given = tuple(map(to_plain, arguments))
        answer = self.world.ask(Turn.ENV, robot or 0, (), external.name, given)
        return self.answer(external, answer)

    def _lasting(
        self, external: core.External, arguments: tuple[Concrete, ...], robot: int | None
    ) -> Concrete:
        """The same while the run goes on: for functions whose answers do not influence it."""
        if external.kind is not core.ExternalKind.FUNCTION:
            raise PutOffError
        return self._library(external, arguments, robot)
