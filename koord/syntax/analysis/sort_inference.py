"""Sort inference: sorts for every integer of a system, and loops with unordered trips. [SYMMETRY]

Of the three forms below, the first two have the same outcome in every order, faults included, since
every trip is made and none sees what another one wrote. In the third the loop ends early, so its
conditions must not fault; then all that matters is whether *some* trip takes the way out.

- a trip sets a variable to something that is the same on every trip, or writes the one element of
  an array that its own loop variable names;
- a trip adds to a variable (``v = v + e``, ``max``, ``or``, …) what does not depend on it;
- ``if c: block`` where the block does the same on every trip and then leaves the loop.

See :mod:`koord.syntax.analysis.sorts` for what sorts are, and
:mod:`koord.syntax.analysis.symmetry` for why they show that robots may change places.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.definedness import Sure, size_of
from koord.syntax.analysis.first_come import is_first_come
from koord.syntax.analysis.sorts import (
    BodyShapes,
    Entries,
    Items,
    Range,
    Scalar,
    Shape,
    SortTable,
    Span,
    be_apart,
    unify,
)
from koord.syntax.analysis.sorts_of_expressions import Expressions
from koord.syntax.core import BinaryOp, Home, Start
from koord.syntax.system import System
from koord.syntax.walk import blocks, nodes, operands, statements, written

_GATHERING = (
    BinaryOp.ADD,
    BinaryOp.MUL,
    BinaryOp.MIN,
    BinaryOp.MAX,
    BinaryOp.AND,
    BinaryOp.OR,
)


def is_order_free(body: core.Block, loop: frozenset[core.Variable], sure: Sure) -> bool:
    """Return whether trips may be made in any order. ``loop`` are the loop's own variables."""
    leaving = [s for s in statements(body) if isinstance(s, core.Break | core.Return)]
    changed = {variable for s in statements(body) for variable in _changed(s)}
    if leaving:
        return _leaves_once(body, _Loop(loop, frozenset(changed), sure))
    return _gathers(body, _Loop(loop, frozenset(changed), sure))


class _Loop(Struct, frozen=True):
    variables: frozenset[core.Variable]
    changed: frozenset[core.Variable]
    sure: Sure

    def sees_no_trip(self, e: object) -> bool:
        """Return whether an expression reads nothing that a trip writes."""
        if any(isinstance(node, core.Call) for node in nodes(e)):
            # A function may read whatever is not bound to a body of its own.
            return all(v.home is Home.BOUND for v in self.changed) and self._unchanged(e)
        return self._unchanged(e)

    def _unchanged(self, e: object) -> bool:
        return not any(v in self.changed for v in _read(e))

    def is_same(self, e: object) -> bool:
        """Return whether an expression has the same value on every trip."""
        return self.sees_no_trip(e) and not any(v in self.variables for v in _read(e))


# --- loops that go to the end ---------------------------------------------------------------------


def _gathers(body: core.Block, loop: _Loop) -> bool:
    assigned: dict[core.Variable, list[core.Assign]] = {}
    for s in statements(body):
        match s:
            case core.Assign():
                assigned.setdefault(s.place.variable, []).append(s)
            case core.If(condition=condition):
                if not loop.sees_no_trip(condition):
                    return False
            case _:
                return False
    return all(_agree(writes, loop) for writes in assigned.values())


def _agree(writes: list[core.Assign], loop: _Loop) -> bool:
    """Return whether the writes to one variable end the same in any order of trips."""
    first = writes[0]
    if all(loop.is_same(w.place.steps) and loop.is_same(w.value) for w in writes):
        return all(w.place == first.place and w.value == first.value for w in writes)
    if all(_is_own_element(w.place, loop) and loop.sees_no_trip(w.value) for w in writes):
        return True
    ops = {_gathered(w, loop) for w in writes}
    return len(ops) == 1 and None not in ops and all(w.place == first.place for w in writes)


def _is_own_element(place: core.Place, loop: _Loop) -> bool:
    """Return whether a place is ``x[i]`` or a part of it, where i is the loop's variable."""
    match place.steps:
        case (core.IndexStep(index=core.Read(place=core.Place(variable=v, steps=()))), *rest):
            return v in loop.variables and loop.sees_no_trip(tuple(rest))
        case _:
            return False


def _gathered(write: core.Assign, loop: _Loop) -> BinaryOp | None:
    """The operator of ``v = v op e``, if ``e`` does not depend on other trips."""
    match write.value:
        case core.Binary(op=op, left=core.Read(place=place), right=e) if op in _GATHERING:
            fits = place == write.place and loop.is_same(place.steps) and loop.sees_no_trip(e)
            # ``and`` and ``or`` do not look at what cannot matter any more.
            short = op in (BinaryOp.AND, BinaryOp.OR)
            return op if fits and (not short or loop.sure.of(e)) else None
        case _:
            return None


# --- loops that end early -------------------------------------------------------------------------


def _leaves_once(body: core.Block, loop: _Loop) -> bool:
    ways = list(_leaves(body, loop))
    first = next((way for way in ways if way), None)
    return first is not None and all(way in ((), first) for way in ways) and _is_way(first, loop)


def _leaves(block: core.Block, loop: _Loop) -> Iterator[core.Block | None]:
    """The leaves of a tree of conditions; None where a condition may fault or see another trip."""
    match block:
        case ():
            yield ()
        case (core.If(condition=condition, then=then, otherwise=otherwise),):
            if not (loop.sees_no_trip(condition) and loop.sure.of(condition)):
                yield None
            yield from _leaves(then, loop)
            yield from _leaves(otherwise, loop)
        case _:
            yield block


def _is_way(block: core.Block, loop: _Loop) -> bool:
    """Return whether a block does the same on every trip, and then leaves."""
    *before, last = block
    if not all(
        isinstance(s, core.Assign) and loop.is_same(s.place.steps) and loop.is_same(s.value)
        for s in before
    ):
        return False
    match last:
        case core.Break():
            return True
        case core.Return(value=value):
            return loop.is_same(value)
        case _:
            return False


# --- the text -------------------------------------------------------------------------------------


def _changed(s: core.Stmt) -> Iterator[core.Variable]:
    """Yield the variables that a trip through a statement changes, inner loops included."""
    match s:
        case core.ForRange(variable=variable):
            yield variable
        case core.ForEach(key=key, value=value):
            yield from (v for v in (key, value) if v is not None)
        case _:
            yield from (place.variable for place in written(s))


def _read(e: object) -> Iterator[core.Variable]:
    return (node.variable for node in nodes(e) if isinstance(node, core.Place))


class Sorting:
    """The inference for one system and some properties.

    ``initialized`` are slots of ``allwrite`` variables that are set wherever an event is looked at:
    of all configurations, or of those alone that can be reached.
    """

    def __init__(
        self,
        system: System,
        properties: tuple[core.Property, ...],
        initialized: frozenset[int] = frozenset(),
    ) -> None:
        self._system = system
        self._properties = properties
        self._initialized = initialized
        self.book = SortTable(system)
        self._expressions = Expressions(self.book, self._block)

    def run(self) -> str:
        """Return the reason why robots may not change places; empty if they may."""
        program, system = self._system.program, self._system
        nobody = BodyShapes(Sure(system, None, in_init=True))
        for function in program.externals:
            parameters = [self.book.fresh(p.type) for p in function.parameters]
            result = self.book.held(function.result.type)
            self.book.externals[function.name] = parameters, result
            if function.kind is core.ExternalKind.FUNCTION:
                for of in (*parameters, result):
                    be_apart(of, "what a function of mathematics is asked")
        for entry, of in zip(program.allwrite, self.book.allwrite, strict=True):
            self._start(entry, of, nobody)
        for function in program.externals:
            self._external(function)
        for kind in sorted(set(system.kinds)):
            self._agent(kind, program.agents[kind])
        closed: list[core.Expr] = [x.condition for x in program.assumptions]
        closed += [x.condition for x in self._properties]
        for condition in closed:
            self._statement(condition, BodyShapes(self._sure(None)))
        return self.book.reason()

    def _agent(self, kind: int, agent: core.Agent) -> None:
        starting = Sure(self._system, kind, in_init=True)
        sure = self._sure(kind)
        for port, of in zip(agent.ports, self.book.ports[kind], strict=True):
            self._start(port.declaration, of, BodyShapes(starting))
        for entry, of in zip(agent.locals, self.book.locals[kind], strict=True):
            self._start(entry, of, BodyShapes(starting))
        for entry, of in zip(self._system.program.allread, self.book.allread, strict=True):
            assert isinstance(of, Items)
            self._start(entry, of.element, BodyShapes(starting))
        self._block(agent.init, BodyShapes(starting))
        for event in agent.events:
            body = BodyShapes(sure)
            self._expressions.shape(event.guard, body)
            self._block(event.effect, body)
        for module in agent.modules:
            self._block(module.environment or (), BodyShapes(sure))
            for contract in module.contracts:
                for e in (*contract.requires, *contract.ensures):
                    self._statement(e, BodyShapes(sure))

    def _sure(self, kind: int | None) -> Sure:
        return Sure(self._system, kind, initialized=self._initialized)

    def _start(self, entry: core.Declaration, of: Shape, body: BodyShapes) -> None:
        if not isinstance(entry.initial, Start):
            unify(of, self._expressions.shape(entry.initial, body))

    def _external(self, function: core.External) -> None:
        parameters, result = self.book.externals[function.name]
        bound = dict(zip(function.parameters, parameters, strict=True))
        bound[function.result] = result
        filled = frozenset(variable.slot for variable in bound)
        sure = replace(Sure(self._system, None), filled=filled)
        for e in (*function.requires, *function.ensures):
            self._statement(e, BodyShapes(sure, dict(bound)))

    def _statement(self, e: core.Expr, body: BodyShapes) -> None:
        self._expressions.shape(e, replace(body, strict=True))

    # --- statements -----------------------------------------------------------------------------

    def _block(self, block: core.Block, body: BodyShapes) -> None:
        for s in block:
            self._execute(s, body)

    def _execute(self, s: core.Stmt, body: BodyShapes) -> None:
        match s:
            case core.Assign(place=place, value=value):
                unify(self._expressions.place(place, body), self._expressions.shape(value, body))
            case core.ForRange():
                self._for_range(s, body)
            case core.ForEach():
                self._for_each(s, body)
            case core.Return(value=value):
                if value is not None and body.result is not None:
                    unify(body.result, self._expressions.shape(value, body))
            case core.Append() | core.Remove() | core.Pop():
                self._on_list(s, body)
            case _:
                for part in operands(s):
                    assert not isinstance(part, core.Place)
                    self._expressions.shape(part, body)
                for inner in blocks(s):
                    self._block(inner, body)

    def _on_list(self, s: core.Append | core.Remove | core.Pop, body: BodyShapes) -> None:
        of = self._expressions.place(s.place, body)
        if isinstance(of, Entries):
            assert isinstance(s, core.Remove)
            unify(of.key, self._expressions.shape(s.value, body))
            return
        assert isinstance(of, Items)
        of.index.be_number("an index into a list that changes its length")
        if not isinstance(s, core.Pop):
            unify(of.element, self._expressions.shape(s.value, body))
        elif s.into is not None:
            unify(self._expressions.place(s.into, body), of.element)

    def _for_range(self, s: core.ForRange, body: BodyShapes) -> None:
        variable = self.book.bound(s.variable, body)
        assert isinstance(variable, Scalar)
        assert variable.sort is not None
        sure = self._expressions.range(s.low, s.high, variable.sort, s.variable.slot, body)
        loop, size = frozenset({s.variable}), size_of(s.low, s.high)
        if sure is not None:
            over = self._expressions.over(s.low, s.high, body)
            is_free = is_order_free(s.body, loop, sure)
            self.book.ranges.append(Range(variable.sort, over, is_free))
            body = replace(body, sure=sure)
        elif size is not None:
            sure = body.sure.with_bound(s.variable.slot, size)
            is_free = is_order_free(s.body, loop, sure) or is_first_come(s.body, s.variable, sure)
            self.book.spans.append(Span(variable.sort, size, is_free))
            body = replace(body, sure=sure)
        self._block(s.body, replace(body, sure=body.sure.with_value(s.variable.slot)))

    def _for_each(self, s: core.ForEach, body: BodyShapes) -> None:
        over = self._expressions.shape(s.sequence, body)
        value = self.book.bound(s.value, body)
        sure = body.sure.with_value(s.value.slot)
        key = self.book.bound(s.key, body) if s.key is not None else None
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
            self.book.ranges.append(Range(over.index, None, is_free))
        self._block(s.body, replace(body, sure=sure))
