"""Compilation of statements to Python, by the rules of chapter 3."""

from __future__ import annotations

from typing import assert_never

from koord.runtime.compile.expressions import (
    expression,
    field_name,
    integers,
    is_inside,
    read,
    root,
)
from koord.runtime.compile.knowledge import assigned_slots
from koord.runtime.compile.naming import is_tree, shape, string, tuple_of
from koord.runtime.compile.scope import ATOM, NOT, OR, Code, Scope
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import ArrayType, MapType, QueueType, RecordType

Lines = list[str]

_INDENT = "    "

#: Of comments: what is longer says nothing at a glance.
_LONGEST_COMMENT = 50


def block(scope: Scope, statements: core.Block) -> Lines:
    """Compile statements in order; ``pass`` if there are none. [S-SEQ]"""
    lines = [line for s in statements for line in statement(scope, s)]
    return lines or ["pass"]


def indented(lines: Lines) -> Lines:
    """Indent lines by one level."""
    return [f"{_INDENT}{line}" if line else line for line in lines]


def statement(scope: Scope, s: core.Stmt) -> Lines:
    """Compile one statement."""
    match s:
        case core.Assign(place=place, value=value):
            return assign(scope, place, expression(scope, value))
        case core.If():
            return _if(scope, s)
        case core.ForRange():
            return _for_range(scope, s)
        case core.ForEach():
            return _for_each(scope, s)
        case core.Break():
            return ["break"]
        case core.Return(value=value):
            # [S-RETURN]
            return ["return" if value is None else f"return {expression(scope, value).text}"]
        case core.Atomic(lock_class=lock_class, body=body):
            # [ATOMIC]: entering is noted; who may enter is decided by the round.
            return [f"self.enter({lock_class})", *block(scope, body)]
        case core.Stop():
            return ["self.stop()"]
        case core.TryStop():
            return ["self.trystop()"]
        case core.Output(stream=stream, values=values):
            # [OUTPUT]
            shown = [expression(scope, value).text for value in values]
            arguments = ", ".join([string(stream), scope.place(s.span), *shown])
            return [f"self.output({arguments})"]
        case core.Append():
            return _append(scope, s)
        case core.Remove():
            return _remove(scope, s)
        case core.Pop():
            return _pop(scope, s)
    assert_never(s)


# --- assignment ---------------------------------------------------------------------------------


def assign(scope: Scope, place: core.Place, value: Code) -> Lines:
    """Compile a write: the value first, then the path to the place. [S-ASSIGN]"""
    variable = place.variable
    shared = variable.home in (Home.ALLREAD, Home.ALLWRITE)
    if not place.steps:
        _now_set(scope, variable)
        if shared:
            return [f"self.set({_name(scope, variable)}, {value.text})"]
        return [f"{_target(scope, variable)} = {value.text}"]
    path, places = _path(scope, place)
    tail = f"{value.text}, {path}{''.join(f', {p}' for p in places)}"
    if shared:
        return [*_said(scope, place), f"self.set({_name(scope, variable)}, {tail})"]
    if variable.home is Home.BOUND and not scope.is_sure(variable):
        scope.unset[variable.slot] = variable
    target = before = _target(scope, variable)
    if variable.home is Home.BOUND and not scope.is_sure(variable) and is_tree(variable.type):
        robots = "self.numAgents" if scope.in_method else "0"
        before = f"begun({target}, {shape(scope.names, variable.type)}, {robots})"
    match variable.type, place.steps:
        case RecordType(), (core.FieldStep(position=position),):
            field = field_name(scope.names, variable.type, position)
            return [f"{target} = {before}._replace({field}={value.text})"]
        case _:
            return [*_said(scope, place), f"{target} = put({before}, {tail})"]


def _name(scope: Scope, variable: core.Variable) -> str:
    return string(scope.names.attribute(variable, scope.agent))


def _target(scope: Scope, variable: core.Variable) -> str:
    """The target of an assignment: the environment's turn writes to its own variables.
    [ENV-MODEL]
    """
    if variable.home is Home.PORT and scope.in_environment:
        return scope.after[variable.slot]
    return root(scope, variable)


def _now_set(scope: Scope, variable: core.Variable) -> None:
    # In the environment's turn, what is written is not what is read. [ENV-MODEL]
    if variable.home is Home.BOUND or not scope.in_environment:
        scope.assigned.add((variable.home, variable.slot))


def _path(scope: Scope, place: core.Place) -> tuple[str, list[str]]:
    """The path to a part as a tuple, and the places of its steps if a step may fault."""
    parts, wrong = [], False
    where = [scope.place(place.span)]
    type_ = place.variable.type
    sure = scope.is_sure(place.variable)
    for number, step in enumerate(place.steps):
        if not isinstance(type_, RecordType | ArrayType):
            wrong = wrong or not sure
        match step:
            case core.FieldStep(position=position):
                parts.append(str(position))
            case core.IndexStep(index=index):
                parts.append(expression(scope, index).text)
                wrong = wrong or not is_inside(scope, index, type_)
            case core.KeyStep(key=key):
                parts.append(expression(scope, key).text)
                wrong = wrong or number + 1 < len(place.steps)
        where.append(scope.place(step.span))
        type_ = step.type
    if not wrong:
        return tuple_of(parts), []
    return tuple_of(parts), where if len(set(where)) > 1 else where[:1]


def _said(scope: Scope, place: core.Place) -> Lines:
    """A comment that names the fields for which a path has numbers."""
    if not any(isinstance(step, core.FieldStep) for step in place.steps):
        return []
    text, type_ = place.variable.name, place.variable.type
    for step in place.steps:
        match step:
            case core.FieldStep(position=position):
                text += f".{field_name(scope.names, type_, position)}"
            case core.IndexStep(index=inner) | core.KeyStep(key=inner):
                text += f"[{expression(scope, inner).text}]"
        type_ = step.type
    return [f"# {text}"] if len(text) <= _LONGEST_COMMENT and text.isprintable() else []


# --- control ------------------------------------------------------------------------------------


def _if(scope: Scope, s: core.If) -> Lines:
    """Compile ``if``. [S-IF]"""
    condition = expression(scope, s.condition)
    before = set(scope.assigned)
    then = block(scope, s.then)
    after_then = set(scope.assigned) if not _leaves(s.then) else None
    scope.assigned = set(before)
    otherwise = block(scope, s.otherwise) if s.otherwise else []
    after_else = scope.assigned if not _leaves(s.otherwise) else None
    ends = [after for after in (after_then, after_else) if after is not None]
    scope.assigned = set.intersection(*ends) if ends else before
    if not s.then and s.otherwise:
        return [f"if not {condition.within(NOT)}:", *indented(otherwise)]
    lines = [f"if {condition.text}:", *indented(then)]
    if not s.otherwise:
        return lines
    if len(s.otherwise) == 1 and isinstance(s.otherwise[0], core.If):
        return [*lines, f"el{otherwise[0]}", *otherwise[1:]]
    return [*lines, "else:", *indented(otherwise)]


def _leaves(statements: core.Block) -> bool:
    """Return whether control never reaches the end of a block."""
    return any(
        isinstance(s, core.Break | core.Return)
        or (isinstance(s, core.If) and _leaves(s.then) and _leaves(s.otherwise))
        or (isinstance(s, core.Atomic) and _leaves(s.body))
        for s in statements
    )


def _for_range(scope: Scope, s: core.ForRange) -> Lines:
    """Compile a loop over a range: bounds are evaluated once. [S-FOR]"""
    over = integers(expression(scope, s.low), expression(scope, s.high))
    name = scope.name(s.variable)
    written = s.variable.slot in assigned_slots(s.body)
    asks = scope.knowledge.asks(s.body)
    # The trip counts in keys, whatever the body makes of the variable.
    trip = scope.temporary("trip") if written and asks else name
    outer_ranges, outer_trail, outer = dict(scope.ranges), scope.trail, set(scope.assigned)
    if not written and _is_natural(s.low):
        scope.ranges[s.variable.slot] = s.high
    else:
        scope.ranges.pop(s.variable.slot, None)
    scope.trail = (*scope.trail, trip) if asks else scope.trail
    scope.assigned.add((Home.BOUND, s.variable.slot))
    body = block(scope, s.body)
    scope.ranges, scope.trail, scope.assigned = outer_ranges, outer_trail, outer
    first = [f"{name} = {trip}"] if trip != name else []
    return [f"for {trip} in {over.text}:", *indented([*first, *body])]


def _is_natural(e: core.Expr) -> bool:
    match e:
        case core.Const(value=int(value)):
            return value >= 0
        case core.Pid() | core.NumAgents():
            return True
        case _:
            return False


def _for_each(scope: Scope, s: core.ForEach) -> Lines:
    """Compile a loop over a value that is evaluated before the loop. [S-FOREACH]"""
    over = expression(scope, s.sequence)
    is_map = isinstance(s.sequence.type, MapType)
    asks = scope.knowledge.asks(s.body)
    value = scope.name(s.value)
    outer_ranges, outer_trail, outer = dict(scope.ranges), scope.trail, set(scope.assigned)
    if s.key is not None:
        head, what = f"{scope.name(s.key)}, {value}", f"{over.within(ATOM)}.items()"
        scope.ranges.pop(s.key.slot, None)
        scope.assigned.add((Home.BOUND, s.key.slot))
        if not is_map:
            what = f"enumerate({over.text})"
    else:
        head, what = value, f"{over.within(ATOM)}.values()" if is_map else over.text
    if asks:
        trip = scope.temporary("trip")
        inner = f"({head})" if s.key is not None else head
        head, what = f"{trip}, {inner}", f"enumerate({what})"
        scope.trail = (*scope.trail, trip)
    scope.ranges.pop(s.value.slot, None)
    scope.assigned.add((Home.BOUND, s.value.slot))
    body = block(scope, s.body)
    scope.ranges, scope.trail, scope.assigned = outer_ranges, outer_trail, outer
    return [f"for {head} in {what}:", *indented(body)]


# --- lists --------------------------------------------------------------------------------------


def _held_back(scope: Scope, value: Code, other: Code, name: str) -> tuple[Lines, Code]:
    """A value that the rules evaluate before ``other``, though Python would do it after."""
    if not (value.faults and other.faults):
        return [], value
    temporary = scope.temporary(name)
    return [f"{temporary} = {value.text}"], Code(temporary)


def _append(scope: Scope, s: core.Append) -> Lines:
    """Compile ``append``. [S-APPEND]"""
    items = read(scope, s.place)
    lines, value = _held_back(scope, expression(scope, s.value), items, "item")
    longer = Code(f"(*{items.within(ATOM)}, {value.within(OR)})", ATOM, True)
    return [*lines, *assign(scope, s.place, longer)]


def _remove(scope: Scope, s: core.Remove) -> Lines:
    """Compile ``remove``: it writes nothing if there is nothing to remove. [S-REMOVE]"""
    whole = read(scope, s.place)
    lines, value = _held_back(scope, expression(scope, s.value), whole, "item")
    is_map = isinstance(s.place.type, MapType)
    rest = f"{'without_key' if is_map else 'without'}({whole.text}, {value.text})"
    home = s.place.variable.home
    # A model writes what it does not read: nothing must not undo what it has written. [ENV-MODEL]
    in_model = home is Home.PORT and scope.in_environment
    if home not in (Home.ALLREAD, Home.ALLWRITE) and not in_model:
        return [*lines, *assign(scope, s.place, Code(rest, ATOM, True))]
    left = scope.temporary("rest")
    return [
        *lines,
        f"{left} = {rest}",
        f"if len({left}) < len({whole.text}):",
        *indented(assign(scope, s.place, Code(left))),
    ]


def _pop(scope: Scope, s: core.Pop) -> Lines:
    """Compile ``pop``. [S-POP]"""
    items = read(scope, s.place)
    name = "first_of" if isinstance(s.place.type, QueueType) else "last_of"
    popped = f"{name}({items.text}, {scope.place(s.span)})"
    if s.into is None:
        return assign(scope, s.place, Code(f"{popped}[1]", ATOM, True))
    taken, rest = scope.temporary("taken"), scope.temporary("rest")
    return [
        f"{taken}, {rest} = {popped}",
        *assign(scope, s.place, Code(rest)),
        *assign(scope, s.into, Code(taken)),
    ]
