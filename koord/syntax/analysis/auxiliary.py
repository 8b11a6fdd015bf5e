"""Auxiliary variables, which nothing depends on but variables of their kind. [AUXILIARY]

A run that repeats itself need not come back to what they hold. This is read off the text on the
safe side: whatever is not plainly so counts as depended on. So are sensors of which some reading is
always allowed, whatever else is so: each promise that speaks of the reading bounds it, all of them
from the same side, or one alone says what it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from itertools import chain

from msgspec import Struct, field

from koord.syntax import core
from koord.syntax.analysis.definedness import Sure
from koord.syntax.core import BinaryOp, Direction, Home, UnaryOp, slot_in
from koord.syntax.system import System
from koord.syntax.types import FloatType, IntType
from koord.syntax.walk import nodes, operands, reached, statements, written


class _Bound(Enum):
    """The way in which a promise restricts a reading."""

    ABOVE = "it is larger than something"
    BELOW = "it is smaller than something"
    EQUAL = "it is something"


def always_met(system: System, kind: int) -> frozenset[int]:
    """The slots of sensors, of one kind of robot, with such readings.

    Their promises speak of no other reading.

    Sensors of models are none of these: what they read is worked out.
    """
    agent = system.program.agents[kind]
    modelled = {
        position
        for module in agent.modules
        if module.environment is not None
        for position in module.ports
    }
    promises = [promise for _, promise in promises_of(agent)]
    asked = [expr for contract in _contracts(agent) for expr in contract.requires]
    if not all(_is_sure(system, kind, expr) for expr in asked):
        return frozenset()
    found = set()
    for position, port in enumerate(agent.ports):
        slot = port.declaration.variable.slot
        about = [promise for promise in promises if slot in primed(promise)]
        bounds = [bound for p in about for bound in _bounds(system, kind, slot, p)]
        alike = len(set(bounds)) <= 1 and (_Bound.EQUAL not in bounds or len(bounds) == 1)
        is_open = port.direction is Direction.SENSOR and position not in modelled
        if is_open and None not in bounds and alike:
            found.add(slot)
    return frozenset(found)


def promises_of(agent: core.Agent) -> Iterator[tuple[core.Contract, core.Expr]]:
    """Yield the promises of contracts about readings, each with its contract."""
    for contract in _contracts(agent):
        yield from ((contract, promise) for promise in contract.ensures)


def primed(promise: core.Expr) -> frozenset[int]:
    """The slots of the ports that a promise reads after the turn."""
    return frozenset(
        node.variable.slot
        for node in nodes(promise)
        if isinstance(node, core.Place) and node.primed
    )


def _contracts(agent: core.Agent) -> Iterator[core.Contract]:
    for module in agent.modules:
        if module.environment is None:
            yield from module.contracts


def _bounds(system: System, kind: int, slot: int, promise: core.Expr) -> Iterator[_Bound | None]:
    """Yield the restrictions that a promise puts on a reading; None where it is not simple."""
    match promise:
        case core.Binary(op=BinaryOp.AND, left=left, right=right):
            yield from _bounds(system, kind, slot, left)
            yield from _bounds(system, kind, slot, right)
        case core.Binary(op=BinaryOp.IMPLIES, left=left, right=right):
            if primed(left) or not _is_sure(system, kind, left):
                yield None
            yield from _bounds(system, kind, slot, right)
        case core.Binary(op=op, left=left, right=right):
            for reading, other, bound in (
                (left, right, _Bound.BELOW),
                (right, left, _Bound.ABOVE),
            ):
                if _is_reading(slot, reading, op) and not primed(other):
                    sure = _is_sure(system, kind, other)
                    equal = op is BinaryOp.EQ
                    yield (_Bound.EQUAL if equal else bound) if sure else None
                    return
            yield None
        case _:
            yield None


def _is_reading(slot: int, e: core.Expr, op: BinaryOp) -> bool:
    """Return whether an expression is the reading, in a comparison that a reading can meet."""
    if op not in (BinaryOp.EQ, BinaryOp.LT, BinaryOp.LE):
        return False
    if isinstance(e, core.Unary) and e.op is UnaryOp.WIDEN and op is not BinaryOp.EQ:
        e = e.operand  # beyond each real number there is an int
    if not isinstance(e, core.Read) or not isinstance(e.type, IntType | FloatType):
        return False
    place = e.place
    return (
        place.primed
        and place.variable.home is Home.PORT
        and place.variable.slot == slot
        and not place.steps
    )


def _is_sure(system: System, kind: int, e: core.Expr) -> bool:
    """Return whether an expression surely has a value, and asks for no answer."""
    asked = (core.Choose, core.ExternalCall)
    return Sure(system, kind).of(e) and not any(
        isinstance(node, asked) for node in reached(system.program, e)
    )


class Var(Struct, frozen=True):
    """A variable of a program: ``kind`` is that of the robots whose local or port it is."""

    home: Home
    kind: int | None
    slot: int


def auxiliary(system: System, stated: Iterable[core.Property]) -> frozenset[Var]:
    """The auxiliary variables: no round depends on them, nor do some liveness statements."""
    program = system.program
    reading = _Reading(system)
    for kind, agent in enumerate(program.agents):
        for event in agent.events:
            reading.use(event.guard, kind)
            for statement in statements(event.effect):
                reading.statement(statement, kind)
        for module in agent.modules:
            if module.environment is not None:
                reading.use((module.environment, module.contracts), kind)
        reading.promises(kind, agent)
    for each in (*stated, *program.expectations):
        reading.use((each.trigger, each.condition), None)
    return frozenset(variables(program)) - reading.depended_on()


def variables(program: core.Program) -> Iterator[Var]:
    """All variables of a program."""
    for kind, agent in enumerate(program.agents):
        yield from (Var(Home.LOCAL, kind, slot) for slot in range(len(agent.locals)))
        yield from (Var(Home.PORT, kind, slot) for slot in range(len(agent.ports)))
    yield from (Var(Home.ALLREAD, None, slot) for slot in range(len(program.allread)))
    yield from (Var(Home.ALLWRITE, None, slot) for slot in range(len(program.allwrite)))


def variables_of(program: core.Program, variable: core.Variable, kind: int | None) -> Iterator[Var]:
    """Yield the variables for an unbound one: in a property, one for each kind that has it."""
    match variable.home:
        case Home.BOUND:
            pass
        case Home.ALLREAD | Home.ALLWRITE:
            yield Var(variable.home, None, variable.slot)
        case Home.LOCAL | Home.PORT:
            for k in range(len(program.agents)) if kind is None else (kind,):
                slot = slot_in(program.agents[k], variable)
                if slot is not None:
                    yield Var(variable.home, k, slot)


class _Reading(Struct, frozen=True):
    """A data-flow analysis: variables that something depends on, and flows between variables."""

    system: System
    used: set[Var] = field(default_factory=set)
    flows: list[tuple[frozenset[Var], frozenset[Var]]] = field(default_factory=list)

    def use(self, part: object, kind: int | None) -> None:
        self.used.update(self._reads(part, kind))

    def statement(self, s: core.Stmt, kind: int) -> None:
        """Add the dependences of a statement itself, apart from those in it."""
        match s:
            case core.Assign(value=value) | core.Append(value=value) | core.Remove(value=value):
                self._written(s, value, kind)
            case core.Output(values=values) if not self._matters(s, values, kind):
                pass
            case _:
                self.use(tuple(operands(s)), kind)

    def promises(self, kind: int, agent: core.Agent) -> None:
        """Add the dependences of contracts, unless some reading always meets them."""
        met = always_met(self.system, kind)
        for contract, promise in promises_of(agent):
            read = (contract.requires, promise)
            about = primed(promise)
            if not about or not about <= met:
                self.use(read, kind)
                continue
            target = frozenset(Var(Home.PORT, kind, slot) for slot in about)
            self.flows.append((target, self._reads(read, kind)))

    def _written(self, s: core.Stmt, value: core.Expr, kind: int) -> None:
        """Add the flow into a written variable; it is used if something else can happen."""
        (place,) = written(s)
        if place.variable.home is Home.BOUND or self._matters(s, value, kind):
            self.use((place, value), kind)
            return
        self.use(place.steps, kind)
        target = frozenset(variables_of(self.system.program, place.variable, kind))
        self.flows.append((target, self._reads(value, kind)))

    def _matters(self, s: core.Stmt, evaluated: object, kind: int) -> bool:
        """Return whether a statement may fault, or may lack an answer."""
        asked = (core.Choose, core.ExternalCall)
        below = reached(self.system.program, evaluated)
        return not Sure(self.system, kind).of_statement(s) or any(
            isinstance(node, asked) for node in below
        )

    def depended_on(self) -> set[Var]:
        """The variables that matter, closed under the flows into them."""
        found = set(self.used)
        grows = True
        while grows:
            new = {x for targets, reads in self.flows if targets & found for x in reads - found}
            grows = bool(new)
            found |= new
        return found

    def _reads(self, part: object, kind: int | None) -> frozenset[Var]:
        nodes = reached(self.system.program, part)
        found = (node for node in nodes if isinstance(node, core.Variable))
        return frozenset(
            chain.from_iterable(variables_of(self.system.program, v, kind) for v in found)
        )
