"""Compilation of expressions to Python.

The text computes what the rules say, faults included: whatever may fault goes through an operation
that checks it, and operands stand in the order in which the rules evaluate them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import assert_never

from msgspec.structs import replace

from koord.runtime.compile.naming import PythonNames, constant, is_tree, shape, string, tuple_of
from koord.runtime.compile.scope import (
    ADD,
    AND,
    ATOM,
    COMPARE,
    MULTIPLY,
    NEGATE,
    NOT,
    OR,
    Code,
    Scope,
)
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, UnaryOp
from koord.syntax.types import ArrayType, FloatType, MapType, RecordType, Robots, Type, contains

# --- expressions --------------------------------------------------------------------------------


def expression(scope: Scope, e: core.Expr) -> Code:
    """Compile an expression."""
    match e:
        case core.Const(value=value, type=type_):
            text = constant(scope.names, value, type_, e.span)
            return Code(text, NEGATE if text.startswith("-") else ATOM)
        case core.Read(place=place):
            return read(scope, place)
        case core.Binary():
            return _binary(scope, e)
        case core.Unary():
            return _unary(scope, e)
        case core.Pid():
            return Code("self.pid")
        case core.NumAgents():
            return Code("self.numAgents")
        case core.Delta():
            return Code("self.delta")
        case core.Select(base=base, step=step):
            return _step(scope, expression(scope, base), step, base.type)
        case core.Builtin():
            return _builtin(scope, e)
        case core.MakeList(items=items):
            made = [expression(scope, item) for item in items]
            return Code(tuple_of(code.text for code in made), ATOM, _any_faults(made))
        case core.MakeRecord(fields=fields, type=type_):
            assert isinstance(type_, RecordType)
            made = [expression(scope, part) for part in fields]
            return _call(scope.names.types[type_], made)
        case core.MakeMap(entries=entries):
            return _map(scope, entries)
        case core.Call():
            return _function_call(scope, e)
        case core.ExternalCall():
            return _external_call(scope, e)
        case core.Choose(low=low, high=high):
            bounds = [expression(scope, low), expression(scope, high)]
            where = Code(scope.place(e.span))
            asked = _call("self.choose", [Code(scope.key(e.site)), *bounds, where])
            return replace(asked, faults=True)
        case core.Quantified():
            return _quantified(scope, e)
        case core.Ran(events=events, robot=robot):
            return _call(
                "self.has_run", [expression(scope, robot), Code(repr(events))], faults=True
            )
        case core.Stopped(robot=robot):
            return _call("self.has_stopped", [expression(scope, robot)], faults=True)
    assert_never(e)


def _any_faults(parts: Iterable[Code]) -> bool:
    return any(part.faults for part in parts)


def _call(function: str, arguments: list[Code], *, faults: bool = False) -> Code:
    inner = ", ".join(argument.text for argument in arguments)
    return Code(f"{function}({inner})", ATOM, faults or _any_faults(arguments))


# --- operators ----------------------------------------------------------------------------------

_OPERATORS = {
    BinaryOp.ADD: ("+", ADD),
    BinaryOp.SUB: ("-", ADD),
    BinaryOp.MUL: ("*", MULTIPLY),
    BinaryOp.LT: ("<", COMPARE),
    BinaryOp.LE: ("<=", COMPARE),
    BinaryOp.AND: ("and", AND),
    BinaryOp.OR: ("or", OR),
}


def _binary(scope: Scope, e: core.Binary) -> Code:
    """Compile a binary operator. [E-ARITH] [E-SHORT]"""
    left, right = expression(scope, e.left), expression(scope, e.right)
    faults = left.faults or right.faults
    match e.op:
        case BinaryOp.EQ | BinaryOp.NE:
            return _equality(e, left, right)
        case BinaryOp.DIV | BinaryOp.MOD:
            return _division(scope, e, left, right)
        case BinaryOp.MIN:
            return _call("min", [left, right])
        case BinaryOp.MAX:
            return _call("max", [left, right])
        case BinaryOp.IMPLIES:
            return Code(f"not {left.within(NOT)} or {right.within(AND)}", OR, faults)
    word, level = _OPERATORS[e.op]
    if e.op in (BinaryOp.AND, BinaryOp.OR):
        return Code(f"{left.within(level)} {word} {right.within(level)}", level, faults)
    # Left-associative; comparisons must not become chains.
    first = level + 1 if level == COMPARE else level
    return Code(f"{left.within(first)} {word} {right.within(level + 1)}", level, faults)


def _equality(e: core.Binary, left: Code, right: Code) -> Code:
    """Compile an equality. [E-EQUAL]"""
    faults, negated = left.faults or right.faults, e.op is BinaryOp.NE
    if contains(e.left.type, FloatType) and not isinstance(e.left.type, FloatType):
        text = f"same({left.text}, {right.text})"
        return Code(f"not {text}", NOT, faults) if negated else Code(text, ATOM, faults)
    word = "!=" if negated else "=="
    return Code(f"{left.within(ADD)} {word} {right.within(ADD)}", COMPARE, faults)


def _division(scope: Scope, e: core.Binary, left: Code, right: Code) -> Code:
    """Compile a division: a constant divisor other than zero needs no check. [E-ARITH]"""
    of_floats = isinstance(e.type, FloatType)
    if isinstance(e.right, core.Const) and e.right.value:
        word = "%" if e.op is BinaryOp.MOD else "/" if of_floats else "//"
        text = f"{left.within(MULTIPLY)} {word} {right.within(NEGATE)}"
        return Code(text, MULTIPLY, left.faults or right.faults)
    name = "remainder" if e.op is BinaryOp.MOD else "ratio" if of_floats else "quotient"
    where = Code(scope.place(e.right.span))
    return _call(name, [left, right, where], faults=True)


def _unary(scope: Scope, e: core.Unary) -> Code:
    operand = expression(scope, e.operand)
    match e.op:
        case UnaryOp.NOT:
            return Code(f"not {operand.within(NOT)}", NOT, operand.faults)
        case UnaryOp.NEG:
            return Code(f"-{operand.within(NEGATE)}", NEGATE, operand.faults)
        case UnaryOp.ABS:
            return _call("abs", [operand])
        case UnaryOp.WIDEN:
            small = isinstance(e.operand, core.Pid | core.NumAgents)
            return _call("float" if small else "real", [operand])
    assert_never(e.op)


def _builtin(scope: Scope, e: core.Builtin) -> Code:
    """Compile a function of lists or maps. [E-LIST]"""
    first = e.arguments[0]
    if e.op is ListOp.LENGTH:
        if isinstance(first.type, ArrayType):
            size = first.type.size
            return Code("self.numAgents" if size is Robots.ALL else str(size))
        return _call("len", [expression(scope, first)])
    items = expression(scope, first)
    match e.op:
        case ListOp.ANY:
            return _call("any", [items])
        case ListOp.ALL:
            return _call("all", [items])
        case ListOp.MIN | ListOp.MAX:
            name = "least" if e.op is ListOp.MIN else "greatest"
            return _call(name, [items, Code(scope.place(e.span))], faults=True)
        case ListOp.CONTAINS:
            wanted = expression(scope, e.arguments[1])
            is_map = isinstance(first.type, MapType)
            plain = is_map or not contains(e.arguments[1].type, FloatType)
            if plain and not (items.faults and wanted.faults):
                # Python evaluates what is looked for first.
                text = f"{wanted.within(ADD)} in {items.within(ADD)}"
                return Code(text, COMPARE, items.faults or wanted.faults)
            return _call("has_key" if is_map else "contains", [items, wanted])
        case ListOp.KEYS:
            return _call("tuple", [items])
    assert_never(e.op)


def _map(scope: Scope, entries: tuple[tuple[core.Expr, core.Expr], ...]) -> Code:
    """Compile a map. [E-MAP]"""
    made = [(expression(scope, key), expression(scope, value)) for key, value in entries]
    inner = ", ".join(f"{key.text}: {value.text}" for key, value in made)
    return Code(f"{{{inner}}}", ATOM, any(k.faults or v.faults for k, v in made))


# --- calls --------------------------------------------------------------------------------------


def _function_call(scope: Scope, e: core.Call) -> Code:
    """Compile a call of a function. [E-CALL]"""
    arguments = [expression(scope, argument) for argument in e.arguments]
    if e.function in scope.knowledge.asking:
        arguments.insert(0, Code(scope.trail_to(e.site)))
    if e.function in scope.knowledge.methods:
        name = f"self.{scope.names.methods[e.function]}"
    else:
        name = scope.names.module_functions[e.function]
    return _call(name, arguments, faults=True)


def _external_call(scope: Scope, e: core.ExternalCall) -> Code:
    """Compile a call of an external function. [EXTERNAL]"""
    function = scope.names.program.external(e.function)
    arguments = [expression(scope, argument) for argument in e.arguments]
    first = [Code(scope.key(e.site))]
    if function.requires:
        first.append(Code(scope.place(e.span)))
    name = scope.names.externals[e.function]
    return _call(f"self.{name}", [*first, *arguments], faults=True)


def _quantified(scope: Scope, e: core.Quantified) -> Code:
    """Compile a quantifier. [E-QUANT]"""
    word = "all" if e.quantifier is core.QuantifierKind.FORALL else "any"
    variable = scope.name(e.variable)
    scope.assigned.add((Home.BOUND, e.variable.slot))
    asks = scope.knowledge.asks(e.body)
    label = variable
    match e.domain:
        case core.AllValues(type=of) if scope.watching:
            over = Code(f"self.samples({shape(scope.names, of)})")
        case core.AllValues():
            # Nobody can try them all: a summary that speaks of them is taken on trust. [REPLAY]
            return Code("True")
        case core.RobotRange(agent=None):
            over = Code("range(self.numAgents)")
        case core.RobotRange(agent=agent):
            chosen = f"[k for k, kind in enumerate(self.kinds) if kind == {agent}]"
            over = Code(chosen)
        case core.IntRange(low=low, high=high):
            over = integers(expression(scope, low), expression(scope, high))
        case core.Elements(sequence=sequence):
            over = expression(scope, sequence)
            if asks:
                label = scope.temporary("position")
                over = _call("enumerate", [over])
    body = expression(scope.inner(label) if asks else scope, e.body)
    head = variable if label == variable else f"{label}, {variable}"
    faults = over.faults or body.faults
    return Code(f"{word}({body.within(OR)} for {head} in {over.within(OR)})", ATOM, faults)


def integers(low: Code, high: Code) -> Code:
    """Compile a range of integers ``[low, high)``."""
    return _call("range", [high] if low.text == "0" else [low, high])


# --- places -------------------------------------------------------------------------------------


def root(scope: Scope, variable: core.Variable) -> str:
    """The Python variable or attribute that holds a variable."""
    if variable.home is Home.BOUND:
        return scope.name(variable)
    return f"self.{scope.names.attribute(variable, scope.agent)}"


def read(scope: Scope, place: core.Place) -> Code:
    """Compile the read of a place. [LOOKUP]

    What may be unset is checked where the rules check it: at the atom that the path leads into, or
    at its end.
    """
    variable = place.variable
    code = _viewed(scope, place) or Code(root(scope, variable))
    sure = scope.is_sure(variable)
    if not sure and variable.home is Home.BOUND:
        scope.unset[variable.slot] = variable
    name, where = string(variable.name), scope.place(place.span)
    type_: Type = variable.type
    if not sure and variable.home is Home.BOUND and place.steps and is_tree(type_):
        # A variable that nothing was stored in is unset as a whole, whatever part is wanted.
        code = Code(f"known({code.text}, {name}, {where})", ATOM, True)
    for step in place.steps:
        if not sure and not is_tree(type_):
            code, sure = Code(f"known({code.text}, {name}, {where})", ATOM, True), True
        code = _step(scope, code, step, type_)
        type_ = step.type
    if not sure:
        check = "whole" if is_tree(type_) else "known"
        code = Code(f"{check}({code.text}, {name}, {where})", ATOM, True)
    return code


def _viewed(scope: Scope, place: core.Place) -> Code | None:
    """Compile a robot's variable as claims read it; None for the robot's own variables.
    [PROP-READ]
    """
    variable = place.variable
    if place.primed:
        return Code(f"self.after[{string(scope.names.attribute(variable, scope.agent))}]")
    if place.robot is None:
        return None
    held = tuple_of(_held_by(scope.names, number, variable) for number in _kinds(scope))
    return _call(
        "self.held",
        [expression(scope, place.robot), Code(held), Code(scope.place(place.robot.span))],
        faults=True,
    )


def _kinds(scope: Scope) -> range:
    return range(len(scope.names.program.agents))


def _held_by(names: PythonNames, kind: int, variable: core.Variable) -> str:
    """The attribute for a variable in one kind of robot: kinds may number a name differently."""
    agent = names.program.agents[kind]
    entries = (
        agent.locals
        if variable.home is Home.LOCAL
        else tuple(port.declaration for port in agent.ports)
    )
    named = [entry.variable for entry in entries if entry.variable.name == variable.name]
    same = [one for one in named if one.slot == variable.slot and one.type == variable.type]
    for one in (*same, *named):
        return string(names.attribute(one, kind))
    return "None"


def _step(scope: Scope, above: Code, step: core.Step, type_: Type) -> Code:
    """Compile the access to a part of a value of some type. [E-SELECT]"""
    match step:
        case core.FieldStep(position=number):
            name = field_name(scope.names, type_, number)
            return Code(f"{above.within(ATOM)}.{name}", ATOM, above.faults)
        case core.KeyStep(key=key):
            at_key = expression(scope, key)
            return _call("entry", [above, at_key, Code(scope.place(step.span))], faults=True)
        case core.IndexStep(index=index):
            position = expression(scope, index)
            if is_inside(scope, index, type_):
                text = f"{above.within(ATOM)}[{position.text}]"
                return Code(text, ATOM, above.faults)
            return _call("at", [above, position, Code(scope.place(step.span))], faults=True)
    assert_never(step)


def field_name(names: PythonNames, type_: Type, position: int) -> str:
    """The attribute of a record's field."""
    assert isinstance(type_, RecordType)
    return names.field(type_.fields[position][0])


def is_inside(scope: Scope, index: core.Expr, type_: Type) -> bool:
    """Return whether an index is surely in range for an array of that type."""
    if not isinstance(type_, ArrayType):
        return False
    match index:
        case core.Pid():
            return type_.size is Robots.ALL
        case core.Const(value=int(value)):
            return isinstance(type_.size, int) and 0 <= value < type_.size
        case core.Read(place=core.Place(variable=variable, steps=())):
            high = scope.ranges.get(variable.slot) if variable.home is Home.BOUND else None
            return high is not None and _at_most(high, type_.size)
        case _:
            return False


def _at_most(high: core.Expr, size: int | Robots) -> bool:
    """Return whether a loop's upper bound is surely at most an array's size."""
    match high:
        case core.Const(value=int(value)):
            return isinstance(size, int) and value <= size
        case core.NumAgents():
            return size is Robots.ALL
        case core.Builtin(op=ListOp.LENGTH, arguments=(over,)):
            return isinstance(over.type, ArrayType) and over.type.size == size
        case _:
            return False
