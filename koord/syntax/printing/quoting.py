"""Quoting: core expressions as syntax trees, to be printed.

Elaborating a tree that was quoted gives the expression again, but for the numbers of bound slots
and of calls. What elaboration puts in by itself is left out again, as the widening of an operand
beside a float; what it writes another way stays so: ``b < a`` for ``a > b``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from itertools import chain
from typing import assert_never

from msgspec import Struct

from koord.syntax import ast, core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.printing.expressions import print_expr
from koord.syntax.types import (
    FLOAT,
    ArrayType,
    EnumType,
    GrowingType,
    ListType,
    MapType,
    RecordType,
    Robots,
    SetType,
    Type,
    show,
    within,
)
from koord.syntax.walk import nodes

#: Functions of the library that operators on positions are made of.
_OF_POSITIONS = {
    "addedPos": ast.BinaryOp.ADD,
    "subtractedPos": ast.BinaryOp.SUB,
    "scaledPos": ast.BinaryOp.MUL,
    "dividedPos": ast.BinaryOp.DIV,
}
_NEGATED_POSITION = "negatedPos"

_NAMED = (BinaryOp.MIN, BinaryOp.MAX)


def quoted_number(value: int | Fraction) -> ast.Expr:
    """Quote a number; one that is no decimal is a quotient."""
    if isinstance(value, int):
        return ast.IntLit(value)
    odd = value.denominator
    for factor in (2, 5):
        while odd % factor == 0:
            odd //= factor
    if odd == 1:
        return ast.FloatLit(value)
    over = ast.IntLit(value.denominator)
    return ast.Binary(ast.BinaryOp.DIV, ast.FloatLit(Fraction(value.numerator)), over)


def print_number(value: Fraction) -> str:
    """Print a number without a point if it is whole."""
    return print_expr(quoted_number(int(value) if value.denominator == 1 else value))


class Quoting(Struct, frozen=True):
    """Quotation of expressions of one program; ``shared`` are names with several meanings in it."""

    program: core.Program
    shared: frozenset[str]

    @classmethod
    def of(cls, program: core.Program) -> Quoting:
        """The quotation of expressions of a program."""
        typed = (node.type for node in nodes(program) if isinstance(node, core.Variable))
        enums = {t for type_ in typed for t in within(type_) if isinstance(t, EnumType)}
        ports = {(p.module, p.declaration.variable.name) for a in program.agents for p in a.ports}
        shared = {d.variable.name for d in (*program.allread, *program.allwrite)}
        local = {d.variable.name for agent in program.agents for d in agent.locals}
        members = chain.from_iterable(enum.members for enum in enums)
        counts = Counter([*members, *(name for _, name in ports), *shared, *local])
        return cls(program, frozenset(name for name, count in counts.items() if count > 1))

    def text(self, e: core.Expr) -> str:
        """Print an expression as a user writes it."""
        return print_expr(self.expr(e))

    def invariant(self, stated: core.Property, name: str = "") -> str:
        """An invariant as a user writes it, with another name; without one, what stands behind."""
        at_round = "at round" if stated.kind is core.PropertyKind.AT_ROUND else ""
        head = " ".join(filter(None, (f"invariant {name}" if name else "", at_round)))
        return f"{head}: {self.text(stated.condition)}" if head else self.text(stated.condition)

    def expr(self, e: core.Expr) -> ast.Expr:
        """Quote an expression as a tree."""
        match e:
            case core.Const():
                return self._constant(e)
            case core.Pid():
                return ast.Name("pid")
            case core.NumAgents():
                return ast.Name("numAgents")
            case core.Delta():
                return ast.Name("delta")
            case core.Read(place=place):
                return self.place(place)
            case core.Select(base=base, step=step):
                return self._stepped(self.expr(base), base.type, (step,))
            case core.Unary(op=UnaryOp.NOT, operand=operand):
                return ast.Unary(ast.UnaryOp.NOT, self.expr(operand))
            case core.Unary(op=UnaryOp.NEG, operand=operand):
                return ast.Unary(ast.UnaryOp.NEG, self.expr(operand))
            case core.Unary(op=op, operand=operand):
                return _call("float" if op is UnaryOp.WIDEN else op.value, self.expr(operand))
            case core.Binary(op=op, left=left, right=right):
                operands = self._operands(left, right)
                if op in _NAMED:
                    return _call(op.value, *operands)
                return ast.Binary(ast.BinaryOp(op.value), *operands)
            case core.Builtin(op=op, arguments=arguments):
                return _call(op.value, *map(self.expr, arguments))
            case core.MakeList(items=items):
                return ast.ListLit(tuple(map(self.expr, items)))
            case core.MakeMap(entries=entries, type=SetType()) if entries:
                return ast.SetLit(tuple(self.expr(element) for element, _ in entries))
            case core.MakeMap(entries=entries):
                return ast.MapLit(tuple((self.expr(k), self.expr(v)) for k, v in entries))
            case core.MakeRecord(fields=fields):
                return _call(show(e.type), *map(self.expr, fields))
            case core.Call(function=name, arguments=arguments):
                return self._applied(self.program.function(name).shown, arguments)
            case core.ExternalCall(function=name, arguments=arguments):
                return self._applied(self.program.external(name).shown, arguments)
            case core.Choose(low=low, high=high):
                return _call("choose", *self._operands(low, high))
            case core.Quantified():
                return self._quantified(e)
            case core.Ran(events=((agent, position), *_), robot=robot):
                event = self.program.agents[agent].events[position].name
                return ast.AtRobot(_call("ran", ast.Name(event)), self.expr(robot))
            case core.Ran():
                raise AssertionError("some kind of robot has the event")
            case core.Stopped(robot=robot):
                return ast.AtRobot(ast.Name("stopped"), self.expr(robot))
            case _:
                assert_never(e)

    def place(self, place: core.Place) -> ast.Expr:
        """Quote a place as a tree."""
        variable = place.variable
        found: ast.Expr = ast.Name(variable.name)
        if variable.home is core.Home.PORT and variable.name in self.shared:
            ports = (port for agent in self.program.agents for port in agent.ports)
            module = next(p.module for p in ports if p.declaration.variable == variable)
            found = ast.Attribute(ast.Name(module), ast.Ident(variable.name))
        if place.robot is not None:
            found = ast.AtRobot(found, self.expr(place.robot))
        return self._stepped(
            ast.Prime(found) if place.primed else found, variable.type, place.steps
        )

    def _stepped(self, found: ast.Expr, type_: Type, steps: Sequence[core.Step]) -> ast.Expr:
        for step in steps:
            match step:
                case core.IndexStep(index=index) | core.KeyStep(key=index):
                    found = ast.Index(found, self.expr(index))
                case core.FieldStep(position=position):
                    assert isinstance(type_, RecordType)
                    found = ast.Attribute(found, ast.Ident(type_.fields[position][0]))
            type_ = step.type
        return found

    def _constant(self, e: core.Const) -> ast.Expr:
        match e:
            case core.Const(value=bool() as truth):
                return ast.BoolLit(truth)
            case core.Const(value=str() as text):
                return ast.StringLit(text)
            case core.Const(value=int() as position, type=EnumType(name=name, members=members)):
                member = members[position]
                if member in self.shared:
                    return ast.Attribute(ast.Name(name), ast.Ident(member))
                return ast.Name(member)
            case core.Const(value=int() | Fraction() as number):
                return quoted_number(number)
        raise AssertionError(f"no constant: {e.value!r}")

    def _operands(self, left: core.Expr, right: core.Expr) -> tuple[ast.Expr, ast.Expr]:
        """Quote two operands of one type; the widening of an integer beside a float is implicit."""
        one, other = _unwidened(left), _unwidened(right)
        if one is not left and other is not right:
            one = left
        elif left.type == FLOAT and one is left and other is right:
            # A number without a point reads better, where what is beside it tells its type.
            one = _whole(left) if not isinstance(right, core.Const) else left
            other = _whole(right) if not isinstance(left, core.Const) else right
        return self.expr(one), self.expr(other)

    def _applied(self, name: str, arguments: Sequence[core.Expr]) -> ast.Expr:
        found = [self.expr(argument) for argument in arguments]
        if name in _OF_POSITIONS:
            return ast.Binary(_OF_POSITIONS[name], *found)
        if name == _NEGATED_POSITION:
            return ast.Unary(ast.UnaryOp.NEG, *found)
        return _call(name, *found)

    # --- quantifiers ----------------------------------------------------------------------------

    def _quantified(self, e: core.Quantified) -> ast.Expr:
        """Quote a quantifier, together with those right below it if all are about any robots."""
        binders = [self._binder(e)]
        body = e.body
        while (
            _is_of_robots(e)
            and isinstance(body, core.Quantified)
            and _is_of_robots(body)
            and body.quantifier is e.quantifier
        ):
            binders.append(self._binder(body))
            body = body.body
        quantifier = ast.Quantifier(e.quantifier.value)
        return ast.Quantified(quantifier, tuple(binders), self.expr(body))

    def _binder(self, e: core.Quantified) -> ast.Binder:
        names = (ast.Ident(e.variable.name),)
        match e.domain:
            case core.RobotRange(agent=None):
                return ast.Binder(names)
            case core.RobotRange(agent=int() as agent):
                return ast.Binder(names, type=ast.NamedType(self.program.agents[agent].name))
            case core.IntRange(low=low, high=high):
                return ast.Binder(names, low=self.expr(low), high=self.expr(high))
            case core.Elements(sequence=sequence):
                return ast.Binder(names, over=self.expr(sequence))
            case core.AllValues(type=type_):
                return ast.Binder(names, type=_type(type_))
        raise AssertionError(f"no range: {e.domain!r}")


def _is_of_robots(e: core.Quantified) -> bool:
    return e.domain == core.RobotRange()


def _unwidened(e: core.Expr) -> core.Expr:
    return e.operand if isinstance(e, core.Unary) and e.op is UnaryOp.WIDEN else e


def _whole(e: core.Expr) -> core.Expr:
    """Print a whole number without its point; other expressions as they are."""
    match e:
        case core.Const(value=Fraction(denominator=1) as value):
            return core.Const(int(value), e.type)
        case _:
            return e


def _call(name: str, *arguments: ast.Expr) -> ast.Call:
    return ast.Call(ast.Ident(name), tuple(ast.Argument(None, each) for each in arguments))


def _type(type_: Type) -> ast.TypeExpr:
    match type_:
        case ArrayType(element=element, size=size):
            count = ast.Name("numAgents") if isinstance(size, Robots) else ast.IntLit(size)
            return ast.ArrayTypeExpr(_type(element), count)
        case ListType(element=element):
            return ast.ArrayTypeExpr(_type(element), None)
        case GrowingType(element=element):
            return ast.NamedType("Queue", (_type(element),))
        case SetType(key=element):
            return ast.NamedType("Set", (_type(element),))
        case MapType(key=key, value=value):
            return ast.NamedType("Map", (_type(key), _type(value)))
        case _:
            return ast.NamedType(show(type_))
