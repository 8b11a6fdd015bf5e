"""External mathematical functions as uninterpreted symbols, with their summaries. [EXTERNAL]"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

from koord.semantics.every_number import NotFiniteError
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax import core
from koord.syntax.types import (
    ArrayType,
    GrowingType,
    MapType,
    RecordType,
    Robots,
    ScalarType,
    SequenceType,
    Type,
    contains,
)
from koord.syntax.walk import nodes, reached
from koord.verify.encoding.terms import Sort, Term, Terms

Symbolic: TypeAlias = "Value[Term]"


def vouched(external: core.External) -> bool:
    """Return whether the summary of a function is asserted for all its arguments at once.

    That is so where it says more than what one answer must be like, unless that is of no use.
    Elsewhere it is required answer by answer: solvers find it hard to come by a function that
    meets it everywhere.
    """
    return (
        external.kind is core.ExternalKind.FUNCTION
        and not external.by_answer
        and all(isinstance(v.type, ScalarType) for v in (external.result, *external.parameters))
        and any(isinstance(n, core.ExternalCall | core.AllValues) for n in nodes(external.ensures))
    )


def asked_of_all(program: core.Program) -> frozenset[str]:
    """The functions that a summary quantifies over, for every value of a type.

    What they answer depends on a variable then, so no constant can stand for it.
    """
    summaries = tuple((external.requires, external.ensures) for external in program.externals)
    bodies = tuple(
        node.body
        for node in nodes(summaries)
        if isinstance(node, core.Quantified) and isinstance(node.domain, core.AllValues)
    )
    calls = (n for n in reached(program, bodies) if isinstance(n, core.ExternalCall))
    return frozenset(call.function for call in calls)


def quantifies(node: object) -> bool:
    """Return whether a summary, or a part of one, quantifies over every value of a type."""
    return any(isinstance(below, core.AllValues) for below in nodes(node))


# --- values as arguments --------------------------------------------------------------------------


def encoded(
    d: Terms, external: core.External, arguments: Sequence[Symbolic], robots: int
) -> list[Term]:
    """Encode arguments as terms that are equal if and only if the values are.

    Raises NotFiniteError for maps, for whose equality there are no such terms. [E-EQUAL]
    """
    flat: list[Term] = []
    for argument, parameter in zip(arguments, external.parameters, strict=True):
        if contains(parameter.type, MapType):
            what = f"a map, as {parameter.name} is, in a question about every value of a type"
            raise NotFiniteError(external.span, what)
        flat += _encoded(d, argument, parameter.type, robots)
    return flat


def _encoded(d: Terms, value: Symbolic, type_: Type, robots: int) -> Iterator[Term]:
    match value:
        case Rec(fields=fields):
            assert isinstance(type_, RecordType)
            for part, (_, field) in zip(fields, type_.fields, strict=True):
                yield from _encoded(d, part, field, robots)
        case Seq(length=length, items=items):
            assert isinstance(type_, SequenceType)
            rows = [list(_encoded(d, item, type_.element, robots)) for item in items]
            if isinstance(type_, ArrayType):
                yield from (part for row in rows for part in row)
            else:
                yield d.list_term(_sorts(d, type_.element, robots), rows, length)
        case Table():
            raise AssertionError("told by the caller")
        case _:
            yield value


def _sorts(d: Terms, type_: Type, robots: int) -> list[Sort]:
    """The sorts of the terms that a value of a type becomes."""
    match type_:
        case RecordType(fields=fields):
            return [sort for _, field in fields for sort in _sorts(d, field, robots)]
        case ArrayType(element=element, size=size):
            return _sorts(d, element, robots) * (robots if size is Robots.ALL else size)
        case GrowingType(element=element):
            return [d.list_sort(_sorts(d, element, robots))]
        case _:
            return [d.sort(type_)]


def scalars(value: Symbolic) -> Iterator[Term]:
    """The scalars that a value consists of."""
    if isinstance(value, Rec):
        for part in value.fields:
            yield from scalars(part)
    elif isinstance(value, Seq):
        for part in value.items:
            yield from scalars(part)
        yield from _open(value.length)
    elif isinstance(value, Table):
        for key, held in value.entries:
            yield from scalars(key)
            yield from scalars(held)
        yield from _open(value.length)
    else:
        yield value


def _open(length: Term) -> Iterator[Term]:
    """A length as a term, unless the shape determines it."""
    if not isinstance(length, int):
        yield length
