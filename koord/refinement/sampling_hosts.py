"""Hosts with random answers that satisfy assumptions, contracts and summaries."""

from __future__ import annotations

from collections.abc import Mapping
from random import Random
from typing import Any

from koord.refinement.translation import PHASES, Translation, to_plain
from koord.runtime.compile.naming import PythonNames
from koord.runtime.deploy.member import Untimed
from koord.runtime.motion.world import Point
from koord.runtime.proposals import rotating
from koord.runtime.robot import Key, Robot, Turn
from koord.sampling.initial_state_search import settle_readings, settle_robot, settled_start
from koord.sampling.sampled_inputs import Question, SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.configurations import Configuration
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.expressions import evaluate
from koord.semantics.recordings import Concrete
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.syntax import core
from koord.syntax.core import ExternalKind
from koord.syntax.system import System
from koord.syntax.types import FLOAT, INT, Type
from koord.traces.trace import Numbers


class SampledHost:
    """The host of a whole fleet; its answers are found, and recorded, with the reference.

    Which answers are asked for, and with which arguments, is up to the program that runs.
    """

    def __init__(self, translation: Translation, inputs: SampledInputs) -> None:
        self.system = translation.system
        self.translation = translation
        self.inputs = inputs

    def settle_start(self, order: tuple[int, ...]) -> None:
        """Find starts that the assumptions allow. Raises KoordError if none are found. [INIT]"""
        settled_start(DOUBLES, self.system, self.inputs, order)

    def settle_readings(self, configuration: Configuration[Constant]) -> None:
        """Find readings that the contracts allow. Raises KoordError if there are none."""
        settle_readings(DOUBLES, self.system, configuration, self.inputs)

    # --- what programs ask ------------------------------------------------------------------------

    def start(self, robot: int | None, name: str) -> Any:
        return to_plain(self.inputs.start(self.translation.declaration(robot, name), robot))

    def read(self, robot: Robot) -> Mapping[str, Any]:
        ports = self.translation.ports(robot.pid)
        sensor = self.inputs.sensor
        return {name: to_plain(sensor(robot.pid, ports[name])) for name in robot.SENSORS}

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        external, given = self.translation.question(function, arguments)
        # Asked as the rules ask: what the summary mentions belongs to the recording, too.
        oracle = self.inputs.oracle(PHASES[turn], robot)
        site, *trail = key
        m = machine(DOUBLES, self.system, oracle, robot=robot)
        m.memory.bound = [held(DOUBLES, value) for value in given]
        m.trail = trail
        reads = tuple(core.Read(core.Place(p)) for p in external.parameters)
        return to_plain(evaluate(m, core.ExternalCall(function, reads, external.result.type, site)))

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        oracle = self.inputs.oracle(PHASES[turn], robot)
        return oracle.choose(key, low, high, FLOAT if isinstance(low, float) else INT)


# --- robots in processes of their own -------------------------------------------------------------


def settled_starts(
    system: System, names: PythonNames, seed: int
) -> dict[tuple[int | None, str], Any]:
    """Starts that meet the assumptions, by robot and attribute. Raises KoordError without any.

    Nothing, if there is nothing to meet: then robots begin as their hosts have it. [PROP-ASSUME]
    """
    if not system.program.assumptions:
        return {}
    inputs = SampledInputs(Sampler(system, Numbers.DOUBLE, Random(seed)))
    settled_start(DOUBLES, system, inputs, rotating(0, system.robots))
    attribute = Translation(system, names).attribute
    starts = inputs.recorded_starts()
    return {(start.robot, attribute(start)): to_plain(start.value) for start in starts}


class _ByQuestion(SampledInputs):
    """Answers determined by the seed and the query, so that all processes agree."""

    seed: str = ""

    def around(self, robot: int | None, type_: Type) -> list[Concrete]:
        """Values that the robot holds; none where the answer has to be equal for all robots."""
        return [] if robot is None else super().around(robot, type_)

    def ask(
        self,
        function: core.External,
        arguments: tuple[Concrete, ...],
        robot: int | None,
        pending: dict[Question, Concrete],
    ) -> Concrete:
        if function.kind is not ExternalKind.FUNCTION:
            return super().ask(function, arguments, robot, pending)
        before = self.sampler.rng
        self.sampler.rng = Random(f"{self.seed} {function.name} {arguments}")
        try:
            return super().ask(function, arguments, None, pending)
        finally:
            self.sampler.rng = before


class SeededHost(Untimed):
    """The host of one robot among several processes, determined by a seed.

    What all robots have to see alike (starts of shared variables, mathematical functions) hangs on
    nothing else. Contracts are kept; who looks after assumptions passes ``starts``.
    """

    def __init__(self, system: System, names: PythonNames, seed: str, pid: int) -> None:
        self.position: Point = (0.0, 0.0, 0.0)
        self.holding = False
        self._system = system
        self._translation = Translation(system, names)
        self._seed, self._pid = seed, pid
        self._own = Random(f"{seed} {pid}")
        sampler = Sampler(system, Numbers.DOUBLE, self._own)
        self._inputs = _ByQuestion(sampler, seed=seed)

    def reseed(self, seed: str) -> None:
        """Let readings and answers to come hang on another seed.

        Mathematical functions stay as they are: they are the same all through a run.
        """
        self._own = self._inputs.sampler.rng = Random(f"{seed} {self._pid}")

    def start(self, robot: int | None, name: str) -> Any:
        declaration = self._translation.declaration(robot, name)
        sampler = self._inputs.sampler
        sampler.rng = Random(f"{self._seed} {robot} {name}")
        type_ = declaration.variable.own_type
        value = sampler.value(type_, (), declaration.length)
        sampler.rng = self._own
        return to_plain(value)

    def read(self, robot: Robot) -> Mapping[str, Any]:
        pid, system, inputs = robot.pid, self._system, self._inputs
        state = self._translation.robot(robot)
        # Contracts are about the robot itself: the others may be anyone.
        seen = Configuration((state,) * system.robots, state.copy, 0)
        inputs.forget_round()
        inputs.look_at(seen)
        settle_robot(DOUBLES, system, seen, pid, inputs)
        ports = self._translation.ports(pid)
        return {name: to_plain(inputs.sensor(pid, ports[name])) for name in robot.SENSORS}

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        return to_plain(self.answer(*self._translation.question(function, arguments), robot))

    def answer(
        self, function: core.External, arguments: tuple[Concrete, ...], robot: int | None
    ) -> Concrete:
        """The answer of any robot's host with this seed. Raises KoordError."""
        return self._inputs.ask(function, arguments, robot, {})

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        type_ = FLOAT if isinstance(low, float) else INT
        return self._inputs.sampler.between(low, high, type_)
