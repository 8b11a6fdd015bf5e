"""Elaboration of expressions and operators."""

from __future__ import annotations

from typing import assert_never

from koord.syntax import ast, core
from koord.syntax.analysis.folding import folded
from koord.syntax.elaboration.body import CLOSED, BodyScope
from koord.syntax.elaboration.calls import function_call, method_call
from koord.syntax.elaboration.coercion import accepts, fit, widened
from koord.syntax.elaboration.function_calls import library_call
from koord.syntax.elaboration.literals import collection
from koord.syntax.elaboration.phrases import a
from koord.syntax.elaboration.places import meaning, read
from koord.syntax.elaboration.quantifiers import quantified
from koord.syntax.elaboration.resolve_types import is_numeric
from koord.syntax.source import Span
from koord.syntax.types import BOOL, FLOAT, INT, POS, STREAM, STRING, Type

_LOGIC = {
    ast.BinaryOp.AND: core.BinaryOp.AND,
    ast.BinaryOp.OR: core.BinaryOp.OR,
    ast.BinaryOp.IMPLIES: core.BinaryOp.IMPLIES,
}
_EQUALITY = {ast.BinaryOp.EQ: core.BinaryOp.EQ, ast.BinaryOp.NE: core.BinaryOp.NE}
#: ``a > b`` is ``b < a``.
_ORDER = {
    ast.BinaryOp.LT: (core.BinaryOp.LT, False),
    ast.BinaryOp.LE: (core.BinaryOp.LE, False),
    ast.BinaryOp.GT: (core.BinaryOp.LT, True),
    ast.BinaryOp.GE: (core.BinaryOp.LE, True),
}
_ARITHMETIC = {
    ast.BinaryOp.ADD: core.BinaryOp.ADD,
    ast.BinaryOp.SUB: core.BinaryOp.SUB,
    ast.BinaryOp.MUL: core.BinaryOp.MUL,
    ast.BinaryOp.DIV: core.BinaryOp.DIV,
    ast.BinaryOp.MOD: core.BinaryOp.MOD,
}

#: Chains of ``and`` and ``or`` longer than this become balanced trees.
_CHAIN = 16


def unary(body: BodyScope, e: ast.Unary) -> core.Expr | None:
    """Elaborate ``-e`` and ``not e``."""
    if e.op is ast.UnaryOp.NOT:
        operand = fit(body, body.expr(e.operand, BOOL), BOOL, e.operand.span, "what `not` negates")
        if operand is None:
            return None
        return folded(core.Unary(core.UnaryOp.NOT, operand, BOOL, span=e.span))
    operand = body.expr(e.operand)
    if operand is None:
        return None
    if operand.type == POS:
        return library_call(body, "negatedPos", (operand,), e.span)
    if not is_numeric(operand.type):
        body.error("K229", e.span, f"`-` applies to numbers, not to {a(operand.type)}")
        return None
    return folded(core.Unary(core.UnaryOp.NEG, operand, operand.type, span=e.span))


def binary(body: BodyScope, e: ast.Binary, expected: Type | None) -> core.Expr | None:
    """Elaborate an operator with two operands."""
    if e.op in _LOGIC:
        return _logic(body, e)
    if e.op in _EQUALITY:
        return _equality(body, e)
    # A name means what it means; but what it may have been meant to be depends on the type.
    sum_of = expected if expected in (INT, FLOAT) else None
    number = FLOAT if e.op in _ORDER else sum_of
    left = body.expr(e.left, expected if expected == POS else _of_name(e.left, number))
    right = body.expr(e.right, _of_name(e.right, number))
    if left is None or right is None:
        return None
    if e.op in _ORDER:
        return _order(body, e, left, right)
    return _arithmetic(body, e, left, right)


def _of_name(e: ast.Expr, expected: Type | None) -> Type | None:
    return expected if isinstance(e, ast.Name | ast.Call) else None


def _logic(body: BodyScope, e: ast.Binary) -> core.Expr | None:
    op = _LOGIC[e.op]
    parts = _chain(e)
    what = f"what `{e.op.value}` joins"
    values = [fit(body, body.expr(part, BOOL), BOOL, part.span, what) for part in parts]
    found = [value for value in values if value is not None]
    if len(found) < len(values):
        return None
    if len(found) > _CHAIN:
        return _balanced(op, found)
    result = found[0]
    for value in found[1:]:
        result = folded(core.Binary(op, result, value, BOOL, span=result.span.to(value.span)))
    return result


def _chain(e: ast.Binary) -> list[ast.Expr]:
    """The operands of a chain ``a and b and c``; ``implies`` has two."""
    if e.op is ast.BinaryOp.IMPLIES:
        return [e.left, e.right]
    parts = [e.right]
    left = e.left
    while isinstance(left, ast.Binary) and left.op is e.op:
        parts.append(left.right)
        left = left.left
    parts.append(left)
    return parts[::-1]


def _balanced(op: core.BinaryOp, parts: list[core.Expr]) -> core.Expr:
    """A balanced tree of operators that evaluates its operands from left to right."""
    if len(parts) == 1:
        return parts[0]
    middle = len(parts) // 2
    left, right = _balanced(op, parts[:middle]), _balanced(op, parts[middle:])
    return core.Binary(op, left, right, BOOL, span=left.span.to(right.span))


def _equality(body: BodyScope, e: ast.Binary) -> core.Expr | None:
    if body.where in CLOSED and "choose" not in body.session.functions.own:
        for choice, other in ((e.right, e.left), (e.left, e.right)):
            if isinstance(choice, ast.Call) and choice.function.name == "choose":
                return _within(body, e, choice, other)
    left, right = _operands(body, e)
    if left is None or right is None:
        return None
    op = _EQUALITY[e.op]
    if is_numeric(left.type) and is_numeric(right.type):
        left, right = _same_number(left, right)
    elif not accepts(left.type, right.type) and not accepts(right.type, left.type):
        body.error(
            "K229",
            e.span,
            f"{a(left.type)} and {a(right.type)} cannot be compared",
        )
        return None
    if STREAM in (left.type, right.type):
        body.error("K238", e.span, "streams cannot be compared")
        return None
    return folded(core.Binary(op, left, right, BOOL, span=e.span))


def _operands(body: BodyScope, e: ast.Binary) -> tuple[core.Expr | None, core.Expr | None]:
    """Elaborate both operands; one with a known type helps one without (``[]``, a member)."""
    if _silent(body, e.left):
        right = body.expr(e.right)
        return body.expr(e.left, right.type if right is not None else None), right
    left = body.expr(e.left)
    return left, body.expr(e.right, left.type if left is not None else None)


def _silent(body: BodyScope, e: ast.Expr) -> bool:
    if isinstance(e, ast.Name):
        return len(body.session.member(e.name)) > 1
    return isinstance(e, ast.Collection)


def _within(body: BodyScope, e: ast.Binary, choice: ast.Call, other: ast.Expr) -> core.Expr | None:
    """Elaborate ``x == choose(low, high)`` in a property: x is in the range."""
    value = body.expr(other)
    if len(choice.arguments) != 2 or e.op is not ast.BinaryOp.EQ:
        body.error(
            "K308",
            e.span,
            "in a property, `choose` stands in `… == choose(low, high)`",
            "or compare with the bounds",
        )
        return None
    low, high = (body.expr(argument.value) for argument in choice.arguments)
    if value is None or low is None or high is None:
        return None
    if not (is_numeric(value.type) and is_numeric(low.type) and is_numeric(high.type)):
        body.error("K229", e.span, "`choose` is about numbers")
        return None
    above = core.Binary(core.BinaryOp.LE, *_same_number(low, value), BOOL, span=e.span)
    below = core.Binary(core.BinaryOp.LE, *_same_number(value, high), BOOL, span=e.span)
    return folded(core.Binary(core.BinaryOp.AND, above, below, BOOL, span=e.span))


def _order(body: BodyScope, e: ast.Binary, left: core.Expr, right: core.Expr) -> core.Expr | None:
    if not (is_numeric(left.type) and is_numeric(right.type)):
        wrong = right if is_numeric(left.type) else left
        body.error(
            "K229",
            e.span,
            f"`{e.op.value}` compares numbers, not {a(wrong.type)}",
            "compare fields, as in `a.x < b.x`, or a `distance(a, b)`"
            if wrong.type == POS
            else None,
        )
        return None
    left, right = _same_number(left, right)
    op, swapped = _ORDER[e.op]
    if swapped:
        left, right = right, left
    return folded(core.Binary(op, left, right, BOOL, span=e.span))


def _same_number(left: core.Expr, right: core.Expr) -> tuple[core.Expr, core.Expr]:
    if left.type == right.type:
        return left, right
    return widened(left), widened(right)


def _arithmetic(
    body: BodyScope, e: ast.Binary, left: core.Expr, right: core.Expr
) -> core.Expr | None:
    if e.op is ast.BinaryOp.ADD and STRING in (left.type, right.type):
        return _joined(body, left, right, e.span)
    if POS in (left.type, right.type):
        return _vector(body, e, left, right)
    if not (is_numeric(left.type) and is_numeric(right.type)):
        wrong = right if is_numeric(left.type) else left
        body.error(
            "K229",
            e.span,
            f"`{e.op.value}` applies to numbers and `pos`, not to {a(wrong.type)}",
            _arithmetic_hint(wrong.type),
        )
        return None
    left, right = _same_number(left, right)
    return compute(body, _ARITHMETIC[e.op], left, right, e.span)


def compute(
    body: BodyScope, op: core.BinaryOp, left: core.Expr, right: core.Expr, span: Span
) -> core.Expr | None:
    """Elaborate arithmetic on two numbers of one type."""
    if op is core.BinaryOp.MOD and left.type == FLOAT:
        body.error("K229", span, "`%` applies to two `int`, not to a `float`")
        return None
    return folded(core.Binary(op, left, right, left.type, span=span))


def pieces(body: BodyScope, e: ast.Expr) -> list[core.Expr | None]:
    """Elaborate what is written to a stream: ``"s" + x`` is ``"s"`` and then ``x``. [OUTPUT]"""
    if not isinstance(e, ast.Binary) or e.op is not ast.BinaryOp.ADD:
        return [body.expr(e)]
    chain: list[ast.Binary] = []
    first: ast.Expr = e
    while isinstance(first, ast.Binary) and first.op is ast.BinaryOp.ADD:
        chain.append(first)
        first = first.left
    found: list[core.Expr | None] = [body.expr(first)]
    for sum_ in reversed(chain):
        left, right = found[-1], body.expr(sum_.right)
        if left is None or right is None or STRING in (left.type, right.type) or len(found) > 1:
            found.append(right)
        else:
            found[-1] = _arithmetic(body, sum_, left, right)
    return found


def _joined(body: BodyScope, left: core.Expr, right: core.Expr, span: Span) -> core.Expr | None:
    """Elaborate ``"s" + x``: the text of both, one behind the other. [E-TEXT]"""
    texts: list[core.Expr] = []
    for each in (left, right):
        text = each if each.type == STRING else _text_of(body, each)
        if text is None:
            return None
        texts.append(text)
    return library_call(body, "joinedText", tuple(texts), span)


def _text_of(body: BodyScope, value: core.Expr) -> core.Expr | None:
    if value.type in (INT, FLOAT, BOOL, POS):
        return library_call(body, "textOf", (value,), value.span)
    message = f"`+` joins strings with numbers, truth values and `pos`, not with {a(value.type)}"
    body.error("K229", value.span, message, "to write several things, use `stdout << a << b`")
    return None


def _arithmetic_hint(wrong: Type) -> str | None:
    if wrong == STRING:
        return "to write several things, use `stdout << a << b`"
    if wrong == BOOL:
        return "use `if` to turn a truth value into a number"
    return None


def _vector(body: BodyScope, e: ast.Binary, left: core.Expr, right: core.Expr) -> core.Expr | None:
    """Elaborate ``a + b``, ``a - b``, ``a * k``, ``k * a``, ``a / k`` of positions."""
    if left.type == POS and right.type == POS:
        if e.op is ast.BinaryOp.ADD:
            return library_call(body, "addedPos", (left, right), e.span)
        if e.op is ast.BinaryOp.SUB:
            return library_call(body, "subtractedPos", (left, right), e.span)
    elif left.type == POS and is_numeric(right.type):
        factor = widened(right)
        if e.op is ast.BinaryOp.MUL:
            return library_call(body, "scaledPos", (left, factor), e.span)
        if e.op is ast.BinaryOp.DIV:
            return library_call(body, "dividedPos", (left, factor), e.span)
    elif is_numeric(left.type) and e.op is ast.BinaryOp.MUL:
        return library_call(body, "scaledPos", (right, widened(left)), e.span)
    body.error(
        "K229",
        e.span,
        f"`{e.op.value}` does not apply to {a(left.type)} and {a(right.type)}",
        "positions can be added and subtracted, and multiplied or divided by a number",
    )
    return None


def expression(body: BodyScope, e: ast.Expr, expected: Type | None) -> core.Expr | None:
    """Elaborate an expression; ``expected`` is the type that its place wants, if known.

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
