"""What the code of a turn asks: choices, external functions, sensors.

The same questions as the rules ask, under the same keys and in the same order. Where code is in
doubt behind them, the rules ask again, and hear the same answers.
"""

from __future__ import annotations

from typing import Any

from msgspec import Struct

from koord.sampling.compiled.operations import InDoubt
from koord.semantics.domain import Constant, Domain
from koord.semantics.expressions import external_call
from koord.semantics.oracle import Inputs, Key, Phase
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.types import Type


class Asking(Struct):
    """Who is asked in one turn of a robot."""

    d: Domain[Constant]
    system: System
    phase: Phase
    robot: int
    inputs: Inputs[Constant]

    def choose(self, key: Key, low: Any, high: Any, type_: Type) -> Any:
        """A value between the bounds. Out of them it is in doubt, as is an empty range. [CHOOSE]"""
        if not low <= high:
            raise InDoubt
        value: Any = self.inputs.oracle(self.phase, self.robot).choose(key, low, high, type_)
        if not low <= value <= high:
            raise InDoubt
        return value

    def external(self, e: core.ExternalCall, trail: tuple[int, ...], arguments: Any) -> Any:
        """The answer of an external function, by the rule; in doubt if it may not be. [EXTERNAL]"""
        oracle = self.inputs.oracle(self.phase, self.robot)
        m = machine(self.d, self.system, oracle, robot=self.robot)
        m.trail = list(trail)
        m.memory.bound = [held(self.d, value) for value in arguments]
        function = self.system.program.external(e.function)
        reads = tuple(core.Read(core.Place(p)) for p in function.parameters)
        answer = external_call(m, core.ExternalCall(e.function, reads, e.type, e.site, span=e.span))
        if m.faults or m.legality:
            raise InDoubt
        return answer

    def sensor(self, port: core.Port) -> Any:
        """What a sensor without a model reads. [ENV-FREE]"""
        return self.inputs.sensor(self.robot, port)
