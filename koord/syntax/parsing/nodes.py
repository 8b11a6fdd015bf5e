"""Nodes of the syntax tree, built from the rules of the line grammar."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import ast
from koord.syntax.parsing.operands import (
    BinderPiece,
    MisplacedError,
    RangeBound,
    TypedBound,
    across,
    binders,
    combine,
    ident,
    place,
)
from koord.syntax.parsing.tokens import Token, string_value

Children = list[Any]


class FunctionHead(Struct, frozen=True):
    """The head of a function."""

    name: ast.Ident
    parameters: tuple[ast.VarDecl, ...]
    result: ast.TypeExpr | None


class LeadsTo(Struct, frozen=True):
    """``trigger leadsto goal``"""

    trigger: ast.Expr
    goal: ast.Expr


class _Variable(Struct, frozen=True):
    """``T x[a][b]`` before it is known whether a value follows."""

    type: ast.TypeExpr
    name: Token
    sizes: tuple[ast.Expr | None, ...]
    last: Token

    def declared(self, initial: ast.Expr | None) -> ast.VarDecl:
        """The declaration; ``T x[n]`` is read as ``T[n] x``."""
        type_ = self.type
        for size in reversed(self.sizes):
            type_ = ast.ArrayTypeExpr(type_, size, span=self.type.span)
        span = across(self.type, initial or self.last)
        return ast.VarDecl(type_, ident(self.name), initial, span=span)


class Builder:
    """A transformer from grammar rules to nodes; one method per rule or alternative."""

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
        return items[0] if len(items) == 1 else combine(items)

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
        return replace(c[1], span=across(c[0], c[2]))

    def position(self, c: Children) -> Any:
        """``(x, y, z)`` is ``pos(x, y, z)``, with a name that takes no room. [OLD-POSITION]"""
        start = c[0].span
        before = replace(start, end_column=start.column)
        items = [ast.Argument(None, item, span=item.span) for item in (c[1], *c[3])]
        return ast.Call(ast.Ident("pos", span=before), tuple(items), span=across(c[0], c[4]))

    def empty_list(self, c: Children) -> Any:
        return ast.ListLit((), span=across(c[0], c[1]))

    def list_literal(self, c: Children) -> Any:
        return ast.ListLit(tuple(c[1]), span=across(c[0], c[2]))

    def empty_map(self, c: Children) -> Any:
        return ast.MapLit((), span=across(c[0], c[1]))

    def map_literal(self, c: Children) -> Any:
        return ast.MapLit(tuple(c[1]), span=across(c[0], c[2]))

    def set_literal(self, c: Children) -> Any:
        return ast.SetLit(tuple(c[1]), span=across(c[0], c[2]))

    def entry(self, c: Children) -> Any:
        return (c[0], c[2])

    def call_plain(self, c: Children) -> Any:
        return ast.Call(ident(c[0]), (), span=across(c[0], c[2]))

    def call(self, c: Children) -> Any:
        return ast.Call(ident(c[0]), tuple(c[2]), span=across(c[0], c[3]))

    def argument(self, c: Children) -> Any:
        return ast.Argument(None, c[0], span=c[0].span)

    def named_argument(self, c: Children) -> Any:
        return ast.Argument(c[0].text, c[2], span=across(c[0], c[2]))

    def attribute(self, c: Children) -> Any:
        return ast.Attribute(c[0], ident(c[2]), span=across(c[0], c[2]))

    def method_plain(self, c: Children) -> Any:
        return ast.MethodCall(c[0], ident(c[2]), (), span=across(c[0], c[4]))

    def method(self, c: Children) -> Any:
        return ast.MethodCall(c[0], ident(c[2]), tuple(c[4]), span=across(c[0], c[5]))

    def index(self, c: Children) -> Any:
        return ast.Index(c[0], c[2], span=across(c[0], c[3]))

    def prime(self, c: Children) -> Any:
        return ast.Prime(c[0], span=across(c[0], c[1]))

    def at_robot(self, c: Children) -> Any:
        return ast.AtRobot(c[0], c[2], span=across(c[0], c[2]))

    # --- quantifiers

    def binder_plain(self, c: Children) -> Any:
        return BinderPiece(c[0])

    def binder_typed(self, c: Children) -> Any:
        return TypedBound(c[0], c[1])

    def binder_in(self, c: Children) -> Any:
        return RangeBound(c[0], c[2])

    def quantified(self, c: Children) -> Any:
        quantifier = ast.Quantifier.FORALL if c[0].type == "FORALL" else ast.Quantifier.EXISTS
        return ast.Quantified(quantifier, binders(c[1]), c[3], span=across(c[0], c[3]))

    # --- types and declarations

    def named_type(self, c: Children) -> Any:
        return ast.NamedType(c[0].text, span=c[0].span)

    def generic_type(self, c: Children) -> Any:
        return ast.NamedType(c[0].text, tuple(c[2]), span=across(c[0], c[3]))

    def list_type(self, c: Children) -> Any:
        return ast.ArrayTypeExpr(c[0], None, span=across(c[0], c[2]))

    def array_type(self, c: Children) -> Any:
        return ast.ArrayTypeExpr(c[0], c[2], span=across(c[0], c[3]))

    def variable(self, c: Children) -> Any:
        return _Variable(c[0], c[1], (), c[1])

    def variable_list(self, c: Children) -> Any:
        variable: _Variable = c[0]
        return _Variable(variable.type, variable.name, (*variable.sizes, None), c[2])

    def variable_array(self, c: Children) -> Any:
        variable: _Variable = c[0]
        return _Variable(variable.type, variable.name, (*variable.sizes, c[2]), c[3])

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
        return FunctionHead(ident(c[0]), (), c[4] if len(c) > 3 else None)

    def signature(self, c: Children) -> Any:
        return FunctionHead(ident(c[0]), tuple(c[2]), c[5] if len(c) > 4 else None)

    def member(self, c: Children) -> Any:
        return [ident(c[0])]

    def member_more(self, c: Children) -> Any:
        c[0].append(ident(c[2]))
        return c[0]

    # --- statements

    def assign(self, c: Children) -> Any:
        return ast.Assign(place(c[0]), c[2], span=across(c[0], c[2]))

    def increment(self, c: Children) -> Any:
        return ast.Increment(place(c[0]), 1, span=across(c[0], c[1]))

    def decrement(self, c: Children) -> Any:
        return ast.Increment(place(c[0]), -1, span=across(c[0], c[1]))

    def output(self, c: Children) -> Any:
        return ast.Output(c[0], tuple(c[1]), span=across(c[0], c[1][-1]))

    output_one = one

    def call_statement(self, c: Children) -> Any:
        if not isinstance(c[0], ast.Call | ast.MethodCall):
            raise MisplacedError(
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
        return ast.Return(c[1], span=across(c[0], c[1]))

    def stop_statement(self, c: Children) -> Any:
        return ast.Stop(span=across(c[0], c[-1]))

    def trystop_statement(self, c: Children) -> Any:
        return ast.TryStop(span=across(c[0], c[-1]))

    def pass_statement(self, c: Children) -> Any:
        return ast.Pass(span=c[0].span)

    def loop_range(self, c: Children) -> Any:
        return ast.ForRange(ident(c[1]), c[3], c[5], ())

    def loop_each(self, c: Children) -> Any:
        return ast.ForEach((ident(c[1]),), c[3], ())

    def loop_pairs(self, c: Children) -> Any:
        return ast.ForEach((ident(c[1]), ident(c[3])), c[5], ())

    def loop_counted(self, c: Children) -> Any:
        return ast.Repeat(c[1], ())

    def goal(self, c: Children) -> Any:
        return c[0]

    def leads_to(self, c: Children) -> Any:
        return LeadsTo(c[0], c[2])
