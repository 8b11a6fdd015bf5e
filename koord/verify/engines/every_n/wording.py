"""Found invariants as Koord: the expressions that candidates are made of, as text."""

from __future__ import annotations

from fractions import Fraction

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.types import EnumType

_OPERATORS = {
    BinaryOp.ADD: "+",
    BinaryOp.SUB: "-",
    BinaryOp.MUL: "*",
    BinaryOp.DIV: "/",
    BinaryOp.MOD: "%",
    BinaryOp.EQ: "==",
    BinaryOp.NE: "!=",
    BinaryOp.LT: "<",
    BinaryOp.LE: "<=",
    BinaryOp.AND: "and",
    BinaryOp.OR: "or",
    BinaryOp.IMPLIES: "implies",
}

#: How tightly operators bind; an operand that binds less tightly stands in brackets.
_TIGHTNESS = {
    BinaryOp.IMPLIES: 1,
    BinaryOp.OR: 2,
    BinaryOp.AND: 3,
    BinaryOp.EQ: 5,
    BinaryOp.NE: 5,
    BinaryOp.LT: 5,
    BinaryOp.LE: 5,
    BinaryOp.ADD: 6,
    BinaryOp.SUB: 6,
    BinaryOp.MUL: 7,
    BinaryOp.DIV: 7,
    BinaryOp.MOD: 7,
}


class NoWordsError(Exception):
    """An expression that candidates are not made of."""


def worded(e: core.Expr) -> str:
    """An expression of a property as Koord. Raises NoWordsError for what candidates never are."""
    text, _ = _worded(e)
    return text


def number_worded(value: Fraction) -> str:
    """A number as Koord has it."""
    return _number(value)[0]


def _worded(e: core.Expr) -> tuple[str, int]:
    match e:
        case core.Const():
            return _constant(e)
        case core.Read(place=place):
            return _place(place), 9
        case core.NumAgents():
            return "numAgents", 9
        case core.Delta():
            return "delta", 9
        case core.Unary(op=UnaryOp.WIDEN, operand=operand):
            return _worded(operand)
        case core.Unary(op=UnaryOp.NOT, operand=operand):
            return f"not {_within(operand, 4)}", 4
        case core.Unary(op=UnaryOp.NEG, operand=operand):
            return f"-{_within(operand, 8)}", 8
        case core.Unary(op=UnaryOp.ABS, operand=operand):
            return f"abs({worded(operand)})", 9
        case core.Binary(op=BinaryOp.MIN | BinaryOp.MAX as op, left=left, right=right):
            return f"{op.value}({worded(left)}, {worded(right)})", 9
        case core.Binary(op=op, left=left, right=right):
            tight = _TIGHTNESS[op]
            first = tight if op in (BinaryOp.ADD, BinaryOp.AND, BinaryOp.OR) else tight + 1
            first = tight if op is BinaryOp.SUB else first
            return f"{_within(left, first)} {_OPERATORS[op]} {_within(right, tight + 1)}", tight
        case core.Stopped(robot=robot):
            return f"stopped@{worded(robot)}", 9
        case core.Quantified(
            quantifier=core.QuantifierKind.FORALL, domain=core.RobotRange(agent=None)
        ):
            return _quantified(e), 0
    raise NoWordsError


def _quantified(e: core.Quantified) -> str:
    names = [e.variable.name]
    body: core.Expr = e.body
    while isinstance(body, core.Quantified):
        names.append(body.variable.name)
        body = body.body
    return f"forall {', '.join(names)}: {worded(body)}"


def _within(e: core.Expr, tight: int) -> str:
    text, its = _worded(e)
    return text if its >= tight else f"({text})"


def _constant(e: core.Const) -> tuple[str, int]:
    match e.type:
        case EnumType(members=members):
            assert isinstance(e.value, int)
            return members[e.value], 9
        case _ if isinstance(e.value, bool):
            return ("true" if e.value else "false"), 9
        case _ if isinstance(e.value, str):
            raise NoWordsError
        case _:
            return _number(Fraction(e.value))


def _number(value: Fraction) -> tuple[str, int]:
    """A number as a decimal, if it is one, or as a quotient."""
    if value < 0:
        text, tight = _number(-value)
        return f"-{text}" if tight == 9 else f"-({text})", 8
    if value.denominator == 1:
        return str(value.numerator), 9
    for places in range(1, 7):
        scaled = value * 10**places
        if scaled.denominator == 1:
            return f"{int(scaled) / 10**places:.{places}f}", 9
    return f"{value.numerator}.0 / {value.denominator}", 7


def _place(place: core.Place) -> str:
    variable = place.variable
    if variable.home is Home.BOUND:
        if place.steps:
            raise NoWordsError
        return variable.name
    text = variable.name
    if place.robot is not None:
        text += f"@{worded(place.robot)}" if _is_name(place.robot) else f"@({worded(place.robot)})"
    for step in place.steps:
        match step:
            case core.IndexStep(index=index):
                text += f"[{worded(index)}]"
            case core.FieldStep(name=name):
                text += f".{name}"
            case _:
                raise NoWordsError
    return text


def _is_name(e: core.Expr) -> bool:
    return isinstance(e, core.Read) and e.place.variable.home is Home.BOUND
