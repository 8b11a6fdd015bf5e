"""Abstraction: types whose values merely flow become opaque sorts, such as planners' paths.

A record or list type whose values a program copies, compares, and hands to external functions, but
never takes apart, is replaced by an uninterpreted sort. Making such a value becomes an external
function, and what summaries say about its inside is dropped. So the abstract program can do all
that the program can, and more: *holds* carries over; a violation is translated back
(:mod:`koord.verify.reduction.problems`) and replayed before it counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.types import (
    ArrayType,
    ListType,
    MapType,
    OpaqueType,
    RecordType,
    SequenceType,
    Type,
    show,
    within,
)
from koord.syntax.walk import last_site, nodes, rebuilt


class Abstraction(Struct, frozen=True):
    """A program and its abstraction.

    ``made`` are the external functions that stand for list and record expressions; ``hidden`` are
    the types that became opaque, by the name of their sort.
    """

    original: core.Program
    program: core.Program
    hidden: dict[str, Type]
    made: frozenset[str]


def abstracted(program: core.Program) -> Abstraction | None:
    """Abstract a program; None if no type of it merely flows."""
    hidden = _flowing(program)
    if not hidden:
        return None
    rewriter = _Rewriter(hidden, last_site(program))
    externals = tuple(_weakened(external, hidden) for external in program.externals)
    rewritten: core.Program = rewriter.rewrite(replace(program, externals=externals))
    made = tuple(rewriter.made.values())
    return Abstraction(
        program,
        replace(rewritten, externals=rewritten.externals + made),
        {_sort_name(type_): type_ for type_ in hidden},
        frozenset(external.name for external in made),
    )


# --- which types flow ---------------------------------------------------------------------------


def _flowing(program: core.Program) -> set[Type]:
    """The record and list types whose values only external functions take apart."""
    types = {t for node in nodes(program) for t in _types_of(node)}
    candidates = {t for t in types if isinstance(t, RecordType | ListType)}
    opened: set[Type] = set()
    # A caller's duty (``requires``) cannot be dropped as a promise can, so it opens types too.
    duties = tuple(external.requires for external in program.externals)
    for node in nodes((replace(program, externals=()), duties)):
        opened |= _opened(node)
    used = {t for e in program.externals for t in _signature(e)}
    flowing = candidates - opened
    # Without an external function that takes or gives such values there is nothing to gain.
    return {t for t in flowing if any(t in within(s) for s in used) or t in used}


def _signature(external: core.External) -> list[Type]:
    return [external.result.type, *(p.type for p in external.parameters)]


def _opened(node: object) -> set[Type]:
    """The types whose values a node takes apart, or reads in another shape."""
    match node:
        case core.Place(variable=variable, steps=steps):
            return {variable.type, *(step.type for step in steps[:-1])} if steps else set()
        case core.Select(base=base):
            return {base.type}
        case core.Builtin(arguments=arguments):
            return {argument.type for argument in arguments[:1]}
        case core.ForEach(sequence=sequence) | core.Elements(sequence=sequence):
            return {sequence.type}
        case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
            return {place.type}
        case core.Read(place=place) if isinstance(place.type, ArrayType):
            # An array may be read where a list is wanted; then that list is no opaque value.
            return {ListType(place.type.element)}
        case _:
            return set()


def _types_of(node: object) -> Iterator[Type]:
    """All types that a node mentions, with the types inside them."""
    for attribute in ("type", "result"):
        type_ = getattr(node, attribute, None)
        if isinstance(type_, Type):
            yield from within(type_)


# --- rewriting ----------------------------------------------------------------------------------


def _weakened(external: core.External, hidden: set[Type]) -> core.External:
    """A summary without the promises that read inside opaque values."""

    def lookswithin(e: core.Expr) -> bool:
        return any(hidden & _opened(node) for node in nodes(e))

    return replace(external, ensures=tuple(e for e in external.ensures if not lookswithin(e)))


class _Rewriter:
    """A rewriter that replaces hidden types, and list and record expressions of them by calls."""

    def __init__(self, hidden: set[Type], site: int) -> None:
        self._hidden = hidden
        self._site = site
        self.made: dict[str, core.External] = {}

    def rewrite(self, node: Any) -> Any:
        if isinstance(node, Type):
            return self._type(node)
        if isinstance(node, core.MakeList | core.MakeRecord) and node.type in self._hidden:
            return self._call(node)
        return rebuilt(node, self.rewrite)

    def _type(self, type_: Type) -> Type:
        if type_ in self._hidden:
            return OpaqueType(_sort_name(type_))
        match type_:
            case RecordType(name=name, fields=its_fields):
                return RecordType(name, tuple((n, self._type(t)) for n, t in its_fields))
            case SequenceType(element=element):
                return replace(type_, element=self._type(element))
            case MapType(key=key, value=value):
                return MapType(self._type(key), self._type(value))
            case _:
                return type_

    def _call(self, node: core.MakeList | core.MakeRecord) -> core.ExternalCall:
        """The expression as an external function of its parts."""
        parts = node.items if isinstance(node, core.MakeList) else node.fields
        arguments = tuple(self.rewrite(part) for part in parts)
        types = tuple(argument.type for argument in arguments)
        signature = ",".join(show(type_) for type_ in types)
        name = f"make {_sort_name(node.type)}({signature})"
        result = self._type(node.type)
        if name not in self.made:
            self.made[name] = _maker(name, types, result)
        self._site += 1
        return core.ExternalCall(name, arguments, result, self._site, span=node.span)


def _maker(name: str, types: tuple[Type, ...], result: Type) -> core.External:
    parameters = tuple(
        core.Variable(core.Home.BOUND, slot, f"part{slot}", type_)
        for slot, type_ in enumerate(types)
    )
    answer = core.Variable(core.Home.BOUND, len(types), "result", result)
    return core.External(
        name,
        parameters,
        answer,
        core.ExternalKind.FUNCTION,
        (),
        (),
        len(types) + 1,
        constructs=True,
    )


def _sort_name(type_: Type) -> str:
    return show(type_)
