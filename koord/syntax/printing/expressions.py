"""Printing of expressions and types, with the fewest parentheses that keep the tree."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import assert_never

from koord.syntax import ast
from koord.syntax.operators import BINDS, COMPARISON, IMPLIES, NEG, NOT, POSTFIX

_ESCAPES = str.maketrans({"\\": "\\\\", '"': '\\"', "\n": "\\n", "\t": "\\t"})


def print_expr(expression: ast.Expr) -> str:
    """Print an expression on one line, as a user writes it."""
    return print_within(expression, 0, last=True)


def print_base(expression: ast.Expr) -> str:
    """Print an expression with parentheses, unless it can take a suffix."""
    return print_within(expression, POSTFIX, last=False)


def print_type(type_: ast.TypeExpr) -> str:
    """Print a type, as a user writes it."""
    match type_:
        case ast.NamedType(name=name, arguments=()):
            return name
        case ast.NamedType(name=name, arguments=arguments):
            return f"{name}<{', '.join(map(print_type, arguments))}>"
        case ast.ArrayTypeExpr(element=element, size=size):
            return f"{print_type(element)}[{print_expr(size) if size else ''}]"
        case _:
            assert_never(type_)


def print_within(e: ast.Expr, binds: int, *, last: bool) -> str:
    """Print an expression, in parentheses if it binds less tightly than ``binds``.

    ``last`` tells that nothing follows that a quantifier at its end would swallow.
    """
    match e:
        case ast.Binary(op=op):
            own = BINDS[op]
            return _within(_binary(e, last=last or own < binds), own < binds)
        case ast.Unary(op=op, operand=operand):
            own = BINDS[op]
            needs = POSTFIX if op is ast.UnaryOp.NEG else NOT  # `--x` would be something else
            text = print_within(operand, needs, last=last or own < binds)
            return _within(f"-{text}" if op is ast.UnaryOp.NEG else f"not {text}", own < binds)
        case ast.Quantified(quantifier=quantifier, binders=binders, body=body):
            text = f"{print_binders(quantifier, binders)}{print_expr(body)}"
            return _within(text, not last or binds > NOT)
        case ast.IntLit(value=value):
            return _within(str(value), value < 0 and binds > NEG)
        case ast.FloatLit(value=value):
            return _within(_decimal(value), value < 0 and binds > NEG)
        case _:
            return _postfix(e)


def print_binders(quantifier: ast.Quantifier, binders: Sequence[ast.Binder]) -> str:
    """Print a quantifier up to its body."""
    return f"{quantifier.value} {', '.join(map(_binder, binders))}: "


def _within(text: str, parentheses: bool) -> str:
    return f"({text})" if parentheses else text


def _binary(e: ast.Binary, *, last: bool) -> str:
    """Print a chain of operators: by a loop along its long side, as chains may be long."""
    pieces: list[str] = []
    node: ast.Expr = e
    own = BINDS[e.op]
    if own == IMPLIES:
        while isinstance(node, ast.Binary) and node.op is ast.BinaryOp.IMPLIES:
            pieces.append(print_within(node.left, own + 1, last=False))
            node = node.right
        pieces.append(print_within(node, own, last=last))
        return " implies ".join(pieces)
    while isinstance(node, ast.Binary) and BINDS[node.op] == own:
        pieces.append(f" {node.op.value} {print_within(node.right, own + 1, last=last)}")
        last = False
        node = node.left
        if own == COMPARISON:
            break
    pieces.append(print_within(node, own + (own == COMPARISON), last=False))
    return "".join(reversed(pieces))


def _postfix(
    e: ast.BoolLit
    | ast.StringLit
    | ast.Name
    | ast.ListLit
    | ast.MapLit
    | ast.SetLit
    | ast.Call
    | ast.MethodCall
    | ast.Index
    | ast.Attribute
    | ast.AtRobot
    | ast.Prime,
) -> str:
    match e:
        case ast.BoolLit(value=value):
            return "true" if value else "false"
        case ast.StringLit(value=value):
            return f'"{value.translate(_ESCAPES)}"'
        case ast.Name(name=name):
            return name
        case ast.ListLit(items=items):
            return f"[{', '.join(map(print_expr, items))}]"
        case ast.SetLit(items=items):
            return f"{{{', '.join(map(print_expr, items))}}}"
        case ast.MapLit(entries=entries):
            pairs = (f"{print_expr(key)}: {print_expr(value)}" for key, value in entries)
            return f"{{{', '.join(pairs)}}}"
        case ast.Call(function=function, arguments=arguments):
            return f"{function.name}({_arguments(arguments)})"
        case ast.MethodCall(receiver=receiver, method=method, arguments=arguments):
            return f"{print_base(receiver)}.{method.name}({_arguments(arguments)})"
        case ast.Index(base=base, index=index):
            return f"{print_base(base)}[{print_expr(index)}]"
        case ast.Attribute(base=base, name=name):
            return f"{print_base(base)}.{name.name}"
        case ast.AtRobot(base=base, robot=robot):
            return f"{print_base(base)}@{_robot(robot)}"
        case ast.Prime(base=base):
            return f"{print_base(base)}'"
        case _:
            assert_never(e)


def _robot(e: ast.Expr) -> str:
    simple = isinstance(e, ast.Name) or (isinstance(e, ast.IntLit) and e.value >= 0)
    return _within(print_expr(e), not simple)


def _arguments(arguments: Sequence[ast.Argument]) -> str:
    return ", ".join(
        f"{argument.name} = {print_expr(argument.value)}"
        if argument.name is not None
        else print_expr(argument.value)
        for argument in arguments
    )


def _binder(binder: ast.Binder) -> str:
    names = ", ".join(name.name for name in binder.names)
    if binder.type:
        return f"{print_type(binder.type)} {names}"
    if binder.over:
        return f"{names} in {print_expr(binder.over)}"
    if binder.low and binder.high:
        return f"{names} in {print_expr(binder.low)}, {print_expr(binder.high)}"
    return names


def _decimal(value: Fraction) -> str:
    """Print a decimal that reads back to the value."""
    exponent = 0
    numerator, denominator = value.numerator, value.denominator
    while denominator % 10 == 0:
        denominator //= 10
        exponent -= 1
    while denominator % 2 == 0:
        denominator //= 2
        numerator *= 5
        exponent -= 1
    while denominator % 5 == 0:
        denominator //= 5
        numerator *= 2
        exponent -= 1
    if denominator != 1:
        return f"({value.numerator}.0 / {value.denominator}.0)"
    while numerator and numerator % 10 == 0:
        numerator //= 10
        exponent += 1
    sign = "-" if numerator < 0 else ""
    digits = str(abs(numerator))
    point = len(digits) + exponent
    if exponent >= 0 and point <= 16:
        return f"{sign}{digits}{'0' * exponent}.0"
    if 0 < point <= 16:
        return f"{sign}{digits[:point]}.{digits[point:]}"
    if -4 < point <= 0:
        return f"{sign}0.{'0' * -point}{digits}"
    rest = f".{digits[1:]}" if len(digits) > 1 else ""
    return f"{sign}{digits[0]}{rest}e{point - 1}"
