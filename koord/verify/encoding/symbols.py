"""Symbolic inputs: every input of a step becomes a fresh term, remembered for the witness.

What the semantics asks of its :class:`~koord.semantics.oracle.Inputs` is answered with constants
that a solver may choose; a model then says what they were, and :mod:`koord.verify.witness` writes
them down as a recording.
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct, field

from koord.semantics.expressions import statement
from koord.semantics.oracle import Key, Oracle, Phase
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import System
from koord.syntax.types import ArrayType, Type
from koord.verify.encoding.terms import Term
from koord.verify.encoding.unknowns import Symbolic, Unknowns


class SymbolicAnswer(Struct, frozen=True):
    """A fresh term for one recorded answer; see :class:`koord.semantics.recordings.Answer`."""

    phase: Phase
    robot: int
    key: Key
    function: str | None
    arguments: tuple[Symbolic, ...]
    value: Symbolic


class SymbolicOracle(Struct):
    """The oracle of one turn whose answers are fresh terms."""

    inputs: SymbolicInputs
    phase: Phase
    robot: int
    _quantified: int = 0  #: so many `forall` over types are being looked into

    def choose(self, key: Key, low: Term, high: Term, type_: Type) -> Term:
        noted = self.inputs.noted(self.phase, self.robot, key)
        if noted is not None:
            assert not isinstance(noted.value, Rec | Seq | Table)
            return noted.value
        value = self.inputs.unknowns.chosen(low, high, type_)
        self.inputs.note(SymbolicAnswer(self.phase, self.robot, key, None, (), value))
        return value

    def external(
        self, function: core.External, key: Key, arguments: tuple[Symbolic, ...]
    ) -> Symbolic:
        if self._quantified:
            # Not one answer, but as many as there are values: none of them is recorded.
            assert function.kind is core.ExternalKind.FUNCTION, "elaboration sees to it"
            return self.inputs.unknowns.function(function, arguments, function.name)
        noted = self.inputs.noted(self.phase, self.robot, key)
        if noted is not None:
            return noted.value
        if function.kind is core.ExternalKind.FUNCTION:
            value = self.inputs.unknowns.function(function, arguments, function.name)
        else:
            value = self.inputs.unknowns.value(function.name, function.result.type)
        name = function.name
        self.inputs.note(SymbolicAnswer(self.phase, self.robot, key, name, arguments, value))
        return value

    def every(self, type_: Type, body: Callable[[Symbolic], Term]) -> Term:
        self._quantified += 1
        holds = self.inputs.unknowns.every((type_,), lambda values: body(values[0]))
        self._quantified -= 1
        return holds

    def vouches_for(self, function: core.External) -> bool:
        return self.inputs.unknowns.vouches_for(function)


class _SummaryOracle(SymbolicOracle):
    """The oracle for summaries that are checked afterwards, as a replay checks them."""

    def every(self, type_: Type, body: Callable[[Symbolic], Term]) -> Term:
        return True


class SymbolicInputs(Struct):
    """The inputs of one step as fresh terms, in the order of the queries."""

    unknowns: Unknowns
    label: str
    starts: list[tuple[Home, int, int | None, Symbolic]] = field(default_factory=list)
    readings: list[tuple[int, int, Symbolic]] = field(default_factory=list)
    answers: dict[tuple[Phase, int, Key], SymbolicAnswer] = field(default_factory=dict)

    def answer_summaries(self, system: System) -> None:
        """Record the functions' answers that summaries rely on, where they were assumed so far.

        A replay checks every summary, so it needs those answers too. [EXTERNAL]
        """
        for answer in list(self.answers.values()):
            if answer.function is None:
                continue
            external = system.program.external(answer.function)
            if not self.unknowns.vouches_for(external):
                continue
            d = self.unknowns.d
            m = machine(d, system, _SummaryOracle(self, answer.phase, answer.robot))
            m.in_summary = True
            m.trail = [*answer.key[1:], answer.key[0]]
            known = [held(d, value) for value in (*answer.arguments, answer.value)]
            m.memory.bound = [*known, *[None] * (external.bound - len(known))]
            for promise in external.ensures:
                statement(m, promise)

    def noted(self, phase: Phase, robot: int, key: Key) -> SymbolicAnswer | None:
        """The answer already given for a key: a turn that is evaluated twice is one turn."""
        return self.answers.get((phase, robot, key))

    def note(self, answer: SymbolicAnswer) -> None:
        """Record an answer."""
        self.answers[answer.phase, answer.robot, answer.key] = answer

    def start(self, declaration: core.Declaration, robot: int | None) -> Symbolic:
        variable = declaration.variable
        type_ = variable.type
        if variable.home is Home.ALLREAD:
            assert isinstance(type_, ArrayType)
            type_ = type_.element
        name = variable.name if robot is None else f"{variable.name}@{robot}"
        value = self.unknowns.value(name, type_, declaration.length)
        self.starts.append((variable.home, variable.slot, robot, value))
        return value

    def sensor(self, robot: int, port: core.Port) -> Symbolic:
        variable = port.declaration.variable
        name = f"{port.module}.{variable.name}@{robot}#{self.label}"
        value = self.unknowns.value(name, variable.type)
        self.readings.append((robot, variable.slot, value))
        return value

    def oracle(self, phase: Phase, robot: int) -> Oracle[Term]:
        return SymbolicOracle(self, phase, robot)
