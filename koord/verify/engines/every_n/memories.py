"""Memories as scalars, each with the path to it, for loops over all robots. [T-LOOP]"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeAlias

from koord.semantics.every_number import NotFiniteError
from koord.semantics.machine import Memory
from koord.semantics.storage import Cell, Many, Storage, Tree
from koord.semantics.values import Family, Rec, Seq, Table, Value
from koord.syntax.source import NOWHERE
from koord.verify.encoding.terms import Term

#: Where a scalar is in a memory: the list or field, the slot, then the way down.
Path: TypeAlias = "tuple[str | int, ...]"

LISTS = ("locals", "ports", "allread", "allwrite", "after", "bound")
FLAGS = ("stop", "trystop", "broke", "returned")

#: The ends of paths to what has no scalars: what stands there is told from others, and no more.
MANY, FAMILY, TABLE = "many", "family", "table"
UNLISTED = (MANY, FAMILY, TABLE)

#: What stands at a path in place of a scalar.
At: TypeAlias = "Callable[[Path, Term], Term]"


def scalars(memory: Memory[Term]) -> list[tuple[Path, Term]]:
    """All scalars of a memory that can be listed."""
    found: list[tuple[Path, Term]] = []

    def note(path: Path, scalar: Term) -> Term:
        found.append((path, scalar))
        return scalar

    for name in LISTS:
        for slot, storage in enumerate(getattr(memory, name)):
            if storage is not None:
                _mapped((name, slot), storage, note)
    for name in FLAGS:
        note((name,), getattr(memory, name))
    if memory.result is not None:
        _mapped(("result",), memory.result, note)
    return found


def with_scalars(memory: Memory[Term], new: dict[Path, Term]) -> Memory[Term]:
    """The memory with other scalars at some paths."""
    made = memory.copied()
    for name in LISTS:
        storages = getattr(made, name)
        for slot, storage in enumerate(storages):
            if storage is not None and any(path[:2] == (name, slot) for path in new):
                storages[slot] = _mapped((name, slot), storage, new.get)
    for name in FLAGS:
        if (name,) in new:
            setattr(made, name, new[name,])
    if made.result is not None:
        made.result = _mapped(("result",), made.result, new.get)
    return made


def _mapped(path: Path, storage: Storage[Term], at: At) -> Storage[Term]:
    """Storage with something else in the place of each scalar."""
    if isinstance(storage, Many):
        _keep((*path, MANY), id(storage), at, "changes an array over all robots")
        return storage
    if isinstance(storage, Tree):
        return Tree(tuple(_mapped((*path, k), part, at) for k, part in enumerate(storage.parts)))
    is_set = at((*path, "set"), storage.is_set)
    return Cell(is_set, _mapped_value((*path, "value"), storage.value, at))


def _mapped_value(path: Path, value: Value[Term], at: At) -> Value[Term]:
    def below(parts: Iterable[Value[Term]]) -> tuple[Value[Term], ...]:
        return tuple(_mapped_value((*path, k), part, at) for k, part in enumerate(parts))

    match value:
        case Family():
            _keep((*path, FAMILY), id(value), at, "changes an array over all robots")
            return value
        case Rec(fields=fields):
            return Rec(below(fields))
        case Seq(length=length, items=items):
            _keep((*path, "length"), length, at, "makes a list longer or shorter")
            return Seq(length, below(items))
        case Table():
            _keep((*path, TABLE), id(value), at, "changes a map")
            return value
        case _:
            return at(path, value)


def _keep(path: Path, scalar: Term, at: At, what: str) -> None:
    """Refuse to change what no loop over all robots may change."""
    if at(path, scalar) is not scalar:
        raise NotFiniteError(NOWHERE, f"a loop over all robots {what}")
