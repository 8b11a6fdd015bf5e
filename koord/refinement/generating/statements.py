"""Random statements and blocks."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct

from koord.refinement.generating.drafts import Context
from koord.refinement.generating.expressions import expression, key, literal, step
from koord.refinement.generating.palette import Way, is_sure, typed_paths
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    GrowingType,
    MapType,
    Robots,
    SequenceType,
    Type,
)


def block(c: Context, nesting: int, *, least: int = 1) -> core.Block:
    """A few statements; what they bind is in scope for those behind them."""
    count = max(least, c.draft.between(c.draft.profile.statements))
    made: list[core.Stmt] = []
    for _ in range(count):
        made += statement(c, nesting)
    return tuple(made)


def statement(c: Context, nesting: int) -> list[core.Stmt]:
    """One statement, now and then with one that belongs before it."""
    depth = c.draft.profile.depth
    makers: list[tuple[float, Callable[[], list[core.Stmt]]]] = [
        (4.0, lambda: _assign(c, depth)),
        (0.8, lambda: _bind(c, depth)),
        (1.5, lambda: _on_list(c, depth)),
    ]
    if c.result is None and not c.in_property and c.may_lock:
        makers.append((0.3, lambda: [_signal(c, depth)]))
    if nesting > 0:
        makers += [
            (1.5, lambda: [_if(c, nesting)]),
            (0.8, lambda: [_for_range(c, nesting)]),
            (0.6, lambda: _for_each(c, nesting)),
        ]
        if c.may_lock and c.atomic is None:
            makers.append((1.2, lambda: [_atomic(c, nesting)]))
    if c.loops:
        makers.append((0.3, lambda: [_guarded(c, core.Break(span=c.draft.span()))]))
    if c.result is not None:
        result = c.result
        makers.append((0.4, lambda: [_guarded(c, _return(c, result))]))
    return c.draft.weighted(makers)()


def _return(c: Context, result: Type) -> core.Stmt:
    return core.Return(expression(c, result, c.draft.profile.depth - 1), span=c.draft.span())


def _guarded(c: Context, leaving: core.Stmt) -> core.Stmt:
    """A ``break`` or ``return``, mostly under a condition."""
    if c.draft.chance(0.15):
        return leaving
    condition = expression(c, BOOL, c.draft.profile.depth - 1)
    return core.If(condition, (leaving,), (), span=c.draft.span())


# --- assignment ---------------------------------------------------------------------------------


def _assign(c: Context, depth: int) -> list[core.Stmt]:
    place = writable(c, None, depth)
    if c.bound and (place is None or c.draft.chance(0.1)):
        place = writable_part(c, c.draft.pick(c.bound), depth)
    if place is None:
        return []
    value = expression(c, place.type, depth)
    return [core.Assign(place, value, span=c.draft.span())]


def _bind(c: Context, depth: int) -> list[core.Stmt]:
    """A local of the body, bound from here on in this block."""
    variable = c.slots.fresh(c.draft, c.draft.type())
    value = expression(c, variable.type, depth)
    c.bound.append(variable)
    place = core.Place(variable, span=c.draft.span())
    return [core.Assign(place, value, span=c.draft.span())]


def _on_list(c: Context, depth: int) -> list[core.Stmt]:
    """An append, remove or pop; or a key of a map is set or removed."""
    if c.draft.chance(0.3):
        return _on_map(c, depth)
    place = growing(c, depth)
    if place is None:
        return []
    type_ = place.type
    assert isinstance(type_, GrowingType)
    match c.draft.weighted([(3, "append"), (1, "remove"), (2, "pop")]):
        case "append":
            value = expression(c, type_.element, depth)
            added = core.Append(place, value, span=c.draft.span())
            return [_if_shorter(c, place, added) if c.draft.profile.finite else added]
        case "remove":
            value = expression(c, type_.element, depth)
            return [core.Remove(place, value, span=c.draft.span())]
        case _:
            into = writable(c, type_.element, depth) if c.draft.chance(0.6) else None
            popped = core.Pop(place, into, span=c.draft.span())
            careless = c.draft.chance(c.draft.profile.faulty * 2)
            return [popped if careless else _if_longer(c, place, popped)]


def _if_shorter(c: Context, place: core.Place, statement: core.Stmt) -> core.Stmt:
    limit = core.Const(2, INT, span=c.draft.span())
    return _if_length(c, statement, _length(c, place), limit)


def _if_longer(c: Context, place: core.Place, statement: core.Stmt) -> core.Stmt:
    zero = core.Const(0, INT, span=c.draft.span())
    return _if_length(c, statement, zero, _length(c, place))


def _if_length(c: Context, then: core.Stmt, left: core.Expr, right: core.Expr) -> core.Stmt:
    condition = core.Binary(BinaryOp.LT, left, right, BOOL, span=c.draft.span())
    return core.If(condition, (then,), (), span=c.draft.span())


def _length(c: Context, place: core.Place) -> core.Expr:
    whole = core.Read(place, span=c.draft.span())
    return core.Builtin(ListOp.LENGTH, (whole,), INT, span=c.draft.span())


def _on_map(c: Context, depth: int) -> list[core.Stmt]:
    types = [v.type for v in c.writable if isinstance(v.type, MapType)]
    if not types:
        return []
    type_ = c.draft.pick(types)
    assert isinstance(type_, MapType)
    place = writable(c, type_, depth)
    if place is None:
        return []
    if c.draft.chance(0.4):
        return [core.Remove(place, key(c, type_, depth), span=c.draft.span())]
    step = core.KeyStep(key(c, type_, depth), type_.value, span=c.draft.span())
    entry = core.Place(place.variable, (*place.steps, step), span=c.draft.span())
    return [core.Assign(entry, expression(c, type_.value, depth), span=c.draft.span())]


# --- control ------------------------------------------------------------------------------------


def _if(c: Context, nesting: int) -> core.Stmt:
    condition = expression(c, BOOL, c.draft.profile.depth)
    then = block(c.inner(), nesting - 1)
    otherwise = block(c.inner(), nesting - 1) if c.draft.chance(0.5) else ()
    return core.If(condition, then, otherwise, span=c.draft.span())


def _for_range(c: Context, nesting: int) -> core.Stmt:
    if not c.draft.profile.calculates:
        return _over_robots(c)
    inner = c.inner()
    inner.loops += 1
    variable = inner.slots.fresh(c.draft, INT)
    low, high = _bound(c, low=True), _bound(c, low=False)
    inner.bound.append(variable)
    return core.ForRange(variable, low, high, block(inner, nesting - 1), span=c.draft.span())


def _over_robots(c: Context) -> core.Stmt:
    """A loop over all robots in which each trip may do the same."""
    draft, inner = c.draft, c.inner()
    variable = inner.slots.fresh(draft, INT)
    inner.bound.append(variable)
    # As in a property, a robot's entries may be asked for by the loop's variable.
    inner.robots.append((variable, None))
    condition = expression(inner, BOOL, draft.profile.depth)
    then = _assign(c, 1)
    if draft.chance(0.4):
        then.append(core.Break(span=draft.span()))
    body = core.If(condition, tuple(then), (), span=draft.span())
    zero, everybody = core.Const(0, INT, span=draft.span()), core.NumAgents(INT, span=draft.span())
    return core.ForRange(variable, zero, everybody, (body,), span=draft.span())


def _bound(c: Context, *, low: bool) -> core.Expr:
    """A loop's bound: from constants, ``numAgents`` and lengths."""
    draft = c.draft
    if low:
        return core.Const(draft.pick((0, 0, 1)), INT, span=draft.span())
    lengths = [
        v
        for v in [*c.variables, *c.bound]
        if isinstance(v.type, SequenceType | MapType)
        and not (c.in_property and v.home in (Home.LOCAL, Home.PORT))
    ]
    if lengths and draft.chance(0.4):
        place = core.Place(draft.pick(lengths), span=draft.span())
        length = _length(c, place)
        if draft.chance(0.2):
            one = core.Const(1, INT, span=draft.span())
            return core.Binary(BinaryOp.SUB, length, one, INT, span=draft.span())
        return length
    if draft.chance(0.3):
        return core.NumAgents(INT, span=draft.span())
    return core.Const(draft.pick((1, 2, 2, 3)), INT, span=draft.span())


def _for_each(c: Context, nesting: int) -> list[core.Stmt]:
    draft = c.draft
    types: list[Type] = [
        t
        for t in [*(v.type for v in [*c.variables, *c.bound]), *draft.palette.all]
        if isinstance(t, SequenceType | MapType)
        and not (isinstance(t, ArrayType) and t.size is Robots.ALL and draft.chance(0.7))
    ]
    if not types:
        return []
    type_ = draft.pick(types)
    over = expression(c, type_, draft.profile.depth - 1)
    inner = c.inner()
    inner.loops += 1
    assert isinstance(type_, SequenceType | MapType)
    is_map = isinstance(type_, MapType)
    element = type_.value if isinstance(type_, MapType) else type_.element
    key_variable = None
    if is_map or draft.chance(0.4):
        key_type = type_.key if isinstance(type_, MapType) else INT
        key_variable = inner.slots.fresh(draft, key_type)
        inner.bound.append(key_variable)
    value_variable = inner.slots.fresh(draft, element)
    inner.bound.append(value_variable)
    body = block(inner, nesting - 1)
    return [core.ForEach(key_variable, value_variable, over, body, span=draft.span())]


def _atomic(c: Context, nesting: int) -> core.Stmt:
    """An atomic block of the class of the allwrite variables that it may write."""
    draft = c.draft
    inner = c.inner()
    inner.atomic = draft.pick(sorted({*c.classes.values(), 0}))
    c.entered.add(inner.atomic)
    return core.Atomic(inner.atomic, block(inner, nesting - 1), span=draft.span())


def _signal(c: Context, depth: int) -> core.Stmt:
    """An output, or a request to stop, mostly under a condition."""
    draft = c.draft
    stops: list[core.Stmt] = [core.Stop(span=draft.span()), core.TryStop(span=draft.span())]
    if draft.chance(0.5):
        types = [draft.type() for _ in range(draft.random.randint(1, 2))]
        values = tuple(expression(c, t, depth - 1) for t in types)
        return core.Output("stdout", values, span=draft.span())
    condition = expression(c, BOOL, depth)
    return core.If(condition, (draft.pick(stops),), (), span=draft.span())


# --- functions ----------------------------------------------------------------------------------


class FunctionType(Struct, frozen=True):
    """The signature of a function."""

    parameters: tuple[Type, ...]
    result: Type


def function(c: Context, name: str, signature: FunctionType) -> core.Function:
    """A function of that signature; ``c`` is the context of a body with nothing bound."""
    parameters = tuple(c.slots.fresh(c.draft, type_) for type_ in signature.parameters)
    c.bound += parameters
    if c.draft.chance(c.draft.profile.unset * 3):
        variable = c.slots.fresh(c.draft, c.draft.type())
        c.draft.unset.add(variable.name)
        c.bound.append(variable)
    c.result = signature.result
    body = block(c, 1, least=0)
    body = (*body, _return(c, signature.result))
    return core.Function(
        name, parameters, signature.result, body, c.slots.used, span=c.draft.span()
    )


__all__ = ["FunctionType", "block", "function", "literal", "statement"]


# --- places that are written ---------------------------------------------------------------------


def writable(c: Context, wanted: Type | None, depth: int) -> core.Place | None:
    """A place that may be written here: of a type, or of any."""
    daring = c.draft.chance(c.draft.profile.faulty * 3)
    found = [
        (variable, path)
        for variable in c.writable
        if _may_write(c, variable)
        for path, its_type in typed_paths(variable.type)
        if (wanted is None or its_type == wanted) and (path or variable.home is not Home.ALLREAD)
        if daring or is_sure(path) or (len(path) == 1 and path[0].way is Way.KEY)
    ]
    if not found:
        return None
    variable, path = c.draft.pick(found)
    steps = [step(c, stage, depth) for stage in path]
    if variable.home is Home.ALLREAD:
        steps[0] = core.IndexStep(core.Pid(INT), path[0].type, span=c.draft.span())
    return core.Place(variable, tuple(steps), span=c.draft.span())


def writable_part(c: Context, variable: core.Variable, depth: int) -> core.Place:
    """A bound variable or a part of it."""
    daring = c.draft.chance(c.draft.profile.faulty * 3)
    path, _ = c.draft.pick([p for p in typed_paths(variable.type) if daring or is_sure(p[0])])
    steps = tuple(step(c, stage, depth) for stage in path)
    return core.Place(variable, steps, span=c.draft.span())


def growing(c: Context, depth: int) -> core.Place | None:
    """A place of a list or queue that may be written here."""
    types = [
        its_type
        for variable in c.writable
        if _may_write(c, variable)
        for path, its_type in typed_paths(variable.type)
        if isinstance(its_type, GrowingType) and (path or variable.home is not Home.ALLREAD)
    ]
    return writable(c, c.draft.pick(types), depth) if types else None


def _may_write(c: Context, variable: core.Variable) -> bool:
    """Return whether a variable may be written: in an atomic block, only those of its class."""
    if variable.home is not Home.ALLWRITE or c.atomic is None:
        return True
    return c.classes.get(variable.slot) == c.atomic
