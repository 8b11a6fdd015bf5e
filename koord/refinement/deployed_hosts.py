"""Hosts of deployed robots whose run is to be judged. [RECORDING]"""

from __future__ import annotations

from collections.abc import Mapping
from random import Random
from typing import Any

from koord.refinement.sampling_host import starting
from koord.refinement.value_translation import Observer, to_plain, to_value
from koord.runtime.compile.naming import Names
from koord.runtime.deciding import rotating
from koord.runtime.motion.world import Point
from koord.runtime.robot import Key, Robot, Turn
from koord.sampling.initial_state_search import settle_robot, settled_start
from koord.sampling.sampled_inputs import Question, SampledInputs
from koord.sampling.values import Sampler
from koord.semantics.configurations import Configuration
from koord.semantics.domain import DOUBLES
from koord.semantics.recordings import Concrete
from koord.syntax import core
from koord.syntax.core import ExternalKind, Home
from koord.syntax.system import System
from koord.syntax.types import FLOAT, INT, ArrayType, Type
from koord.traces.trace import Numbers


def settled_starts(system: System, names: Names, seed: int) -> dict[tuple[int | None, str], Any]:
    """Starts that meet the assumptions, by robot and attribute. Raises KoordError without any.

    Nothing, if there is nothing to meet: then robots begin as their hosts have it. [PROP-ASSUME]
    """
    if not system.program.assumptions:
        return {}
    inputs = SampledInputs(Sampler(system, Numbers.DOUBLE, Random(seed)))
    settled_start(DOUBLES, system, inputs, rotating(0, system.robots))
    attributes = {
        (kind, entry.variable.home, entry.variable.slot): name
        for (kind, name), entry in starting(system.program, names)
    }
    found = {}
    for start in inputs.recorded_starts():
        kind = None if start.robot is None else system.kinds[start.robot]
        name = attributes[kind, start.home, start.slot]
        found[start.robot, name] = to_plain(start.value)
    return found


class _ByQuestion(SampledInputs):
    """Answers that hang on the seed and the question alone, so that all processes agree."""

    seed: str = ""

    def around(self, robot: int | None, type_: Type) -> list[Concrete]:
        """What the robot holds; what everybody has to answer alike hangs on nobody."""
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


class SeededHost:
    """The host of one robot among several processes: all that it says hangs on a seed.

    What all robots have to see alike (starts of shared variables, mathematical functions) hangs on
    nothing else. Contracts are kept; who looks after assumptions passes ``starts``.
    """

    def __init__(self, system: System, names: Names, seed: str, pid: int) -> None:
        self.position: Point = (0.0, 0.0, 0.0)
        self.holding = False
        self._system = system
        self._names = names
        self._seed = seed
        self._starts = dict(starting(system.program, names))
        self._observer = Observer(system, names)
        self._own = Random(f"{seed} {pid}")
        sampler = Sampler(system, Numbers.DOUBLE, self._own)
        self._inputs = _ByQuestion(sampler, seed=seed)

    def start(self, robot: int | None, name: str) -> Any:
        kind = None if robot is None else self._system.kinds[robot]
        declaration = self._starts[kind, name]
        type_ = declaration.variable.type
        if declaration.variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        sampler = self._inputs.sampler
        sampler.rng = Random(f"{self._seed} {robot} {name}")
        value = sampler.value(type_, (), declaration.length)
        sampler.rng = self._own
        return to_plain(value)

    def read(self, robot: Robot) -> Mapping[str, Any]:
        pid, system, inputs = robot.pid, self._system, self._inputs
        state = self._observer.robot(robot)
        # Contracts are about the robot itself: the others may be anyone.
        seen = Configuration((state,) * system.robots, state.copy, 0)
        inputs.forget_round()
        inputs.look_at(seen)
        settle_robot(DOUBLES, system, seen, pid, inputs)
        ports = (port for port in system.agent(pid).ports)
        named = {self._names.attribute(p.declaration.variable, state.kind): p for p in ports}
        return {name: to_plain(inputs.sensor(pid, named[name])) for name in robot.SENSORS}

    def ask(
        self, turn: Turn, robot: int, key: Key, function: str, arguments: tuple[Any, ...]
    ) -> Any:
        external = self._system.program.external(function)
        pairs = zip(arguments, external.parameters, strict=True)
        given = tuple(to_value(argument, parameter.type) for argument, parameter in pairs)
        return to_plain(self.answer(external, given, robot))

    def answer(
        self, function: core.External, arguments: tuple[Concrete, ...], robot: int | None
    ) -> Concrete:
        """What any robot's host of this seed answers. Raises KoordError."""
        return self._inputs.ask(function, arguments, robot, {})

    def choose(self, turn: Turn, robot: int, key: Key, low: Any, high: Any) -> Any:
        type_ = FLOAT if isinstance(low, float) else INT
        return self._inputs.sampler.between(low, high, type_)
