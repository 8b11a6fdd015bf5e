"""Parsing of operands: operators by precedence, assignable places, quantified names."""

from __future__ import annotations

from msgspec import Struct

from koord.syntax import ast
from koord.syntax.operators import BINDS, COMPARISON, IMPLIES, SPELLINGS
from koord.syntax.parsing.tokens import Token
from koord.syntax.source import Span


class MisplacedError(Exception):
    """Raised for a construct that the grammar allows and the language does not."""

    def __init__(self, code: str, span: Span, message: str, hint: str | None = None) -> None:
        super().__init__(code, span, message, hint)
        self.code = code
        self.span = span
        self.message = message
        self.hint = hint


class BinderPiece(Struct, frozen=True):
    """A piece of a quantifier that is a name, or the upper bound of the piece before it."""

    value: ast.Expr


class TypedBound(Struct, frozen=True):
    """``pos p`` in a quantifier."""

    type: ast.TypeExpr
    name: Token


class RangeBound(Struct, frozen=True):
    """``k in low`` or ``t in list`` in a quantifier."""

    name: ast.Expr
    low: ast.Expr


def across(first: ast.Node | Token, last: ast.Node | Token) -> Span:
    """The span from the beginning of one node to the end of another."""
    start = first if isinstance(first, Token) else first.span
    if isinstance(last, Token):
        return Span(start.file, start.line, start.column, last.line, last.end_column)
    end = last.span
    return Span(start.file, start.line, start.column, end.end_line, end.end_column)


def ident(token: Token) -> ast.Ident:
    return ast.Ident(token.text, span=token.span)


def combine(items: list[ast.Expr | Token]) -> ast.Expr:
    """Combine operators with their operands by precedence (no recursion: chains may be long)."""
    operands: list[ast.Expr] = []
    waiting: list[tuple[int, ast.BinaryOp | ast.UnaryOp, Token]] = []

    def apply() -> None:
        _, operator, token = waiting.pop()
        right = operands.pop()
        if isinstance(operator, ast.UnaryOp):
            operands.append(ast.Unary(operator, right, span=across(token, right)))
            return
        left = operands.pop()
        operands.append(ast.Binary(operator, left, right, span=across(left, right)))

    behind_operand = False
    for item in items:
        if not isinstance(item, Token):
            operands.append(item)
            behind_operand = True
        elif behind_operand:
            operator = SPELLINGS[item.text]
            binds = BINDS[operator]
            while waiting and waiting[-1][0] >= binds:
                if waiting[-1][0] == binds == IMPLIES:
                    break
                if waiting[-1][0] == binds == COMPARISON:
                    raise MisplacedError(
                        "K134",
                        item.span,
                        "comparisons do not chain",
                        "compare twice and join with `and`: `a < b and b < c`",
                    )
                apply()
            waiting.append((binds, operator, item))
            behind_operand = False
        else:
            unary = ast.UnaryOp.NOT if item.type == "NOT" else ast.UnaryOp.NEG
            waiting.append((BINDS[unary], unary, item))
    while waiting:
        apply()
    return operands[0]


def place(target: ast.Expr) -> ast.Expr:
    """Check that a target can be assigned: a name, an element, a field. Raises MisplacedError."""
    base = target
    while isinstance(base, ast.Index | ast.Attribute):
        base = base.base
    if not isinstance(base, ast.Name):
        raise MisplacedError(
            "K136",
            target.span,
            "nothing can be assigned to this",
            "assign to a variable, an element, a field or a port",
        )
    return target


def binders(pieces: list[BinderPiece | TypedBound | RangeBound]) -> tuple[ast.Binder, ...]:
    """Names that share a range, from the pieces between commas."""
    found: list[ast.Binder] = []
    names: list[ast.Ident] = []
    type_: ast.TypeExpr | None = None

    def close() -> None:
        nonlocal names, type_
        if names:
            span = across(type_ or names[0], names[-1])
            found.append(ast.Binder(tuple(names), type=type_, span=span))
        names = []
        type_ = None

    position = 0
    while position < len(pieces):
        piece = pieces[position]
        position += 1
        match piece:
            case BinderPiece():
                names.append(_bound_name(piece.value))
            case TypedBound():
                close()
                type_ = piece.type
                names.append(ident(piece.name))
            case RangeBound():
                if type_:
                    close()
                names.append(_bound_name(piece.name))
                shared, names = tuple(names), []
                following = pieces[position] if position < len(pieces) else None
                if isinstance(following, BinderPiece):
                    position += 1
                    high = following.value
                    span = across(shared[0], high)
                    found.append(ast.Binder(shared, low=piece.low, high=high, span=span))
                else:
                    span = across(shared[0], piece.low)
                    found.append(ast.Binder(shared, over=piece.low, span=span))
    close()
    return tuple(found)


def _bound_name(expression: ast.Expr) -> ast.Ident:
    if isinstance(expression, ast.Name):
        return ast.Ident(expression.name, span=expression.span)
    raise MisplacedError(
        "K138",
        expression.span,
        "a name for what is quantified over is expected here",
        "write `forall i:`, `forall k in 0, n:`, `forall t in list:`",
    )
