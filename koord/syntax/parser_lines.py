"""The forms of one line: an LALR parser (grammar.lark) fed with tokens, and its node builder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, cast

from lark import Lark
from lark import Token as LarkToken
from lark.exceptions import UnexpectedToken
from lark.lexer import Lexer

from koord.syntax import ast
from koord.syntax.source import Span
from koord.syntax.tokens import Token, string_value


class Form(Enum):
    """What a line, or a piece of one, can be: the start symbols of the grammar."""

    EXPRESSION = "expression"
    LEADS_TO = "leads_to"
    DECLARATION = "declaration"
    SIGNATURE = "signature"
    MEMBERS = "members"
    STATEMENT = "statement"
    LOOP = "loop"


@dataclass(frozen=True, slots=True)
class Unexpected(Exception):
    """The token that no form of line allows where it stands."""

    token: Token
    position: int  #: of the token in the line; the length of the line if it is too short
    expected: frozenset[str]  #: names of terminals


@dataclass(frozen=True, slots=True)
class Misplaced(Exception):
    """Something that the grammar lets through but the language does not have."""

    code: str
    span: Span
    message: str
    hint: str | None = None


class _NoLexer(Lexer):
    """The tokens are made elsewhere and fed one by one."""

    def __init__(self, conf: Any) -> None:
        pass

    def lex(self, *_: Any) -> Any:
        return iter(())


@cache
def _lark() -> Lark:
    return Lark(
        Path(__file__).with_name("grammar.lark").read_text("utf-8"),
        parser="lalr",
        lexer=_NoLexer,
        start=[form.value for form in Form],
        transformer=Builder(),
        maybe_placeholders=False,
        keep_all_tokens=True,
    )


def parse_line(form: Form, tokens: list[Token], end: Token) -> Any:
    """The node that the tokens of a line make.

    ``end`` is a token for the place behind the line. Raises Unexpected or Misplaced.
    """
    state = _lark().parse_interactive(None, form.value).parser_state
    feed = cast(Callable[..., Any], state.feed_token)
    position = 0
    try:
        for position, token in enumerate(tokens):  # noqa: B007
            feed(token)
        position = len(tokens)
        return feed(LarkToken("$END", ""), True)
    except UnexpectedToken as error:
        token = tokens[position] if position < len(tokens) else end
        raise Unexpected(token, position, frozenset(error.accepts or error.expected)) from None


_BINARY = {
    "implies": (ast.BinaryOp.IMPLIES, 1),
    "or": (ast.BinaryOp.OR, 2),
    "||": (ast.BinaryOp.OR, 2),
    "|": (ast.BinaryOp.OR, 2),
    "and": (ast.BinaryOp.AND, 3),
    "&&": (ast.BinaryOp.AND, 3),
    "&": (ast.BinaryOp.AND, 3),
    "==": (ast.BinaryOp.EQ, 5),
    "!=": (ast.BinaryOp.NE, 5),
    "≠": (ast.BinaryOp.NE, 5),
    "<": (ast.BinaryOp.LT, 5),
    "<=": (ast.BinaryOp.LE, 5),
    "≤": (ast.BinaryOp.LE, 5),
    ">": (ast.BinaryOp.GT, 5),
    ">=": (ast.BinaryOp.GE, 5),
    "≥": (ast.BinaryOp.GE, 5),
    "+": (ast.BinaryOp.ADD, 6),
    "-": (ast.BinaryOp.SUB, 6),
    "*": (ast.BinaryOp.MUL, 7),
    "/": (ast.BinaryOp.DIV, 7),
    "%": (ast.BinaryOp.MOD, 7),
}
_NOT_BINDS = 4
_NEG_BINDS = 8
_COMPARISON = 5
_RIGHT = 1  # `implies` groups to the right

Children = list[Any]


def _across(first: ast.Node | Token, last: ast.Node | Token) -> Span:
    """From the beginning of one to the end of the other."""
    start = first if isinstance(first, Token) else first.span
    if isinstance(last, Token):
        return Span(start.file, start.line, start.column, last.line, last.end_column)
    end = last.span
    return Span(start.file, start.line, start.column, end.end_line, end.end_column)


def _ident(token: Token) -> ast.Ident:
    return ast.Ident(token.text, span=token.span)


@dataclass(frozen=True, slots=True)
class _BinderItem:
    """A piece between the commas of a quantifier."""

    form: str
    parts: tuple[Any, ...]


def _combine(items: list[ast.Expr | Token]) -> ast.Expr:
    """Operators to their operands, by how tightly they bind (no recursion: chains may be long)."""
    operands: list[ast.Expr] = []
    waiting: list[tuple[int, ast.BinaryOp | ast.UnaryOp, Token]] = []

    def apply() -> None:
        binds, operator, token = waiting.pop()
        right = operands.pop()
        if isinstance(operator, ast.UnaryOp):
            operands.append(ast.Unary(operator, right, span=_across(token, right)))
            return
        left = operands.pop()
        operands.append(ast.Binary(operator, left, right, span=left.span.to(right.span)))

    behind_operand = False
    for item in items:
        if not isinstance(item, Token):
            operands.append(item)
            behind_operand = True
        elif behind_operand:
            operator, binds = _BINARY[item.text]
            while waiting and (
                waiting[-1][0] > binds or (waiting[-1][0] == binds and binds != _RIGHT)
            ):
                if binds == _COMPARISON == waiting[-1][0]:
                    raise Misplaced(
                        "K134",
                        item.span,
                        "comparisons do not chain",
                        "compare twice and join with `and`: `a < b and b < c`",
                    )
                apply()
            waiting.append((binds, operator, item))
            behind_operand = False
        elif item.type == "NOT":
            waiting.append((_NOT_BINDS, ast.UnaryOp.NOT, item))
        else:
            waiting.append((_NEG_BINDS, ast.UnaryOp.NEG, item))
    while waiting:
        apply()
    return operands[0]


class Builder:
    """Makes a node of the children of a rule; one method per rule or alternative."""

    # --- sequences

    def one(self, c: Children) -> Children:
        return [c[-1]]

    def several(self, c: Children) -> Children:
        items: Children = c[0]
        items.append(c[-1])
        return items

    def operand(self, c: Children) -> Children:
        return c

    def more(self, c: Children) -> Children:
        items: Children = c[0]
        items.append(c[1])
        return items

    prefixed = more

    # --- expressions

    def operators(self, c: Children) -> Children:
        items: Children = c[0]
        return items

    def operator(self, c: Children) -> Children:
        items: Children = c[0]
        items.append(c[1])
        items.append(c[2])
        return items

    def operator_prefixed(self, c: Children) -> Children:
        items: Children = c[0]
        items.append(c[1])
        items.extend(c[2])
        return items

    def expression(self, c: Children) -> Any:
        items: Children = c[0]
        return items[0] if len(items) == 1 else _combine(items)

    def name(self, c: Children) -> Any:
        return ast.Name(c[0].text, span=c[0].span)

    def int_literal(self, c: Children) -> Any:
        return ast.IntLit(int(c[0].text), span=c[0].span)

    def float_literal(self, c: Children) -> Any:
        return ast.FloatLit(Fraction(c[0].text), span=c[0].span)

    def string_literal(self, c: Children) -> Any:
        return ast.StringLit(string_value(c[0].text), span=c[0].span)

    def bool_literal(self, c: Children) -> Any:
        return ast.BoolLit(c[0].type == "TRUE", span=c[0].span)

    def group(self, c: Children) -> Any:
        return replace(c[1], span=_across(c[0], c[2]))

    def empty_list(self, c: Children) -> Any:
        return ast.ListLit((), span=_across(c[0], c[1]))

    def list_literal(self, c: Children) -> Any:
        return ast.ListLit(tuple(c[1]), span=_across(c[0], c[2]))

    def empty_map(self, c: Children) -> Any:
        return ast.MapLit((), span=_across(c[0], c[1]))

    def map_literal(self, c: Children) -> Any:
        return ast.MapLit(tuple(c[1]), span=_across(c[0], c[2]))

    def entry(self, c: Children) -> Any:
        return (c[0], c[2])

    def call_plain(self, c: Children) -> Any:
        return ast.Call(_ident(c[0]), (), span=_across(c[0], c[2]))

    def call(self, c: Children) -> Any:
        return ast.Call(_ident(c[0]), tuple(c[2]), span=_across(c[0], c[3]))

    def argument(self, c: Children) -> Any:
        return ast.Argument(None, c[0], span=c[0].span)

    def named_argument(self, c: Children) -> Any:
        return ast.Argument(c[0].text, c[2], span=_across(c[0], c[2]))

    def attribute(self, c: Children) -> Any:
        return ast.Attribute(c[0], _ident(c[2]), span=_across(c[0], c[2]))

    def method_plain(self, c: Children) -> Any:
        return ast.MethodCall(c[0], _ident(c[2]), (), span=_across(c[0], c[4]))

    def method(self, c: Children) -> Any:
        return ast.MethodCall(c[0], _ident(c[2]), tuple(c[4]), span=_across(c[0], c[5]))

    def index(self, c: Children) -> Any:
        return ast.Index(c[0], c[2], span=_across(c[0], c[3]))

    def unsized(self, c: Children) -> Any:
        raise Misplaced("K130", _across(c[1], c[2]), "an index is missing between `[` and `]`")

    def prime(self, c: Children) -> Any:
        return ast.Prime(c[0], span=_across(c[0], c[1]))

    def at_robot(self, c: Children) -> Any:
        return ast.AtRobot(c[0], c[2], span=_across(c[0], c[2]))

    # --- quantifiers

    def binder_plain(self, c: Children) -> Any:
        return _BinderItem("plain", (c[0],))

    def binder_typed(self, c: Children) -> Any:
        return _BinderItem("typed", (c[0], c[1]))

    def binder_in(self, c: Children) -> Any:
        return _BinderItem("in", (c[0], c[2]))

    def quantified(self, c: Children) -> Any:
        quantifier = ast.Quantifier.FORALL if c[0].type == "FORALL" else ast.Quantifier.EXISTS
        return ast.Quantified(quantifier, _binders(c[1]), c[3], span=_across(c[0], c[3]))

    # --- types and declarations

    def named_type(self, c: Children) -> Any:
        return ast.NamedType(c[0].text, span=c[0].span)

    def generic_type(self, c: Children) -> Any:
        return ast.NamedType(c[0].text, tuple(c[2]), span=_across(c[0], c[3]))

    def list_type(self, c: Children) -> Any:
        return ast.ArrayTypeExpr(c[0], None, span=_across(c[0], c[2]))

    def array_type(self, c: Children) -> Any:
        return ast.ArrayTypeExpr(c[0], c[2], span=_across(c[0], c[3]))

    def variable(self, c: Children) -> Any:
        return _Variable(c[0], c[1], [], c[1])

    def variable_list(self, c: Children) -> Any:
        variable: _Variable = c[0]
        return _Variable(variable.type, variable.name, [*variable.sizes, None], c[2])

    def variable_array(self, c: Children) -> Any:
        variable: _Variable = c[0]
        return _Variable(variable.type, variable.name, [*variable.sizes, c[2]], c[3])

    def declaration(self, c: Children) -> Any:
        return c[0].declared(None)

    def initialised(self, c: Children) -> Any:
        return c[0].declared(c[2])

    def parameter(self, c: Children) -> Any:
        return [c[0].declared(None)]

    def parameter_more(self, c: Children) -> Any:
        c[0].append(c[2].declared(None))
        return c[0]

    def signature_plain(self, c: Children) -> Any:
        return Signature(_ident(c[0]), (), c[4] if len(c) > 3 else None)

    def signature(self, c: Children) -> Any:
        return Signature(_ident(c[0]), tuple(c[2]), c[5] if len(c) > 4 else None)

    def member(self, c: Children) -> Any:
        return [_ident(c[0])]

    def member_more(self, c: Children) -> Any:
        c[0].append(_ident(c[2]))
        return c[0]

    # --- statements

    def assign(self, c: Children) -> Any:
        return ast.Assign(_place(c[0]), c[2], span=_across(c[0], c[2]))

    def increment(self, c: Children) -> Any:
        return ast.Increment(_place(c[0]), 1, span=_across(c[0], c[1]))

    def decrement(self, c: Children) -> Any:
        return ast.Increment(_place(c[0]), -1, span=_across(c[0], c[1]))

    def output(self, c: Children) -> Any:
        return ast.Output(c[0], tuple(c[1]), span=_across(c[0], c[1][-1]))

    output_one = one

    def call_statement(self, c: Children) -> Any:
        if not isinstance(c[0], ast.Call | ast.MethodCall):
            raise Misplaced(
                "K136",
                c[0].span,
                "this is a value, not a statement",
                "assign it with `=`, or call something",
            )
        return ast.CallStmt(c[0], span=c[0].span)

    def break_statement(self, c: Children) -> Any:
        return ast.Break(span=c[0].span)

    def return_plain(self, c: Children) -> Any:
        return ast.Return(None, span=c[0].span)

    def return_value(self, c: Children) -> Any:
        return ast.Return(c[1], span=_across(c[0], c[1]))

    def stop_statement(self, c: Children) -> Any:
        return ast.Stop(span=_across(c[0], c[-1]))

    def trystop_statement(self, c: Children) -> Any:
        return ast.TryStop(span=_across(c[0], c[-1]))

    def pass_statement(self, c: Children) -> Any:
        return ast.Pass(span=c[0].span)

    def loop_range(self, c: Children) -> Any:
        return LoopRange(_ident(c[1]), c[3], c[5])

    def loop_each(self, c: Children) -> Any:
        return LoopEach((_ident(c[1]),), c[3])

    def loop_pairs(self, c: Children) -> Any:
        return LoopEach((_ident(c[1]), _ident(c[3])), c[5])

    def leads_to(self, c: Children) -> Any:
        return (c[0],)

    def leads_to_pair(self, c: Children) -> Any:
        return (c[0], c[2])


@dataclass(frozen=True, slots=True)
class Signature:
    """The head of a function."""

    name: ast.Ident
    parameters: tuple[ast.VarDecl, ...]
    result: ast.TypeExpr | None


@dataclass(frozen=True, slots=True)
class LoopRange:
    """The head of ``for i = low, high:``."""

    variable: ast.Ident
    low: ast.Expr
    high: ast.Expr


@dataclass(frozen=True, slots=True)
class LoopEach:
    """The head of ``for x in list:`` or ``for k, v in list:``."""

    variables: tuple[ast.Ident, ...]
    sequence: ast.Expr


@dataclass(frozen=True, slots=True)
class _Variable:
    """``T x[a][b]`` before it is known whether a value follows."""

    type: ast.TypeExpr
    name: Token
    sizes: list[ast.Expr | None]
    last: Token

    def declared(self, initial: ast.Expr | None) -> ast.VarDecl:
        """The declaration; ``T x[n]`` is read as ``T[n] x``."""
        type_ = self.type
        for size in reversed(self.sizes):
            type_ = ast.ArrayTypeExpr(type_, size, span=self.type.span)
        span = _across(self.type, initial or self.last)
        return ast.VarDecl(type_, _ident(self.name), initial, span=span)


def _place(target: ast.Expr) -> ast.Expr:
    """What can be written: a name, an element, a field."""
    base = target
    while isinstance(base, ast.Index | ast.Attribute):
        base = base.base
    if not isinstance(base, ast.Name):
        raise Misplaced(
            "K136",
            target.span,
            "this cannot be assigned to",
            "a variable, an element, a field or a port can",
        )
    return target


def _binders(items: list[_BinderItem]) -> tuple[ast.Binder, ...]:
    """Names that share a range, from the pieces between commas.

    A piece right behind ``k in a`` is the upper bound of that range.
    """
    binders: list[ast.Binder] = []
    names: list[ast.Ident] = []
    type_: ast.TypeExpr | None = None

    def close() -> None:
        nonlocal names, type_
        if names:
            first = type_ or names[0]
            binders.append(ast.Binder(tuple(names), type=type_, span=_across(first, names[-1])))
        names = []
        type_ = None

    position = 0
    while position < len(items):
        item = items[position]
        position += 1
        match item.form:
            case "plain":
                names.append(_bound(item.parts[0]))
            case "typed":
                close()
                type_ = _type_of(item.parts[0])
                names.append(_ident(item.parts[1]))
            case _:
                if type_:
                    close()
                names.append(_bound(item.parts[0]))
                shared = tuple(names)
                names = []
                low = item.parts[1]
                if position < len(items) and items[position].form == "plain":
                    high = items[position].parts[0]
                    position += 1
                    span = _across(shared[0], high)
                    binders.append(ast.Binder(shared, low=low, high=high, span=span))
                else:
                    span = _across(shared[0], low)
                    binders.append(ast.Binder(shared, over=low, span=span))
    close()
    return tuple(binders)


def _bound(expression: ast.Expr) -> ast.Ident:
    if isinstance(expression, ast.Name):
        return ast.Ident(expression.name, span=expression.span)
    raise Misplaced("K130", expression.span, "a name for what is quantified over is expected here")


def _type_of(expression: ast.Expr) -> ast.TypeExpr:
    match expression:
        case ast.Name(name=name):
            return ast.NamedType(name, span=expression.span)
        case ast.Index(base=base, index=size):
            return ast.ArrayTypeExpr(_type_of(base), size, span=expression.span)
        case _:
            raise Misplaced("K130", expression.span, "a type is expected here")
