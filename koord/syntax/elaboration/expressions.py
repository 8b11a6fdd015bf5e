"""Expressions: one case per form."""

from __future__ import annotations

from typing import assert_never

from koord.syntax import ast, core
from koord.syntax.elaboration.body import BodyScope
from koord.syntax.elaboration.calls import function_call, method_call
from koord.syntax.elaboration.literals import collection
from koord.syntax.elaboration.operators import binary, unary
from koord.syntax.elaboration.places import meaning, read
from koord.syntax.elaboration.quantifiers import quantified
from koord.syntax.types import BOOL, FLOAT, INT, STRING, Type


def expression(body: BodyScope, e: ast.Expr, expected: Type | None) -> core.Expr | None:
    """The expression, typed; ``expected`` is the type that its place wants, if that is known.

    Where the type of the result differs from ``expected``, the caller finds out. None means that
    something is wrong, and told.
    """
    if isinstance(e, ast.Collection):
        return collection(body, e, expected)
    match e:
        case ast.Name() | ast.Attribute() | ast.Index() | ast.AtRobot() | ast.Prime():
            return read(meaning(body, e, expected), e)
        case ast.IntLit(value=number):
            return core.Const(number, INT, span=e.span)
        case ast.Binary():
            return binary(body, e, expected)
        case ast.BoolLit(value=truth):
            return core.Const(truth, BOOL, span=e.span)
        case ast.Call():
            return function_call(body, e, expected)
        case ast.Unary():
            return unary(body, e)
        case ast.FloatLit(value=fraction):
            return core.Const(fraction, FLOAT, span=e.span)
        case ast.StringLit(value=text):
            return core.Const(text, STRING, span=e.span)
        case ast.MethodCall():
            return method_call(body, e, expected)
        case ast.Quantified():
            return quantified(body, e)
        case _:
            assert_never(e)
