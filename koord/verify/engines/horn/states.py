"""What a configuration at the end of a round consists of, as one list of scalars."""

from __future__ import annotations

from collections.abc import Iterator

from koord.semantics.configurations import Configuration
from koord.semantics.every_number import NotFiniteError
from koord.semantics.storage import Many, Storage, Tree
from koord.semantics.values import Family, Rec, Seq, Table, Value
from koord.syntax.source import NOWHERE
from koord.verify.encoding.terms import Term


def scalars(configuration: Configuration[Term]) -> list[Term]:
    """The scalars of a configuration, in an order that all of a system have in common.

    Raises NotFiniteError where there are lists or maps that may be of any size.
    """
    found: list[Term] = []
    for robot in configuration.robots:
        found += [robot.status, robot.ran]
        for storage in (*robot.locals, *robot.ports):
            found += _of_storage(storage)
    for storage in (*configuration.store.allread, *configuration.store.allwrite):
        found += _of_storage(storage)
    return found


def _of_storage(storage: Storage[Term]) -> Iterator[Term]:
    if isinstance(storage, Many):
        raise AssertionError("systems of so many robots have no families")
    if isinstance(storage, Tree):
        for part in storage.parts:
            yield from _of_storage(part)
    else:
        yield storage.is_set
        yield from _of_value(storage.value)


def _of_value(value: Value[Term]) -> Iterator[Term]:
    if isinstance(value, Rec):
        for part in value.fields:
            yield from _of_value(part)
    elif isinstance(value, Seq):
        if not isinstance(value.length, int):
            raise NotFiniteError(NOWHERE, "a list may have any length")
        yield value.length
        for part in value.items:
            yield from _of_value(part)
    elif isinstance(value, Table):
        raise NotFiniteError(NOWHERE, "a map may have any size")
    elif isinstance(value, Family):
        raise AssertionError("systems of so many robots have no families")
    else:
        yield value
