"""Coercion of a value to the type of its place: only ``int`` widens."""

from __future__ import annotations

from fractions import Fraction

from koord.syntax import core
from koord.syntax.diagnostics import Edit
from koord.syntax.elaboration.body import BodyScope, Confusion
from koord.syntax.elaboration.phrases import a
from koord.syntax.source import Span
from koord.syntax.types import (
    FLOAT,
    INT,
    POS,
    ArrayType,
    FloatType,
    IntType,
    ListType,
    OpaqueType,
    QueueType,
    Robots,
    Type,
)

#: Expected where the type of a place is wrong, which was told: what its value is does not matter.
POISON = OpaqueType("?")


def widened(value: core.Expr) -> core.Expr:
    """Widen an ``int`` to a ``float``; any other value stays."""
    if value.type != INT:
        return value
    if isinstance(value, core.Const) and isinstance(value.value, int):
        return core.Const(Fraction(value.value), FLOAT, span=value.span)
    return core.Unary(core.UnaryOp.WIDEN, value, FLOAT, span=value.span)


def accepts(wanted: Type, given: Type) -> bool:
    """Return whether a value of type ``given`` may stand where ``wanted`` is read, unchanged."""
    if wanted == given:
        return True
    match wanted, given:
        case ListType(element=inner), ArrayType(element=element) | ListType(element=element):
            return accepts(inner, element)
        case _:
            return False


def fit(
    body: BodyScope, value: core.Expr | None, wanted: Type | None, span: Span, what: str
) -> core.Expr | None:
    """Coerce a value to the type ``wanted``; ``what`` says what it is for in messages."""
    if value is None or wanted is None:
        return None
    given = value.type
    if accepts(wanted, given):
        return value
    if isinstance(wanted, FloatType) and isinstance(given, IntType):
        return widened(value)
    if not _confused(body, value, wanted, span):
        story = f"{what} is {a(wanted)}, but this is {a(given)}"
        edits = _as_path(span) if wanted == ListType(POS) and given == POS else ()
        body.findings.error("K204", span, story, _cure(wanted, given), (), edits)
    return None


def _as_path(span: Span) -> tuple[Edit, ...]:
    """The edits that make a path of a position: the path of somebody who stays. [OLD-PATH]"""
    return Edit(span.beginning(0), "["), Edit(span.end, "]")


def _cure(wanted: Type, given: Type) -> str | None:
    match wanted, given:
        case IntType(), FloatType():
            return "a `float` never becomes an `int` by itself: make the variable a `float`"
        case ListType(element=element), _ if accepts(element, given):
            return "a list with this one element is written between `[` and `]`"
        case ArrayType(), ListType():
            return f"only {a(wanted)} fits: a list may have any length"
        case QueueType(), ListType():
            return "declare both as `Queue` or both as lists"
        case _:
            return None


def _confused(body: BodyScope, value: core.Expr, wanted: Type, span: Span) -> bool:
    """Return whether a type error is due to an allread variable meant to hold lists."""
    if not isinstance(value, core.Read):
        return False
    place = value.place
    if place.variable.home is not core.Home.ALLREAD or place.steps:
        return False
    match wanted, value.type:
        case (
            ListType(element=ListType(element=inner)),
            ArrayType(element=element, size=Robots.ALL),
        ) if accepts(inner, element):
            body.session.confusions.append(Confusion(place.variable, span, stored=False))
            return True
        case _:
            return False


def stores_list(body: BodyScope, place: core.Place, value: core.Expr, span: Span) -> bool:
    """Return whether a list is stored in an allread entry that holds one element; noted if so."""
    if place.variable.home is not core.Home.ALLREAD or len(place.steps) != 1:
        return False
    match value.type:
        case ListType(element=element) | ArrayType(element=element):
            confused = accepts(place.type, element) or (place.type == FLOAT and element == INT)
        case _:
            confused = False
    if confused:
        body.session.confusions.append(Confusion(place.variable, span, stored=True))
    return confused
