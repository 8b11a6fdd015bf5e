"""Runs on any host as traces: a host that hears what another answers, and writes it down. [TRACE]

The simulator's host knows a world, and knows nothing of recordings; here each start, reading and
answer that a program gets from it is noted. What only the rules ask, because a summary, a contract
or an assumption mentions it, is asked of the same host when the run is over.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from koord.refinement.running import Compiled, Ran, schedule_of
from koord.refinement.sampling_host import starting
from koord.refinement.summaries import Completing, PutOffError, with_summaries
from koord.refinement.value_translation import Observer, to_plain, to_value, to_written
from koord.runtime.engine.fleet import Fleet
from koord.runtime.proposals import INIT_ROUND, Decision
from koord.runtime.robot import Host, Key, Robot, Turn
from koord.runtime.shapes import Shape, from_plain
from koord.semantics.configurations import Configuration, Fault, FaultKind
from koord.semantics.domain import Constant
from koord.semantics.oracle import Phase
from koord.semantics.recordings import Answer, Concrete, Opening, Reading, Recording, Round, Start
from koord.syntax import core
from koord.syntax.core import Direction, Home
from koord.syntax.source import NOWHERE
from koord.syntax.system import System
from koord.syntax.types import ArrayType
from koord.traces.trace import Emitted, Numbers, Sources, Trace

_PHASES = {Turn.INIT: Phase.INIT, Turn.PROG: Phase.PROG, Turn.ENV: Phase.ENV}


class Hearing:
    """A host that answers as another does. The run that it heard is :meth:`ran`.

    ``world`` is who answers what only the rules ask: in the end the same host.
    """

    def __init__(
        self, made: Compiled, system: System, host: Host, world: Host | None = None
    ) -> None:
        self.made, self.system, self.host = made, system, host
        self.world = host if world is None else world
        self._observer = Observer(system, made.names)
        self._starting = dict(starting(system.program, made.names))
        self._shapes = {name: s for one in made.classes for name, s in one.EXTERNALS.items()}
        self._starts: dict[tuple[Home, int, int | None], Start] = {}
        self._readings: list[Reading] = []
        self._answers: list[Answer] = []
        self._opening = Opening(())
        self._rounds: list[Round] = []
        self._configurations: list[Configuration[Constant]] = []
        self._completing = Completing(system, self._lasting)
        self._complete: list[Round] = []  #: the rounds with all answers, as far as they are known
        self._complete_opening: Opening | None = None

    # --- the host ---------------------------------------------------------------------------------

    def start(self, robot: int | None, name: str) -> Any:
        value = self.host.start(robot, name)
        kind = None if robot is None else self.system.kinds[robot]
        variable = self._starting[kind, name].variable
        type_ = variable.type
        if variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        key = (variable.home, variable.slot, robot)
        self._starts[key] = Start(*key, to_value(value, type_))
        return value

    def read(self, robot: Robot) -> Mapping[str, Any]:
        given = self.host.read(robot)
        readings = {name: given.get(name, getattr(robot, name)) for name in robot.SENSORS}
        kind = self.system.kinds[robot.pid]
        for module in self.system.agent(robot.pid).modules:
            for position in module.ports if module.environment is None else ():
                port = self.system.agent(robot.pid).ports[position]
                if port.direction is Direction.SENSOR:
                    variable = port.declaration.variable
                    name = self.made.names.attribute(variable, kind)
                    value = from_plain(robot.PORTS[name], readings[name], robot.numAgents)
                    reading = Reading(robot.pid, variable.slot, to_value(value, variable.type))
                    self._readings.append(reading)
        return readings

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        answer = self.host.ask(turn, robot, key, function, arguments)
        external = self.system.program.external(function)
        given = tuple(
            to_value(argument, parameter.type)
            for argument, parameter in zip(arguments, external.parameters, strict=True)
        )
        value = self._value(external, self._shapes[function], answer)
        self._answers.append(Answer(_PHASES[turn], robot, key, function, given, value))
        return answer

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        value = self.host.choose(turn, robot, key, low, high)
        self._answers.append(Answer(_PHASES[turn], robot, key, None, (), value))
        return value

    # --- the run ----------------------------------------------------------------------------------

    @property
    def is_begun(self) -> bool:
        """Whether INIT is over."""
        return bool(self._configurations)

    def begun(self, decision: Decision, fleet: Fleet) -> None:
        """INIT is over."""
        order, _ = schedule_of(decision, self.system.robots)
        order = (*order, *(i for i in range(self.system.robots) if i not in order))
        self._opening = Opening(order, tuple(self._starts.values()), self._taken())
        self._configurations.append(self._observer.configuration(fleet))

    def round(self, decision: Decision, fleet: Fleet) -> None:
        """A round is over, or cut by a fault."""
        order, events = schedule_of(decision, self.system.robots)
        cut = decision.fault is not None
        readings = () if cut else tuple(self._readings)
        self._readings = []
        self._rounds.append(Round(order, events, readings, self._taken(), cut))
        last = self._configurations[-1]
        self._configurations.append(last if cut else self._observer.configuration(fleet))

    def so_far(
        self, fleet: Fleet, sources: Sources, shapes: Mapping[str, Shape], *, whole: bool = False
    ) -> Trace:
        """The run up to the last round that is over; to its end, if that is the ``whole`` run.

        ``shapes`` are those of the answers of functions that no robot asks. Raises KoordError.
        """
        self._shapes = {**shapes, **self._shapes}
        if self._complete_opening is None:
            self._complete_opening = self._completing.opening(self._opening)
        known = self._rounds if whole else [one for one in self._rounds if not one.cut]
        new = known[len(self._complete) :]
        self._complete += map(self._completing.round, new)
        return Trace(
            sources,
            self.system,
            Numbers.DOUBLE,
            Recording(self._complete_opening, tuple(self._complete)),
            tuple(self._configurations[: len(known) + 1]),
            tuple(one for one in self._outputs(fleet) if one.round < len(known)),
        )

    def ran(self, fleet: Fleet, sources: Sources, shapes: Mapping[str, Shape]) -> Ran:
        """The run, with the answers that the rules ask for. Raises KoordError."""
        trace = self.so_far(fleet, sources, shapes, whole=True)
        if self._completing.put_off:
            bare = replace(trace, recording=Recording(self._opening, tuple(self._rounds)))
            trace = with_summaries(bare, self._library)
        ended = fleet.ended
        if ended is None:
            return Ran(trace, None)
        kind = FaultKind(ended.fault.kind.value)
        fault = Fault(kind, ended.robot, NOWHERE, ended.fault.detail)
        *before, last = trace.configurations
        configurations = (*before, replace(last, fault=fault))
        return Ran(replace(trace, configurations=configurations), ended.fault.place)

    # --- inside -----------------------------------------------------------------------------------

    def _taken(self) -> tuple[Answer, ...]:
        answers, self._answers = tuple(self._answers), []
        return answers

    def _value(self, external: core.External, shape: Shape, answer: Any) -> Concrete:
        return to_value(from_plain(shape, answer, self.system.robots), external.result.type)

    def _library(
        self, external: core.External, arguments: tuple[Concrete, ...], robot: int | None
    ) -> Concrete:
        """What the host answers to what only the rules ask."""
        given = tuple(map(to_plain, arguments))
        answer = self.world.ask(Turn.ENV, robot or 0, (), external.name, given)
        return self._value(external, self._shapes[external.name], answer)

    def _lasting(
        self, external: core.External, arguments: tuple[Concrete, ...], robot: int | None
    ) -> Concrete:
        """The same while the run goes on: of functions whose answers change nothing of it."""
        if external.kind is not core.ExternalKind.FUNCTION:
            raise PutOffError
        return self._library(external, arguments, robot)

    def _outputs(self, fleet: Fleet) -> list[Emitted]:
        return [
            Emitted(
                one.round,
                None if one.round == INIT_ROUND else one.robot,
                to_written(written, self.made.places[written.place]),
            )
            for one in fleet.shown
            if one.round < len(self._rounds)
            for written in one.written
        ]
