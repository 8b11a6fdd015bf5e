"""Sorts for every integer of a system. [SYMMETRY]

See :mod:`koord.semantics.search.sorts` for what sorts are, and
:mod:`koord.semantics.search.symmetry` for why they show that robots may change places.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from koord.semantics.configurations import System
from koord.semantics.places import slot_in
from koord.semantics.search.loops import is_order_free
from koord.semantics.search.sorts import Entries, Fields, Items, Scalar, Shape, Sort, shape, unify
from koord.semantics.search.sureness import Sure, indices
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, ListOp, QuantifierKind, Start, UnaryOp
from koord.syntax.types import INT, Type

_CONNECTIVES = (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES)


@dataclass(slots=True)
class _Body:
    """Where expressions stand: whose body it is, and its bound variables' shapes.

    ``strict`` holds where a statement is false if the expression is: there it does not matter
    whether it is false or faults.
    """

    sure: Sure
    bound: dict[core.Variable, Shape] = field(default_factory=dict)
    result: Shape | None = None
    strict: bool = False

    @property
    def kind(self) -> int | None:
        return self.sure.kind


@dataclass(frozen=True, slots=True)
class _Range:
    """A range over all robots, if its variable turns out to be one; ``is_free`` of any order."""

    variable: Sort
    over: Sort | None  #: the index of the list over whose indices it goes
    is_free: bool


class Sorting:
    """The inference for one system and some properties."""

    def __init__(self, system: System, properties: tuple[core.Property, ...]) -> None:
        program = system.program
        self._system = system
        self._properties = properties
        self._sorts: list[Sort] = []
        self._ranges: list[_Range] = []
        self.locals = [[self._held(x.variable.type) for x in a.locals] for a in program.agents]
        self.ports = [
            [self._held(p.declaration.variable.type) for p in a.ports] for a in program.agents
        ]
        self.allread = [self._over_robots(x.variable.type) for x in program.allread]
        self.allwrite = [self._held(x.variable.type) for x in program.allwrite]
        self._externals: dict[str, tuple[list[Shape], Shape]] = {}

    # --- shapes ---------------------------------------------------------------------------------

    def _fresh(self, type_: Type) -> Shape:
        return self._noted(shape(type_))

    def _noted(self, of: Shape) -> Shape:
        match of:
            case Scalar(sort=sort):
                if sort is not None:
                    self._sorts.append(sort)
            case Fields(parts=parts):
                for part in parts:
                    self._noted(part)
            case Items(index=index, element=element):
                self._sorts.append(index)
                self._noted(element)
            case Entries(key=key, value=value):
                self._noted(key)
                self._noted(value)
        return of

    def _held(self, type_: Type) -> Shape:
        """The shape of what a variable holds: its lists have any length."""
        of = self._fresh(type_)
        _number_lists(of)
        return of

    def _over_robots(self, type_: Type) -> Shape:
        of = self._held(type_)
        assert isinstance(of, Items)
        of.index.be_robot()
        return of

    def _integer(self, *, number: str = "", constant: int | None = None) -> Scalar:
        sort = Sort(number=number)
        if constant is not None:
            sort.constants.add(constant)
        self._sorts.append(sort)
        return Scalar(sort)

    # --- the system -----------------------------------------------------------------------------

    def run(self) -> str:
        """Why robots may not change places; empty if they may."""
        program, system = self._system.program, self._system
        nobody = _Body(Sure(system, None, in_init=True))
        for entry, of in zip(program.allwrite, self.allwrite, strict=True):
            self._start(entry, of, nobody)
        for function in program.externals:
            self._external(function)
        for kind in sorted(set(system.kinds)):
            self._agent(kind, program.agents[kind])
        closed: list[core.Expr] = [x.condition for x in program.assumptions]
        closed += [x.condition for x in self._properties]
        for condition in closed:
            self._statement(condition, _Body(Sure(system, None)))
        return self._reason()

    def _reason(self) -> str:
        for sort in self._sorts:
            root = sort.root()
            if root.is_robot and root.number:
                return f"a robot's number is {root.number}"
        for each in self._ranges:
            if each.variable.root().is_robot:
                if each.over is not None and not each.over.root().is_robot:
                    return "a loop over a list's indices runs over robots"
                if not each.is_free:
                    return "a loop over robots may depend on their order"
        return ""

    def fixed(self) -> frozenset[int]:
        """The robots that the text names by number."""
        roots = [sort.root() for sort in self._sorts]
        named = {c for root in roots if root.is_robot for c in root.constants}
        return frozenset(named & set(range(self._system.robots)))

    def _agent(self, kind: int, agent: core.Agent) -> None:
        starting = Sure(self._system, kind, in_init=True)
        sure = Sure(self._system, kind)
        for port, of in zip(agent.ports, self.ports[kind], strict=True):
            self._start(port.declaration, of, _Body(starting))
        for entry, of in zip(agent.locals, self.locals[kind], strict=True):
            self._start(entry, of, _Body(starting))
        for entry, of in zip(self._system.program.allread, self.allread, strict=True):
            assert isinstance(of, Items)
            self._start(entry, of.element, _Body(starting))
        self._block(agent.init, _Body(starting))
        for event in agent.events:
            body = _Body(sure)
            self._expression(event.guard, body)
            self._block(event.effect, body)
        for module in agent.modules:
            self._block(module.environment or (), _Body(sure))
            for contract in module.contracts:
                for e in (*contract.requires, *contract.ensures):
                    self._statement(e, _Body(sure))

    def _start(self, entry: core.Declaration, of: Shape, body: _Body) -> None:
        if not isinstance(entry.initial, Start):
            unify(of, self._expression(entry.initial, body))

    def _external(self, function: core.External) -> None:
        parameters = [self._fresh(p.type) for p in function.parameters]
        result = self._held(function.result.type)
        self._externals[function.name] = (parameters, result)
        bound = dict(zip(function.parameters, parameters, strict=True))
        bound[function.result] = result
        filled = frozenset(variable.slot for variable in bound)
        sure = replace(Sure(self._system, None), filled=filled)
        for e in (*function.requires, *function.ensures):
            self._statement(e, _Body(sure, dict(bound)))

    def _statement(self, e: core.Expr, body: _Body) -> None:
        self._expression(e, replace(body, strict=True))

    # --- statements -----------------------------------------------------------------------------

    def _block(self, block: core.Block, body: _Body) -> None:
        for s in block:
            self._execute(s, body)

    def _execute(self, s: core.Stmt, body: _Body) -> None:
        match s:
            case core.Assign(place=place, value=value):
                unify(self._place(place, body), self._expression(value, body))
            case core.If(condition=condition, then=then, otherwise=otherwise):
                self._expression(condition, body)
                self._block(then, body)
                self._block(otherwise, body)
            case core.ForRange():
                self._for_range(s, body)
            case core.ForEach():
                self._for_each(s, body)
            case core.Return(value=value):
                if value is not None and body.result is not None:
                    unify(body.result, self._expression(value, body))
            case core.Atomic(body=inner):
                self._block(inner, body)
            case core.Output(values=values):
                for value in values:
                    self._expression(value, body)
            case core.Append() | core.Remove() | core.Pop():
                self._on_list(s, body)
            case core.Break() | core.Stop() | core.TryStop():
                pass

    def _on_list(self, s: core.Append | core.Remove | core.Pop, body: _Body) -> None:
        of = self._place(s.place, body)
        if isinstance(of, Entries):
            assert isinstance(s, core.Remove)
            unify(of.key, self._expression(s.value, body))
            return
        assert isinstance(of, Items)
        of.index.be_number("an index into a list that changes its length")
        if not isinstance(s, core.Pop):
            unify(of.element, self._expression(s.value, body))
        elif s.into is not None:
            unify(self._place(s.into, body), of.element)

    def _for_range(self, s: core.ForRange, body: _Body) -> None:
        variable = self._bound(s.variable, body)
        assert isinstance(variable, Scalar)
        assert variable.sort is not None
        sure = self._range(s.low, s.high, variable.sort, s.variable.slot, body)
        loop = frozenset({s.variable})
        if sure is not None:
            over = self._over(s.low, s.high, body)
            is_free = is_order_free(s.body, loop, sure)
            self._ranges.append(_Range(variable.sort, over, is_free))
            body = replace(body, sure=sure)
        self._block(s.body, replace(body, sure=body.sure.with_value(s.variable.slot)))

    def _range(
        self, low: core.Expr, high: core.Expr, variable: Sort, slot: int, body: _Body
    ) -> Sure | None:
        """What is known in a range that may be one over all robots; None if it is not."""
        starts_at_0 = isinstance(low, core.Const) and low.value == 0
        if starts_at_0 and isinstance(high, core.NumAgents):
            return body.sure.with_robot(slot, None)
        of = indices(low, high)
        if of is not None:
            return body.sure.with_index(slot, of)
        variable.be_number("counted from one number to another")
        for limit in (low, high):
            _be_number(self._expression(limit, body), "the limit of a range")
        return None

    def _over(self, low: core.Expr, high: core.Expr, body: _Body) -> Sort | None:
        of = indices(low, high)
        if of is None:
            return None
        found = self._expression(of, body)
        return found.index if isinstance(found, Items) else Sort(number="a map's length")

    def _for_each(self, s: core.ForEach, body: _Body) -> None:
        over = self._expression(s.sequence, body)
        value = self._bound(s.value, body)
        sure = body.sure.with_value(s.value.slot)
        key = self._bound(s.key, body) if s.key is not None else None
        if s.key is not None:
            sure = sure.with_index(s.key.slot, s.sequence)
        if isinstance(over, Entries):
            unify(value, over.value)
            if key is not None:
                unify(key, over.key)
        else:
            assert isinstance(over, Items)
            unify(value, over.element)
            if key is not None:
                unify(key, Scalar(over.index))
            loop = frozenset({s.value, *([s.key] if s.key is not None else [])})
            is_free = is_order_free(s.body, loop, sure)
            self._ranges.append(_Range(over.index, None, is_free))
        self._block(s.body, replace(body, sure=sure))

    # --- expressions ----------------------------------------------------------------------------

    def _expression(self, e: core.Expr, body: _Body) -> Shape:
        inner = replace(body, strict=False) if body.strict else body
        match e:
            case core.Const(value=value):
                if e.type == INT:
                    assert isinstance(value, int)
                    return self._integer(constant=value)
                return Scalar(None)
            case core.Pid():
                return self._robot()
            case core.NumAgents():
                return self._integer(constant=self._system.robots)
            case core.Delta():
                return Scalar(None)
            case core.Read(place=place):
                return self._place(place, inner)
            case core.Select(base=base, step=step):
                return self._step(self._expression(base, inner), step, inner)
            case core.Unary():
                return self._unary(e, inner)
            case core.Binary():
                return self._binary(e, body)
            case core.Builtin():
                return self._builtin(e, inner)
            case core.MakeList(items=items):
                return self._listed(items, e.type, inner)
            case core.MakeMap():
                return self._mapped(e, inner)
            case core.MakeRecord(fields=fields):
                return Fields(tuple(self._expression(part, inner) for part in fields))
            case core.Call():
                return self._call(e, inner)
            case core.ExternalCall():
                return self._external_call(e, inner)
            case core.Choose():
                for limit in (e.low, e.high):
                    _be_number(self._expression(limit, inner), "the limit of a choice")
                return self._integer(number="chosen") if e.type == INT else Scalar(None)
            case core.Quantified():
                return self._quantified(e, body)
            case core.Ran(robot=robot) | core.Stopped(robot=robot):
                unify(self._expression(robot, inner), self._robot())
                return Scalar(None)

    def _robot(self) -> Scalar:
        made = self._integer()
        assert made.sort is not None
        made.sort.be_robot()
        return made

    def _unary(self, e: core.Unary, body: _Body) -> Shape:
        operand = self._expression(e.operand, body)
        if e.op is UnaryOp.NOT:
            return Scalar(None)
        _be_number(operand, "calculated with")
        return self._integer(number="calculated") if e.type == INT else Scalar(None)

    def _binary(self, e: core.Binary, body: _Body) -> Shape:
        if e.op in _CONNECTIVES:
            # Where ``a and b`` is false, it may as well fault; so may b of ``a implies b``.
            strict_left = body.strict and e.op is BinaryOp.AND
            strict_right = body.strict and e.op in (BinaryOp.AND, BinaryOp.IMPLIES)
            self._expression(e.left, replace(body, strict=strict_left))
            self._expression(e.right, replace(body, strict=strict_right))
            return Scalar(None)
        inner = replace(body, strict=False)
        left, right = self._expression(e.left, inner), self._expression(e.right, inner)
        if e.op in (BinaryOp.EQ, BinaryOp.NE):
            unify(left, right)
            return Scalar(None)
        why = "ordered" if e.op in (BinaryOp.LT, BinaryOp.LE) else "calculated with"
        _be_number(left, why)
        _be_number(right, why)
        return self._integer(number="calculated") if e.type == INT else Scalar(None)

    def _builtin(self, e: core.Builtin, body: _Body) -> Shape:
        shapes = [self._expression(argument, body) for argument in e.arguments]
        of = shapes[0]
        match e.op:
            case ListOp.LENGTH:
                return self._integer(number="a length")
            case ListOp.CONTAINS:
                assert isinstance(of, Items | Entries)
                unify(of.key if isinstance(of, Entries) else of.element, shapes[1])
            case ListOp.MIN | ListOp.MAX:
                assert isinstance(of, Items)
                _be_number(of.element, "ordered")
                return self._integer(number="ordered") if e.type == INT else Scalar(None)
            case ListOp.ANY | ListOp.ALL:
                pass
        return Scalar(None)

    def _listed(self, items: tuple[core.Expr, ...], type_: Type, body: _Body) -> Shape:
        of = self._held(type_)
        assert isinstance(of, Items)
        of.index.be_number("an index into a list that is written out")
        for item in items:
            unify(of.element, self._expression(item, body))
        return of

    def _mapped(self, e: core.MakeMap, body: _Body) -> Shape:
        of = self._held(e.type)
        assert isinstance(of, Entries)
        for key, value in e.entries:
            unify(of.key, self._expression(key, body))
            unify(of.value, self._expression(value, body))
        return of

    def _call(self, e: core.Call, body: _Body) -> Shape:
        """Each call has sorts of its own, as if the body stood in its place."""
        function = self._system.program.function(e.function)
        assert function.result is not None
        bound = {
            parameter: self._expression(argument, body)
            for parameter, argument in zip(function.parameters, e.arguments, strict=True)
        }
        result = self._fresh(function.result)
        filled = frozenset(parameter.slot for parameter in function.parameters)
        sure = replace(body.sure, filled=filled, robots={}, within={})
        self._block(function.body, _Body(sure, bound, result))
        return result

    def _external_call(self, e: core.ExternalCall, body: _Body) -> Shape:
        parameters, result = self._externals[e.function]
        for of, argument in zip(parameters, e.arguments, strict=True):
            unify(of, self._expression(argument, body))
        return result

    def _quantified(self, e: core.Quantified, body: _Body) -> Shape:
        variable, slot = self._bound(e.variable, body), e.variable.slot
        strict = body.strict and e.quantifier is QuantifierKind.FORALL
        outer = replace(body, strict=False)
        sure: Sure | None = body.sure.with_value(slot)
        sort, over = None, None
        match e.domain:
            case core.RobotRange(agent=kind):
                unify(variable, self._robot())
                sure = body.sure.with_robot(slot, kind)
                sort = variable.sort if isinstance(variable, Scalar) else None
            case core.IntRange(low=low, high=high):
                assert isinstance(variable, Scalar)
                assert variable.sort is not None
                sure = self._range(low, high, variable.sort, slot, outer)
                sort = variable.sort if sure is not None else None
                over = self._over(low, high, outer) if sure is not None else None
            case core.Elements(sequence=sequence):
                of = self._expression(sequence, outer)
                assert isinstance(of, Items)
                unify(variable, of.element)
                sort = of.index
            case core.AllValues():
                _number_robots(variable)
        known = sure if sure is not None else body.sure.with_value(slot)
        if sort is not None:
            self._ranges.append(_Range(sort, over, strict or known.of(e.body)))
        self._expression(e.body, replace(body, sure=known, strict=strict))
        return Scalar(None)

    # --- places ---------------------------------------------------------------------------------

    def _place(self, place: core.Place, body: _Body) -> Shape:
        if place.robot is not None:
            unify(self._expression(place.robot, body), self._robot())
        of = self._variable(place.variable, body)
        for step in place.steps:
            of = self._step(of, step, body)
        return of

    def _variable(self, variable: core.Variable, body: _Body) -> Shape:
        match variable.home:
            case Home.BOUND:
                return self._bound(variable, body)
            case Home.ALLREAD:
                return self.allread[variable.slot]
            case Home.ALLWRITE:
                return self.allwrite[variable.slot]
            case Home.LOCAL | Home.PORT:
                shapes = self.locals if variable.home is Home.LOCAL else self.ports
                if body.kind is not None:
                    return shapes[body.kind][variable.slot]
                return self._of_any_kind(variable, shapes)

    def _of_any_kind(self, variable: core.Variable, shapes: list[list[Shape]]) -> Shape:
        """The variable of that name in every kind of robot that has one."""
        found = []
        for agent, of_kind in zip(self._system.program.agents, shapes, strict=True):
            slot = slot_in(agent, variable)
            if slot is not None:
                found.append(of_kind[slot])
        for other in found[1:]:
            unify(found[0], other)
        return found[0] if found else self._fresh(variable.type)

    def _bound(self, variable: core.Variable, body: _Body) -> Shape:
        if variable not in body.bound:
            body.bound[variable] = self._fresh(variable.type)
        return body.bound[variable]

    def _step(self, of: Shape, step: core.Step, body: _Body) -> Shape:
        match step:
            case core.FieldStep(position=position):
                assert isinstance(of, Fields)
                return of.parts[position]
            case core.IndexStep(index=index):
                assert isinstance(of, Items)
                unify(self._expression(index, body), Scalar(of.index))
                return of.element
            case core.KeyStep(key=key):
                assert isinstance(of, Entries)
                unify(self._expression(key, body), of.key)
                return of.value


def _be_number(of: Shape, reason: str) -> None:
    if isinstance(of, Scalar) and of.sort is not None:
        of.sort.be_number(reason)


def _number_robots(of: Shape) -> None:
    """No integer in a value of that shape is a robot."""
    match of:
        case Scalar():
            _be_number(of, "any integer")
        case Fields(parts=parts):
            for part in parts:
                _number_robots(part)
        case Items(element=element):
            _number_robots(element)
        case Entries(key=key, value=value):
            _number_robots(key)
            _number_robots(value)


def _number_lists(of: Shape) -> None:
    """Lists of any length are not indexed by robots."""
    match of:
        case Scalar():
            pass
        case Fields(parts=parts):
            for part in parts:
                _number_lists(part)
        case Items(index=index, element=element, is_over_robots=over):
            if not over:
                index.be_number("an index into a list of any length")
            _number_lists(element)
        case Entries(key=key, value=value):
            _number_lists(key)
            _number_lists(value)
