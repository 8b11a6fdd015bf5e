"""What a turn found out, as plain data, so that two domains can be compared by equality.

What has no meaning is left out: items behind a list's end, the value of an unset atom, and
anything behind the first fault.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeAlias, TypeVar

import z3
from msgspec import Struct

from koord.semantics.configurations import Configuration, Fault, Robot, Store, Written
from koord.semantics.domain import Constant
from koord.semantics.environment import Evolved
from koord.semantics.machine import Legality
from koord.semantics.recordings import Concrete
from koord.semantics.storage import Storage, Tree
from koord.semantics.turns import Turned
from koord.semantics.values import Rec, Seq, Table, Value
from koord.syntax.system import System
from koord.syntax.types import (
    BOOL,
    INT,
    ArrayType,
    ListType,
    MapType,
    QueueType,
    RecordType,
    StreamType,
    StringType,
    Type,
)
from koord.verify.encoding.terms import Term
from tests.agreement.symbols import Symbols, own_types, part_types, shared_types

V = TypeVar("V")

#: Gives the constant that a scalar of a type is.
Meaning: TypeAlias = Callable[[V, Type], Constant]


def itself(value: Constant, type_: Type) -> Constant:
    """The meaning of a scalar of the exact domain."""
    return value


def meaning_of(symbols: Symbols, results: object) -> Meaning[Term]:
    """The meaning of every term in some results, all worked out at once."""
    terms = list({term.get_id(): term for term in _terms(results)}.values())
    known = {
        term.get_id(): constant
        for term, constant in zip(terms, symbols.evaluated(terms), strict=True)
    }

    def meaning(value: Term, type_: Type) -> Constant:
        constant = known[value.get_id()] if isinstance(value, z3.ExprRef) else value
        if isinstance(type_, StringType | StreamType) and not isinstance(constant, str):
            assert isinstance(constant, int)
            return symbols.d.text_of(constant)
        return constant

    return meaning


def _terms(results: object) -> Iterator[z3.ExprRef]:
    if isinstance(results, z3.ExprRef):
        yield results
    elif isinstance(results, tuple | list | frozenset):
        for part in results:
            yield from _terms(part)
    elif isinstance(results, dict):
        yield from _terms(tuple(results.values()))
    elif isinstance(results, Struct) and not isinstance(results, Fault):
        for name in results.__struct_fields__:
            yield from _terms(getattr(results, name))


# --- values and storage ---------------------------------------------------------------------------


def flat_value(meaning: Meaning[V], value: Value[V], type_: Type) -> object:
    """A value without what lies behind the ends of lists."""
    if isinstance(value, Rec):
        assert isinstance(type_, RecordType)
        pairs = zip(value.fields, type_.fields, strict=True)
        return tuple(flat_value(meaning, part, t) for part, (_, t) in pairs)
    if isinstance(value, Seq):
        assert isinstance(type_, ArrayType | ListType | QueueType)
        items = value.items[: _count(meaning, value.length)]
        return [flat_value(meaning, item, type_.element) for item in items]
    if isinstance(value, Table):
        assert isinstance(type_, MapType)
        entries = value.entries[: _count(meaning, value.length)]
        return [
            (flat_value(meaning, k, type_.key), flat_value(meaning, v, type_.value))
            for k, v in entries
        ]
    return meaning(value, type_)


def _count(meaning: Meaning[V], length: V) -> int:
    count = meaning(length, INT)
    assert isinstance(count, int)
    return count


def flat_storage(meaning: Meaning[V], storage: Storage[V], type_: Type) -> object:
    """What is set in a storage, and what it holds there."""
    if isinstance(storage, Tree):
        types = part_types(type_, len(storage.parts))
        pairs = zip(storage.parts, types, strict=True)
        return tuple(flat_storage(meaning, part, t) for part, t in pairs)
    if not meaning(storage.is_set, BOOL):
        return "unset"
    return ("set", flat_value(meaning, storage.value, type_))


def flat_storages(
    meaning: Meaning[V], storages: Sequence[Storage[V]], types: Sequence[Type]
) -> list[object]:
    pairs = zip(storages, types, strict=True)
    return [flat_storage(meaning, storage, type_) for storage, type_ in pairs]


def flat_store(meaning: Meaning[V], system: System, store: Store[V]) -> object:
    allread, allwrite = shared_types(system)
    return (
        flat_storages(meaning, store.allread, allread),
        flat_storages(meaning, store.allwrite, allwrite),
    )


def flat_robot(meaning: Meaning[V], system: System, number: int, robot: Robot[V]) -> object:
    locals_, ports = own_types(system, number)
    return (
        flat_storages(meaning, robot.locals, locals_),
        flat_storages(meaning, robot.ports, ports),
        flat_store(meaning, system, robot.copy),
        meaning(robot.status, INT),
        meaning(robot.ran, INT),
        robot.turn,
    )


def flat_configuration(meaning: Meaning[V], system: System, c: Configuration[V]) -> object:
    """A configuration, but for its fault."""
    robots = [flat_robot(meaning, system, i, robot) for i, robot in enumerate(c.robots)]
    return robots, flat_store(meaning, system, c.store), c.round, c.turn


def exact_value(value: Concrete, type_: Type) -> object:
    return flat_value(itself, value, type_)  # type: ignore[arg-type]  # a union within a union


def exact_storage(storage: Storage[Constant], type_: Type) -> object:
    return flat_storage(itself, storage, type_)


# --- turns ----------------------------------------------------------------------------------------


def first_fault(meaning: Meaning[V], faults: Iterable[tuple[V, Fault]]) -> Fault | None:
    return next((fault for condition, fault in faults if meaning(condition, BOOL)), None)


def is_legal(meaning: Meaning[V], legality: Iterable[Legality[V]]) -> bool:
    return all(meaning(needed.condition, BOOL) for needed in legality)


def flat_turned(
    meaning: Meaning[V], system: System, number: int, turned: Turned[V], after: Store[V]
) -> object:
    """What a turn found out; ``after`` is some store with its writes put into it."""
    fault = first_fault(meaning, turned.faults)
    if fault is not None:
        return fault
    return (
        flat_robot(meaning, system, number, turned.robot),
        flat_store(meaning, system, after),
        sorted(k for k, condition in turned.entered.items() if meaning(condition, BOOL)),
        [_flat_output(meaning, w) for condition, w in turned.output if meaning(condition, BOOL)],
        is_legal(meaning, turned.legality),
    )


def _flat_output(meaning: Meaning[V], written: Written[V]) -> object:
    pairs = zip(written.values, written.types, strict=True)
    return written.stream, [flat_value(meaning, value, type_) for value, type_ in pairs]


def flat_evolved(meaning: Meaning[V], system: System, number: int, turned: Evolved[V]) -> object:
    """What the environment's turn did to one robot."""
    fault = first_fault(meaning, turned.faults)
    if fault is not None:
        return fault
    _, ports = own_types(system, number)
    return (
        flat_storages(meaning, turned.ports, ports),
        is_legal(meaning, turned.legality),
        [(meaning(kept, BOOL), contract.name) for kept, contract in turned.promises],
    )
