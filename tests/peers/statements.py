"""Statements as C: reads are from the robot's own state, writes reach it and the store."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import ArrayType, ListType, MapType, QueueType, RecordType, Type
from tests.peers.bodies import Body
from tests.peers.shapes import ROOM, NotCoveredError

#: A step of a place whose indices and keys are evaluated: what kind, and the C name or position.
_Known = tuple[Literal["field", "index", "key"], str]


@dataclass(frozen=True)
class _Found:
    """A part of storage or of a value in C: the way to it, a pointer, what it points to."""

    lines: str
    pointer: str
    type: Type
    is_storage: bool


def block(body: Body, statements: core.Block) -> str:
    """[S-SEQ]"""
    return " ".join(f"{{ {statement(body, s)} }}" for s in statements)


def statement(body: Body, s: core.Stmt) -> str:
    """One statement, by the rules of chapter 3."""
    match s:
        case core.Assign(place=place, value=value):
            v = body.fresh()
            given = body.as_(value, place.type)
            return f"{body.shapes.value(place.type)} {v} = {given}; {write(body, place, v)}"
        case core.If(condition=condition, then=then, otherwise=otherwise):
            test = body.expr(condition)
            return f"if ({test}) {{ {block(body, then)} }} else {{ {block(body, otherwise)} }}"
        case core.ForRange(variable=variable, low=low, high=high, body=inner):
            i, end = body.fresh(), body.fresh()
            pointer = body.bind(variable)
            return (
                f"int {i} = {body.expr(low)}; int {end} = {body.expr(high)}; "
                f"for (; {i} < {end}; {i}++) {{ write0({pointer}, {i}); {block(body, inner)} }}"
            )
        case core.ForEach():
            return _for_each(body, s)
        case core.Break():
            return "break;"
        case core.Atomic(lock_class=number, body=inner):
            return f"cx->entered |= 1 << {number}; {block(body, inner)}"
        case core.Stop():
            return "cx->stop = STOPPED;"
        case core.TryStop():
            return "if (cx->stop == RUNNING) cx->stop = ASKED;"
        case core.Output(values=values):
            return " ".join(f"(void) {body.expr(value)};" for value in values)
        case core.Append() | core.Remove() | core.Pop():
            return _on_list(body, s)
        case core.Return(value=value):
            if value is None or body.result is None:
                raise NotCoveredError("a function without a result")
            return f"return {body.as_(value, body.result)};"


def _for_each(body: Body, s: core.ForEach) -> str:
    """[S-FOREACH]"""
    whole, i, type_ = body.fresh(), body.fresh(), s.sequence.type
    assert isinstance(type_, ArrayType | ListType | QueueType | MapType)
    element = type_.value if isinstance(type_, MapType) else type_.element
    item = body.converted(f"{whole}.items[{i}]", element, s.value.type)
    binds = f"write{body.shapes.number(s.value.type)}({body.bind(s.value)}, {item});"
    if s.key is not None:
        key = f"{whole}.keys[{i}]" if isinstance(type_, MapType) else i
        binds += f" write{body.shapes.number(s.key.type)}({body.bind(s.key)}, {key});"
    return (
        f"{body.shapes.value(type_)} {whole} = {body.expr(s.sequence)}; int {i}; "
        f"for ({i} = 0; {i} < {body.shapes.count(type_, whole)}; {i}++) "
        f"{{ {binds} {block(body, s.body)} }}"
    )


def _on_list(body: Body, s: core.Append | core.Remove | core.Pop) -> str:
    """[S-APPEND] [S-REMOVE] [S-POP]: the location written is the list."""
    type_, whole = s.place.type, body.fresh()
    assert isinstance(type_, ListType | QueueType | MapType)
    n = body.shapes.number(type_)
    read = f"{body.shapes.value(type_)} {whole} = {body.read(s.place)};"
    match s:
        case core.Append(value=value):
            assert not isinstance(type_, MapType)
            v = body.fresh()
            return (
                f"{body.shapes.value(type_.element)} {v} = {body.as_(value, type_.element)}; "
                f"{read} if ({whole}.n == {ROOM}) TOO_LARGE(); "
                f"{whole}.items[{whole}.n++] = {v}; {write(body, s.place, whole)}"
            )
        case core.Remove(value=value):
            v, i = body.fresh(), body.fresh()
            sought = type_.key if isinstance(type_, MapType) else type_.element
            among = "keys" if isinstance(type_, MapType) else "items"
            same = f"eq{body.shapes.number(sought)}({whole}.{among}[{i}], {v})"
            return (
                f"{body.shapes.value(sought)} {v} = {body.as_(value, sought)}; {read} int {i}; "
                f"for ({i} = 0; {i} < {whole}.n; {i}++) if ({same}) break; "
                f"if ({i} < {whole}.n) {{ drop{n}(&{whole}, {i}); {write(body, s.place, whole)} }}"
            )
        case core.Pop(into=into):
            assert not isinstance(type_, MapType)
            v = body.fresh()
            at = "0" if isinstance(type_, QueueType) else f"{whole}.n - 1"
            then = ""
            if into is not None:
                taken = body.converted(v, type_.element, into.type)
                w = body.fresh()
                then = f"{body.shapes.value(into.type)} {w} = {taken}; {write(body, into, w)}"
            return (
                f"{read} if ({whole}.n == 0) LEAVE(FAULT); "
                f"{body.shapes.value(type_.element)} {v} = {whole}.items[{at}]; "
                f"drop{n}(&{whole}, {at}); {write(body, s.place, whole)} {then}"
            )


# --- writing --------------------------------------------------------------------------------------


def write(body: Body, place: core.Place, value: str) -> str:
    """Write the C variable ``value``, of the place's type, to the place. [S-ASSIGN] [SHARED-ASSIGN]

    The store loses the write where the part is gone; for the robot itself that is a fault.
    """
    variable = place.variable
    lines, steps = _evaluated(body, place)
    own = body.home(place)
    if variable.home is Home.PORT:
        own = f"(&cx->out->a{body.kind}p{variable.slot})"
    lines += _put(body, _walk(body, own, variable.type, steps, "LEAVE(FAULT);"), value)
    if variable.home not in (Home.ALLREAD, Home.ALLWRITE):
        return lines
    letter = "r" if variable.home is Home.ALLREAD else "w"
    cut = next((n + 1 for n, (how, _) in enumerate(steps) if how == "key"), len(steps))
    if cut < len(steps):  # below a key the whole entry is the location
        entry = _walk(body, own, variable.type, steps[:cut], "LEAVE(FAULT);")
        value = body.fresh()
        lines += f" {entry.lines} {body.shapes.value(entry.type)} {value} = *{entry.pointer};"
    store = _walk(
        body, f"(&cx->store->{letter}{variable.slot})", variable.type, steps[:cut], "break;"
    )
    return f"{lines} do {{ {_put(body, store, value)} }} while (0);"


def _evaluated(body: Body, place: core.Place) -> tuple[str, list[_Known]]:
    """Indices and keys, from left to right."""
    lines, steps = "", list[_Known]()
    type_ = place.variable.type
    for step in place.steps:
        match step:
            case core.FieldStep(position=position):
                steps.append(("field", str(position)))
            case core.IndexStep(index=index):
                at = body.fresh()
                lines += f"int {at} = {body.expr(index)}; "
                steps.append(("index", at))
            case core.KeyStep(key=key):
                assert isinstance(type_, MapType)
                at = body.fresh()
                lines += f"{body.shapes.value(type_.key)} {at} = {body.as_(key, type_.key)}; "
                steps.append(("key", at))
        type_ = step.type
    return lines, steps


def _walk(body: Body, pointer: str, type_: Type, steps: list[_Known], missing: str) -> _Found:
    """To the part that is written; ``missing`` is what to do where there is none."""
    lines, is_storage = "", True
    for position, (how, name) in enumerate(steps):
        if is_storage and not isinstance(type_, RecordType | ArrayType):
            lines += f"if (!{pointer}->set) {missing} "
            pointer, is_storage = f"(&{pointer}->v)", False
        match how, type_:
            case "field", RecordType(fields=fields):
                pointer, type_ = f"(&{pointer}->f{name})", fields[int(name)][1]
            case "index", ArrayType() | ListType() | QueueType():
                size = str(body.shapes.size(type_)) if isinstance(type_, ArrayType) else None
                size = size or f"{pointer}->n"
                lines += f"if ({name} < 0 || {name} >= {size}) {missing} "
                pointer, type_ = f"(&{pointer}->items[{name}])", type_.element
            case "key", MapType():
                n, at = body.shapes.number(type_), body.fresh()
                if position + 1 == len(steps):
                    lines += f"int {at} = place{n}({pointer}, {name}); "
                else:
                    lines += f"int {at} = find{n}({pointer}, {name}); if ({at} < 0) {missing} "
                pointer, type_ = f"(&{pointer}->items[{at}])", type_.value
            case _:
                raise NotCoveredError(f"a step into {type(type_).__name__}")
    return _Found(lines, pointer, type_, is_storage)


def _put(body: Body, found: _Found, value: str) -> str:
    if found.is_storage:
        n = body.shapes.number(found.type)
        return f"{found.lines} write{n}({found.pointer}, {value});"
    return f"{found.lines} *{found.pointer} = {value};"


# --- functions ------------------------------------------------------------------------------------


def function(body: Body, made: core.Function) -> str:
    """A C function for a Koord one; without a result it is a fault. [E-CALL]"""
    if made.result is None:
        raise NotCoveredError("a function without a result")
    body.result = made.result
    bound = _parameters(body, made.parameters)
    text = block(body, made.body)
    return (
        f"static {body.shapes.value(made.result)} f_{made.name}({_heading(body, made.parameters)}) "
        f"{{ {body.declarations()} {bound} {text} LEAVE(FAULT); }}"
    )


def _heading(body: Body, parameters: tuple[core.Variable, ...]) -> str:
    given = [f"{body.shapes.value(p.type)} a{n}" for n, p in enumerate(parameters)]
    return ", ".join(["struct Context *cx", *given])


def _parameters(body: Body, parameters: tuple[core.Variable, ...]) -> str:
    return " ".join(
        f"write{body.shapes.number(p.type)}({body.bind(p)}, a{n});"
        for n, p in enumerate(parameters)
    )


def external(body: Body, made: core.External) -> str:
    """A C function that asks for an answer and checks it against the summary. [EXTERNAL]"""
    if made.kind is not core.ExternalKind.FRESH:
        raise NotCoveredError("a mathematical function")
    n, pointer = body.shapes.number(made.result.type), body.bind(made.result)
    lines = [_parameters(body, made.parameters), "int held;"]
    lines += [f"HOLDS(held, {body.expr(e)}); if (!held) LEAVE(FAULT);" for e in made.requires]
    answer = body.arbitrary(made.result.type)
    lines.append(f"{body.shapes.value(made.result.type)} answer = {answer};")
    lines.append(f"write{n}({pointer}, answer);")
    lines += [f"HOLDS(held, {body.expr(e)}); if (!held) LEAVE(ILLEGAL);" for e in made.ensures]
    return (
        f"static {body.shapes.value(made.result.type)} g_{made.name}"
        f"({_heading(body, made.parameters)}) "
        f"{{ {body.declarations()} {' '.join(lines)} return answer; }}"
    )
