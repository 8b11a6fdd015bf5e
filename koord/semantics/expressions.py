"""Evaluation of expressions. [LOOKUP] and the rules of chapter 2, each cited where it stands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias, TypeVar, assert_never

from koord.semantics.configurations import FaultKind, Robot, Status
from koord.semantics.crowds import Crowd
from koord.semantics.domain import disjunction
from koord.semantics.machine import Machine, NotFiniteError
from koord.semantics.storage import (
    AtField,
    AtIndex,
    AtKey,
    Cell,
    Location,
    Storage,
    Tree,
    contents,
    descend,
    held,
    merge_storage,
    part_of,
)
from koord.semantics.values import (
    Family,
    Rec,
    Seq,
    Table,
    Value,
    default,
    equal,
    insert,
    inside,
    listed,
    lookup,
    merge_known,
    scalar,
    sequence,
)
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp
from koord.syntax.types import INT, ArrayType, Robots

V = TypeVar("V")

#: Low, high, the value that an integer stands for, and whether it counts.
Range: TypeAlias = "tuple[V, V, Callable[[V], Value[V]], Callable[[V], V]]"


def evaluate(m: Machine[V], e: core.Expr) -> Value[V]:
    """The value of an expression on the machine's memory. Total: faults are logged. [E-CONST]"""
    match e:
        case core.Read():
            return read(m, e.place)
        case core.Const():
            return m.d.const(e.value, e.type)
        case core.Binary():
            return binary(m, e)
        case core.Unary():
            return m.d.unary(e.op, scalar(evaluate(m, e.operand)))
        case core.Pid():
            return m.pid()
        case core.NumAgents():
            return m.count()
        case core.Delta():
            return m.d.const(m.system.delta_s, e.type)
        case core.Select():
            return select(m, e)
        case core.Builtin():
            return builtin(m, e)
        case core.MakeList():
            return listed(m.d, [evaluate(m, item) for item in e.items])
        case core.MakeRecord():
            return Rec(tuple(evaluate(m, part) for part in e.fields))
        case core.MakeMap():
            return make_map(m, e)
        case core.Call():
            # Calls run statements, so their rule stands with them.
            from koord.semantics.statements import call

            return call(m, e)
        case core.ExternalCall():
            return external_call(m, e)
        case core.Choose():
            return choose(m, e)
        case core.Quantified():
            return quantified(m, e)
        case core.Ran():
            return ran(m, e)
        case core.Stopped():
            return stopped(m, e)
    assert_never(e)


def condition(m: Machine[V], e: core.Expr) -> V:
    """The value of a Boolean expression."""
    return scalar(evaluate(m, e))


def statement(m: Machine[V], e: core.Expr) -> V:
    """Whether a statement of a property holds: true, and evaluated without a fault. [PROP-FAULT]"""
    faults, m.faults = m.faults, []
    holds = condition(m, e)
    for fault, _ in m.faults:
        holds = m.both(holds, m.negated(fault))
    m.faults = faults
    return holds


# --- operators ----------------------------------------------------------------------------------


def binary(m: Machine[V], e: core.Binary) -> Value[V]:
    """[E-EQUAL] [E-ARITH] [E-SHORT]"""
    match e.op:
        case BinaryOp.AND | BinaryOp.IMPLIES:
            left = condition(m, e.left)
            if m.d.known(left) is False:
                return m.truth(e.op is BinaryOp.IMPLIES)
            right = scalar(m.within(left, lambda: evaluate(m, e.right)))
            return m.d.binary(e.op, left, right)
        case BinaryOp.OR:
            left = condition(m, e.left)
            if m.d.known(left) is True:
                return m.truth(True)
            right = scalar(m.within(m.negated(left), lambda: evaluate(m, e.right)))
            return m.d.binary(e.op, left, right)
        case BinaryOp.EQ | BinaryOp.NE:
            same = equal(m.d, evaluate(m, e.left), evaluate(m, e.right))
            return same if e.op is BinaryOp.EQ else m.negated(same)
        case BinaryOp.DIV | BinaryOp.MOD:
            left, right = scalar(evaluate(m, e.left)), scalar(evaluate(m, e.right))
            zero = m.d.const(0, e.right.type)
            m.fault_unless(m.d.binary(BinaryOp.NE, right, zero), FaultKind.DIVISION, e.right.span)
            return m.d.binary(e.op, left, right)
        case _:
            left, right = scalar(evaluate(m, e.left)), scalar(evaluate(m, e.right))
            return m.d.binary(e.op, left, right)


def make_map(m: Machine[V], e: core.MakeMap) -> Value[V]:
    """[E-MAP]: of two entries with one key the later counts."""
    made: Table[V] = Table(m.d.const(0, INT), ())
    for key, value in e.entries:
        made = insert(m.d, made, evaluate(m, key), evaluate(m, value))
    return made


def builtin(m: Machine[V], e: core.Builtin) -> Value[V]:
    """[E-LIST]"""
    first = e.arguments[0]
    if e.op is ListOp.LENGTH and isinstance(first.type, ArrayType):
        # A fixed array's length is known without reading what may still be unset.
        size = first.type.size
        return m.count() if size is Robots.ALL else m.d.const(size, INT)
    value = evaluate(m, first)
    match e.op:
        case ListOp.LENGTH:
            assert isinstance(value, Seq | Table)
            return value.length
        case ListOp.CONTAINS:
            return contains(m, value, evaluate(m, e.arguments[1]))
        case ListOp.ANY | ListOp.ALL:
            return any_or_all(m, e.op, sequence(value))
        case ListOp.MIN | ListOp.MAX:
            return extreme(m, e, sequence(value))
    assert_never(e.op)


def contains(m: Machine[V], value: Value[V], wanted: Value[V]) -> V:
    """Whether a list has an element, or a map a key."""
    if isinstance(value, Table):
        entries: Table[V] = value
        found_key, _ = lookup(m.d, entries, wanted)
        return found_key
    items = sequence(value)
    if isinstance(items, Family):
        family: Family[V] = items
        return m.negated(family.every(lambda item: m.negated(equal(m.d, item, wanted))))
    found = [
        m.both(inside(m.d, k, items.length), equal(m.d, item, wanted))
        for k, item in enumerate(items.items)
    ]
    return disjunction(m.d, found)


def any_or_all(m: Machine[V], op: ListOp, items: Seq[V]) -> V:
    """Whether some or every element of a list of Booleans is true."""
    if isinstance(items, Family):
        family: Family[V] = items
        if op is ListOp.ALL:
            return family.every(scalar)
        return m.negated(family.every(lambda item: m.negated(scalar(item))))
    result = m.truth(op is ListOp.ALL)
    for k, item in enumerate(items.items):
        here = inside(m.d, k, items.length)
        if op is ListOp.ANY:
            result = m.either(result, m.both(here, scalar(item)))
        else:
            result = m.both(result, m.d.binary(BinaryOp.IMPLIES, here, scalar(item)))
    return result


def extreme(m: Machine[V], e: core.Builtin, items: Seq[V]) -> V:
    """The least or greatest element of a list of numbers; of an empty one a fault."""
    some = m.d.binary(BinaryOp.LT, m.d.const(0, INT), items.length)
    m.fault_unless(some, FaultKind.EMPTY, e.span)
    op = BinaryOp.MIN if e.op is ListOp.MIN else BinaryOp.MAX
    if isinstance(items, Family):
        family: Family[V] = items
        return extreme_of_all(op, family)
    if not items.items:
        nothing: V = scalar(default(m.d, e.type, m.system.size))
        return nothing
    best = scalar(items.items[0])
    for k, item in enumerate(items.items[1:], start=1):
        better = m.d.binary(op, best, scalar(item))
        best = scalar(merge_known(m.d, inside(m.d, k, items.length), better, best))
    return best


def extreme_of_all(op: BinaryOp, items: Family[V]) -> V:
    """The least or greatest element of an array over a crowd."""
    crowd: Crowd[V] = items.crowd
    best: V = crowd.extreme(op, crowd.first, crowd.count, lambda i: scalar(items.at(i)))
    return best


# --- places -------------------------------------------------------------------------------------


def read(m: Machine[V], place: core.Place) -> Value[V]:
    """The value at a place. [LOOKUP]"""
    storage = root(m, place)
    type_ = place.variable.type
    steps = list(place.steps)
    while steps and isinstance(storage, Tree):
        step = steps.pop(0)
        below, legal = descend(m.d, storage, located(m, step))
        m.fault_unless(legal, FaultKind.INDEX, step.span)
        type_ = step.type
        if below is None:
            return default(m.d, place.type, m.system.size)
        storage = below
    value, is_set = contents(m.d, storage, type_)
    m.fault_unless(is_set, FaultKind.UNSET, place.span, place.variable.name)
    return parts(m, value, tuple(steps))


def parts(m: Machine[V], value: Value[V], steps: tuple[core.Step, ...]) -> Value[V]:
    """A part of a value, some steps below it. [E-SELECT]"""
    for step in steps:
        location = located(m, step)
        below, legal = part_of(m.d, value, location)
        kind = FaultKind.KEY if isinstance(location, AtKey) else FaultKind.INDEX
        m.fault_unless(legal, kind, step.span)
        value = below if below is not None else default(m.d, step.type, m.system.size)
    return value


def located(m: Machine[V], step: core.Step) -> Location[V]:
    """A step with its index or key evaluated."""
    match step:
        case core.FieldStep():
            return AtField(step.position)
        case core.IndexStep():
            return AtIndex(scalar(evaluate(m, step.index)))
        case core.KeyStep():
            return AtKey(evaluate(m, step.key))
    assert_never(step)


def select(m: Machine[V], e: core.Select) -> Value[V]:
    """A part of a computed value. [E-SELECT]"""
    return parts(m, evaluate(m, e.base), (e.step,))


def root(m: Machine[V], place: core.Place) -> Storage[V]:
    """What a place's variable holds: from ``M`` in a turn, from the view in a property."""
    variable = place.variable
    if variable.home is Home.BOUND:
        cell = m.memory.bound[variable.slot]
        if cell is None:
            return Cell(m.truth(False), default(m.d, variable.type, m.system.size))
        return cell
    if m.view is not None:
        return viewed(m, place)
    match variable.home:
        case Home.LOCAL:
            return m.memory.locals[variable.slot]
        case Home.PORT:
            return (m.memory.after if place.primed else m.memory.ports)[variable.slot]
        case Home.ALLREAD:
            return m.memory.allread[variable.slot]
        case Home.ALLWRITE:
            return m.memory.allwrite[variable.slot]


def viewed(m: Machine[V], place: core.Place) -> Storage[V]:
    """The storage of a variable in the configuration that a property is about. [PROP-READ]"""
    assert m.view is not None
    variable = place.variable
    if variable.home is Home.ALLREAD:
        return m.view.store.allread[variable.slot]
    if variable.home is Home.ALLWRITE:
        return m.view.store.allwrite[variable.slot]
    assert place.robot is not None
    index = scalar(evaluate(m, place.robot))
    known = m.d.known(index)
    if isinstance(known, int) and 0 <= known < len(m.view.robots):
        storage = _of_robot(m, variable, m.view.robots[known])
        if storage is not None:
            return storage
    return at_robot(m, place, index)


def at_robot(m: Machine[V], place: core.Place, index: V) -> Storage[V]:
    """The storage of the robot that ``v@i`` names; no such robot is a fault."""
    assert m.view is not None
    assert place.robot is not None
    found = [
        (here, storage)
        for here, robot in those_at(m, index)
        if (storage := _of_robot(m, place.variable, robot)) is not None
    ]
    there = disjunction(m.d, [here for here, _ in found])
    m.fault_unless(there, FaultKind.INDEX, place.robot.span)
    if not found:
        return Cell(m.truth(False), default(m.d, place.variable.type, m.system.size))
    *others, (_, chosen) = found
    for here, storage in others:
        if m.d.known(here) is None:
            chosen = merge_storage(m.d, here, storage, chosen)
    return chosen


def those_at(m: Machine[V], index: V) -> Sequence[tuple[V, Robot[V]]]:
    """The robots that a number may be that of, each with the condition that it is. [PROP-READ]"""
    assert m.view is not None
    if m.view.at is not None:
        return m.view.at(index)
    numbered = enumerate(m.view.robots)
    return [(m.d.binary(BinaryOp.EQ, index, m.d.const(n, INT)), robot) for n, robot in numbered]


def _of_robot(m: Machine[V], variable: core.Variable, robot: Robot[V]) -> Storage[V] | None:
    """What a robot holds in a local or port; None for kinds without that variable."""
    slot = slot_in(m.system.program.agents[robot.kind], variable)
    storages = robot.locals if variable.home is Home.LOCAL else robot.ports
    return storages[slot] if slot is not None else None


def slot_in(agent: core.Agent, variable: core.Variable) -> int | None:
    """The slot of a local or port in one kind of robot: kinds may number a name differently."""
    declarations = (
        agent.locals
        if variable.home is Home.LOCAL
        else tuple(port.declaration for port in agent.ports)
    )
    if variable.slot < len(declarations):
        here = declarations[variable.slot].variable
        if here.name == variable.name and here.type == variable.type:
            return variable.slot
    for declaration in declarations:
        if declaration.variable.name == variable.name:
            return declaration.variable.slot
    return None


# --- what is left open --------------------------------------------------------------------------


def choose(m: Machine[V], e: core.Choose) -> Value[V]:
    """[CHOOSE]"""
    low, high = scalar(evaluate(m, e.low)), scalar(evaluate(m, e.high))
    m.fault_unless(m.d.binary(BinaryOp.LE, low, high), FaultKind.CHOICE, e.span)
    value = m.oracle.choose((e.site, *m.trail), low, high, e.type)
    between = m.both(m.d.binary(BinaryOp.LE, low, value), m.d.binary(BinaryOp.LE, value, high))
    # An empty range is a fault already; then any value will do.
    empty = m.d.binary(BinaryOp.LT, high, low)
    m.require("CHOOSE", m.either(empty, between), "a chosen value lies in its range", e.span)
    return value


def external_call(m: Machine[V], e: core.ExternalCall) -> Value[V]:
    """[EXTERNAL]: the answer is the oracle's; the summary is required of it."""
    function = m.system.program.external(e.function)
    arguments = tuple(evaluate(m, argument) for argument in e.arguments)
    answer = m.oracle.external(function, (e.site, *m.trail), arguments)
    if m.in_summary:
        # Summaries that mention external functions speak of them without summaries of their own.
        return answer
    bound = m.memory.bound
    known = [held(m.d, value) for value in (*arguments, answer)]
    m.memory.bound = [*known, *[None] * (function.bound - len(known))]
    m.in_summary = True
    m.trail.append(e.site)
    met = m.truth(True)
    for requirement in function.requires:
        holds = statement(m, requirement)
        m.fault_unless(holds, FaultKind.PRECONDITION, e.span, function.name)
        met = m.both(met, holds)
    promises = () if m.oracle.vouches_for(function) else function.ensures
    for promise in promises:
        holds = m.d.binary(BinaryOp.IMPLIES, met, statement(m, promise))
        what = f"the answer of {function.name} meets its summary"
        m.require("EXTERNAL", holds, what, promise.span)
    m.trail.pop()
    m.in_summary = False
    m.memory.bound = bound
    return answer


# --- properties ---------------------------------------------------------------------------------


def quantified(m: Machine[V], e: core.Quantified) -> Value[V]:
    """[E-QUANT]: over finitely many values, one after the other."""
    slot = e.variable.slot
    if isinstance(e.domain, core.AllValues):

        def body(value: Value[V]) -> V:
            m.memory.bound[slot] = held(m.d, value)
            return statement(m, e.body)

        assert e.quantifier is core.QuantifierKind.FORALL
        return m.oracle.every(e.domain.type, body)
    if m.system.crowd is not None and (over := span_of(m, e.domain)) is not None:
        return quantified_over(m, e, *over)
    universal = e.quantifier is core.QuantifierKind.FORALL
    result = m.truth(universal)
    for label, here, value in instances(m, e):
        m.system.patience.spend()
        # As with ``and`` and ``or``: what is decided already is not looked at.
        undecided = result if universal else m.negated(result)
        if m.d.known(undecided) is False:
            break
        m.memory.bound[slot] = held(m.d, value)
        relevant = m.both(undecided, here)
        m.trail.append(label)
        holds = scalar(m.within(relevant, lambda: evaluate(m, e.body)))
        m.trail.pop()
        if universal:
            result = m.both(result, m.d.binary(BinaryOp.IMPLIES, here, holds))
        else:
            result = m.either(result, m.both(here, holds))
    return result


def span_of(m: Machine[V], over: core.QuantifierDomain) -> Range[V] | None:
    """The integers that a quantifier in a crowd is about, where the domain cannot list them.

    With them the value that each stands for, and the condition under which it counts.
    """
    crowd: Crowd[V] | None = m.system.crowd
    assert crowd is not None
    match over:
        case core.RobotRange(agent=agent):
            kind = agent

            def counts(i: V) -> V:
                return m.truth(True) if kind is None else crowd.is_of(i, kind)

            return crowd.first, crowd.count, lambda i: i, counts
        case core.IntRange(low=low, high=high):
            start, end = scalar(evaluate(m, low)), scalar(evaluate(m, high))
            if listable(m, low, high, start, end):
                return None
            return start, end, lambda i: i, lambda i: m.truth(True)
        case core.Elements(sequence=elements):
            items = sequence(evaluate(m, elements))
            if not isinstance(items, Family):
                return None
            return crowd.first, crowd.count, items.at, lambda i: m.truth(True)
        case core.AllValues():
            return None


def quantified_over(
    m: Machine[V],
    e: core.Quantified,
    low: V,
    high: V,
    value: Callable[[V], Value[V]],
    counts: Callable[[V], V],
) -> V:
    """[E-QUANT] over integers that cannot be listed: what it gives, and where it faults.

    As with lists, a fault counts only if what comes before leaves the outcome undecided.
    """
    crowd: Crowd[V] | None = m.system.crowd
    assert crowd is not None
    universal = e.quantifier is core.QuantifierKind.FORALL

    def undecided(i: V) -> V:
        """Whether the trip for ``i`` leaves the outcome open."""
        holds, _ = looked_at(m, e, value(i))
        wanted = holds if universal else m.negated(holds)
        return m.d.binary(BinaryOp.IMPLIES, counts(i), wanted)

    def sound(i: V) -> V:
        _, faults = looked_at(m, e, value(i))
        if not faults:
            return m.truth(True)
        broken = m.both(counts(i), disjunction(m.d, faults))
        return m.negated(m.both(broken, crowd.every(low, i, undecided)))

    safe = crowd.every(low, high, sound)
    m.fault_unless(safe, FaultKind.UNSET, e.span, "in a quantifier")
    every = crowd.every(low, high, undecided)
    return every if universal else m.negated(every)


def looked_at(m: Machine[V], e: core.Quantified, value: Value[V]) -> tuple[V, list[V]]:
    """The body of a quantifier for one value: what it gives, and the conditions of its faults."""
    inner = m.apart()
    inner.memory.bound[e.variable.slot] = held(m.d, value)
    holds = scalar(evaluate(inner, e.body))
    crowd: Crowd[V] | None = m.system.crowd
    assert crowd is not None
    for needed in inner.legality:
        # Nothing is left open in a statement but functions, which answer alike everywhere.
        crowd.assume(needed.condition)
    return holds, [fault for fault, _ in inner.faults]


def instances(m: Machine[V], e: core.Quantified) -> Iterator[tuple[int, V, Value[V]]]:
    """The values of a bound variable, each with a number and the condition that it is one."""
    match e.domain:
        case core.RobotRange(agent=agent):
            for robot, kind in enumerate(m.system.kinds):
                if agent is None or kind == agent:
                    yield robot, m.truth(True), m.d.const(robot, INT)
        case core.IntRange(low=low, high=high):
            yield from integers(m, low, high)
        case core.Elements(sequence=over):
            items = sequence(evaluate(m, over))
            for k, item in enumerate(items.items):
                here = inside(m.d, k, items.length)
                if m.d.known(here) is not False:
                    yield k, here, item
        case core.AllValues():
            raise AssertionError("handled by the caller")


def integers(m: Machine[V], low: core.Expr, high: core.Expr) -> Iterator[tuple[int, V, V]]:
    """The integers from ``low`` up to and excluding ``high``, each with its condition.

    First as Python's own, which the keys of answers are made of. [RECORDING]
    """
    start, end = scalar(evaluate(m, low)), scalar(evaluate(m, high))
    first, last = limit(m, low, start, least=True), limit(m, high, end, least=False)
    for k in range(first, last):
        m.system.patience.spend()
        number = m.d.const(k, INT)
        above = m.d.binary(BinaryOp.LE, start, number)
        here = m.both(above, m.d.binary(BinaryOp.LT, number, end))
        if m.d.known(here) is not False:
            yield k, here, number


def listable(m: Machine[V], low: core.Expr, high: core.Expr, start: V, end: V) -> bool:
    """Whether the domain knows bounds of a range, so that its integers can be listed."""
    if m.system.crowd is None:
        return True
    try:
        limit(m, low, start, least=True)
        limit(m, high, end, least=False)
    except NotFiniteError:
        return False
    return True


def limit(m: Machine[V], e: core.Expr, value: V, *, least: bool) -> int:
    """A bound of an integer that the domain knows in part: itself, or from how it is built."""
    known = m.d.known(value)
    if known is not None:
        assert isinstance(known, int)
        return known
    match e:
        case core.Builtin(op=ListOp.LENGTH, arguments=(over,)):
            if least:
                return 0
            items = evaluate(m, over)
            assert isinstance(items, Seq | Table)
            return len(items.items if isinstance(items, Seq) else items.entries)
        case core.Binary(op=BinaryOp.ADD, left=left, right=right):
            values = scalar(evaluate(m, left)), scalar(evaluate(m, right))
            return limit(m, left, values[0], least=least) + limit(m, right, values[1], least=least)
        case core.Binary(op=BinaryOp.SUB, left=left, right=right):
            values = scalar(evaluate(m, left)), scalar(evaluate(m, right))
            return limit(m, left, values[0], least=least) - limit(
                m, right, values[1], least=not least
            )
        case _:
            raise NotFiniteError(e.span, "the range has no bound that is known beforehand")


def ran(m: Machine[V], e: core.Ran) -> Value[V]:
    """[PROP-RAN]: the robot's last program turn ran one of these events."""
    assert m.view is not None
    index = scalar(evaluate(m, e.robot))
    holds = []
    for here, robot in those_at(m, index):
        for kind, position in e.events:
            if kind == robot.kind:
                did = m.d.binary(BinaryOp.EQ, robot.ran, m.d.const(position, INT))
                holds.append(m.both(here, did))
    return disjunction(m.d, holds)


def stopped(m: Machine[V], e: core.Stopped) -> Value[V]:
    """[PROP-STOPPED]"""
    assert m.view is not None
    index = scalar(evaluate(m, e.robot))
    holds = []
    for here, robot in those_at(m, index):
        done = m.d.binary(BinaryOp.EQ, robot.status, m.d.const(int(Status.STOPPED), INT))
        holds.append(m.both(here, done))
    return disjunction(m.d, holds)
