"""Promises of summaries about every value of a type, checked on the values in a run.

A replay takes such promises on trust, for nobody can try all values. But a run that is to be shown
should not break them where one can look: the answers that it asks for say of each function what it
gives for some arguments, and that may already be what no function of that summary gives. (Summaries
say something of all values, and deny nothing of all: elaboration sees to it.) Other answers, which
a solver gave for branches that are not taken, break no promise. [EXTERNAL]
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from msgspec import Struct

from koord.sampling.values import values_within
from koord.semantics.domain import EXACT, Constant
from koord.semantics.expressions import statement
from koord.semantics.oracle import Key
from koord.semantics.recordings import Answer, Concrete
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.semantics.values import default
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.types import Type
from koord.verify.encoding.externals import quantifies

#: So many values are put into promises before a run is taken to keep them.
_MOST_TRIED = 20_000


class Unkept(Struct, frozen=True):
    """An answer that a promise of its function excludes."""

    function: str
    promise: core.Expr


def unkept(system: System, heard: Iterable[Answer]) -> Unkept | None:
    """A promise about every value of a type that a run's answers break, or None."""
    program = system.program
    speaking = {
        external.name: external for external in program.externals if quantifies(external.ensures)
    }
    if not speaking:
        return None
    answers = [answer for answer in heard if answer.function is not None]
    tried = _Tried(_mentioned(program, answers), _known(program, answers), system.robots)
    seen: set[tuple[str | None, tuple[Concrete, ...], Concrete]] = set()
    for answer in answers:
        external = speaking.get(answer.function or "")
        if external is None or (answer.function, answer.arguments, answer.value) in seen:
            continue
        seen.add((answer.function, answer.arguments, answer.value))
        for promise in external.ensures:
            if not tried.keeps(system, external, answer, promise):
                return Unkept(external.name, promise)
    return None


def _mentioned(program: core.Program, answers: Iterable[Answer]) -> dict[Type, list[Concrete]]:
    """The values in answers and their arguments, by type."""
    found: dict[Type, dict[Concrete, None]] = {}
    for answer in answers:
        external = program.external(answer.function or "")
        values = (*answer.arguments, answer.value)
        variables = (*external.parameters, external.result)
        for value, variable in zip(values, variables, strict=True):
            for type_, part in values_within(value, variable.type):
                found.setdefault(type_, {}).setdefault(part)
    return {type_: list(values) for type_, values in found.items()}


def _known(
    program: core.Program, answers: Iterable[Answer]
) -> dict[tuple[str, tuple[Concrete, ...]], Concrete]:
    """The known answers of mathematical functions, by function and arguments."""
    return {
        (answer.function, answer.arguments): answer.value
        for answer in answers
        if answer.function is not None
        and program.external(answer.function).kind is core.ExternalKind.FUNCTION
    }


class _Tried(Struct):
    """The oracle of a run's answers, which tries *every value* on those that the run mentions."""

    values: dict[Type, list[Concrete]]
    known: dict[tuple[str, tuple[Concrete, ...]], Concrete]
    robots: int
    unsure: bool = False  #: what was evaluated last asked for an answer that nobody knows
    left: int = _MOST_TRIED

    def keeps(
        self, system: System, external: core.External, answer: Answer, promise: core.Expr
    ) -> bool:
        """Return whether an answer is consistent with a promise."""
        m = machine(EXACT, system, self)
        m.in_summary = True
        bound = [held(EXACT, value) for value in (*answer.arguments, answer.value)]
        m.memory.bound = [*bound, *[None] * (external.bound - len(bound))]
        self.unsure = False
        met = all(statement(m, duty) is True for duty in external.requires)
        kept = not met or statement(m, promise) is True
        return kept or self.unsure

    def choose(self, key: Key, low: Constant, high: Constant, type_: Type) -> Constant:
        raise AssertionError("summaries do not choose")

    def external(
        self, function: core.External, key: Key, arguments: tuple[Concrete, ...]
    ) -> Concrete:
        answer = self.known.get((function.name, arguments))
        if answer is None:
            self.unsure = True
            return default(EXACT, function.result.type, self.robots)
        return answer

    def every(self, type_: Type, body: Callable[[Concrete], Constant]) -> Constant:
        outside, broken = self.unsure, False
        for value in self.values.get(type_, []):
            if self.left <= 0:
                break
            self.left -= 1
            self.unsure = False
            if body(value) is not True and not self.unsure:
                broken = True
                break
        self.unsure = outside
        return not broken

    def vouches_for(self, function: core.External) -> bool:
        return False
