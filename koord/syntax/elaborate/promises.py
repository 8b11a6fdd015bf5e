"""Where a summary may speak of every value of a type: where it promises something of all."""

from __future__ import annotations

from collections.abc import Iterator

from koord.syntax import core
from koord.syntax.elaborate.body import Body, Where
from koord.syntax.walk import nodes


def check_promises(body: Body, condition: core.Expr) -> None:
    """Tell of statements about every value of a type that nobody could ever try. [EXTERNAL]

    Of what is said of all values, some can be tried, and the rest taken on trust. Of what is denied
    of all, required of a caller, or said of some one value, nothing can be.
    """
    if body.where is Where.SUMMARY_REQUIRES:
        for node in _about_all(condition):
            body.error(
                "K310",
                node.span,
                "a duty of callers that speaks of every value of a type can be checked nowhere",
                "say it of the arguments, or of the elements of a list",
            )
        return
    for node in _denied(condition, denied=False):
        body.error(
            "K310",
            node.span,
            "a summary says something of every value of a type, but does not deny it",
            "`forall` over a type stands neither behind `not` nor left of `implies`, and there is "
            "no `exists` over a type",
        )


def _about_all(node: object) -> Iterator[core.Quantified]:
    for below in nodes(node):
        if isinstance(below, core.Quantified) and isinstance(below.domain, core.AllValues):
            yield below


def _denied(e: core.Expr, *, denied: bool) -> Iterator[core.Quantified]:
    """The quantifiers over types that are not simply promised."""
    match e:
        case core.Quantified(domain=core.AllValues(), body=body, quantifier=quantifier):
            if denied or quantifier is not core.QuantifierKind.FORALL:
                yield e
            else:
                yield from _denied(body, denied=denied)
        case core.Quantified(body=body, domain=domain):
            yield from _about_all(domain)
            yield from _denied(body, denied=denied)
        case core.Unary(op=core.UnaryOp.NOT, operand=operand):
            yield from _denied(operand, denied=not denied)
        case core.Binary(op=core.BinaryOp.AND | core.BinaryOp.OR, left=left, right=right):
            yield from _denied(left, denied=denied)
            yield from _denied(right, denied=denied)
        case core.Binary(op=core.BinaryOp.IMPLIES, left=left, right=right):
            yield from _denied(left, denied=not denied)
            yield from _denied(right, denied=denied)
        case _:
            yield from _about_all(e)
