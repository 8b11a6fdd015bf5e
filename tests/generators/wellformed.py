"""Whether a core program is one that elaboration could have made: every type agrees.

Independent of the generator, so that a mistake there is not taken for one of the semantics.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, UnaryOp
from koord.syntax.types import (
    BOOL,
    FLOAT,
    INT,
    ArrayType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    Robots,
    Type,
    show,
)


def complaints(program: core.Program) -> list[str]:
    """What is wrong with a program; empty if nothing is."""
    return list(_Checker(program).program_complaints())


def fits(actual: Type, expected: Type) -> bool:
    """Whether a value of one type may stand where the other is expected."""
    if actual == expected:
        return True
    if isinstance(expected, ListType) and isinstance(actual, ArrayType):
        return actual.element == expected.element
    return isinstance(expected, ArrayType) and _is_literal_of(actual, expected)


def _is_literal_of(actual: Type, expected: ArrayType) -> bool:
    return isinstance(actual, ArrayType) and actual.element == expected.element


@dataclass(slots=True)
class _Body:
    """What is allowed where statements and expressions stand."""

    bound: int
    agent: core.Agent | None = None
    in_property: bool = False
    in_function: bool = False
    in_loop: bool = False
    in_atomic: bool = False
    in_environment: bool = False
    primes: bool = False
    pid: bool = True


@dataclass(slots=True)
class _Checker:
    program: core.Program
    sites: set[int] = field(default_factory=set)

    def program_complaints(self) -> Iterator[str]:
        for agent in self.program.agents:
            yield from self._agent(agent)
        for function in self.program.functions:
            body = _Body(function.bound, in_function=True)
            yield from self._block(function.body, body)
        for external in self.program.externals:
            body = _Body(external.bound, in_property=True, pid=False)
            for e in (*external.requires, *external.ensures):
                yield from self._expect(e, BOOL, body)
        closed: tuple[core.Assumption | core.Property, ...] = (
            *self.program.assumptions,
            *self.program.properties,
        )
        for entry in closed:
            body = _Body(entry.bound, in_property=True, pid=False)
            yield from self._expect(entry.condition, BOOL, body)

    def _agent(self, agent: core.Agent) -> Iterator[str]:
        yield from self._block(agent.init, _Body(agent.init_bound, agent))
        for entry in (*agent.locals, *(port.declaration for port in agent.ports)):
            if not isinstance(entry.initial, core.Start):
                yield from self._expect(entry.initial, entry.variable.type, _Body(0, agent))
        for event in agent.events:
            body = _Body(event.bound, agent)
            yield from self._expect(event.guard, BOOL, body)
            yield from self._block(event.effect, body)
            entered = {s.lock_class for s in _statements(event.effect) if _is_atomic(s)}
            if not entered <= event.lock_classes:
                yield f"{event.name} enters {entered}, declared {event.lock_classes}"
        for module in agent.modules:
            yield from self._module(agent, module)

    def _module(self, agent: core.Agent, module: core.Module) -> Iterator[str]:
        if module.environment is not None:
            body = _Body(module.environment_bound, agent, in_environment=True)
            yield from self._block(module.environment, body)
        for contract in module.contracts:
            before = _Body(0, agent, in_environment=True)
            after = _Body(0, agent, in_environment=True, primes=True)
            for e in contract.requires:
                yield from self._expect(e, BOOL, before)
            for e in contract.ensures:
                yield from self._expect(e, BOOL, after)

    # --- statements -----------------------------------------------------------------------------

    def _block(self, block: core.Block, body: _Body) -> Iterator[str]:
        for statement in block:
            yield from self._statement(statement, body)

    def _inside(self, block: core.Block, body: _Body, *, atomic: bool = False) -> Iterator[str]:
        before = body.in_loop, body.in_atomic
        body.in_loop, body.in_atomic = not atomic or body.in_loop, atomic or body.in_atomic
        yield from self._block(block, body)
        body.in_loop, body.in_atomic = before

    def _statement(self, s: core.Stmt, body: _Body) -> Iterator[str]:
        match s:
            case core.Assign(place=place, value=value):
                yield from self._write(place, body)
                yield from self._expect(value, place.type, body)
            case core.If(condition=condition, then=then, otherwise=otherwise):
                yield from self._expect(condition, BOOL, body)
                yield from self._block(then, body)
                yield from self._block(otherwise, body)
            case core.ForRange():
                yield from self._expect(s.low, INT, body)
                yield from self._expect(s.high, INT, body)
                yield from self._inside(s.body, body)
            case core.ForEach():
                yield from self._for_each(s, body)
            case core.Break():
                if not body.in_loop:
                    yield "break outside of a loop"
            case core.Return(value=returned):
                if not body.in_function:
                    yield "return outside of a function"
                if returned is not None:
                    yield from self._expression(returned, body)
            case core.Atomic():
                if body.in_atomic:
                    yield "atomic inside atomic"
                yield from self._inside(s.body, body, atomic=True)
            case core.Output(values=values):
                for value in values:
                    yield from self._expression(value, body)
            case core.Append() | core.Remove() | core.Pop():
                yield from self._on_list(s, body)
            case core.Stop() | core.TryStop():
                pass

    def _for_each(self, s: core.ForEach, body: _Body) -> Iterator[str]:
        yield from self._expression(s.sequence, body)
        over = s.sequence.type
        key, value = _entries(over)
        if value != s.value.type or (s.key is not None and s.key.type != key):
            yield f"a loop over {show(over)} binds {show(s.value.type)}"
        yield from self._inside(s.body, body)

    def _on_list(self, s: core.Append | core.Remove | core.Pop, body: _Body) -> Iterator[str]:
        yield from self._write(s.place, body)
        key, value = _entries(s.place.type)
        if isinstance(s, core.Pop):
            if s.into is not None:
                yield from self._write(s.into, body)
                if s.into.type != value:
                    yield f"pop of {show(s.place.type)} into {show(s.into.type)}"
            return
        expected = key if isinstance(s.place.type, MapType) else value
        if expected is None:
            yield f"{show(s.place.type)} is no list"
        else:
            yield from self._expect(s.value, expected, body)

    def _write(self, place: core.Place, body: _Body) -> Iterator[str]:
        yield from self._place(place, body)
        home = place.variable.home
        if body.in_function and home is not Home.BOUND:
            yield f"a function writes {place.variable.name}"
        if body.in_environment and home not in (Home.PORT, Home.BOUND):
            yield f"an environment writes {place.variable.name}"
        if home is Home.ALLREAD:
            first = place.steps[0] if place.steps else None
            if not (isinstance(first, core.IndexStep) and isinstance(first.index, core.Pid)):
                yield f"allread {place.variable.name} is written elsewhere than at [pid]"

    # --- expressions ----------------------------------------------------------------------------

    def _expect(self, e: core.Expr, type_: Type, body: _Body) -> Iterator[str]:
        yield from self._expression(e, body)
        if not fits(e.type, type_):
            yield f"{show(e.type)} where {show(type_)} is expected: {e}"

    def _expression(self, e: core.Expr, body: _Body) -> Iterator[str]:
        match e:
            case core.Const() | core.NumAgents() | core.Delta():
                return
            case core.Pid():
                if not body.pid:
                    yield "pid in a property"
            case core.Read(place=place):
                yield from self._place(place, body)
            case core.Select(base=base, step=step):
                yield from self._expression(base, body)
                yield from self._step(base.type, step, body)
            case core.Unary():
                wanted: Type = INT if e.op is UnaryOp.WIDEN else e.type
                yield from self._expect(e.operand, wanted, body)
            case core.Binary():
                yield from self._binary(e, body)
            case core.Builtin():
                yield from self._builtin(e, body)
            case core.MakeList(items=items, type=type_):
                _, element = _entries(type_)
                for item in items:
                    assert element is not None
                    yield from self._expect(item, element, body)
            case core.MakeMap(entries=entries, type=type_):
                assert isinstance(type_, MapType)
                for key, value in entries:
                    yield from self._expect(key, type_.key, body)
                    yield from self._expect(value, type_.value, body)
            case core.MakeRecord(fields=fields, type=type_):
                assert isinstance(type_, RecordType)
                for (_, field_type), part in zip(type_.fields, fields, strict=True):
                    yield from self._expect(part, field_type, body)
            case core.Call() | core.ExternalCall():
                yield from self._call(e, body)
            case core.Choose():
                yield from self._site(e.site)
                yield from self._expect(e.low, e.type, body)
                yield from self._expect(e.high, e.type, body)
            case core.Quantified():
                yield from self._quantified(e, body)
            case core.Ran(robot=robot) | core.Stopped(robot=robot):
                yield from self._expect(robot, INT, body)

    def _binary(self, e: core.Binary, body: _Body) -> Iterator[str]:
        yield from self._expression(e.left, body)
        yield from self._expression(e.right, body)
        if not (fits(e.left.type, e.right.type) or fits(e.right.type, e.left.type)):
            yield f"{e.op} of {show(e.left.type)} and {show(e.right.type)}"
        logical = e.op in (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES)
        compares = e.op in (BinaryOp.EQ, BinaryOp.NE, BinaryOp.LT, BinaryOp.LE)
        if not (logical or compares) and e.left.type != e.type:
            yield f"{e.op} gives {show(e.type)}"
        if logical and e.left.type != BOOL:
            yield f"{e.op} of {show(e.left.type)}"
        if (
            e.op not in (BinaryOp.EQ, BinaryOp.NE)
            and not logical
            and e.left.type not in (INT, FLOAT)
        ):
            yield f"{e.op} of {show(e.left.type)}"

    def _builtin(self, e: core.Builtin, body: _Body) -> Iterator[str]:
        for argument in e.arguments:
            yield from self._expression(argument, body)
        key, value = _entries(e.arguments[0].type)
        if value is None:
            yield f"{e.op} of {show(e.arguments[0].type)}"
        elif e.op is ListOp.CONTAINS:
            is_map = isinstance(e.arguments[0].type, MapType)
            wanted = key if is_map else value
            if wanted is None or not fits(e.arguments[1].type, wanted):
                yield "contains of another type"
        elif e.op in (ListOp.MIN, ListOp.MAX) and value != e.type:
            yield f"{e.op} gives {show(e.type)}"

    def _call(self, e: core.Call | core.ExternalCall, body: _Body) -> Iterator[str]:
        yield from self._site(e.site)
        found: tuple[core.Function | core.External, ...] = (
            self.program.functions if isinstance(e, core.Call) else self.program.externals
        )
        function = next(f for f in found if f.name == e.function)
        for parameter, argument in zip(function.parameters, e.arguments, strict=True):
            yield from self._expect(argument, parameter.type, body)

    def _site(self, site: int) -> Iterator[str]:
        if site in self.sites:
            yield f"two calls or choices have the site {site}"
        self.sites.add(site)

    def _quantified(self, e: core.Quantified, body: _Body) -> Iterator[str]:
        match e.domain:
            case core.IntRange(low=low, high=high):
                yield from self._expect(low, INT, body)
                yield from self._expect(high, INT, body)
            case core.Elements(sequence=over):
                yield from self._expression(over, body)
                if _entries(over.type)[1] != e.variable.type:
                    yield "a quantifier over elements of another type"
            case core.RobotRange() | core.AllValues():
                pass
        yield from self._expect(e.body, BOOL, body)

    # --- places ---------------------------------------------------------------------------------

    def _place(self, place: core.Place, body: _Body) -> Iterator[str]:
        variable = place.variable
        if variable.home is Home.BOUND and variable.slot >= body.bound:
            yield f"{variable.name} has slot {variable.slot} of {body.bound}"
        if place.primed and not body.primes:
            yield f"{variable.name}' outside of ensures"
        of_robot = variable.home in (Home.LOCAL, Home.PORT)
        if body.in_property and of_robot and place.robot is None:
            yield f"{variable.name} of no robot"
        if place.robot is not None:
            yield from self._expect(place.robot, INT, body)
        type_ = variable.type
        for step in place.steps:
            yield from self._step(type_, step, body)
            type_ = step.type

    def _step(self, above: Type, step: core.Step, body: _Body) -> Iterator[str]:
        match step:
            case core.FieldStep(position=position):
                if not isinstance(above, RecordType) or above.fields[position][1] != step.type:
                    yield f"no such field in {show(above)}"
            case core.IndexStep(index=index):
                yield from self._expect(index, INT, body)
                if isinstance(above, MapType) or _entries(above)[1] != step.type:
                    yield f"no such element in {show(above)}"
            case core.KeyStep(key=key):
                if not isinstance(above, MapType) or above.value != step.type:
                    yield f"no such entry in {show(above)}"
                else:
                    yield from self._expect(key, above.key, body)


def _entries(type_: Type) -> tuple[Type | None, Type | None]:
    """The types of a container's indices or keys, and of what stands there."""
    match type_:
        case ArrayType(element=element) | ListType(element=element) | QueueType(element=element):
            return INT, element
        case MapType(key=key, value=value):
            return key, value
        case _:
            return None, None


def _is_atomic(s: core.Stmt) -> bool:
    return isinstance(s, core.Atomic)


def _statements(block: core.Block) -> Iterator[core.Atomic]:
    """Every atomic block at or below a block."""
    for s in block:
        match s:
            case core.Atomic():
                yield s
            case core.If(then=then, otherwise=otherwise):
                yield from _statements(then)
                yield from _statements(otherwise)
            case core.ForRange(body=body) | core.ForEach(body=body):
                yield from _statements(body)
            case _:
                pass


__all__ = ["Robots", "complaints", "fits"]
