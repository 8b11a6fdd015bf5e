"""Translation of core expressions to TLA+.

Integers and Booleans are TLA+'s own, members of enumerations are strings, arrays are functions from
0, records are records. An index that is out of range makes TLC stop with an error, as does a
division by zero: that is how it shows a fault.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import count

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, UnaryOp
from koord.syntax.diagnostics import KoordError, refusal
from koord.syntax.source import Span
from koord.syntax.types import (
    ArrayType,
    BoolType,
    EnumType,
    IntType,
    ListType,
    RecordType,
    Type,
    within,
)

_INFIX = {
    BinaryOp.ADD: "+",
    BinaryOp.SUB: "-",
    BinaryOp.MUL: "*",
    BinaryOp.EQ: "=",
    BinaryOp.NE: "#",
    BinaryOp.LT: "<",
    BinaryOp.LE: "<=",
    BinaryOp.AND: "/\\",
    BinaryOp.OR: "\\/",
    BinaryOp.IMPLIES: "=>",
}

#: Those that the module defines.
_OPERATORS = {
    BinaryOp.DIV: "Quotient",
    BinaryOp.MOD: "Remainder",
    BinaryOp.MIN: "Least",
    BinaryOp.MAX: "Greatest",
}

#: Words that no name may be.
_RESERVED = re.compile(
    "ASSUM(E|PTION)|AXIOM|CASE|CHOOSE|CONSTANTS?|DOMAIN|ELSE|ENABLED|EXCEPT|EXTENDS|IF|IN|INSTANCE|"
    "LAMBDA|LET|LOCAL|MODULE|NEW|OBVIOUS|OTHER|PROOF|PROVE|QED|RECURSIVE|STATE|SUBSET|THEN|"
    "THEOREM|UNCHANGED|UNION|USE|VARIABLES?|WITH|TRUE|FALSE|BOOLEAN|STRING"
)


def refused(what: str, span: Span, hint: str) -> KoordError:
    """A KoordError for a construct that cannot be translated."""
    return refusal("K943", span, f"{what} cannot be written in TLA+ here", hint)


def name_of(name: str) -> str:
    """Turn a name of the program into one of TLA+."""
    return f"{name}_" if _RESERVED.fullmatch(name) else name


def check_type(type_: Type, span: Span) -> None:
    """Check that a type's values can be translated. Raises KoordError."""
    for each in within(type_):
        if not isinstance(each, _TRANSLATED):
            raise refused(
                f"a {_KINDS.get(type(each).__name__, 'value of this type')}",
                span,
                "use Booleans, integers, enumerations, records and arrays",
            )


_TRANSLATED = (BoolType, IntType, EnumType, ArrayType, ListType, RecordType)

_KINDS = {
    "FloatType": "float",
    "StringType": "string",
    "StreamType": "stream",
    "QueueType": "queue",
    "MapType": "map",
}


class Scope(Struct, frozen=True):
    """The context of an expression, as texts in TLA+.

    ``memory`` is the text of what the robot sees, ``me`` of its number (empty in properties),
    ``picks`` of what is chosen in INIT (empty elsewhere), ``bound`` of variables that quantifiers
    bind, by slot. ``blank`` are variables that may be unset.
    """

    program: core.Program
    kinds: tuple[int, ...]
    memory: str
    me: str
    picks: str = ""
    blank: frozenset[core.Variable] = frozenset()
    bound: dict[int, str] = field(default_factory=dict)
    fresh: Iterator[int] = field(default_factory=count)

    def at(self, memory: str) -> Scope:
        """The same scope with another memory of the robot."""
        return replace(self, memory=memory)

    def size(self, type_: Type) -> int | None:
        """The number of an array's elements; None for a list."""
        if not isinstance(type_, ArrayType):
            return None
        return type_.size if isinstance(type_.size, int) else len(self.kinds)


def text(e: core.Expr, of: Scope) -> str:
    """Translate an expression. Raises KoordError."""
    match e:
        case core.Const(value=bool() as value):
            return str(value).upper()
        case core.Const(value=value, type=EnumType() as type_):
            return f'"{type_.members[int(value)]}"'
        case core.Const(value=int() as value):
            return f"(0 - {-value})" if value < 0 else str(value)
        case core.Choose(site=site) if of.picks:
            return f"{of.picks}.{chosen(site)}"
        case core.Pid():
            return of.me
        case core.NumAgents():
            return str(len(of.kinds))
        case core.Read(place=place):
            return read(place, of)
        case core.Select(base=base, step=step):
            return text(base, of) + step_text(step, base.type, of)
        case core.Unary():
            return _unary(e, of)
        case core.Binary(op=op, left=left, right=right) if op in _OPERATORS:
            return f"{_OPERATORS[op]}({text(left, of)}, {text(right, of)})"
        case core.Binary(op=op, left=left, right=right):
            return f"({text(left, of)} {_INFIX[op]} {text(right, of)})"
        case core.Builtin():
            return _builtin(e, of)
        case core.MakeRecord(fields=values, type=RecordType(fields=fields)):
            pairs = zip(fields, values, strict=True)
            parts = ", ".join(f"{name_of(name)} |-> {text(x, of)}" for (name, _), x in pairs)
            return f"[{parts}]"
        case core.MakeList():
            return _made_list(e, of)
        case core.Call(function=function, arguments=arguments):
            given = "".join(f", {text(x, of)}" for x in arguments)
            return f"{function_name(function)}({of.memory}, {of.me or 0}{given})"
        case core.Quantified():
            return _quantified(e, of)
        case core.Stopped(robot=robot):
            return f'(status[{text(robot, of)}] = "stopped")'
        case core.Ran(events=events, robot=robot):
            those = ", ".join(f"<<{kind}, {position}>>" for kind, position in events)
            return f"(ran[{text(robot, of)}] \\in {{{those}}})"
        case _:
            raise refused(_what(e), e.span, "leave it out")


def _made_list(e: core.MakeList, of: Scope) -> str:
    if not e.items or of.size(e.type) not in (None, len(e.items)):
        raise refused("a list shorter than its array", e.span, "write all elements")
    k, last = f"k{next(of.fresh)}", len(e.items) - 1
    items = [text(item, of) for item in e.items]
    cases = "".join(f"IF {k} = {n} THEN {item} ELSE " for n, item in enumerate(items[:-1]))
    return f"[{k} \\in 0..{last} |-> {cases}{items[-1]}]"


def _what(e: core.Expr) -> str:
    match e:
        case core.ExternalCall(function=function):
            return f"the external function {function}"
        case core.Choose():
            return "choose"
        case core.Const():
            return "a float or a string"
        case _:
            return f"this ({type(e).__name__})"


def read(place: core.Place, of: Scope) -> str:
    """Translate a read of a place. Raises KoordError for sensors and actuators."""
    variable = place.variable
    if variable.home is Home.PORT or place.primed:
        raise refused("a sensor or an actuator", place.span, "leave modules out")
    check_type(variable.type, place.span)
    match variable.home:
        case Home.BOUND:
            start = of.bound.get(variable.slot, f"{of.memory}.b[{variable.slot}]")
        case Home.LOCAL if place.robot is not None:
            start = f"loc[{text(place.robot, of)}].{name_of(variable.name)}"
        case Home.LOCAL:
            start = f"{of.memory}.l.{name_of(variable.name)}"
        case _:
            start = f"{of.memory}.c.{name_of(variable.name)}"
    type_ = variable.type
    for step in place.steps:
        start += step_text(step, type_, of)
        type_ = step.type
    if variable in of.blank:
        return f"(IF {_is_set(start, type_, of)} THEN {start} ELSE {start})"
    return start


def _is_set(value: str, type_: Type, of: Scope) -> str:
    """An expression that is true of set values, and an error of TLC for others. [LOOKUP]"""
    match type_:
        case ArrayType(element=element):
            size, k = of.size(type_), f"k{next(of.fresh)}"
            assert size is not None
            return f"(\\A {k} \\in 0..{size - 1}: {_is_set(f'{value}[{k}]', element, of)})"
        case RecordType(fields=fields):
            parts = [_is_set(f"{value}.{name_of(name)}", each, of) for name, each in fields]
            return "(" + " /\\ ".join(parts) + ")" if parts else "TRUE"
        case IntType():
            return f"({value} = {value} + 0)"
        case _:
            return f"({value} \\in {values(type_, of)})"


def unset(type_: Type, of: Scope) -> str:
    """A value of a type all of whose parts are unset."""
    match type_:
        case ArrayType(element=element):
            size = of.size(type_)
            assert size is not None
            return f"[k{next(of.fresh)} \\in 0..{size - 1} |-> {unset(element, of)}]"
        case RecordType(fields=fields):
            parts = ", ".join(f"{name_of(name)} |-> {unset(each, of)}" for name, each in fields)
            return f"[{parts}]"
        case _:
            return "None"


def values(type_: Type, of: Scope) -> str | None:
    """The set of all values of a type; None if there are infinitely many."""
    match type_:
        case BoolType():
            return "BOOLEAN"
        case EnumType(members=members):
            return "{" + ", ".join(f'"{member}"' for member in members) + "}"
        case ArrayType(element=element):
            each = values(element, of)
            return each and f"[0..{(of.size(type_) or 0) - 1} -> {each}]"
        case RecordType(fields=fields):
            parts = [(name_of(name), values(each, of)) for name, each in fields]
            if any(each is None for _, each in parts) or not parts:
                return None
            return f"[{', '.join(f'{name}: {each}' for name, each in parts)}]"
        case _:
            return None


def chosen(site: int) -> str:
    """The name of the answer to a ``choose`` of INIT."""
    return f"c{site}"


def step_text(step: core.Step, type_: Type, of: Scope) -> str:
    """The text of a step from a value of a type to a part of it."""
    match step:
        case core.IndexStep(index=index):
            return f"[{text(index, of)}]"
        case core.FieldStep():
            return f".{field_name(step, type_)}"
        case core.KeyStep():
            raise refused("a map", step.span, "use an array")


def field_name(step: core.FieldStep, type_: Type) -> str:
    assert isinstance(type_, RecordType)
    return name_of(type_.fields[step.position][0])


def _unary(e: core.Unary, of: Scope) -> str:
    inner = text(e.operand, of)
    match e.op:
        case UnaryOp.NOT:
            return f"~{inner}"
        case UnaryOp.NEG:
            return f"(0 - {inner})"
        case UnaryOp.ABS:
            return f"Greatest({inner}, 0 - {inner})"
        case UnaryOp.WIDEN:
            raise refused("a float", e.span, "use integers")


def _builtin(e: core.Builtin, of: Scope) -> str:
    sequence = text(e.arguments[0], of)
    if e.op is ListOp.LENGTH:
        return f"Cardinality(DOMAIN ({sequence}))"
    k = f"k{next(of.fresh)}"
    each = f"{k} \\in DOMAIN ({sequence}): ({sequence})[{k}]"
    match e.op:
        case ListOp.CONTAINS:
            return f"(\\E {each} = {text(e.arguments[1], of)})"
        case ListOp.ANY:
            return f"(\\E {each})"
        case ListOp.ALL:
            return f"(\\A {each})"
        case _:
            raise refused(f"{e.op.value} of an array", e.span, "write the loop out")


def _quantified(e: core.Quantified, of: Scope) -> str:
    sign = "\\A" if e.quantifier is core.QuantifierKind.FORALL else "\\E"
    name = f"q{e.variable.slot}"
    inner = replace(of, bound={**of.bound, e.variable.slot: name})
    match e.domain:
        case core.RobotRange(agent=kind):
            robots = [i for i, k in enumerate(of.kinds) if kind is None or k == kind]
            over = f"{{{', '.join(map(str, robots))}}}"
        case core.IntRange(low=low, high=high):
            over = f"({text(low, of)})..({text(high, of)} - 1)"
        case core.Elements(sequence=sequence):
            whole = text(sequence, of)
            k = f"k{next(of.fresh)}"
            over = f"{{({whole})[{k}] : {k} \\in DOMAIN ({whole})}}"
        case _:
            raise refused("a statement about all values of a type", e.span, "give a range")
    return f"({sign} {name} \\in {over}: {text(e.body, inner)})"


def function_name(name: str) -> str:
    """The name of the operator for a function of the program."""
    return "fun_" + "".join(c if c.isalnum() else "_" for c in name)
