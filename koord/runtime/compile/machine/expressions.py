"""Compilation of expressions to machine code, by the rules of chapter 2, or to doubt.

Numbers are those of the compiled robot to the last bit: doubles are rounded once by each operation,
and comparisons with a NaN come out as Python's do.
"""

from __future__ import annotations

from fractions import Fraction

from koord.machine.code import F64, I1, I64, Ir, real, word
from koord.runtime.compile.machine.body import Body, Cells, Frame, Position, Value
from koord.runtime.compile.machine.layout import Leaf, NoCodeError, leaves, part_at
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, UnaryOp
from koord.syntax.types import (
    ArrayType,
    FloatType,
    Robots,
    SequenceType,
    Type,
    is_by_robot,
    show,
)
from koord.syntax.walk import nodes

_LEAST, _GREATEST = -(2**63), 2**63 - 1

_CHECKED = {BinaryOp.ADD: "sadd", BinaryOp.SUB: "ssub", BinaryOp.MUL: "smul"}
_OF_FLOATS = {BinaryOp.ADD: "fadd", BinaryOp.SUB: "fsub", BinaryOp.MUL: "fmul"}


def expression(body: Body, e: core.Expr) -> Value:
    """Compile an expression. Raises NoCodeError for what has no machine code."""
    body.budget.spend(1)
    match e:
        case core.Const():
            return [_constant(body, e)]
        case core.Read(place=place):
            return read(body, place)
        case core.Binary():
            return [_binary(body, e)]
        case core.Unary():
            return [_unary(body, e)]
        case core.Pid() if body.watched is None:
            return [body.robot]
        case core.NumAgents():
            return [body.count]
        case core.Delta():
            return [body.delta]
        case core.Select(base=base, step=core.FieldStep(position=position, type=type_)):
            parts = expression(body, base)
            first = part_at(base.type, position)
            return parts[first : first + len(leaves(type_))]
        case core.Select(base=base, step=core.IndexStep(index=index, type=type_)):
            return _element(body, base, index, type_)
        case core.MakeRecord(fields=parts):
            leaves(e.type)
            return [leaf for part in parts for leaf in expression(body, part)]
        case core.MakeList(items=parts, type=ArrayType(size=int())):
            leaves(e.type)
            return [leaf for part in parts for leaf in expression(body, part)]
        case core.Builtin():
            return [_builtin(body, e)]
        case core.Call():
            return _call(body, e)
        case core.Quantified():
            return [_quantified(body, e)]
        case _:
            raise NoCodeError(type(e).__name__)


def truth(body: Body, e: core.Expr) -> Ir:
    """Compile a condition."""
    (found,) = expression(body, e)
    return found


def _constant(body: Body, e: core.Const) -> Ir:
    match leaves(e.type)[0]:
        case Leaf.FLOAT:
            assert not isinstance(e.value, str)
            return real(float(Fraction(e.value)))
        case Leaf.BOOL:
            return body.bit(bool(e.value))
        case Leaf.INT:
            assert isinstance(e.value, int)
            if not _LEAST <= e.value <= _GREATEST:
                raise NoCodeError("a number of more than 64 bits")
            return word(e.value)


# --- operators ------------------------------------------------------------------------------------


def _binary(body: Body, e: core.Binary) -> Ir:
    """Compile a binary operator. [E-ARITH] [E-SHORT]"""
    match e.op:
        case BinaryOp.AND:
            return _if_needed(body, e, wanted=True, else_=False)
        case BinaryOp.OR:
            return _if_needed(body, e, wanted=False, else_=True)
        case BinaryOp.IMPLIES:
            return _if_needed(body, e, wanted=True, else_=True)
        case BinaryOp.EQ:
            return _equal(body, e)
        case BinaryOp.NE:
            return body.b.not_(_equal(body, e))
    (left,), (right,) = expression(body, e.left), expression(body, e.right)
    if isinstance(e.left.type, FloatType):
        return _of_floats(body, e.op, left, right)
    return _of_ints(body, e.op, left, right)


def _if_needed(body: Body, e: core.Binary, *, wanted: bool, else_: bool) -> Ir:
    """The right operand where the left is what is wanted, and elsewhere a constant. [E-SHORT]"""
    left = truth(body, e.left)
    found = body.code.slot(I1)
    body.b.store(body.bit(else_), found)
    with body.code.only_if(left if wanted else body.b.not_(left)):
        body.b.store(truth(body, e.right), found)
    return body.b.load(found)


def _equal(body: Body, e: core.Binary) -> Ir:
    """Compile an equality. [E-EQUAL]"""
    kinds = leaves(e.left.type)
    if len(leaves(e.right.type)) != len(kinds):
        raise NoCodeError("arrays of different lengths")
    return _same(body, e.left.type, expression(body, e.left), expression(body, e.right))


def _same(body: Body, type_: Type, one: Value, other: Value) -> Ir:
    """Whether values are equal: all their leaves are, and a NaN equals nothing. [E-EQUAL]"""
    found = body.bit(True)
    for leaf, left, right in zip(leaves(type_), one, other, strict=True):
        if leaf is Leaf.FLOAT:
            same = body.b.fcmp_ordered("==", left, right)
        else:
            same = body.b.icmp_signed("==", left, right)
        found = body.b.and_(found, same)
    return found


def _of_floats(body: Body, op: BinaryOp, left: Ir, right: Ir) -> Ir:
    b = body.b
    match op:
        case BinaryOp.ADD | BinaryOp.SUB | BinaryOp.MUL:
            return getattr(b, _OF_FLOATS[op])(left, right)
        case BinaryOp.DIV:
            body.doubt_if(b.fcmp_ordered("==", right, real(0.0)))
            return b.fdiv(left, right)
        case BinaryOp.LT:
            return b.fcmp_ordered("<", left, right)
        case BinaryOp.LE:
            return b.fcmp_ordered("<=", left, right)
        case BinaryOp.MIN:  # of equal ones the first, as Python has it
            return b.select(b.fcmp_ordered("<", right, left), right, left)
        case BinaryOp.MAX:
            return b.select(b.fcmp_ordered(">", right, left), right, left)
        case _:
            raise NoCodeError(op.value)


def _of_ints(body: Body, op: BinaryOp, left: Ir, right: Ir) -> Ir:
    b = body.b
    match op:
        case BinaryOp.ADD | BinaryOp.SUB | BinaryOp.MUL:
            return checked(body, op, left, right)
        case BinaryOp.DIV | BinaryOp.MOD:
            return _divided(body, op, left, right)
        case BinaryOp.LT:
            return b.icmp_signed("<", left, right)
        case BinaryOp.LE:
            return b.icmp_signed("<=", left, right)
        case BinaryOp.MIN:
            return b.select(b.icmp_signed("<", right, left), right, left)
        case BinaryOp.MAX:
            return b.select(b.icmp_signed(">", right, left), right, left)
        case _:
            raise NoCodeError(op.value)


def checked(body: Body, op: BinaryOp, left: Ir, right: Ir) -> Ir:
    """Compute with whole numbers. In doubt where the result has more than 64 bits. [E-ARITH]"""
    pair = getattr(body.b, f"{_CHECKED[op]}_with_overflow")(left, right)
    body.doubt_if(body.b.extract_value(pair, 1))
    return body.b.extract_value(pair, 0)


def _divided(body: Body, op: BinaryOp, left: Ir, right: Ir) -> Ir:
    """Divide whole numbers and round down; the remainder has the divisor's sign. [E-ARITH]"""
    b = body.b
    body.doubt_if(b.icmp_signed("==", right, word(0)))
    too_large = b.and_(
        b.icmp_signed("==", left, word(_LEAST)), b.icmp_signed("==", right, word(-1))
    )
    body.doubt_if(too_large)
    rest = b.srem(left, right)
    signs_differ = b.icmp_signed("<", b.xor(rest, right), word(0))
    is_off = b.and_(b.icmp_signed("!=", rest, word(0)), signs_differ)
    if op is BinaryOp.MOD:
        return b.select(is_off, b.add(rest, right), rest)
    whole = b.sdiv(left, right)
    return b.select(is_off, b.sub(whole, word(1)), whole)


def _unary(body: Body, e: core.Unary) -> Ir:
    b = body.b
    (operand,) = expression(body, e.operand)
    of_floats = isinstance(e.type, FloatType)
    match e.op:
        case UnaryOp.NOT:
            return b.not_(operand)
        case UnaryOp.WIDEN:
            return b.sitofp(operand, F64)
        case UnaryOp.NEG:
            return b.fneg(operand) if of_floats else checked(body, BinaryOp.SUB, word(0), operand)
        case UnaryOp.ABS if of_floats:
            return body.code.known("llvm.fabs.f64", F64, [operand])
        case UnaryOp.ABS:
            turned = checked(body, BinaryOp.SUB, word(0), operand)
            return b.select(b.icmp_signed("<", operand, word(0)), turned, operand)


# --- arrays over robots, and other arrays ---------------------------------------------------------


def _builtin(body: Body, e: core.Builtin) -> Ir:
    """Compile a function of arrays, or of a list that is written there. [E-LIST]"""
    first = e.arguments[0]
    if e.op is ListOp.LENGTH and isinstance(first.type, ArrayType):
        size = first.type.size
        return body.count if size is Robots.ALL else word(size)
    if is_by_robot(first.type):
        return _over_robots(body, e.op, first)
    items, type_ = elements(body, first)
    if e.op is ListOp.LENGTH:
        return word(len(items))
    if e.op is ListOp.CONTAINS:
        wanted, found = expression(body, e.arguments[1]), body.bit(False)
        for item in items:
            found = body.b.or_(found, _same(body, type_, item, wanted))
        return found
    if not items:
        raise NoCodeError("an empty list")
    found = items[0][0]
    for item in items[1:]:
        found = _joined(body, e.op, type_, found, item[0])
    return found


def elements(body: Body, e: core.Expr) -> tuple[list[Value], Type]:
    """The elements of a fixed array, or of a list that is written there, and their type."""
    type_ = e.type
    if isinstance(e, core.MakeList) and isinstance(type_, SequenceType):
        leaves(type_.element)
        return [expression(body, item) for item in e.items], type_.element
    if not isinstance(type_, ArrayType):
        raise NoCodeError("a list")
    values, size = expression(body, e), len(leaves(type_.element))
    return [values[k : k + size] for k in range(0, len(values), size)], type_.element


def _element(body: Body, base: core.Expr, index: core.Expr, type_: Type) -> Value:
    """An element of what :func:`elements` has. In doubt if there is none. [E-SELECT] [LOOKUP]"""
    items, _ = elements(body, base)
    (at,) = expression(body, index)
    body.doubt_if(body.b.icmp_unsigned(">=", at, word(len(items))))
    size = len(leaves(type_))
    cells = body.local(type_, max(1, len(items)))
    for number, item in enumerate(items):
        body.store(cells, number * size, type_, item)
    return body.load(cells, at if size == 1 else body.b.mul(at, word(size)), type_)


def _joined(body: Body, op: ListOp, type_: Type, one: Ir, other: Ir) -> Ir:
    match op:
        case ListOp.ANY:
            return body.b.or_(one, other)
        case ListOp.ALL:
            return body.b.and_(one, other)
        case ListOp.MIN | ListOp.MAX:
            each = BinaryOp.MIN if op is ListOp.MIN else BinaryOp.MAX
            of = _of_floats if isinstance(type_, FloatType) else _of_ints
            return of(body, each, one, other)
        case _:
            raise NoCodeError(op.value)


def _over_robots(body: Body, op: ListOp, e: core.Expr) -> Ir:
    """A function of all entries of an allread variable. In doubt if any is not known. [LOOKUP]"""
    match e:
        case core.Read(place=core.Place(variable=variable, steps=(), robot=None, primed=False)):
            if variable.home is not Home.ALLREAD:
                raise NoCodeError("an array over robots")
        case _:
            raise NoCodeError("an array over robots")
    type_ = variable.own_type
    if len(leaves(type_)) != 1:
        raise NoCodeError(op.value)
    b, code = body.b, body.code
    body.doubt_if(b.icmp_signed("==", body.count, word(0)))
    (start,) = body.load(entry_cells(body, variable, word(0)), 0, type_)
    found = code.slot(start.type)
    b.store(start, found)
    with code.loop(word(1), body.count) as robot:
        (item,) = body.load(entry_cells(body, variable, robot), 0, type_)
        b.store(_joined(body, op, type_, b.load(found), item), found)
    return b.load(found)


# --- quantifiers ----------------------------------------------------------------------------------


def _quantified(body: Body, e: core.Quantified) -> Ir:
    """Compile a quantifier of a claim over robots or numbers; in order, as Python. [E-QUANT]"""
    watched, variable, b = body.watched, e.variable, body.b
    if watched is None or variable.slot in watched or body.frame.result is not None:
        raise NoCodeError("a quantifier")
    kind: int | None = None
    match e.domain:
        case core.RobotRange(agent=agent) if agent is None or len(body.program.agents) == 1:
            low, high = word(0), body.count
            kind = 0 if len(body.program.agents) == 1 else None
        case core.IntRange():
            (low,), (high,) = expression(body, e.domain.low), expression(body, e.domain.high)
        case _:
            raise NoCodeError("values of many kinds")
    is_forall = e.quantifier is core.QuantifierKind.FORALL
    found, trip = body.code.slot(I1), body.code.slot(I64)
    b.store(body.bit(is_forall), found)
    b.store(low, trip)
    head, inside, decided, after = (
        b.append_basic_block(name) for name in ("head", "body", "decided", "after")
    )
    b.branch(head)
    b.position_at_end(head)
    now = b.load(trip)
    b.cbranch(b.icmp_signed("<", now, high), inside, after)
    b.position_at_end(inside)
    body.store(body.bound(variable), 0, variable.type, [now])
    is_robot = isinstance(e.domain, core.RobotRange)
    watched[variable.slot] = (now if is_robot else None, kind)
    holds = truth(body, e.body)
    del watched[variable.slot]
    b.store(b.add(now, word(1)), trip)
    b.cbranch(holds, *((head, decided) if is_forall else (decided, head)))
    b.position_at_end(decided)
    b.store(body.bit(not is_forall), found)
    b.branch(after)
    b.position_at_end(after)
    return b.load(found)


# --- places ---------------------------------------------------------------------------------------


def read(body: Body, place: core.Place) -> Value:
    """Compile the read of a place. [LOOKUP]"""
    if (place.robot is not None and body.watched is None) or place.primed:
        raise NoCodeError("another robot's")
    cells, first, type_ = located(body, place)
    return body.load(cells, first, type_)


def located(body: Body, place: core.Place) -> tuple[Cells, Position, Type]:
    """Where a place is: its cells, the first of its leaves, and its type. [LOCATION]"""
    variable, steps = place.variable, place.steps
    match variable.home:
        case Home.BOUND:
            cells, type_ = body.bound(variable), variable.type
        case Home.ALLREAD:
            if not steps or not isinstance(steps[0], core.IndexStep):
                raise NoCodeError("a whole array over robots")
            (robot,) = expression(body, steps[0].index)
            if not isinstance(steps[0].index, core.Pid):
                body.doubt_if(body.b.icmp_unsigned(">=", robot, body.count))
            cells, type_ = entry_cells(body, variable, robot), variable.own_type
            steps = steps[1:]
        case Home.LOCAL | Home.PORT if body.watched is not None:
            cells, type_ = _held_cells(body, place), variable.type
        case _:
            cells, type_ = variable_cells(body, variable), variable.type
    first: Position = 0
    for step in steps:
        match step:
            case core.FieldStep(position=position):
                first = body.sum(first, part_at(type_, position))
            case core.IndexStep(index=index):
                if not isinstance(type_, ArrayType) or not isinstance(type_.size, int):
                    raise NoCodeError("an index into a list")
                (at,) = expression(body, index)
                body.doubt_if(body.b.icmp_unsigned(">=", at, word(type_.size)))
                size = len(leaves(type_.element))
                first = body.sum(first, at if size == 1 else body.b.mul(at, word(size)))
            case _:
                raise NoCodeError("a key")
        type_ = step.type
    return cells, first, type_


def variable_cells(body: Body, variable: core.Variable) -> Cells:
    """The cells of a local, a port or an allwrite variable."""
    column = body.layout.column(body.kind, variable)
    banked = body.banked.get(id(column))
    if banked is not None:
        return banked
    if variable.home is Home.ALLWRITE:
        return body.cells_at(body.shared, body.shared_flags, column.first)
    return body.cells_of(column, body.robot)


def _held_cells(body: Body, place: core.Place) -> Cells:
    """The cells of a variable of a robot that a claim names. [PROP-READ]

    In doubt if there is no such robot.
    """
    named, robot, kind = place.robot, None, None
    # The slots of functions that are written out are others.
    if body.watched is None or named is None or body.frame.result is not None:
        raise NoCodeError("nobody's")
    match named:
        case core.Read(place=core.Place(variable=core.Variable(home=Home.BOUND) as v, steps=())):
            robot, kind = body.watched.get(v.slot, (None, None))
    if robot is None and len(body.program.agents) == 1:
        kind = 0
        (robot,) = expression(body, named)
        body.doubt_if(body.b.icmp_unsigned(">=", robot, body.count))
    if robot is None or kind is None:
        raise NoCodeError("a robot of any kind")
    return body.cells_of(body.layout.column(kind, _of_kind(body, kind, place.variable)), robot)


def _of_kind(body: Body, kind: int, variable: core.Variable) -> core.Variable:
    """What robots of a kind have of a name. [PROP-READ]"""
    agent = body.program.agents[kind]
    for one in (*agent.locals, *(port.declaration for port in agent.ports)):
        if one.variable.name == variable.name and one.variable.type == variable.type:
            return one.variable
    raise NoCodeError("what robots of the kind do not have")


def entry_cells(body: Body, variable: core.Variable, robot: Ir) -> Cells:
    """The cells of a robot's entry of an allread variable: of its own, what the event wrote."""
    column = body.layout.column(body.kind, variable)
    theirs, own = body.cells_of(column, robot), body.banked.get(id(column))
    if own is None:
        return theirs
    if robot is body.robot:
        return own
    b = body.b
    is_own = b.icmp_signed("==", robot, body.robot)
    return Cells(
        b.select(is_own, own.words, theirs.words),
        b.select(is_own, own.flags, theirs.flags),
        lambda leaf: b.select(is_own, own.index(leaf), theirs.index(leaf)),
    )


# --- calls ----------------------------------------------------------------------------------------


def _call(body: Body, e: core.Call) -> Value:
    """Compile a call of a function: its body is written out. [E-CALL]"""
    function = body.program.function(e.function)
    if function.result is None:
        raise NoCodeError("a function without a result")
    arguments = [expression(body, argument) for argument in e.arguments]
    b = body.b
    result = body.local(function.result)
    # What returns nothing gives zeros; loops come here again.
    body.forget(result, function.result, flags=1)
    after = b.append_basic_block("returned")
    outer, outer_loops = body.frame, body.loops
    body.frame, body.loops = Frame({}, result, function.result, after), []
    for variable in _variables(function):
        body.forget(body.bound(variable), variable.type, flags=0)
    for parameter, value in zip(function.parameters, arguments, strict=True):
        body.store(body.bound(parameter), 0, parameter.type, value)
    body.block(body, function.body)
    b.branch(after)
    b.position_at_end(after)
    body.frame, body.loops = outer, outer_loops
    return body.load(result, 0, function.result)


def _variables(function: core.Function) -> list[core.Variable]:
    """The bound variables of a function; of those in one slot, one of each type."""
    found = [*function.parameters]
    found += [node for node in nodes(function.body) if isinstance(node, core.Variable)]
    bound = [one for one in found if one.home is Home.BOUND]
    return list({(one.slot, show(one.type)): one for one in bound}.values())
