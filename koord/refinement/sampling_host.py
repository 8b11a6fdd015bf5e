"""A host for runs that are to be judged: it answers by chance, and remembers for the recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from koord.refinement.value_translation import to_plain, to_value
from koord.runtime.compile.naming import Names
from koord.runtime.robot import Key, Robot, Turn
from koord.sampling.initial_state_search import settle_readings, settled_start
from koord.sampling.sampled_inputs import SampledInputs
from koord.semantics.configurations import Configuration
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.expressions import evaluate
from koord.semantics.oracle import Phase
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.syntax import core
from koord.syntax.core import Direction
from koord.syntax.system import System
from koord.syntax.types import FLOAT, INT

_PHASES = {Turn.INIT: Phase.INIT, Turn.PROG: Phase.PROG, Turn.ENV: Phase.ENV}


class SampledHost:
    """Answers what a program leaves open, such that assumptions, summaries and contracts hold.

    They are found with the help of the reference; which of them are asked for, and with which
    arguments, is up to the program that runs.
    """

    def __init__(self, system: System, names: Names, inputs: SampledInputs) -> None:
        self.system = system
        self.names = names
        self.inputs = inputs
        self._starts = dict(starting(system.program, names))

    def settle_start(self, order: tuple[int, ...]) -> None:
        """Choose starts that the assumptions allow. Raises KoordError if none are found. [INIT]"""
        settled_start(DOUBLES, self.system, self.inputs, order)

    def settle_readings(self, configuration: Configuration[Constant]) -> None:
        """Choose readings that the contracts allow. Raises KoordError if there are none."""
        settle_readings(DOUBLES, self.system, configuration, self.inputs)

    # --- what programs ask ------------------------------------------------------------------------

    def start(self, robot: int | None, name: str) -> Any:
        kind = None if robot is None else self.system.kinds[robot]
        return to_plain(self.inputs.start(self._starts[kind, name], robot))

    def read(self, robot: Robot) -> Mapping[str, Any]:
        kind = self.system.kinds[robot.pid]
        agent = self.system.program.agents[kind]
        return {
            self.names.attribute(port.declaration.variable, kind): to_plain(
                self.inputs.sensor(robot.pid, port)
            )
            for module in agent.modules
            if module.environment is None
            for port in (agent.ports[position] for position in module.ports)
            if port.direction is Direction.SENSOR
        }

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        external = self.system.program.external(function)
        given = tuple(
            to_value(argument, parameter.type)
            for argument, parameter in zip(arguments, external.parameters, strict=True)
        )
        # Asked as the rules ask: what the summary mentions belongs to the recording, too.
        oracle = self.inputs.oracle(_PHASES[turn], robot)
        site, *trail = key
        m = machine(DOUBLES, self.system, oracle, robot=robot)
        m.memory.bound = [held(DOUBLES, value) for value in given]
        m.trail = trail
        reads = tuple(core.Read(core.Place(p)) for p in external.parameters)
        return to_plain(evaluate(m, core.ExternalCall(function, reads, external.result.type, site)))

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        oracle = self.inputs.oracle(_PHASES[turn], robot)
        type_ = FLOAT if isinstance(low, float) else INT
        return oracle.choose(key, low, high, type_)


def starting(
    program: core.Program, names: Names
) -> Iterator[tuple[tuple[int | None, str], core.Declaration]]:
    """The declarations that may start arbitrary, by kind and attribute."""
    for entry in program.allwrite:
        yield (None, names.attribute(entry.variable, None)), entry
    for kind, agent in enumerate(program.agents):
        ports = (port.declaration for port in agent.ports)
        for entry in (*agent.locals, *ports, *program.allread):
            yield (kind, names.attribute(entry.variable, kind)), entry
