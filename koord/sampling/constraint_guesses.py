"""Guesses of values that would make a statement true, as for ``psn.x == 2 * i``.

Only a guide for a search by trying: every guess is checked by evaluating the statement.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import TypeGuard, TypeVar

from msgspec import Struct

from koord.semantics.domain import Constant
from koord.semantics.expressions import evaluate, statement
from koord.semantics.machine import Machine
from koord.semantics.quantifiers import instances
from koord.semantics.recordings import Concrete
from koord.semantics.storage import held
from koord.semantics.values import Rec, Seq, Table
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, QuantifierKind, UnaryOp, slot_in
from koord.syntax.types import FLOAT, INT, SequenceType
from koord.syntax.walk import rebuilt

#: How far apart the sides of an order may be put.
_MARGINS = (Fraction(0), Fraction(1), Fraction(1, 10))

#: Lists are not made longer than this to meet a statement about their lengths.
_LONGEST = 1000

T = TypeVar("T")


class AnswerGuess(Struct, frozen=True):
    """A new answer of an external function to these arguments."""

    function: str
    arguments: tuple[Concrete, ...]
    value: Concrete


class Repair(Struct, frozen=True):
    """A part of a variable, and a new value for it. ``path`` are positions of fields and elements.

    The answer of an external function is a bound variable in its summary, of no robot.
    """

    home: Home
    slot: int
    robot: int | None
    path: tuple[int, ...]
    value: Concrete


def repairs(m: Machine[Constant], e: core.Expr) -> Iterator[Repair]:
    """Yield changes of variables that may make a statement hold that does not."""
    return (found for found in guesses(m, e) if isinstance(found, Repair))


def guesses(m: Machine[Constant], e: core.Expr) -> Iterator[Repair | AnswerGuess]:
    """As :func:`repairs`, and also other answers of external functions."""
    match e:
        # Where all of it holds each part does, and is asked anyway.
        case core.Binary(op=BinaryOp.AND, left=left, right=right):
            yield from guesses(m, left)
            yield from guesses(m, right)
            return
        case core.Quantified(quantifier=QuantifierKind.FORALL) if not isinstance(
            e.domain, core.AllValues
        ):
            for label, here, value in list(instances(m, e)):
                if here:
                    m.memory.bound[e.variable.slot] = held(m.d, value)
                    m.trail.append(label)
                    yield from guesses(m, _of_element(e, label))
                    m.trail.pop()
            return
        case _:
            pass
    if statement(m, e):
        return
    match e:
        case core.Binary(op=BinaryOp.OR, left=left, right=right):
            yield from guesses(m, left)
            yield from guesses(m, right)
        case core.Binary(op=BinaryOp.IMPLIES, right=right):
            yield from guesses(m, right)
        case core.Binary(op=BinaryOp.EQ, left=left, right=right):
            yield from _solved(m, left, evaluate(m, right))
            yield from _solved(m, right, evaluate(m, left))
        case core.Binary(op=BinaryOp.LT | BinaryOp.LE, left=left, right=right):
            for margin in _MARGINS:
                yield from _solved(m, left, _moved(evaluate(m, right), -margin))
                yield from _solved(m, right, _moved(evaluate(m, left), margin))
        case core.Unary(op=UnaryOp.NOT, operand=operand):
            yield from _solved(m, operand, False)
        case core.Call():
            inlined = _inlined(m, e)
            if inlined is not None:
                yield from guesses(m, inlined)
        case core.Read():
            yield from _solved(m, e, True)
        case _:
            pass


def _of_element(e: core.Quantified, label: int) -> core.Expr:
    """The body of a quantifier over a variable's elements, in terms of the element itself."""
    match e.domain:
        case core.Elements(sequence=core.Read(place=core.Place(type=type_) as place)) if isinstance(
            type_, SequenceType
        ):
            step = core.IndexStep(core.Const(label, INT), type_.element)
            element = core.Read(place.part(step))
            return _substituted(e.body, {e.variable.slot: element})
        case _:
            return e.body


def _moved(value: Concrete, by: Fraction) -> Concrete:
    """Move a number by some distance; an int by a whole one."""
    match value:
        case bool() | str() | Rec() | Seq():
            return value
        case int():
            return value + int(by)
        case float():
            return value + float(by)
        case Fraction():
            return value + by
        case _:
            return value


def _solved(m: Machine[Constant], e: core.Expr, value: Concrete) -> Iterator[Repair | AnswerGuess]:
    """Yield changes of variables under which an expression has a given value."""
    match e:
        case core.Read(place=place):
            yield from _targets(m, place, value)
        case core.ExternalCall():
            yield AnswerGuess(e.function, tuple(evaluate(m, a) for a in e.arguments), value)
        case core.MakeRecord(fields=parts):
            if isinstance(value, Rec):
                for part, its in zip(parts, value.fields, strict=True):
                    yield from _solved(m, part, its)
        case core.Unary(op=UnaryOp.WIDEN, operand=operand):
            if isinstance(value, int | Fraction) and value == int(value):
                yield from _solved(m, operand, int(value))
        case core.Unary(op=UnaryOp.NEG, operand=operand):
            yield from _solved(m, operand, _computed(m, e, BinaryOp.SUB, _zero(m, e), value))
        case core.Unary(op=UnaryOp.ABS, operand=operand):
            yield from _solved(m, operand, value)
        case core.Builtin(op=core.ListOp.LENGTH, arguments=(operand,)):
            old = evaluate(m, operand)
            if isinstance(old, Seq) and isinstance(value, int) and 0 <= value <= _LONGEST:
                # What a list grows by is like its last element; to an empty one nothing is alike.
                items = (*old.items[:value], *old.items[-1:] * (value - len(old.items)))
                yield from _solved(m, operand, Seq(len(items), items))
        case core.Binary(op=BinaryOp.ADD, left=left, right=right):
            yield from _solved(m, left, _computed(m, e, BinaryOp.SUB, value, evaluate(m, right)))
            yield from _solved(m, right, _computed(m, e, BinaryOp.SUB, value, evaluate(m, left)))
        case core.Binary(op=BinaryOp.SUB, left=left, right=right):
            yield from _solved(m, left, _computed(m, e, BinaryOp.ADD, value, evaluate(m, right)))
            yield from _solved(m, right, _computed(m, e, BinaryOp.SUB, evaluate(m, left), value))
        case core.Binary(op=BinaryOp.MUL, left=left, right=right) if e.type == FLOAT:
            yield from _solved(m, left, _computed(m, e, BinaryOp.DIV, value, evaluate(m, right)))
            yield from _solved(m, right, _computed(m, e, BinaryOp.DIV, value, evaluate(m, left)))
        case core.Call():
            inlined = _inlined(m, e)
            if inlined is not None:
                yield from _solved(m, inlined, value)
        case _:
            pass


def _zero(m: Machine[Constant], e: core.Expr) -> Constant:
    return m.d.const(0, e.type)


def _computed(
    m: Machine[Constant], e: core.Expr, op: BinaryOp, left: Concrete, right: Concrete
) -> Concrete:
    if e.type not in (INT, FLOAT) or not _is_scalar(left) or not _is_scalar(right):
        return left
    return m.d.binary(op, left, right)


def _is_scalar(value: Concrete) -> TypeGuard[Constant]:
    return not isinstance(value, Rec | Seq | Table)


def _targets(m: Machine[Constant], place: core.Place, value: Concrete) -> Iterator[Repair]:
    """Yield the change of the variable that a place lies in, if that may be chosen."""
    variable, steps = place.variable, list(place.steps)
    slot: int | None = variable.slot
    robot: int | None = None
    if variable.home is Home.BOUND:
        pass
    elif m.view is None:
        if not place.primed:
            return
        robot = m.robot
    else:
        match variable.home:
            case Home.LOCAL | Home.PORT:
                assert place.robot is not None
                robot = _index(m, place.robot, len(m.view.robots))
                slot = None if robot is None else slot_in(m.system.agent(robot), variable)
            case Home.ALLREAD:
                first = steps.pop(0) if steps else None
                if not isinstance(first, core.IndexStep):
                    return
                robot = _index(m, first.index, len(m.view.robots))
            case Home.ALLWRITE:
                pass
    if slot is None:
        return
    if robot is None and variable.home not in (Home.ALLWRITE, Home.BOUND):
        return
    path = []
    for step in steps:
        match step:
            case core.FieldStep(position=position):
                path.append(position)
            case core.IndexStep(index=index):
                at = _index(m, index, None)
                if at is None:
                    return
                path.append(at)
            case core.KeyStep():
                return
    yield Repair(variable.home, slot, robot, tuple(path), value)


def _index(m: Machine[Constant], e: core.Expr, below: int | None) -> int | None:
    value = evaluate(m, e)
    if isinstance(value, bool) or not isinstance(value, int):
        return None
    return value if value >= 0 and (below is None or value < below) else None


def placed(value: Concrete, path: tuple[int, ...], part: Concrete) -> Concrete:
    """The value with a part replaced; unchanged where it has no such part."""
    if not path:
        return part
    first, rest = path[0], path[1:]
    match value:
        case Rec(fields=items) if first < len(items):
            return Rec((*items[:first], placed(items[first], rest, part), *items[first + 1 :]))
        case Seq(length=length, items=items) if first < len(items):
            changed = (*items[:first], placed(items[first], rest, part), *items[first + 1 :])
            return Seq(length, changed)
        case _:
            return value


# --- functions of one expression ----------------------------------------------------------------


def _inlined(m: Machine[Constant], e: core.Call) -> core.Expr | None:
    """Inline a call of a function whose body is one expression."""
    function = m.system.program.function(e.function)
    match function.body:
        case (core.Return(value=body),) if body is not None:
            arguments = dict(enumerate(e.arguments))
            return _substituted(body, arguments)
        case _:
            return None


def _substituted(node: T, arguments: dict[int, core.Expr]) -> T:
    """Substitute the parameters in a part of a function's body."""
    if isinstance(node, core.Read) and node.place.variable.home is Home.BOUND:
        found = arguments.get(node.place.variable.slot)
        return node if found is None else _reached(found, node.place.steps)  # type: ignore[return-value]
    if isinstance(node, core.Variable):
        return node
    changed: T = rebuilt(node, lambda part: _substituted(part, arguments))
    return changed


def _reached(base: core.Expr, steps: tuple[core.Step, ...]) -> core.Expr:
    if isinstance(base, core.Read):
        return core.Read(base.place.part(*steps))
    for step in steps:
        base = core.Select(base, step)
    return base
