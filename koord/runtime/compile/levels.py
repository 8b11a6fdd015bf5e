"""Levels: how nearly a claim is broken, as a number that goes up as the claim comes closer to it.

Comparisons of numbers say it by how much they hold; the rest of a claim says who counts::

    a ≤ b        a − b                    not e        the level of e, the other way round
    a = b        |a − b|                  e and f      the greater of both
    a ≠ b        − |a − b|                e or f       the lesser of both
    for all i    the greatest of all i    there is i   the least of all i

What is no comparison of numbers is −∞ where it holds and ∞ where it does not. This is the
robustness of temporal logics, negated. (Fainekos and Pappas 2009)
"""

from __future__ import annotations

from typing import Any, TypeAlias

from msgspec import Struct, field
from msgspec.structs import replace

from koord.runtime.compile.naming import PythonNames
from koord.runtime.compile.watching import Watched, WatchedClaim, WatchedKind, WatchModule
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, QuantifierKind, UnaryOp
from koord.syntax.types import FloatType, IntType, Type
from koord.syntax.walk import rebuilt


class Difference(Struct, frozen=True):
    """A comparison of numbers: the method that says by how much, given the robots so far."""

    method: str


class Truth(Struct, frozen=True):
    """Another statement: the method that says if it holds, and whether that brings a break near."""

    method: str
    negated: bool


class Both(Struct, frozen=True):
    """The ``greatest`` of the levels of parts, or the least."""

    parts: tuple[Level, ...]
    greatest: bool


class OfRobots(Struct, frozen=True):
    """The ``greatest`` of the levels of robots of an agent (None: of all), or the least."""

    agent: int | None
    body: Level
    greatest: bool


Level: TypeAlias = Difference | Truth | Both | OfRobots


class LevelCode(Struct, frozen=True):
    """A level, and the code of its methods."""

    level: Level
    watched: Watched


def level_of(program: core.Program, stated: core.Property) -> LevelCode | None:
    """Compile the level of an invariant; None if it compares no numbers."""
    made = _Levels(program, stated.bound)
    level = made.of(stated.condition, (), negated=False)
    return LevelCode(*made.compiled(level)) if made.compares else None


class _Levels(Struct):
    program: core.Program
    bound: int  #: so many slots are taken
    functions: list[core.Function] = field(default_factory=list)
    compares: bool = False

    def of(self, e: core.Expr, robots: tuple[core.Variable, ...], *, negated: bool) -> Level:
        """How nearly a statement about robots is false; or, ``negated``, how nearly it is true."""
        match e:
            case core.Unary(op=UnaryOp.NOT, operand=operand):
                return self.of(operand, robots, negated=not negated)
            case core.Binary(op=BinaryOp.AND | BinaryOp.OR | BinaryOp.IMPLIES as op):
                supposed = negated is not (op is BinaryOp.IMPLIES)
                parts = (
                    self.of(e.left, robots, negated=supposed),
                    self.of(e.right, robots, negated=negated),
                )
                return Both(parts, greatest=(op is BinaryOp.AND) is not negated)
            case core.Quantified(domain=core.RobotRange(agent=agent), variable=variable):
                body = self.of(e.body, (*robots, variable), negated=negated)
                for_all = e.quantifier is QuantifierKind.FORALL
                return OfRobots(agent, body, greatest=for_all is not negated)
            case core.Binary(left=left, right=right) if _is_number(left.type):
                self.compares = True
                return Difference(self._method(_difference(e.op, left, right, negated), robots))
            case core.Call(function=name, arguments=arguments):
                function = self.program.function(name)
                match function.body:
                    case (core.Return(value=value),) if value is not None:
                        return self.of(
                            self._put(function, arguments, value), robots, negated=negated
                        )
        return Truth(self._method(e, robots), negated)

    def _put(
        self, function: core.Function, arguments: tuple[core.Expr, ...], body: core.Expr
    ) -> core.Expr:
        """The body of a function with arguments in place of its parameters."""
        given = {one.slot: e for one, e in zip(function.parameters, arguments, strict=True)}
        beyond, self.bound = self.bound, self.bound + function.bound

        def put(node: Any) -> Any:
            match node:
                case core.Read(place=core.Place(variable=variable, steps=steps)) if (
                    variable.home is Home.BOUND and variable.slot in given
                ):
                    e = given[variable.slot]
                    for step in steps:
                        e = core.Select(e, put(step))
                    return e
                case core.Variable(home=Home.BOUND, slot=slot):
                    return replace(node, slot=slot + beyond)
                case _:
                    return rebuilt(node, put)

        made: core.Expr = put(body)
        return made

    def _method(self, e: core.Expr, robots: tuple[core.Variable, ...]) -> str:
        """The function of a part, with the robots that it is about as parameters."""
        name = f"level {len(self.functions)}"
        body = (core.Return(e),)
        self.functions.append(core.Function(name, robots, e.type, body, self.bound, span=e.span))
        return name

    def compiled(self, level: Level) -> tuple[Level, Watched]:
        """The level with methods in the place of functions, and the code of these."""
        functions = (*self.program.functions, *self.functions)
        made = replace(self.program, functions=functions)
        claims = [
            WatchedClaim(one.name, WatchedKind.INVARIANT, one.span, one.name)
            for one in self.functions
        ]
        module = WatchModule(made, PythonNames(self.program), claims)
        text = module.text()
        named = _renamed(level, module.names.methods)
        return named, Watched((), text, made)


def _renamed(level: Level, methods: dict[str, str]) -> Level:
    match level:
        case Difference(method=method) | Truth(method=method):
            return replace(level, method=methods[method])
        case Both(parts=parts):
            return replace(level, parts=tuple(_renamed(part, methods) for part in parts))
        case OfRobots(body=body):
            return replace(level, body=_renamed(body, methods))


def _is_number(type_: Type) -> bool:
    return isinstance(type_, IntType | FloatType)


def _difference(op: BinaryOp, left: core.Expr, right: core.Expr, negated: bool) -> core.Expr:
    """By how much a comparison does not hold; or, ``negated``, holds."""
    if op in (BinaryOp.LT, BinaryOp.LE):
        first, second = (right, left) if negated else (left, right)
        return core.Binary(BinaryOp.SUB, first, second, left.type)
    assert op in (BinaryOp.EQ, BinaryOp.NE)
    gap = core.Binary(BinaryOp.SUB, left, right, left.type)
    size = core.Unary(UnaryOp.ABS, gap, left.type)
    is_far = (op is BinaryOp.EQ) is not negated
    return size if is_far else core.Unary(UnaryOp.NEG, size, left.type)
