"""Constant folding. An expression that would fault has no value."""

from __future__ import annotations

from fractions import Fraction

from koord.syntax import core

Scalar = int | Fraction | bool | str


def constant(expr: core.Expr) -> Scalar | None:
    """The value of a constant expression, or None if it is not constant."""
    match expr:
        case core.Const(value=value):
            return value
        case core.Unary(op=op, operand=operand):
            value_ = constant(operand)
            return None if value_ is None else _unary(op, value_)
        case core.Binary(op=op, left=left, right=right):
            return _binary(op, constant(left), constant(right))
        case core.Quantified(body=body):
            # a range may be empty, but robots are not
            value_ = constant(body)
            return value_ if isinstance(expr.domain, core.RobotRange) else None
        case _:
            return None


def folded(expr: core.Expr) -> core.Expr:
    """The expression, folded to a constant if its operands are constants."""
    value = constant(expr)
    if value is None or isinstance(expr, core.Const):
        return expr
    return core.Const(value, expr.type, span=expr.span)


def _unary(op: core.UnaryOp, value: Scalar) -> Scalar | None:
    if isinstance(value, bool):
        return not value if op is core.UnaryOp.NOT else None
    if isinstance(value, str):
        return None
    match op:
        case core.UnaryOp.NEG:
            return -value
        case core.UnaryOp.ABS:
            return value if value >= 0 else -value
        case core.UnaryOp.WIDEN:
            return Fraction(value)
        case core.UnaryOp.NOT:
            return None


def _binary(op: core.BinaryOp, left: Scalar | None, right: Scalar | None) -> Scalar | None:
    match op:
        case core.BinaryOp.AND:
            if left is False or (right is False and left is not None):
                return False
            return True if left is True and right is True else None
        case core.BinaryOp.OR:
            if left is True or (right is True and left is not None):
                return True
            return False if left is False and right is False else None
        case core.BinaryOp.IMPLIES:
            if left is False:
                return True
            return right if left is True else None
        case _:
            pass
    if left is None or right is None:
        return None
    if op is core.BinaryOp.EQ:
        return left == right
    if op is core.BinaryOp.NE:
        return left != right
    if isinstance(left, str) or isinstance(right, str):
        return None
    return _arithmetic(op, left, right)


def _arithmetic(
    op: core.BinaryOp, left: int | Fraction, right: int | Fraction
) -> int | Fraction | bool | None:
    match op:
        case core.BinaryOp.ADD:
            return left + right
        case core.BinaryOp.SUB:
            return left - right
        case core.BinaryOp.MUL:
            return left * right
        case core.BinaryOp.LT:
            return left < right
        case core.BinaryOp.LE:
            return left <= right
        case core.BinaryOp.MIN:
            return min(left, right)
        case core.BinaryOp.MAX:
            return max(left, right)
        case core.BinaryOp.DIV if right != 0:
            return left // right if isinstance(left, int) else left / right
        case core.BinaryOp.MOD if right != 0:
            return left % right
        case _:
            return None
