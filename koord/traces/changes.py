"""Differences between two configurations, location by location."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

from koord.semantics.configurations import NO_EVENT, Configuration, Store
from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage
from koord.semantics.values import Rec, Seq, Table, Value, identical
from koord.syntax.system import Status
from koord.syntax.types import POS, MapType, RecordType, SequenceType, Type, part_types
from koord.traces.names import Named, Names
from koord.traces.rendering import ROUNDED, show_storage, show_value
from koord.traces.value_codec import encode_value


class Change(Struct, frozen=True):
    """A location that changed, before and after; ``robot`` is None for shared ones."""

    robot: int | None
    name: str
    old: str
    new: str

    def told(self, of: int | None = None) -> str:
        """The change in words; with its robot, where that is not plain: not robot ``of``."""
        whose = "" if self.robot in (None, of) else f"@{self.robot}"
        return f"{self.name}{whose}: {self.old} → {self.new}"


def changes(
    names: Names, before: Configuration[Constant], after: Configuration[Constant]
) -> Iterator[Change]:
    """Yield the changes that a step made to the store and to robots' locals, ports and status.

    Robots' copies are left out: they are the store at the round's start with the robot's own
    writes, which the store shows.
    """
    yield from _of_store(names, before.store, after.store)
    for number, (old, new) in enumerate(zip(before.robots, after.robots, strict=True)):
        if old is new:
            continue
        own = names.of(number)
        yield from _of_variables(number, own.locals, old.locals, new.locals)
        yield from _of_variables(number, own.ports, old.ports, new.ports)
        if old.status != new.status:
            yield Change(number, "status", _status(old.status), _status(new.status))


def differences(
    names: Names, expected: Configuration[Constant], recorded: Configuration[Constant]
) -> Iterator[Change]:
    """Yield the differences of a recorded configuration (``new``) from the expected one. [REPLAY]

    Two are identical if nothing is yielded: [CONFIG]. Of a faulted one the fault alone counts, and
    of the fault its kind and robot: the text may have been laid out anew.
    """
    if _fault(expected) != _fault(recorded):
        yield Change(None, "the fault", _fault(expected), _fault(recorded))
    if expected.fault is not None:
        # What an evaluator left behind a fault has no meaning.
        return
    if expected.round != recorded.round:
        yield Change(None, "the number of rounds", str(expected.round), str(recorded.round))
    if expected.turn is not recorded.turn:
        yield Change(None, "the turn", expected.turn.value, recorded.turn.value)
    if expected.taken != recorded.taken:
        yield Change(None, "the lock classes taken", _set(expected.taken), _set(recorded.taken))
    yield from changes(names, expected, recorded)
    for number, (old, new) in enumerate(zip(expected.robots, recorded.robots, strict=True)):
        if old.ran != new.ran:
            events = names.of(number).events
            yield Change(number, "the event run", _event(events, old.ran), _event(events, new.ran))
        if old.turn is not new.turn:
            yield Change(number, "the turn", old.turn.value, new.turn.value)
        for change in _of_store(names, old.copy, new.copy):
            yield Change(number, f"the copy of {change.name}", change.old, change.new)


def _set(classes: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(classes))) or "none"


def _fault(configuration: Configuration[Constant]) -> str:
    fault = configuration.fault
    if fault is None:
        return "none"
    whose = "" if fault.robot is None else f" of robot {fault.robot}"
    return f"{fault.kind.value}{whose}"


def _event(events: tuple[str, ...], ran: Constant) -> str:
    assert isinstance(ran, int)
    return "none" if ran == NO_EVENT else events[ran]


def _status(status: Constant) -> str:
    assert isinstance(status, int)
    return Status(status).name.lower()


def _of_store(names: Names, old: Store[Constant], new: Store[Constant]) -> Iterator[Change]:
    if old is not new:
        yield from _of_variables(None, names.allread, old.allread, new.allread)
        yield from _of_variables(None, names.allwrite, old.allwrite, new.allwrite)


def _of_variables(
    robot: int | None,
    named: Iterable[Named],
    old: Iterable[Storage[Constant]],
    new: Iterable[Storage[Constant]],
) -> Iterator[Change]:
    for one, before, after in zip(named, old, new, strict=True):
        if before is not after:
            for name, was, became in _of_storage(one.name, one.type, before, after):
                yield Change(robot, name, was, became)


#: A location, and what it held.
Found = tuple[str, str, str]


def _of_storage(
    name: str, type_: Type, old: Storage[Constant], new: Storage[Constant]
) -> Iterator[Found]:
    if old is new:
        return
    if isinstance(old, Cell) and isinstance(new, Cell):
        if old.is_set and new.is_set:
            yield from _of_value(name, type_, old.value, new.value)
        elif old.is_set or new.is_set:
            yield name, show_storage(old, type_), show_storage(new, type_)
        return
    assert not isinstance(old, Cell)
    assert not isinstance(new, Cell)
    if _is_whole(type_) or not _anything_set(old):
        if any(_of_parts(name, type_, old.parts, new.parts)):
            yield name, show_storage(old, type_), show_storage(new, type_)
        return
    yield from _of_parts(name, type_, old.parts, new.parts)


def _of_parts(
    name: str,
    type_: Type,
    old: tuple[Storage[Constant], ...],
    new: tuple[Storage[Constant], ...],
) -> Iterator[Found]:
    types = part_types(type_, len(old))
    for position, (t, before, after) in enumerate(zip(types, old, new, strict=True)):
        yield from _of_storage(_below(name, type_, position), t, before, after)


def _of_value(
    name: str, type_: Type, old: Value[Constant], new: Value[Constant]
) -> Iterator[Found]:
    if old is new:
        return
    match old, new:
        case Rec(fields=before), Rec(fields=after) if not _is_whole(type_):
            assert isinstance(type_, RecordType)
            for position, (_, t) in enumerate(type_.fields):
                below = _below(name, type_, position)
                yield from _of_value(below, t, before[position], after[position])
        case Seq(items=before), Seq(items=after) if len(before) == len(after):
            assert isinstance(type_, SequenceType)
            for position, (a, b) in enumerate(zip(before, after, strict=True)):
                yield from _of_value(f"{name}[{position}]", type_.element, a, b)
        case Table(entries=before), Table(entries=after) if [k for k, _ in before] == [
            k for k, _ in after
        ]:
            assert isinstance(type_, MapType)
            for (key, a), (_, b) in zip(before, after, strict=True):
                shown = show_value(key, type_.key)
                yield from _of_value(f"{name}[{shown}]", type_.value, a, b)
        case _:
            if not identical(old, new):
                yield name, *told_apart(old, new, type_)


def told_apart(old: Value[Constant], new: Value[Constant], type_: Type) -> tuple[str, str]:
    """Show two values that differ so that the difference is visible: exactly, if need be."""
    shown = show_value(old, type_), show_value(new, type_)
    if shown[0].replace(ROUNDED, "") != shown[1].replace(ROUNDED, ""):
        return shown
    return str(encode_value(old, type_)), str(encode_value(new, type_))


def _anything_set(storage: Storage[Constant]) -> bool:
    if isinstance(storage, Cell):
        return bool(storage.is_set)
    return any(map(_anything_set, storage.parts))


def _is_whole(type_: Type) -> bool:
    """Return whether a place with coordinates is shown as one value, not field by field."""
    return type_ == POS


def _below(name: str, type_: Type, position: int) -> str:
    if isinstance(type_, RecordType):
        return f"{name}.{type_.fields[position][0]}"
    return f"{name}[{position}]"
