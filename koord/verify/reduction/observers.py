"""External functions that stand for what a program makes and asks of opaque values. [T-OBSERVE]"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.types import BOOL, INT, ListType, MapType, Type, show


class Observer(Enum):
    """What a program asks of a list or map that is opaque."""

    LENGTH = "length"  #: of a list or map
    ITEM = "item"  #: of a list, by its index
    HAS = "has"  #: of a map: whether a key is there
    AT = "at"  #: of a map, by a key that is there


def constructor(name: str, types: tuple[Type, ...], result: Type) -> core.External:
    """The external function that makes a value of parts, without a summary yet."""
    return replace(_function(name, types, result), by_answer=True)


def observing(name: str, observer: Observer, types: Sequence[Type], result: Type) -> core.External:
    """The external function of an observer, with what is so of all lists and maps. [T-OBSERVE]"""
    function = _function(name, types, result)
    parts = [read(parameter) for parameter in function.parameters]
    answer = read(function.result)
    zero = number(0)
    match observer:
        case Observer.LENGTH:
            is_none = binary(BinaryOp.EQ, answer, zero)
            is_empty = binary(BinaryOp.EQ, parts[0], parts[1])
            promises = (binary(BinaryOp.LE, zero, answer), binary(BinaryOp.EQ, is_none, is_empty))
            return replace(function, ensures=promises)
        case Observer.HAS:
            is_empty = binary(BinaryOp.EQ, parts[0], parts[2])
            absent = core.Unary(UnaryOp.NOT, answer, BOOL)
            return replace(function, ensures=(binary(BinaryOp.IMPLIES, is_empty, absent),))
        case Observer.ITEM:
            from_first = binary(BinaryOp.LE, zero, parts[1])
            to_last = binary(BinaryOp.LT, parts[1], parts[2])
            return replace(function, requires=(binary(BinaryOp.AND, from_first, to_last),))
        case Observer.AT:
            return replace(function, requires=(parts[2],))


def _function(name: str, types: Sequence[Type], result: Type) -> core.External:
    parameters = tuple(
        core.Variable(core.Home.BOUND, slot, f"part{slot}", type_)
        for slot, type_ in enumerate(types)
    )
    answer = core.Variable(core.Home.BOUND, len(types), "result", result)
    return core.External(
        name, parameters, answer, core.ExternalKind.FUNCTION, (), (), len(types) + 1
    )


def answer_type(observer: Observer, type_: Type) -> Type:
    """The type of what an observer answers about values of a type."""
    match observer:
        case Observer.LENGTH:
            return INT
        case Observer.HAS:
            return BOOL
        case Observer.ITEM:
            assert isinstance(type_, ListType)
            return type_.element
        case Observer.AT:
            assert isinstance(type_, MapType)
            return type_.value


def look_name(observer: Observer, type_: Type) -> str:
    """The name of the external function that is an observer of a type."""
    return f"{observer.value} of {show(type_)}"


def read(variable: core.Variable) -> core.Read:
    """The value of a variable."""
    return core.Read(core.Place(variable))


def binary(op: BinaryOp, left: core.Expr, right: core.Expr) -> core.Expr:
    """A condition on two values."""
    return core.Binary(op, left, right, BOOL)


def either(left: core.Expr, right: core.Expr) -> core.Expr:
    """The condition that one of two holds."""
    return binary(BinaryOp.OR, left, right)


def number(value: int) -> core.Expr:
    """A whole number that is known."""
    return core.Const(value, INT)
