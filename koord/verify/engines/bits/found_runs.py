"""Counterexamples from circuits: the model of each step, read as values of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast

from msgspec import Struct, field

from koord.semantics.domain import Constant
from koord.semantics.recordings import Recording
from koord.syntax.system import System
from koord.syntax.types import OpaqueType, StreamType, StringType, Type
from koord.verify.claims import ClaimPhase
from koord.verify.engines.bits.cells import as_constant
from koord.verify.engines.bits.circuit import Circuit
from koord.verify.engines.bits.domain import Bit, BitDomain, Bits
from koord.verify.engines.bits.numbers import Number
from koord.verify.engines.bits.opaque import EQUALS, Argument, Known, OpaqueChoice, Opaques
from koord.verify.engines.bits.unrolling import CircuitRun
from koord.verify.witness import ModelReader, opening_of, round_of


class Assignment(Struct):
    """An assignment to the inputs of a graph in one step. Missing ones are false."""

    d: BitDomain
    given: Mapping[int, bool]
    names: ValueNames
    part: int
    _values: list[bool] = field(default_factory=lambda: [False])

    def literal(self, literal: int) -> bool:
        """The value of a literal."""
        values, g = self._values, self.d.graph
        for node in range(len(values), len(g.left)):
            if g.is_input(node):
                values.append(self.given.get(node, False))
            else:
                a, b = g.left[node], g.right[node]
                values.append((values[a >> 1] ^ (a & 1)) & (values[b >> 1] ^ (b & 1)) == 1)
        return values[literal >> 1] ^ (literal & 1) == 1

    # --- what a reader asks of a model ----------------------------------------------------------

    def truth(self, condition: Bits) -> bool:
        return self.literal(condition.literal) if isinstance(condition, Bit) else bool(condition)

    def scalar(self, value: Bits, type_: Type) -> Constant:
        """The value of a scalar of a type: zero for a loose number, a name for an opaque value."""
        match value:
            case Bit():
                return self.truth(value)
            case OpaqueChoice():
                return self.name(value)
            case Number():
                found: Constant = self.number(value)
                if isinstance(type_, StringType | StreamType):
                    return self.d.text_of(int(found))
                return found
            case _:
                if isinstance(type_, OpaqueType):
                    return str(value)
                return value

    def number(self, value: Bits) -> Any:
        if not isinstance(value, Number):
            return value
        if self.literal(value.loose):
            return as_constant(0, value.scale)
        bits = [self.literal(x) for x in value.literals]
        whole = sum(1 << k for k, bit in enumerate(bits) if bit) - (bits[-1] << len(bits))
        return as_constant(whole, value.scale)

    def name(self, value: OpaqueChoice) -> str:
        """The name of an opaque value in the whole run."""
        for token, guard in value.parts:
            if self.literal(guard):
                return self.names.of(self, token)
        return f"{value.sort}!0"


class RelationValue(Struct, frozen=True):
    """The value of a relation between named values in a step of a run (0: INIT)."""

    relation: str
    names: tuple[str, ...]
    step: int
    literal: int  #: of the circuit
    holds: bool


class ValueNames(Struct):
    """Names of opaque values in a run: equal values share a name across steps."""

    opaques: Opaques
    standing: dict[int, str] = field(default_factory=dict)
    _fresh: dict[int, str] = field(default_factory=dict)
    _terms: dict[tuple[str, tuple[str, ...]], str] = field(default_factory=dict)
    _count: int = 0

    def next(self, standing: dict[int, str]) -> None:
        """Begin the next step, with these values in the variables."""
        self.standing = standing
        self._fresh = {}

    def of(self, step: Assignment, argument: Argument) -> str:
        """The name of a token in a step."""
        if isinstance(argument, Known):
            return str(argument.value)
        token = self.opaques.tokens[argument]
        if token.function and not token.arguments:
            return token.function
        if token.standing:
            return self.standing.get(argument, f"{token.sort}!0")
        if token.function:
            arguments = tuple(self.of(step, a) for a in token.arguments)
            key = (token.function, arguments)
            if key not in self._terms:
                self._terms[key] = self._equal(step, argument) or self._new(token.sort)
            return self._terms[key]
        if argument not in self._fresh:
            self._fresh[argument] = self._equal(step, argument) or self._new(token.sort)
        return self._fresh[argument]

    def _equal(self, step: Assignment, token: int) -> str | None:
        """The name of an older token that is equal in the step."""
        for (relation, arguments), same in self.opaques.atoms.get(step.part, {}).items():
            if relation == EQUALS and token in arguments and step.literal(same):
                other = arguments[0] if arguments[1] == token else arguments[1]
                if isinstance(other, int):
                    if self.opaques.tokens[other].standing:
                        return self.of(step, other)
                    if other in self._fresh:
                        return self._fresh[other]
        return None

    def _new(self, sort: str) -> str:
        self._count += 1
        return f"{sort}!val!{self._count}"


def recording(
    circuit: Circuit,
    system: System,
    run: CircuitRun,
    phase: ClaimPhase,
    seen: Callable[[dict[int, str]], None] = lambda standing: None,
    told: Callable[[RelationValue], None] | None = None,
) -> Recording:
    """Make the recording of a circuit's run, up to a phase of its last round.

    ``seen`` is told after INIT and after each round what opaque variables hold, by name, and
    ``told`` of all that is said of opaque values.
    """
    d = circuit.d
    names = ValueNames(d.opaques)
    first = Assignment(d, run.opening, names, 0)
    opening = opening_of(_reader(first, system), circuit.opening)
    if told is not None:
        _tell(first, 0, told)
    names.next({token: first.name(starts) for token, (starts, _) in circuit.tokens.items()})
    seen(names.standing)
    rounds = []
    for number, given in enumerate(run.rounds):
        step = Assignment(d, given, names, 1)
        last = number + 1 == len(run.rounds)
        d.opaques.part = 1
        rounds.append(round_of(_reader(step, system), circuit.round, phase if last else None))
        if told is not None:
            _tell(step, number + 1, told)
        names.next({token: step.name(then) for token, (_, then) in circuit.tokens.items()})
        seen(names.standing)
    return Recording(opening, tuple(rounds))


def _tell(step: Assignment, number: int, told: Callable[[RelationValue], None]) -> None:
    """Record the relations of opaque values in a step."""
    for (relation, arguments), x in list(step.d.opaques.atoms.get(step.part, {}).items()):
        if relation != EQUALS:
            names = tuple(step.names.of(step, argument) for argument in arguments)
            told(RelationValue(relation, names, number, x, step.literal(x)))


def _reader(step: Assignment, system: System) -> ModelReader:
    return ModelReader(cast(Any, step), system)
