"""Sort inference of expressions: integers that are compared, computed with, or used as indices.
[SYMMETRY]
"""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.definedness import Sure, indices, size_of
from koord.syntax.analysis.sorts import (
    BodyShapes,
    Entries,
    Fields,
    Items,
    Range,
    Scalar,
    Shape,
    Sort,
    SortTable,
    Span,
    be_number,
    number_robots,
    unify,
)
from koord.syntax.core import BinaryOp, ListOp, QuantifierKind, UnaryOp
from koord.syntax.types import INT, Type

_CONNECTIVES = (BinaryOp.AND, BinaryOp.OR, BinaryOp.IMPLIES)

#: Goes through the statements of a function's body.
RunBlock = Callable[[core.Block, BodyShapes], None]


class Expressions(Struct):
    """The inference of the shapes of expressions, recorded in the book.

    ``run_block`` goes through the body of a function that is called.
    """

    book: SortTable
    run_block: RunBlock

    def shape(self, e: core.Expr, body: BodyShapes) -> Shape:
        """The shape of an expression's value."""
        inner = replace(body, strict=False) if body.strict else body
        match e:
            case core.Const(value=value):
                if e.type == INT:
                    assert isinstance(value, int)
                    return self.book.integer(constant=value)
                return Scalar(None)
            case core.Pid():
                return self.book.robot()
            case core.NumAgents():
                return self.book.integer(constant=self.book.system.robots)
            case core.Delta():
                return Scalar(None)
            case core.Read(place=place):
                return self.place(place, inner)
            case core.Select(base=base, step=step):
                return self._step(self.shape(base, inner), step, inner)
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
                return Fields(tuple(self.shape(part, inner) for part in fields))
            case core.Call():
                return self._call(e, inner)
            case core.ExternalCall():
                return self._external_call(e, inner)
            case core.Choose():
                return self._chosen(e, inner)
            case core.Quantified():
                return self._quantified(e, body)
            case core.Ran(robot=robot) | core.Stopped(robot=robot):
                unify(self.shape(robot, inner), self.book.robot())
                return Scalar(None)

    def _chosen(self, e: core.Choose, body: BodyShapes) -> Shape:
        for limit in (e.low, e.high):
            be_number(self.shape(limit, body), "the limit of a choice")
        if e.type != INT:
            return Scalar(None)
        match e.low, e.high:
            case core.Const(value=int(low)), core.Const(value=int(high)):
                # All elements may be chosen, or none.
                chosen = self.book.integer(number="chosen", tells_apart=False)
                assert chosen.sort is not None
                chosen.sort.cut(low, high + 1)
                return chosen
            case _:
                return self.book.integer(number="chosen")

    # --- operators ------------------------------------------------------------------------------

    def _unary(self, e: core.Unary, body: BodyShapes) -> Shape:
        operand = self.shape(e.operand, body)
        if e.op is UnaryOp.NOT:
            return Scalar(None)
        be_number(operand, "calculated with")
        return self.book.integer(number="calculated") if e.type == INT else Scalar(None)

    def _binary(self, e: core.Binary, body: BodyShapes) -> Shape:
        if e.op in _CONNECTIVES:
            # Where ``a and b`` is false, it may as well fault; so may b of ``a implies b``.
            strict_left = body.strict and e.op is BinaryOp.AND
            strict_right = body.strict and e.op in (BinaryOp.AND, BinaryOp.IMPLIES)
            self.shape(e.left, replace(body, strict=strict_left))
            self.shape(e.right, replace(body, strict=strict_right))
            return Scalar(None)
        inner = replace(body, strict=False)
        left, right = self.shape(e.left, inner), self.shape(e.right, inner)
        if e.op in (BinaryOp.EQ, BinaryOp.NE):
            unify(left, right)
            return Scalar(None)
        if e.op in (BinaryOp.LT, BinaryOp.LE) and self._is_cut(e, left, right):
            return Scalar(None)
        why = "ordered" if e.op in (BinaryOp.LT, BinaryOp.LE) else "calculated with"
        be_number(left, why)
        be_number(right, why)
        return self.book.integer(number="calculated") if e.type == INT else Scalar(None)

    def _is_cut(self, e: core.Binary, left: Shape, right: Shape) -> bool:
        """Return whether an integer is compared with a constant, and note where that cuts."""
        match e.left, e.right:
            case _, core.Const(value=int(value)):
                one, number = left, value if e.op is BinaryOp.LT else value + 1
            case core.Const(value=int(value)), _:
                one, number = right, value + 1 if e.op is BinaryOp.LT else value
            case _:
                return False
        if isinstance(one, Scalar) and one.sort is not None:
            one.sort.be_number("ordered", tells_apart=False)
            one.sort.cut(number)
        return True

    def _builtin(self, e: core.Builtin, body: BodyShapes) -> Shape:
        shapes = [self.shape(argument, body) for argument in e.arguments]
        of = shapes[0]
        match e.op:
            case ListOp.LENGTH:
                return self.book.integer(number="a length")
            case ListOp.CONTAINS:
                assert isinstance(of, Items | Entries)
                unify(of.key if isinstance(of, Entries) else of.element, shapes[1])
            case ListOp.MIN | ListOp.MAX:
                assert isinstance(of, Items)
                be_number(of.element, "ordered")
                return self.book.integer(number="ordered") if e.type == INT else Scalar(None)
            case ListOp.KEYS:
                listed = self.book.held(e.type)
                assert isinstance(of, Entries)
                assert isinstance(listed, Items)
                unify(listed.element, of.key)
                return listed
            case ListOp.ANY | ListOp.ALL:
                pass
        return Scalar(None)

    def _listed(self, items: tuple[core.Expr, ...], type_: Type, body: BodyShapes) -> Shape:
        of = self.book.held(type_)
        assert isinstance(of, Items)
        of.index.be_number("an index into a list that is written out")
        for item in items:
            unify(of.element, self.shape(item, body))
        return of

    def _mapped(self, e: core.MakeMap, body: BodyShapes) -> Shape:
        of = self.book.held(e.type)
        assert isinstance(of, Entries)
        for key, value in e.entries:
            unify(of.key, self.shape(key, body))
            unify(of.value, self.shape(value, body))
        return of

    # --- calls and quantifiers ------------------------------------------------------------------

    def _call(self, e: core.Call, body: BodyShapes) -> Shape:
        """The shape of a call: each has fresh sorts, as if the body were inlined."""
        function = self.book.system.program.function(e.function)
        assert function.result is not None
        bound = {
            parameter: self.shape(argument, body)
            for parameter, argument in zip(function.parameters, e.arguments, strict=True)
        }
        result = self.book.fresh(function.result)
        filled = frozenset(parameter.slot for parameter in function.parameters)
        sure = replace(body.sure, filled=filled, robots={}, within={}, bounds={})
        self.run_block(function.body, BodyShapes(sure, bound, result))
        return result

    def _external_call(self, e: core.ExternalCall, body: BodyShapes) -> Shape:
        parameters, result = self.book.externals[e.function]
        for of, argument in zip(parameters, e.arguments, strict=True):
            unify(of, self.shape(argument, body))
        return result

    def _quantified(self, e: core.Quantified, body: BodyShapes) -> Shape:
        variable, slot = self.book.bound(e.variable, body), e.variable.slot
        strict = body.strict and e.quantifier is QuantifierKind.FORALL
        outer = replace(body, strict=False)
        sure: Sure | None = body.sure.with_value(slot)
        sort, over = None, None
        match e.domain:
            case core.RobotRange(agent=kind):
                unify(variable, self.book.robot())
                sure = body.sure.with_robot(slot, kind)
                sort = variable.sort if isinstance(variable, Scalar) else None
            case core.IntRange(low=low, high=high):
                assert isinstance(variable, Scalar)
                assert variable.sort is not None
                sure = self.range(low, high, variable.sort, slot, outer)
                sort = variable.sort if sure is not None else None
                over = self.over(low, high, outer) if sure is not None else None
                size = size_of(low, high)
                if sure is None and size is not None:
                    sure = body.sure.with_bound(slot, size)
                    free = strict or sure.of(e.body)
                    self.book.spans.append(Span(variable.sort, size, free))
            case core.Elements(sequence=sequence):
                of = self.shape(sequence, outer)
                assert isinstance(of, Items)
                unify(variable, of.element)
                sort = of.index
            case core.AllValues():
                number_robots(variable)
        known = sure if sure is not None else body.sure.with_value(slot)
        if sort is not None:
            self.book.ranges.append(Range(sort, over, strict or known.of(e.body)))
        self.shape(e.body, replace(body, sure=known, strict=strict))
        return Scalar(None)

    def range(
        self, low: core.Expr, high: core.Expr, variable: Sort, slot: int, body: BodyShapes
    ) -> Sure | None:
        """The context in a range that may be over all robots; None if it is not."""
        starts_at_0 = isinstance(low, core.Const) and low.value == 0
        if starts_at_0 and isinstance(high, core.NumAgents):
            variable.root().sizes.add(0)
            return body.sure.with_robot(slot, None)
        of = indices(low, high)
        if of is not None:
            return body.sure.with_index(slot, of)
        told = size_of(low, high) is None
        variable.be_number("counted from one number to another", tells_apart=told)
        for limit in (low, high):
            be_number(self.shape(limit, body), "the limit of a range")
        return None

    def over(self, low: core.Expr, high: core.Expr, body: BodyShapes) -> Sort | None:
        """The index sort of the list whose indices a range covers, if it does that."""
        of = indices(low, high)
        if of is None:
            return None
        found = self.shape(of, body)
        return found.index if isinstance(found, Items) else Sort(number="a map's length")

    # --- places ---------------------------------------------------------------------------------

    def place(self, place: core.Place, body: BodyShapes) -> Shape:
        """The shape of the value at a place."""
        if place.robot is not None:
            unify(self.shape(place.robot, body), self.book.robot())
        of = self.book.variable(place.variable, body)
        for step in place.steps:
            of = self._step(of, step, body)
        return of

    def _step(self, of: Shape, step: core.Step, body: BodyShapes) -> Shape:
        match step:
            case core.FieldStep(position=position):
                assert isinstance(of, Fields)
                return of.parts[position]
            case core.IndexStep(index=index):
                assert isinstance(of, Items)
                unify(self.shape(index, body), Scalar(of.index))
                return of.element
            case core.KeyStep(key=key):
                assert isinstance(of, Entries)
                unify(self.shape(key, body), of.key)
                return of.value
