"""Python text of expressions, on numbers that are known and where nothing faults.

The text computes what the rules of chapter 2 say, or is in doubt (:mod:`operations`). What has no
text raises :class:`NoCodeError`: then the reference semantics does all the work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from typing import Any, assert_never

from koord.sampling.compiled.operations import NAMES
from koord.semantics.domain import EXACT, Constant, Domain
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, QuantifierKind, UnaryOp
from koord.syntax.system import System
from koord.syntax.types import (
    ArrayType,
    FloatType,
    Robots,
    ScalarType,
    Type,
    contains,
)

#: Short numbers are less than this, and more than its negative.
LARGEST = 2**60

#: What is made of so few short numbers is never too long.
_MOST_PARTS = 500

_QUOTIENTS = (BinaryOp.DIV, BinaryOp.MOD)


class NoCodeError(Exception):
    """Raised for what is left to the reference semantics."""


class Names:
    """The names that a text uses, with what they stand for."""

    def __init__(self, d: Domain[Constant], system: System) -> None:
        self.d = d
        self.system = system
        self.values: dict[str, Any] = {**NAMES, "D": d, "WIDEN": _widening(d)}
        self.functions: dict[str, str] = {}
        self.texts: list[str] = []

    def new(self, prefix: str, value: Any = None) -> str:
        """A name that was not used before, for a value."""
        name = f"{prefix}{len(self.values)}"
        self.values[name] = value
        return name

    def made(self, name: str) -> Callable[..., Any]:
        """The function of a name, from the texts written so far. Raises NoCodeError."""
        if self.texts:
            source = "\n".join(self.texts)
            self.texts.clear()
            try:
                exec(compile(source, f"<{name}>", "exec"), self.values)
            except (SyntaxError, RecursionError, MemoryError):
                raise NoCodeError("the text is too deep for Python") from None
        function: Callable[..., Any] = self.values[name]
        return function


def _widening(d: Domain[Constant]) -> Callable[[Any], Constant]:
    return lambda number: d.unary(UnaryOp.WIDEN, number)


class Writer:
    """A writer of the expressions of one body. ``bound`` has the names of its bound variables.

    With a ``unit``, exact floats are counted in units, as ints: ``Fraction(1, unit)`` is one.
    Where variables are ``short``, so is what is made of a few of them.
    """

    def __init__(self, names: Names, *, unit: int | None = None, short: bool = False) -> None:
        self.names = names
        self.unit = unit
        self.short = short
        self.bound: dict[int, str] = {}
        #: Bound variables that hold the number of a robot.
        self.robots: set[str] = set()

    # --- what bodies differ in -------------------------------------------------------------------

    def read(self, place: core.Place) -> str:
        """Where a variable of the system is read, UNSET where it is not set. [LOOKUP]"""
        raise NoCodeError(f"{place.variable.name} is read in a function")

    def pid(self) -> str:
        raise NoCodeError("there is no pid")

    def ran(self, e: core.Ran) -> str:
        raise NoCodeError("ran() is of claims")

    def stopped(self, e: core.Stopped) -> str:
        raise NoCodeError("stopped() is of claims")

    def call(self, e: core.Call) -> str:
        """A call of a function defined in Koord. [E-CALL]"""
        raise NoCodeError("a function is called")

    def choose(self, e: core.Choose) -> str:
        raise NoCodeError("a choice is asked for")

    def external(self, e: core.ExternalCall) -> str:
        raise NoCodeError("a function is asked for")

    # --- expressions -----------------------------------------------------------------------------

    def sure(self, e: core.Expr) -> str:
        """An expression whose value is used for itself: reads are looked at here and now."""
        text = self.expression(e)
        if isinstance(e, core.Read | core.Select) or (
            isinstance(e, core.Binary) and e.op in (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES)
        ):
            return f"sure({text})"
        return text

    def expression(self, e: core.Expr) -> str:
        """The text of an expression, in parentheses where it has operators."""
        match e:
            case core.Read():
                return self._read(e.place)
            case core.Const():
                return self._constant(e.value, e.type)
            case core.Binary():
                return self._binary(e)
            case core.Unary():
                return self._unary(e)
            case core.Pid():
                return self.pid()
            case core.NumAgents():
                return str(self.names.system.robots)
            case core.Delta():
                return self._constant(self.names.system.delta_s, e.type)
            case core.Select():
                return self._below(self.sure(e.base), e.step)
            case core.Builtin():
                return self._builtin(e)
            case core.MakeList():
                self.uncounted(e.type)
                return f"Seq({len(e.items)}, {self._tuple(e.items)})"
            case core.MakeRecord():
                self.uncounted(e.type)
                return f"Rec({self._tuple(e.fields)})"
            case core.Call():
                self.uncounted(e.type, *(argument.type for argument in e.arguments))
                return self.call(e)
            case core.Quantified():
                return self._quantified(e)
            case core.Ran():
                return self.ran(e)
            case core.Stopped():
                return self.stopped(e)
            case core.Choose():
                return self.choose(e)
            case core.ExternalCall():
                return self.external(e)
            case core.MakeMap():
                self.uncounted(e.type)
                pairs = "".join(f"({self.sure(k)}, {self.sure(v)}), " for k, v in e.entries)
                return f"mapped(D, ({pairs}))"
        assert_never(e)

    def uncounted(self, *types: Type) -> None:
        """Refuse floats inside of values, and of functions, which are not counted in units."""
        if self.unit is not None and any(contains(type_, FloatType) for type_ in types):
            raise NoCodeError("parts of values are not counted in units")

    def _tuple(self, parts: tuple[core.Expr, ...]) -> str:
        return "(" + "".join(f"{self.sure(part)}, " for part in parts) + ")"

    def _constant(self, value: int | Fraction | bool | str, type_: Type) -> str:
        if isinstance(type_, FloatType) and self.unit is not None:
            count = Fraction(value) * self.unit
            if count.denominator != 1:
                raise NoCodeError(f"{value} is no number of units")
            return f"({count.numerator})"
        constant = self.names.d.const(value, type_)
        if isinstance(constant, bool) or (type(constant) is int and constant.bit_length() < 64):
            return f"({constant})"
        return self.names.new("k", constant)

    def _unary(self, e: core.Unary) -> str:
        operand = self.expression(e.operand)
        match e.op:
            case UnaryOp.NOT:
                return f"(not {operand})"
            case UnaryOp.NEG:
                return f"(-{operand})"
            case UnaryOp.ABS:
                return f"absolute({operand})"
            case UnaryOp.WIDEN:
                if self.unit is not None:
                    return f"({operand} * {self.unit})"
                return f"WIDEN(sure({operand}))"
        assert_never(e.op)

    def _binary(self, e: core.Binary) -> str:
        """An operator on two operands. [E-EQUAL] [E-ARITH] [E-SHORT]"""
        left, right = self.expression(e.left), self.expression(e.right)
        match e.op:
            case BinaryOp.AND:
                return f"({left} and {right})"
            case BinaryOp.OR:
                return f"({left} or {right})"
            case BinaryOp.IMPLIES:
                return f"(not {left} or {right})"
            case BinaryOp.EQ | BinaryOp.NE:
                return self._equality(e, left, right)
            case BinaryOp.LT | BinaryOp.LE:
                return f"({left} {e.op.value} {right})"
            case BinaryOp.MIN | BinaryOp.MAX:
                return f"{e.op.value}({left}, {right})"
            case BinaryOp.ADD | BinaryOp.SUB:
                return self._handy(e, f"{left} {e.op.value} {right}")
            case BinaryOp.MUL:
                return self._product(e, left, right)
            case BinaryOp.DIV | BinaryOp.MOD:
                if self.unit is not None and isinstance(e.type, FloatType):
                    raise NoCodeError("a quotient is no number of units")
                name = "quotient" if e.op is BinaryOp.DIV else "remainder"
                return f"{name}({left}, {right})"
        assert_never(e.op)

    def _equality(self, e: core.Binary, left: str, right: str) -> str:
        word = "" if e.op is BinaryOp.EQ else "not "
        if isinstance(e.left.type, ScalarType):
            return f"({left} {e.op.value} {right})"
        self.uncounted(e.left.type, e.right.type)
        return f"({word}equal(D, sure({left}), sure({right})))"

    def _product(self, e: core.Binary, left: str, right: str) -> str:
        if self.unit is not None and isinstance(e.type, FloatType):
            # A product counts units of units: one of the two has to be a number of its own.
            if isinstance(e.left, core.Const) and _is_whole(e.left.value):
                left = f"({int(e.left.value)})"
            elif isinstance(e.right, core.Const) and _is_whole(e.right.value):
                right = f"({int(e.right.value)})"
            elif isinstance(e.left, core.Unary) and e.left.op is UnaryOp.WIDEN:
                left = self.expression(e.left.operand)
            elif isinstance(e.right, core.Unary) and e.right.op is UnaryOp.WIDEN:
                right = self.expression(e.right.operand)
            else:
                raise NoCodeError("a product is no number of units")
        return self._handy(e, f"{left} * {right}")

    def _handy(self, e: core.Binary, text: str) -> str:
        """A number that is no longer than numbers may be. [E-ARITH]"""
        exact = self.unit is None and self.names.d is EXACT
        if self.short and not (exact and isinstance(e.type, FloatType)):
            parts = self._short_parts(e)
            if parts is not None and parts <= _MOST_PARTS:
                return f"({text})"
        return f"handy({text})"

    def _short_parts(self, e: core.Expr) -> int | None:
        """Of how many short numbers an expression is made; None if of others as well."""
        match e:
            case core.Pid() | core.NumAgents() | core.Delta():
                return 1
            case core.Const(value=value):
                is_short = isinstance(value, int | Fraction) and -LARGEST < value < LARGEST
                return 1 if is_short else None
            case core.Read(place=core.Place(variable=variable, steps=steps)):
                if variable.home is Home.BOUND:
                    return 1 if self.bound.get(variable.slot) in self.robots else None
                own_steps = 1 if variable.home is Home.ALLREAD else 0
                return 1 if len(steps) == own_steps else None
            case core.Unary(operand=operand):
                return self._short_parts(operand)
            case core.Binary(op=op, left=left, right=right) if op not in _QUOTIENTS:
                one, other = self._short_parts(left), self._short_parts(right)
                return None if one is None or other is None else one + other
            case _:
                return None

    # --- places ----------------------------------------------------------------------------------

    def _read(self, place: core.Place) -> str:
        if place.variable.home is not Home.BOUND:
            return self.read(place)
        name = self.bound.get(place.variable.slot)
        if name is None:
            raise NoCodeError("a bound variable is not known")
        if place.steps:
            return self.below(f"sure({name})", place.steps)
        self.uncounted(place.variable.type)
        return name

    def below(self, text: str, steps: tuple[core.Step, ...]) -> str:
        """A part of a value, some steps below it. [E-SELECT]"""
        for step in steps:
            text = self._below(text, step)
        return text

    def _below(self, text: str, step: core.Step) -> str:
        self.uncounted(step.type)
        match step:
            case core.FieldStep():
                return f"{text}.fields[{step.position}]"
            case core.IndexStep():
                return f"pick({text}.items, {self.expression(step.index)})"
            case core.KeyStep():
                self.uncounted(step.key.type)
                return f"entry(D, {text}, {self.sure(step.key)})"
        assert_never(step)

    # --- lists -----------------------------------------------------------------------------------

    def _builtin(self, e: core.Builtin) -> str:
        """A function of lists and maps. [E-LIST]"""
        first = e.arguments[0]
        if e.op is ListOp.LENGTH and isinstance(first.type, ArrayType):
            size = first.type.size
            return str(self.names.system.robots if size is Robots.ALL else size)
        self.uncounted(first.type)
        value = self.sure(first)
        match e.op:
            case ListOp.LENGTH:
                return f"{value}.length"
            case ListOp.CONTAINS:
                return f"has(D, {value}, {self.sure(e.arguments[1])})"
            case ListOp.ANY | ListOp.ALL:
                return f"{e.op.value}({value}.items)"
            case ListOp.MIN | ListOp.MAX:
                return f"extreme({e.op.value}, {value}.items)"
            case ListOp.KEYS:
                return f"keys({value})"
        assert_never(e.op)

    # --- quantifiers -----------------------------------------------------------------------------

    def _quantified(self, e: core.Quantified) -> str:
        """A quantifier, by Python's ``all`` and ``any``, which stop as early. [E-QUANT]"""
        word = "all" if e.quantifier is QuantifierKind.FORALL else "any"
        with self.ranging(e) as (name, over):
            return f"{word}({self.expression(e.body)} for {name} in {over})"

    @contextmanager
    def ranging(self, e: core.Quantified) -> Iterator[tuple[str, str]]:
        """Bind the variable of a quantifier: its name, and the text of what it ranges over."""
        match e.domain:
            case core.RobotRange(agent=agent):
                over = self.of_kind(agent)
            case core.IntRange(low=low, high=high):
                over = f"range({self.expression(low)}, {self.expression(high)})"
            case core.Elements(sequence=elements):
                self.uncounted(elements.type)
                over = f"{self.sure(elements)}.items"
            case core.AllValues():
                raise NoCodeError("all values of a type cannot be tried")
            case _:
                assert_never(e.domain)
        is_robot = isinstance(e.domain, core.RobotRange)
        with self.binding(e.variable, is_robot=is_robot) as name:
            yield name, over

    @contextmanager
    def binding(self, variable: core.Variable, *, is_robot: bool) -> Iterator[str]:
        """Bind a variable to a name of its own."""
        name = self.names.new("b")
        before = self.bound.get(variable.slot)
        self.bound[variable.slot] = name
        if is_robot:
            self.robots.add(name)
        yield name
        if before is None:
            del self.bound[variable.slot]
        else:
            self.bound[variable.slot] = before

    def of_kind(self, agent: int | None) -> str:
        """The robots of one kind, or all of them."""
        kinds = self.names.system.kinds
        if agent is None:
            return f"range({len(kinds)})"
        return self.names.new("k", tuple(i for i, kind in enumerate(kinds) if kind == agent))


def _is_whole(value: object) -> bool:
    return isinstance(value, int | Fraction) and Fraction(value).denominator == 1
