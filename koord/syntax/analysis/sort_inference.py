"""Sorts for every integer of a system. [SYMMETRY]

See :mod:`koord.syntax.analysis.sorts` for what sorts are, and
:mod:`koord.syntax.analysis.symmetry` for why they show that robots may change places.
"""

from __future__ import annotations

from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.analysis.definedness import Sure
from koord.syntax.analysis.loop_order import is_order_free
from koord.syntax.analysis.sort_constraints import BodyShapes, Range, SortBook
from koord.syntax.analysis.sorts import Entries, Items, Scalar, Shape, unify
from koord.syntax.analysis.sorts_of_expressions import Expressions
from koord.syntax.core import Start
from koord.syntax.system import System
from koord.syntax.walk import blocks, operands


class Sorting:
    """The inference for one system and some properties."""

    def __init__(self, system: System, properties: tuple[core.Property, ...]) -> None:
        self._system = system
        self._properties = properties
        self.book = SortBook(system)
        self._expressions = Expressions(self.book, self._block)

    def run(self) -> str:
        """Why robots may not change places; empty if they may."""
        program, system = self._system.program, self._system
        nobody = BodyShapes(Sure(system, None, in_init=True))
        for function in program.externals:
            parameters = [self.book.fresh(p.type) for p in function.parameters]
            self.book.externals[function.name] = parameters, self.book.held(function.result.type)
        for entry, of in zip(program.allwrite, self.book.allwrite, strict=True):
            self._start(entry, of, nobody)
        for function in program.externals:
            self._external(function)
        for kind in sorted(set(system.kinds)):
            self._agent(kind, program.agents[kind])
        closed: list[core.Expr] = [x.condition for x in program.assumptions]
        closed += [x.condition for x in self._properties]
        for condition in closed:
            self._statement(condition, BodyShapes(Sure(system, None)))
        return self.book.reason()

    def _agent(self, kind: int, agent: core.Agent) -> None:
        starting = Sure(self._system, kind, in_init=True)
        sure = Sure(self._system, kind)
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
        loop = frozenset({s.variable})
        if sure is not None:
            over = self._expressions.over(s.low, s.high, body)
            is_free = is_order_free(s.body, loop, sure)
            self.book.ranges.append(Range(variable.sort, over, is_free))
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
