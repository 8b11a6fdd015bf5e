"""Abstraction: types whose values merely flow become opaque sorts, such as planners' paths.

A record, list or map type whose values a program copies, compares, and hands to external functions,
but never takes apart, is replaced by an uninterpreted sort. Making such a value becomes an external
function, and what summaries say about its inside is dropped. So the abstract program can do all
that the program can, and more: *holds* carries over; a violation is translated back
(:mod:`koord.verify.reduction.problems`) and replayed before it counts.

Lists and maps of any length may be looked into: their length, an element by its index or key, and
whether a key is there become external functions, too (:class:`Observer`). Their summaries say only
what is so of all lists and maps, and so nothing bounds a length. Functions that merge two maps
become external functions as well, with a summary of every key. [T-OBSERVE]
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.core import BinaryOp, Direction, ListOp, Start
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
from koord.verify.reduction.merges import asked_keys, merged, without_summaries
from koord.verify.reduction.observers import (
    Observer,
    answer_type,
    binary,
    constructor,
    either,
    look_name,
    number,
    observing,
    read,
)


class Abstraction(Struct, frozen=True):
    """A program and its abstraction.

    ``made`` are the external functions that stand for list, map and record expressions, and
    ``merges`` those of them that merge two maps; ``observers`` stand for looks into a list or map;
    ``hidden`` are the types that became opaque, by the name of their sort.
    """

    original: core.Program
    program: core.Program
    hidden: dict[str, Type]
    made: frozenset[str]
    merges: frozenset[str]
    observers: dict[str, Observer]


def abstracted(program: core.Program) -> Abstraction | None:
    """Abstract a program; None if no type of it merely flows."""
    hidden = _flowing(program)
    if not hidden:
        return None
    merges = {f.name: type_ for f in program.functions if (type_ := merged(f)) in hidden}
    keys = {type_: asked_keys(program, type_) for type_ in merges.values()}
    rewriter = _Rewriter(hidden, last_site(program), merges, keys)
    # What the program never looks into, nobody needs to be told of.
    unseen = hidden - _looked_into([without_summaries(program)])
    externals = tuple(_weakened(external, hidden, unseen) for external in program.externals)
    functions = tuple(f for f in program.functions if f.name not in merges)
    rewritten: core.Program = rewriter.rewrite(
        replace(program, functions=functions, externals=externals)
    )
    helpers = rewriter.helpers()
    return Abstraction(
        program,
        # Summaries may look into what is opaque, and functions come before those that call them.
        replace(rewritten, externals=helpers + rewritten.externals),
        {_sort_name(type_): type_ for type_ in hidden},
        frozenset(external.name for external in helpers) - rewriter.observers.keys(),
        rewriter.merged,
        rewriter.observers,
    )


# --- which types flow ---------------------------------------------------------------------------


def _flowing(program: core.Program) -> set[Type]:
    """The record, list and map types whose values only external functions take apart."""
    types = {t for node in nodes(program) for t in _types_of(node)}
    candidates = {t for t in types if isinstance(t, RecordType | ListType | MapType)}
    # A caller's duty (``requires``) cannot be dropped as a promise can, so it opens types too; and
    # where it faults it is not met, so it looks at real values.
    body = without_summaries(program)
    opened = _opened_by(body)
    opened |= _looked_into(e.requires for e in program.externals)
    # A list whose length is known is best looked into as it is.
    opened |= _looked_into([body]) - _of_any_length(program)
    used = {t for e in program.externals for t in _signature(e)}
    flowing = candidates - opened
    # Without an external function that takes or gives such values there is nothing to gain.
    return {t for t in flowing if any(t in within(s) for s in used) or t in used}


def _of_any_length(program: core.Program) -> set[Type]:
    """The types of lists and maps that come from outside: answers, readings, arbitrary starts."""
    outside = [external.result.type for external in program.externals]
    ports = [port for agent in program.agents for port in agent.ports]
    declarations = [port.declaration for port in ports if port.direction is Direction.SENSOR]
    declarations += [*program.allread, *program.allwrite]
    declarations += [d for agent in program.agents for d in agent.locals]
    outside += [
        d.variable.type for d in declarations if d.initial is Start.ARBITRARY and d.length is None
    ]
    found = {t for type_ in outside for t in within(type_)}
    return {t for t in found if isinstance(t, ListType | MapType)}


def _signature(external: core.External) -> list[Type]:
    return [external.result.type, *(p.type for p in external.parameters)]


def _opened_by(part: object) -> set[Type]:
    """The types whose values a part of a program takes apart, but by observers."""
    every = list(nodes(part))
    # Places are told apart as objects: the same one may be read here and written there.
    read = {id(node.place) for node in every if isinstance(node, core.Read)}
    found: set[Type] = set()
    for node in every:
        found |= _opened(node, is_read=id(node) in read)
    return found


def _looked_into(parts: Iterable[object]) -> set[Type]:
    """The types whose values a part of a program takes apart, or asks by observers."""
    every = [node for part in parts for node in nodes(part)]
    return {t for node in every for t in (*_opened(node, is_read=False), *_observed(node))}


def _opened(node: object, *, is_read: bool) -> set[Type]:
    """The types whose values a node takes apart but by observers, or reads in another shape.

    ``is_read``: the node is a place that is read.
    """
    match node:
        case core.Place(variable=variable, steps=steps):
            bases = [variable.type, *(step.type for step in steps[:-1])]
            pairs = zip(bases, steps, strict=False)
            return {base for base, step in pairs if not (is_read and _is_look(step))}
        case core.Select(base=base, step=step):
            return set() if _is_look(step) else {base.type}
        case core.Builtin(arguments=arguments):
            return set() if _observed(node) else {argument.type for argument in arguments[:1]}
        case core.ForRange(low=low, high=high) | core.IntRange(low=low, high=high):
            # So often something is done: that has to be known.
            return _looked_into((low, high))
        case core.ForEach(sequence=sequence) | core.Elements(sequence=sequence):
            return {sequence.type}
        case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
            return {place.type}
        case core.Read(place=place) if isinstance(place.type, ArrayType):
            # An array may be read where a list is wanted; then that list is no opaque value.
            return {ListType(place.type.element)}
        case _:
            return set()


def _observed(node: object) -> set[Type]:
    """The types of lists and maps that a node asks by observers."""
    match node:
        case core.Builtin(op=ListOp.LENGTH, arguments=(one,)):
            return {one.type} if isinstance(one.type, ListType | MapType) else set()
        case core.Builtin(op=ListOp.CONTAINS, arguments=(one, _)):
            return {one.type} if isinstance(one.type, MapType) else set()
        case core.Select(base=base, step=step) if _is_look(step):
            return {base.type}
        case _:
            return set()


def _is_look(step: core.Step) -> bool:
    return isinstance(step, core.IndexStep | core.KeyStep)


def _types_of(node: object) -> Iterator[Type]:
    """All types that a node mentions, with the types inside them."""
    for attribute in ("type", "result"):
        type_ = getattr(node, attribute, None)
        if isinstance(type_, Type):
            yield from within(type_)


# --- rewriting ----------------------------------------------------------------------------------


def _weakened(external: core.External, hidden: set[Type], unseen: set[Type]) -> core.External:
    """A summary without the promises that take opaque values apart, or look into ``unseen``."""
    kept = tuple(
        e for e in external.ensures if not (hidden & _opened_by(e) or unseen & _looked_into([e]))
    )
    looks = bool(hidden & _looked_into(kept))
    return replace(external, ensures=kept, by_answer=looks)


class _Rewriter:
    """A rewriter that replaces hidden types; calls make their values, and look into them."""

    def __init__(
        self,
        hidden: set[Type],
        site: int,
        merges: dict[str, MapType],
        keys: dict[MapType, range | None],
    ) -> None:
        self._hidden = hidden
        self._site = site
        self._merges = merges
        self._keys = keys
        self._merging: dict[str, core.External] = {}
        self._empty: dict[str, core.External] = {}
        self._looks: dict[str, core.External] = {}
        self._made: dict[str, core.External] = {}
        self.observers: dict[str, Observer] = {}

    def helpers(self) -> tuple[core.External, ...]:
        """The external functions of the abstraction, each behind those that its summary asks."""
        made = [self._promising(external) for external in self._made.values()]
        made += [self._promising_merged(external) for external in self._merging.values()]
        return (*self._empty.values(), *self._looks.values(), *made)

    @property
    def merged(self) -> frozenset[str]:
        """The names of the external functions that merge two maps."""
        return frozenset(external.name for external in self._merging.values())

    def rewrite(self, node: Any) -> Any:
        if isinstance(node, Type):
            return self._type(node)
        match node:
            case core.MakeList(items=parts) if node.type in self._hidden:
                return self._making(node, parts)
            case core.MakeRecord(fields=parts) if node.type in self._hidden:
                return self._making(node, parts)
            case core.MakeMap(entries=entries) if node.type in self._hidden:
                return self._making(node, tuple(part for entry in entries for part in entry))
            case core.Call(function=name, arguments=(old, new)) if name in self._merges:
                type_ = self._merges[name]
                return self._merge(type_, (self.rewrite(old), self.rewrite(new)), node)
            case core.Builtin(op=op, arguments=(base, *rest)) if base.type in self._hidden:
                observer = Observer.LENGTH if op is ListOp.LENGTH else Observer.HAS
                return self._look(observer, self.rewrite(base), base.type, rest, node)
            case core.Select(base=base, step=step) if base.type in self._hidden:
                return self._step(self.rewrite(base), base.type, step, node)
            case core.Read(place=place) if self._looking(place) is not None:
                return self._look_up(node)
            case _:
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

    # --- what makes values ----------------------------------------------------------------------

    def _making(
        self, node: core.MakeList | core.MakeMap | core.MakeRecord, parts: Sequence[core.Expr]
    ) -> core.Expr:
        """The expression as an external function of its parts."""
        arguments = tuple(self.rewrite(part) for part in parts)
        if not arguments:
            return self._nothing(node.type, node)
        types = tuple(argument.type for argument in arguments)
        signature = ",".join(show(type_) for type_ in types)
        name = f"make {_sort_name(node.type)}({signature})"
        if name not in self._made:
            found = constructor(name, types, self._type(node.type))
            # Maps of other entries may be alike: of two with one key only the later counts.
            is_map = isinstance(node, core.MakeMap)
            self._made[name] = replace(found, constructs=not is_map)
        return self._call(self._made[name], arguments, node)

    def _nothing(self, type_: Type, node: core.Expr) -> core.Expr:
        """The list, map or record of no parts."""
        name = f"make {_sort_name(type_)}()"
        if name not in self._empty:
            self._empty[name] = replace(constructor(name, (), self._type(type_)), constructs=True)
        return self._call(self._empty[name], (), node)

    def _promising(self, maker: core.External) -> core.External:
        """A maker that says what its list or map is like, if anything looks into one."""
        type_ = self._type_of(maker.result)
        result = read(maker.result)
        parts = [read(parameter) for parameter in maker.parameters]
        ensures: list[core.Expr] = []
        if isinstance(type_, ListType):
            if self._asks(Observer.LENGTH, type_):
                length = self._look(Observer.LENGTH, result, type_, (), result)
                ensures.append(binary(BinaryOp.EQ, length, number(len(parts))))
            if self._asks(Observer.ITEM, type_):
                for k, part in enumerate(parts):
                    item = self._look(Observer.ITEM, result, type_, (number(k),), result)
                    ensures.append(binary(BinaryOp.EQ, item, part))
        elif isinstance(type_, MapType):
            keys, values = parts[::2], parts[1::2]
            for k, (key, value) in enumerate(zip(keys, values, strict=True)):
                if self._asks(Observer.HAS, type_):
                    ensures.append(self._look(Observer.HAS, result, type_, (key,), result))
                if self._asks(Observer.AT, type_):
                    found = self._look(Observer.AT, result, type_, (key,), result)
                    is_it = binary(BinaryOp.EQ, found, value)
                    # Of two entries with one key the later counts.
                    later = [binary(BinaryOp.EQ, key, other) for other in keys[k + 1 :]]
                    ensures.append(reduce(either, later, is_it))
        return replace(maker, ensures=tuple(ensures))

    def _merge(
        self, type_: MapType, arguments: tuple[core.Expr, core.Expr], node: core.Expr
    ) -> core.Expr:
        """Two maps merged, as an external function of them."""
        name = f"merge {_sort_name(type_)}"
        if name not in self._merging:
            opaque = self._type(type_)
            self._merging[name] = constructor(name, (opaque, opaque), opaque)
        return self._call(self._merging[name], arguments, node)

    def _promising_merged(self, merging: core.External) -> core.External:
        """A merging function that says what the merged map has at every key that is asked for."""
        type_ = self._type_of(merging.result)
        assert isinstance(type_, MapType)
        key = core.Variable(core.Home.BOUND, merging.bound, "key", self._type(type_.key))
        old, new = (read(parameter) for parameter in merging.parameters)
        result = read(merging.result)

        def look(observer: Observer, base: core.Expr) -> core.Expr:
            return self._look(observer, base, type_, (read(key),), base)

        every: list[core.Expr] = []
        if self._asks(Observer.HAS, type_):
            there = either(look(Observer.HAS, old), look(Observer.HAS, new))
            every.append(binary(BinaryOp.EQ, look(Observer.HAS, result), there))
        if self._asks(Observer.AT, type_):
            is_new = look(Observer.HAS, new)
            from_new, from_old = (
                binary(BinaryOp.EQ, look(Observer.AT, result), look(Observer.AT, source))
                for source in (new, old)
            )
            every.append(binary(BinaryOp.IMPLIES, is_new, from_new))
            every.append(either(is_new, from_old))
        forall, keys = core.QuantifierKind.FORALL, self._keys[type_]
        of_keys: core.QuantifierDomain = core.AllValues(key.type)
        if keys is not None:
            of_keys = core.IntRange(number(keys.start), number(keys.stop))
        promises = tuple(core.Quantified(forall, key, of_keys, each) for each in every)
        return replace(merging, ensures=promises, bound=merging.bound + 1)

    def _type_of(self, variable: core.Variable) -> Type:
        """The type that an opaque variable is of in the program."""
        assert isinstance(variable.type, OpaqueType)
        name = variable.type.name
        return next(t for t in self._hidden if _sort_name(t) == name)

    # --- what looks into values -----------------------------------------------------------------

    def _looking(self, place: core.Place) -> int | None:
        """The first step of a place that goes into an opaque value."""
        bases = [place.variable.type, *(step.type for step in place.steps)]
        looks = (k for k in range(len(place.steps)) if bases[k] in self._hidden)
        return next(looks, None)

    def _look_up(self, node: core.Read) -> core.Expr:
        place, first = node.place, self._looking(node.place)
        assert first is not None
        base: core.Expr = replace(node, place=replace(place, steps=place.steps[:first]))
        type_ = base.type
        found: core.Expr = self.rewrite(base)
        for step in place.steps[first:]:
            found = self._step(found, type_, step, node)
            type_ = step.type
        return found

    def _step(self, base: core.Expr, type_: Type, step: core.Step, node: core.Expr) -> core.Expr:
        """A part of a value, whose type was ``type_``, one step below it."""
        if type_ not in self._hidden:
            return core.Select(base, self.rewrite(step), span=node.span)
        assert not isinstance(step, core.FieldStep), "records that are looked into are not hidden"
        key = step.index if isinstance(step, core.IndexStep) else step.key
        observer = Observer.ITEM if isinstance(step, core.IndexStep) else Observer.AT
        return self._look(observer, base, type_, (self.rewrite(key),), node)

    def _asks(self, observer: Observer, type_: Type) -> bool:
        return look_name(observer, type_) in self._looks

    def _look(
        self,
        observer: Observer,
        base: core.Expr,
        type_: Type,
        keys: Sequence[core.Expr],
        node: core.Expr,
    ) -> core.Expr:
        """A call of an observer.

        What a caller must keep to is an argument of it: a summary asks other functions without
        their summaries. [EXTERNAL]
        """
        arguments = [base, *(self.rewrite(key) for key in keys)]
        match observer:
            case Observer.LENGTH | Observer.HAS:
                arguments.append(self._nothing(type_, node))
            case Observer.ITEM:
                arguments.append(self._look(Observer.LENGTH, base, type_, (), node))
            case Observer.AT:
                arguments.append(self._look(Observer.HAS, base, type_, keys, node))
        name = look_name(observer, type_)
        if name not in self._looks:
            types = [argument.type for argument in arguments]
            self._looks[name] = observing(
                name, observer, types, self._type(answer_type(observer, type_))
            )
            self.observers[name] = observer
        return self._call(self._looks[name], tuple(arguments), node)

    def _call(
        self, external: core.External, arguments: tuple[core.Expr, ...], node: core.Expr
    ) -> core.ExternalCall:
        self._site += 1
        type_ = external.result.type
        return core.ExternalCall(external.name, arguments, type_, self._site, span=node.span)


def _sort_name(type_: Type) -> str:
    return show(type_)
