"""Names that are declared, and may not be used where they stand."""

from __future__ import annotations

from koord.syntax import ast
from koord.syntax.elaborate.body import (
    Body,
    Where,
)


def out_of_reach(body: Body, e: ast.Expr, what: str) -> None:
    match body.where:
        case Where.FUNCTION | Where.SUMMARY | Where.SUMMARY_REQUIRES:
            body.error(
                "K224",
                e.span,
                f"a function knows its parameters only, not {what}",
                "pass it as an argument",
            )
        case Where.ENVIRONMENT:
            body.error(
                "K239",
                e.span,
                f"an `environment:` block knows ports only, not {what}",
                "let the program write what the environment needs to an actuator",
            )
        case Where.REQUIRES | Where.ENSURES:
            body.error(
                "K307",
                e.span,
                f"a contract speaks of ports only, not of {what}",
                "say it in an `invariant`",
            )
        case Where.CONSTANT:
            body.error("K226", e.span, f"{what} is not known before the run", "use a `param`")
        case _:
            body.error(
                "K226",
                e.span,
                f"an initial value cannot use {what}",
                "assign it in `init:`",
            )
