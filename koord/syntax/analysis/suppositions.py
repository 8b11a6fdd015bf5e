"""Suppositions of statements: the A of ``A implies B`` and of ``not A or B``.

A supposition is told by its *denial*: a statement that holds exactly where no instance of what is
supposed is true. [PROP-VACUOUS]
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from functools import cached_property, reduce
from itertools import count
from typing import Any, TypeAlias

from msgspec import Struct, field
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, QuantifierKind, UnaryOp
from koord.syntax.source import Span
from koord.syntax.types import BOOL
from koord.syntax.walk import chained, nodes, rebuilt

#: That something supposed never holds, and the place of what is supposed.
Denial: TypeAlias = "tuple[core.Expr, Span]"


def _anything(e: core.Expr) -> bool:
    return True


class SuppositionReader(Struct, dict=True):
    """A reader of the suppositions in a program's statements.

    A function that is called in one place is read as if it stood there: then the denial calls one
    of the ``copies``, which the program does not have. One that is called in several places has
    cases that are not meant in each of them.
    """

    program: core.Program
    copies: list[core.Function] = field(default_factory=list)

    def denials(
        self,
        e: core.Expr,
        admits: Callable[[core.Expr], bool] = _anything,
        *,
        disjunctions: bool = True,
    ) -> Iterator[Denial]:
        """Yield the denial of each supposition of a statement: that it never holds.

        What is not admitted as supposed is not read as an implication, nor a call as its body.
        Disjunctions are read as implications only where nothing is supposed before.
        """
        match e:
            case core.Quantified(quantifier=QuantifierKind.FORALL, body=body):
                for inner, span in self.denials(body, admits, disjunctions=disjunctions):
                    yield core.Quantified(e.quantifier, e.variable, e.domain, inner), span
            case core.Binary(op=BinaryOp.AND, left=left, right=right):
                for part in (left, right):
                    yield from self.denials(part, admits, disjunctions=disjunctions)
            case core.Binary(op=BinaryOp.IMPLIES, left=supposed, right=said) if admits(supposed):
                yield from self._implied(supposed, said, admits)
            case core.Binary(op=BinaryOp.OR) if disjunctions:
                implication = _implication(e)
                if implication is not None and admits(implication[0]):
                    yield from self._implied(*implication, admits)
            case core.Call() if self._calls[e.function] == 1 and admits(e):
                yield from self._called(e, admits, disjunctions)
            case _:
                return

    def _implied(
        self, supposed: core.Expr, said: core.Expr, admits: Callable[[core.Expr], bool]
    ) -> Iterator[Denial]:
        nested = list(self.denials(said, admits, disjunctions=False))
        for inner, span in nested:
            yield core.Binary(BinaryOp.IMPLIES, supposed, inner, BOOL), span
        if not nested:
            yield core.Unary(UnaryOp.NOT, supposed, BOOL), supposed.span

    def _called(
        self, call: core.Call, admits: Callable[[core.Expr], bool], disjunctions: bool
    ) -> Iterator[Denial]:
        """Yield the suppositions of each answer of a function."""
        function = self.program.function(call.function)
        answers = [node.value for node in nodes(function.body) if isinstance(node, core.Return)]
        for position, answer in enumerate(answers):
            assert answer is not None, "statements call functions that answer"
            for inner, span in self.denials(answer, admits, disjunctions=disjunctions):
                name = f"{function.name} denied {len(self.copies)}"
                body = _answering(function.body, position, inner)
                self.copies.append(replace(function, name=name, body=body))
                yield replace(call, function=name), span

    @cached_property
    def _calls(self) -> Counter[str]:
        """The number of places that call each function."""
        called = (n.function for n in nodes(self.program) if isinstance(n, core.Call))
        return Counter(called)


def _implication(e: core.Expr) -> tuple[core.Expr, core.Expr] | None:
    """Split a disjunction with exactly one negated part: that part without ``not``, and the rest.

    With several, as in ``not A or not B``, none of them is the one that is supposed; and in
    ``C or not (A and B)``, A and B may as well exclude each other.
    """
    parts = list(chained(e, BinaryOp.OR))
    negated = [part for part in parts if _is_negation(part)]
    if len(negated) != 1:
        return None
    (supposed,) = (part.operand for part in negated if isinstance(part, core.Unary))
    if isinstance(supposed, core.Binary) and supposed.op is BinaryOp.AND:
        return None
    rest = [part for part in parts if part is not negated[0]]
    return supposed, reduce(lambda a, b: core.Binary(BinaryOp.OR, a, b, BOOL), rest)


def _is_negation(e: core.Expr) -> bool:
    return isinstance(e, core.Unary) and e.op is UnaryOp.NOT


def _answering(body: core.Block, position: int, answer: core.Expr) -> core.Block:
    """A function's body with another answer in one place, and true in all others."""
    numbers = count()

    def part(node: Any) -> Any:
        if isinstance(node, core.Return):
            is_meant = next(numbers) == position
            return replace(node, value=answer if is_meant else core.Const(True, BOOL))
        return rebuilt(node, part)

    changed: core.Block = part(body)
    return changed
