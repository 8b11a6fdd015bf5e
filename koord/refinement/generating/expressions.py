"""Random expressions of a given type."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

from koord.refinement.generating.drafts import Context
from koord.refinement.generating.palette import Stage, Way, is_sure, typed_paths
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, UnaryOp
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    GrowingType,
    IntType,
    ListType,
    MapType,
    OpaqueType,
    RecordType,
    Robots,
    SequenceType,
    StreamType,
    StringType,
    Type,
)

Maker = Callable[[], core.Expr | None]

_FLOATS = (Fraction(0), Fraction(1), Fraction(1, 2), Fraction(-3, 2), Fraction(2))
_TEXTS = ("", "go", "stop")


def expression(c: Context, type_: Type, depth: int) -> core.Expr:
    """A random expression of a type. An array may stand where a list is asked for."""
    makers: list[tuple[float, Maker]] = [
        (1.0, lambda: literal(c, type_, depth)),
        (2.5, lambda: _read(c, type_, depth)),
    ]
    if depth > 0:
        makers += _operators(c, type_, depth - 1)
        makers += [
            (0.4, lambda: _call(c, type_, depth - 1)),
            (0.4, lambda: _external(c, type_, depth - 1)),
            (0.3, lambda: _select(c, type_, depth - 1)),
        ]
        if isinstance(type_, ListType):
            makers.append((0.5, lambda: _array_as_list(c, type_, depth)))
    made = c.draft.weighted(makers)()
    return made if made is not None else literal(c, type_, depth)


def literal(c: Context, type_: Type, depth: int) -> core.Expr:
    """A constant, or a literal of a record, list or map."""
    draft, span = c.draft, c.draft.span()
    match type_:
        case IntType():
            numbers = (-1, 0, 0, 1, 1, 2, 3) if draft.profile.calculates else (*(-1,) * 15, 0)
            return core.Const(draft.pick(numbers), INT, span=span)
        case FloatType():
            return core.Const(draft.pick(_FLOATS), FLOAT, span=span)
        case BoolType():
            return core.Const(draft.chance(0.5), BOOL, span=span)
        case StringType() | StreamType():
            return core.Const(draft.pick(_TEXTS), type_, span=span)
        case EnumType(members=members):
            return core.Const(draft.random.randrange(len(members)), type_, span=span)
        case RecordType(fields=fields):
            parts = tuple(expression(c, field, depth - 1) for _, field in fields)
            return core.MakeRecord(parts, type_, span=span)
        case ArrayType(element=element, size=size):
            # An array over robots is written out as a shorter one: the rest stays unset.
            count = size if isinstance(size, int) else 1
            items = tuple(expression(c, element, depth - 1) for _ in range(count))
            return core.MakeList(items, type_, span=span)
        case GrowingType(element=element):
            count = draft.weighted([(2, 0), (3, 1), (2, 2)])
            items = tuple(expression(c, element, depth - 1) for _ in range(count))
            return core.MakeList(items, type_, span=span)
        case MapType(key=key_type, value=value):
            count = draft.weighted([(1, 0), (2, 1), (2, 2)])
            pairs = [
                (literal(c, key_type, 0), expression(c, value, depth - 1)) for _ in range(count)
            ]
            return core.MakeMap(tuple(pairs), type_, span=span)
        case OpaqueType():
            raise AssertionError("no program text has opaque values")


def key(c: Context, above: Type, depth: int) -> core.Expr:
    """A key into a map: mostly a simple one, so that keys recur."""
    assert isinstance(above, MapType)
    if c.draft.profile.finite or c.draft.chance(0.7):
        return literal(c, above.key, 0)
    return expression(c, above.key, depth - 1)


def _read(c: Context, type_: Type, depth: int) -> core.Expr | None:
    place = readable(c, type_, depth)
    return core.Read(place, span=c.draft.span()) if place is not None else None


def _array_as_list(c: Context, type_: ListType, depth: int) -> core.Expr | None:
    sizes: tuple[int | Robots, ...] = (2, 3, Robots.ALL)
    size = c.draft.pick(sizes)
    return _read(c, ArrayType(type_.element, size), depth)


# --- places that are read ------------------------------------------------------------------------


def readable(c: Context, type_: Type, depth: int) -> core.Place | None:
    """A readable place of a type, if there is one."""
    daring = c.draft.chance(c.draft.profile.faulty)
    found = [
        (variable, path, False)
        for variable in [*c.variables, *c.bound]
        if _is_in_reach(c, variable) and (daring or variable.name not in c.draft.unset)
        for path, its_type in typed_paths(variable.type)
        if its_type == type_ and (daring or is_sure(path))
    ]
    found += [
        (variable, path, True)
        for variable in c.primed
        for path, its_type in typed_paths(variable.type)
        if its_type == type_
    ]
    if not found:
        return None
    variable, path, primed = c.draft.pick(found)
    steps = tuple(step(c, stage, depth) for stage in path)
    robot = _robot(c, variable) if c.in_property else None
    return core.Place(variable, steps, robot, primed, span=c.draft.span())


def _is_in_reach(c: Context, variable: core.Variable) -> bool:
    """Return whether a place is readable: in a property, locals and ports need a named robot."""
    if not c.in_property or variable.home not in (Home.LOCAL, Home.PORT):
        return True
    return bool(c.robots)


def _robot(c: Context, variable: core.Variable) -> core.Expr | None:
    if variable.home not in (Home.LOCAL, Home.PORT):
        return None
    kind = c.kinds.get((variable.home, variable.name))
    suitable = [bound for bound, agent in c.robots if agent == kind or kind is None]
    if not suitable or c.draft.chance(c.draft.profile.faulty / 2):
        suitable = [bound for bound, _ in c.robots]
    place = core.Place(c.draft.pick(suitable), span=c.draft.span())
    return core.Read(place, span=c.draft.span())


def step(c: Context, stage: Stage, depth: int) -> core.Step:
    span = c.draft.span()
    match stage.way:
        case Way.FIELD:
            return core.FieldStep(stage.position, f"field{stage.position}", stage.type, span=span)
        case Way.INDEX:
            return core.IndexStep(index(c, stage.above, depth), stage.type, span=span)
        case Way.KEY:
            return core.KeyStep(key(c, stage.above, depth), stage.type, span=span)


def index(c: Context, above: Type, depth: int) -> core.Expr:
    """An index into an array or list, mostly within its bounds."""
    draft = c.draft
    if draft.chance(draft.profile.faulty):
        return expression(c, INT, depth - 1)
    if isinstance(above, ArrayType) and above.size is Robots.ALL:
        names: list[core.Expr] = [
            core.Read(core.Place(bound, span=draft.span()), span=draft.span())
            for bound, _ in c.robots
        ]
        if c.pid:
            names += [core.Pid(INT, span=draft.span())] * 2
        if names and not draft.profile.calculates:
            return draft.pick(names)
        return draft.pick([*names, core.Const(0, INT, span=draft.span())])
    if isinstance(above, ArrayType):
        assert isinstance(above.size, int)
        if depth > 0 and draft.profile.calculates and draft.chance(0.3):
            return _within(c, above.size, depth)
        return core.Const(draft.random.randrange(above.size), INT, span=draft.span())
    counters = [b for b in c.bound if b.type == INT and draft.profile.calculates]
    if counters and draft.chance(0.4):
        return core.Read(core.Place(draft.pick(counters), span=draft.span()), span=draft.span())
    return core.Const(draft.weighted([(6, 0), (2, 1), (1, 2)]), INT, span=draft.span())


def _within(c: Context, size: int, depth: int) -> core.Expr:
    """A computed index that is within the bounds of an array of that size."""
    computed = expression(c, INT, depth - 1)
    limit = core.Const(size, INT, span=c.draft.span())
    return core.Binary(BinaryOp.MOD, computed, limit, INT, span=c.draft.span())


# --- operators ----------------------------------------------------------------------------------


def _operators(c: Context, type_: Type, depth: int) -> list[tuple[float, Maker]]:
    match type_:
        case IntType():
            return _on_ints(c, depth)
        case FloatType():
            return _on_floats(c, depth)
        case BoolType():
            return _on_bools(c, depth)
        case _:
            return []


def _on_ints(c: Context, depth: int) -> list[tuple[float, Maker]]:
    draft = c.draft

    def operand() -> core.Expr:
        return expression(c, INT, depth)

    def arithmetic() -> core.Expr:
        op = draft.pick((BinaryOp.ADD, BinaryOp.SUB, BinaryOp.MUL))
        made = core.Binary(op, operand(), operand(), INT, span=draft.span())
        if not draft.profile.finite:
            return made
        modulus = core.Const(draft.pick((2, 3)), INT, span=draft.span())
        return core.Binary(BinaryOp.MOD, made, modulus, INT, span=draft.span())

    def divided() -> core.Expr:
        op = draft.pick((BinaryOp.DIV, BinaryOp.MOD))
        return core.Binary(op, operand(), divisor(c, INT, depth), INT, span=draft.span())

    def bounded() -> core.Expr:
        op = draft.pick((BinaryOp.MIN, BinaryOp.MAX))
        return core.Binary(op, operand(), operand(), INT, span=draft.span())

    def signed() -> core.Expr:
        op = draft.pick((UnaryOp.NEG, UnaryOp.ABS))
        return core.Unary(op, operand(), INT, span=draft.span())

    if not draft.profile.calculates:
        return [(1.0, lambda: core.Pid(INT, span=draft.span()))] if c.pid else []
    makers: list[tuple[float, Maker]] = [
        (1.5, arithmetic),
        (0.6, divided),
        (0.5, bounded),
        (0.4, signed),
        (0.5, lambda: core.NumAgents(INT, span=draft.span())),
        (0.8, lambda: _length(c, depth)),
        (0.4, lambda: _extreme(c, INT, depth)),
    ]
    if c.pid:
        makers.append((1.0, lambda: core.Pid(INT, span=draft.span())))
    if c.choices:
        makers.append((1.0, lambda: choose(c, INT, depth)))
    return makers


def _on_floats(c: Context, depth: int) -> list[tuple[float, Maker]]:
    draft = c.draft

    def operand() -> core.Expr:
        return expression(c, FLOAT, depth)

    def arithmetic() -> core.Expr:
        op = draft.pick((BinaryOp.ADD, BinaryOp.SUB, BinaryOp.MUL))
        return core.Binary(op, operand(), operand(), FLOAT, span=draft.span())

    def divided() -> core.Expr:
        right = divisor(c, FLOAT, depth)
        return core.Binary(BinaryOp.DIV, operand(), right, FLOAT, span=draft.span())

    def bounded() -> core.Expr:
        op = draft.pick((BinaryOp.MIN, BinaryOp.MAX))
        return core.Binary(op, operand(), operand(), FLOAT, span=draft.span())

    def signed() -> core.Expr:
        op = draft.pick((UnaryOp.NEG, UnaryOp.ABS))
        return core.Unary(op, operand(), FLOAT, span=draft.span())

    def widened() -> core.Expr:
        inner = expression(c, INT, depth)
        return core.Unary(UnaryOp.WIDEN, inner, FLOAT, span=draft.span())

    makers: list[tuple[float, Maker]] = [
        (0.5, bounded),
        (0.4, signed),
        (0.5, widened),
        (0.4, lambda: core.Delta(FLOAT, span=draft.span())),
        (0.3, lambda: _extreme(c, FLOAT, depth)),
    ]
    if not draft.profile.finite:
        makers += [(1.5, arithmetic), (0.6, divided)]
        if c.choices:
            makers.append((1.0, lambda: choose(c, FLOAT, depth)))
    return makers


def _on_bools(c: Context, depth: int) -> list[tuple[float, Maker]]:
    draft = c.draft

    def connected() -> core.Expr:
        op = draft.pick((BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES))
        left, right = expression(c, BOOL, depth), expression(c, BOOL, depth)
        return core.Binary(op, left, right, BOOL, span=draft.span())

    def negated() -> core.Expr:
        return core.Unary(UnaryOp.NOT, expression(c, BOOL, depth), BOOL, span=draft.span())

    def compared() -> core.Expr:
        number: Type = FLOAT if FLOAT in draft.palette.scalars and draft.chance(0.4) else INT
        if number == INT and not draft.profile.calculates:
            return equated()
        op = draft.pick((BinaryOp.LT, BinaryOp.LE))
        left, right = expression(c, number, depth), expression(c, number, depth)
        return core.Binary(op, left, right, BOOL, span=draft.span())

    def equated() -> core.Expr:
        lists = [t for t in draft.palette.all if isinstance(t, GrowingType | MapType)]
        common = draft.weighted(
            [(2, draft.scalar()), (1.2, draft.type()), (0.8, draft.pick(lists))]
        )
        op = draft.pick((BinaryOp.EQ, BinaryOp.NE))
        left, right = expression(c, common, depth), expression(c, common, depth)
        return core.Binary(op, left, right, BOOL, span=draft.span())

    def any_or_all() -> core.Expr:
        op = draft.pick((ListOp.ANY, ListOp.ALL))
        whole = expression(c, ListType(BOOL), depth)
        return core.Builtin(op, (whole,), BOOL, span=draft.span())

    return [
        (1.2, connected),
        (0.5, negated),
        (1.2, compared),
        (1.2, equated),
        (0.4, any_or_all),
        (0.6, lambda: _contains(c, depth)),
    ]


def divisor(c: Context, type_: Type, depth: int) -> core.Expr:
    """A divisor: mostly a constant that is not zero."""
    draft = c.draft
    if draft.chance(draft.profile.faulty * 2):
        return expression(c, type_, depth)
    value = draft.pick((1, 2, 3, -2, 2))
    constant = Fraction(value) if type_ == FLOAT else value
    return core.Const(constant, type_, span=draft.span())


def choose(c: Context, type_: Type, depth: int) -> core.Expr:
    """A ``choose``: mostly with a small range that is not empty."""
    draft = c.draft
    site = draft.site()
    if draft.chance(draft.profile.faulty):
        low, high = expression(c, type_, depth), expression(c, type_, depth)
    else:
        bounds = draft.pick(((0, 1), (-1, 1), (1, 2), (0, 0)))
        low, high = (
            core.Const(Fraction(b) if type_ == FLOAT else b, type_, span=draft.span())
            for b in bounds
        )
    return core.Choose(low, high, type_, site, span=draft.span())


# --- lists --------------------------------------------------------------------------------------


def _containers(c: Context, kinds: tuple[type, ...]) -> list[Type]:
    declared = [v.type for v in [*c.variables, *c.bound]]
    return [t for t in [*declared, *c.draft.palette.all] if isinstance(t, kinds)]


def _length(c: Context, depth: int) -> core.Expr | None:
    types = _containers(c, (SequenceType, MapType))
    if not types:
        return None
    whole = expression(c, c.draft.pick(types), depth)
    if isinstance(whole.type, MapType):  # its keys are as many
        listed = ListType(whole.type.key)
        whole = core.Builtin(ListOp.KEYS, (whole,), listed, span=c.draft.span())
    return core.Builtin(ListOp.LENGTH, (whole,), INT, span=c.draft.span())


def _contains(c: Context, depth: int) -> core.Expr | None:
    types = _containers(c, (GrowingType, MapType))
    if not types:
        return None
    type_ = c.draft.pick(types)
    whole = expression(c, type_, depth)
    if isinstance(type_, MapType):
        wanted = key(c, type_, depth)
    else:
        assert isinstance(type_, GrowingType)
        wanted = expression(c, type_.element, depth)
    return core.Builtin(ListOp.CONTAINS, (whole, wanted), BOOL, span=c.draft.span())


def _extreme(c: Context, type_: Type, depth: int) -> core.Expr:
    op = c.draft.pick((ListOp.MIN, ListOp.MAX))
    if c.draft.chance(c.draft.profile.faulty * 2):
        whole: core.Expr = expression(c, ListType(type_), depth)
    else:
        items = tuple(expression(c, type_, depth - 1) for _ in range(c.draft.random.randint(1, 3)))
        whole = core.MakeList(items, ListType(type_), span=c.draft.span())
    return core.Builtin(op, (whole,), type_, span=c.draft.span())


# --- calls --------------------------------------------------------------------------------------


def _call(c: Context, type_: Type, depth: int) -> core.Expr | None:
    limit = c.calls
    if limit is None:
        return None
    suitable = [f for reach, f in c.draft.functions if f.result == type_ and reach <= limit]
    if not suitable:
        return None
    function = c.draft.pick(suitable)
    arguments = tuple(expression(c, p.type, depth) for p in function.parameters)
    return core.Call(function.name, arguments, type_, c.draft.site(), span=c.draft.span())


def _external(c: Context, type_: Type, depth: int) -> core.Expr | None:
    suitable = [f for f in c.draft.externals if f.result.type == type_] if c.externals else []
    if not suitable:
        return None
    function = c.draft.pick(suitable)
    arguments = tuple(expression(c, p.type, depth) for p in function.parameters)
    return core.ExternalCall(function.name, arguments, type_, c.draft.site(), span=c.draft.span())


def _select(c: Context, type_: Type, depth: int) -> core.Expr | None:
    """A part of a computed value."""
    draft = c.draft
    records = [
        (record, position)
        for record in draft.palette.all
        if isinstance(record, RecordType)
        for position, (_, field) in enumerate(record.fields)
        if field == type_
    ]
    if records and draft.chance(0.6):
        record, position = draft.pick(records)
        name = record.fields[position][0]
        step: core.Step = core.FieldStep(position, name, type_, span=draft.span())
        return core.Select(expression(c, record, depth), step, span=draft.span())
    if not draft.chance(draft.profile.faulty * 4):
        return None
    whole = ListType(type_)
    step = core.IndexStep(index(c, whole, depth), type_, span=draft.span())
    return core.Select(expression(c, whole, depth), step, span=draft.span())
