"""Open answers: what is known of a statement whatever external functions answer. [EXTERNAL]

Scalars are constants or open, as in Kleene's three-valued logic: a conjunction with something false
is false, also where the other side is open. So what comes out as false is false by all answers.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any, TypeAlias

from msgspec import Struct

from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.oracle import Inputs, Key, Oracle, Phase
from koord.semantics.recordings import Concrete
from koord.semantics.values import Rec, Seq, Table, Value, default, map_atoms
from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import GrowingType, MapType, Type


class Open(Enum):
    """What nobody knows."""

    OPEN = "open"


#: A constant, or what nobody knows.
Partial: TypeAlias = Constant | Open


class CannotTellError(Exception):
    """Raised where a value is open whose size hangs on the answer."""


class Partials:
    """The domain of doubles some of which are open."""

    def const(self, value: Constant, type_: Type) -> Partial:
        return DOUBLES.const(value, type_)

    def known(self, value: Partial) -> Constant | None:
        return None if isinstance(value, Open) else value

    def unary(self, op: UnaryOp, operand: Partial) -> Partial:
        return operand if isinstance(operand, Open) else DOUBLES.unary(op, operand)

    def binary(self, op: BinaryOp, left: Partial, right: Partial) -> Partial:
        match op:
            case BinaryOp.AND if left is False or right is False:
                return False
            case BinaryOp.OR if left is True or right is True:
                return True
            case BinaryOp.IMPLIES if left is False or right is True:
                return True
        if isinstance(left, Open) or isinstance(right, Open):
            return Open.OPEN
        return DOUBLES.binary(op, left, right)

    def ite(self, condition: Partial, then: Partial, other: Partial) -> Partial:
        if isinstance(condition, Open):
            return then if then is other else Open.OPEN
        return then if condition else other


PARTIALS = Partials()

#: The value of a function of some arguments where it is known: asked under a key, in a turn.
Known: TypeAlias = Callable[
    [Phase, int, Key, core.External, "tuple[Concrete, ...]"], "Concrete | None"
]


class OpenInputs(Struct, frozen=True):
    """Inputs of which some answers are known, and all others open. ``others`` has the starts."""

    others: Inputs[Any]
    robots: int
    known: Known

    def start(self, declaration: core.Declaration, robot: int | None) -> Value[Partial]:
        return self.others.start(declaration, robot)

    def sensor(self, robot: int, port: core.Port) -> Value[Partial]:
        return self.others.sensor(robot, port)

    def oracle(self, phase: Phase, robot: int) -> Oracle[Partial]:
        return _OpenOracle(self, phase, robot)


class _OpenOracle(Struct, frozen=True):
    inputs: OpenInputs
    phase: Phase
    robot: int

    def choose(self, key: Key, low: Partial, high: Partial, type_: Type) -> Partial:
        return Open.OPEN

    def external(
        self, function: core.External, key: Key, arguments: tuple[Value[Partial], ...]
    ) -> Value[Partial]:
        if not any(map(_is_open, arguments)):
            given: tuple[Any, ...] = arguments
            known: Value[Any] | None = self.inputs.known(
                self.phase, self.robot, key, function, given
            )
            if known is not None:
                return known
        type_ = function.result.type
        if _grows(type_):
            raise CannotTellError
        some = default(PARTIALS, type_, self.inputs.robots)
        return map_atoms(some, lambda atom: Open.OPEN)

    def every(self, type_: Type, body: Callable[[Value[Partial]], Partial]) -> Partial:
        return True  # taken on trust, as replay does

    def vouches_for(self, function: core.External) -> bool:
        return False


def _is_open(value: Value[Partial]) -> bool:
    """Return whether anything in a value is open."""
    match value:
        case Rec(fields=parts):
            return any(map(_is_open, parts))
        case Seq(items=items):
            return any(map(_is_open, items))
        case Table(entries=entries):
            return any(_is_open(part) for entry in entries for part in entry)
        case _:
            return isinstance(value, Open)


def _grows(type_: Type) -> bool:
    """Return whether there are values of a type of different sizes."""
    return isinstance(type_, GrowingType | MapType) or any(map(_grows, type_.parts))
