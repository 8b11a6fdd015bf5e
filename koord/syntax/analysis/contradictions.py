"""Contradictory conjunctions, detected by the ranges of the values that they compare.

Each part of a conjunction that compares something with a constant narrows the values which that may
have. Where none is left, no configuration meets all parts. What is compared counts as one thing
wherever it is written alike; deeper contradictions are left to the verifier.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from koord.syntax import core
from koord.syntax.analysis.bounds import Bounds
from koord.syntax.analysis.folding import constant
from koord.syntax.core import BinaryOp, QuantifierKind, UnaryOp
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import nodes


def contradicting(conditions: Iterable[core.Expr]) -> core.Expr | None:
    """The first conjunct that leaves a term no value; None if all may hold together."""
    left: dict[core.Expr, Bounds] = {}
    for condition in conditions:
        for part in _parts(condition):
            said = _compared(part)
            if said is None:
                continue
            what, bounds = said
            left[what] = left.get(what, Bounds()).meet(bounds)
            if left[what].is_empty():
                return part
    return None


def _parts(e: core.Expr) -> Iterator[core.Expr]:
    """Yield the conjuncts of a condition; a quantifier over robots counts as its body."""
    match e:
        case core.Binary(op=BinaryOp.AND):
            yield from _parts(e.left)
            yield from _parts(e.right)
        case core.Quantified(QuantifierKind.FORALL, domain=core.RobotRange()):
            yield from _parts(e.body)
        case _:
            yield e


def _compared(e: core.Expr) -> tuple[core.Expr, Bounds] | None:
    """The term that a condition compares with a constant, and the values that it allows."""
    match e:
        case core.Binary(op=BinaryOp.EQ | BinaryOp.NE | BinaryOp.LT | BinaryOp.LE as op):
            for what, other, turned in ((e.left, e.right, False), (e.right, e.left, True)):
                value = constant(other)
                if value is not None and constant(what) is None and _is_steady(what):
                    return what, Bounds.compared(op, value, turned=turned, whole=what.type == INT)
        case core.Unary(op=UnaryOp.NOT, operand=core.Read() as operand):
            return operand, Bounds(only=frozenset({False}))
        case core.Read() if e.type == BOOL:
            return e, Bounds(only=frozenset({True}))
        case _:
            pass
    return None


def _is_steady(e: core.Expr) -> bool:
    """Return whether an expression has the same value wherever it is written."""
    return not any(isinstance(node, core.Choose | core.ExternalCall) for node in nodes(e))
