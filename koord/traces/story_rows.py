"""Rows of stories: variables, split into parts that have values of their own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage
from koord.semantics.values import Rec
from koord.syntax import core
from koord.syntax.system import Status
from koord.syntax.types import POS, RecordType, Type, part_types
from koord.traces.names import Named, Names
from koord.traces.rendering import show_storage
from koord.traces.story_form import Home, NewValue, Position, StoryRow

#: Arrays with more elements are one row.
_MOST_PARTS = 32


class _Leaf(Struct, frozen=True):
    """A row's part of a variable: its type, and the way to it."""

    type: Type
    path: tuple[int, ...]

    def of(self, storage: Storage[Constant]) -> Storage[Constant]:
        for position in self.path:
            assert not isinstance(storage, Cell)
            storage = storage.parts[position]
        return storage


class _Source(Struct, frozen=True):
    """A variable with the number of its first row, and its leaves."""

    home: core.Home
    robot: int | None
    slot: int
    first: int
    leaves: tuple[_Leaf, ...]

    def of(self, configuration: Configuration[Constant]) -> Storage[Constant]:
        match self.home:
            case core.Home.ALLREAD:
                return configuration.store.allread[self.slot]
            case core.Home.ALLWRITE:
                return configuration.store.allwrite[self.slot]
            case core.Home.LOCAL:
                assert self.robot is not None
                return configuration.robots[self.robot].locals[self.slot]
            case core.Home.PORT:
                assert self.robot is not None
                return configuration.robots[self.robot].ports[self.slot]
            case core.Home.BOUND:
                raise AssertionError("no configuration has bound variables")
        assert_never(self.home)


class RowTable(Struct):
    """The rows of a story: all variables, with the values that they have at present."""

    rows: list[StoryRow]
    types: list[Type | None]
    sources: list[_Source]
    texts: list[str]
    statuses: dict[int, int]  #: the rows of robots' statuses

    @staticmethod
    def of(
        names: Names,
        first: Configuration[Constant],
        read: frozenset[core.Variable],
        subject: str,
    ) -> RowTable:
        """The rows of a system; ``read`` are variables that the claim reads."""
        table = RowTable([], [], [], [], {})
        asked = {(v.home, v.name) for v in read} | {(core.Home.ALLWRITE, subject)}
        system = names.system
        for slot, one in enumerate(names.allwrite):
            variable = system.program.allwrite[slot].variable
            is_read = (core.Home.ALLWRITE, variable.name) in asked
            table.add(one, core.Home.ALLWRITE, "allwrite", None, first, is_read=is_read)
        for slot, one in enumerate(names.allread):
            variable = system.program.allread[slot].variable
            is_read = (core.Home.ALLREAD, variable.name) in asked
            table.add(one, core.Home.ALLREAD, "allread", None, first, is_read=is_read)
        for robot in range(system.robots):
            own, agent = names.of(robot), system.agent(robot)
            for one, declaration in zip(own.locals, agent.locals, strict=True):
                is_read = (core.Home.LOCAL, declaration.variable.name) in asked
                table.add(one, core.Home.LOCAL, "local", robot, first, is_read=is_read)
            for one, port in zip(own.ports, agent.ports, strict=True):
                is_read = (core.Home.PORT, port.declaration.variable.name) in asked
                home: Home = "sensor" if port.direction is core.Direction.SENSOR else "actuator"
                table.add(one, core.Home.PORT, home, robot, first, is_read=is_read)
            table.statuses[robot] = len(table.rows)
            table.rows.append(StoryRow("status", "status", robot, "", is_read=False))
            table.types.append(None)
        table.texts = list(table.texts_of(first))
        return table

    def add(
        self,
        named: Named,
        home: core.Home,
        shown: Home,
        robot: int | None,
        first: Configuration[Constant],
        *,
        is_read: bool,
    ) -> None:
        """Add the rows of a variable."""
        at = len(self.rows)
        slot = named.slot
        source = _Source(home, robot, slot, at, ())
        leaves = list(_leaves(named.name, named.type, source.of(first), ()))
        self.sources.append(replace(source, leaves=tuple(leaf for _, leaf in leaves)))
        for name, leaf in leaves:
            self.rows.append(StoryRow(name, shown, robot, "", is_read))
            self.types.append(leaf.type)

    def texts_of(self, configuration: Configuration[Constant]) -> list[str]:
        """The values of all rows."""
        found = [""] * len(self.rows)
        for source in self.sources:
            storage = source.of(configuration)
            for k, leaf in enumerate(source.leaves):
                found[source.first + k] = show_storage(leaf.of(storage), leaf.type)
        for robot, row in self.statuses.items():
            found[row] = _status(configuration, robot)
        return found

    def changes(
        self, before: Configuration[Constant] | None, after: Configuration[Constant]
    ) -> Iterator[NewValue]:
        """The rows whose values are others than at present, which they become."""
        for source in self.sources:
            storage = source.of(after)
            old = None if before is None else source.of(before)
            if storage is old:
                continue
            for k, leaf in enumerate(source.leaves):
                here = leaf.of(storage)
                if old is not None and leaf.of(old) is here:
                    continue
                yield from self._new(source.first + k, show_storage(here, leaf.type))
        for robot, row in self.statuses.items():
            yield from self._new(row, _status(after, robot))

    def _new(self, row: int, text: str) -> Iterator[NewValue]:
        if self.texts[row] != text:
            self.texts[row] = text
            yield NewValue(row, text)

    def positions(
        self, before: Configuration[Constant] | None, after: Configuration[Constant]
    ) -> Iterator[Position]:
        """The ports of type ``pos`` that are others than before, in metres."""
        for source in self.sources:
            if source.home is not core.Home.PORT:
                continue
            storage = source.of(after)
            if before is not None and source.of(before) is storage:
                continue
            for k, leaf in enumerate(source.leaves):
                place = _coordinates(leaf.of(storage)) if leaf.type == POS else None
                if place is not None:
                    yield Position(source.first + k, *place)


def _leaves(
    name: str, type_: Type, storage: Storage[Constant], path: tuple[int, ...]
) -> Iterator[tuple[str, _Leaf]]:
    """The parts of a variable that have rows of their own: places and lists are one."""
    if isinstance(storage, Cell) or type_ == POS or not 0 < len(storage.parts) <= _MOST_PARTS:
        yield name, _Leaf(type_, path)
        return
    types = part_types(type_, len(storage.parts))
    for position, (part_type, part) in enumerate(zip(types, storage.parts, strict=True)):
        below = f"{name}[{position}]"
        if isinstance(type_, RecordType):
            below = f"{name}.{type_.fields[position][0]}"
        yield from _leaves(below, part_type, part, (*path, position))


def _coordinates(storage: Storage[Constant]) -> tuple[float, float, float] | None:
    """The coordinates of a place, None where one of them is not set."""
    if isinstance(storage, Cell):
        value = storage.value
        if not storage.is_set or not isinstance(value, Rec):
            return None
        x, y, z = (float(part) for part in value.fields if isinstance(part, Constant))
        return x, y, z
    parts = [part for part in storage.parts if isinstance(part, Cell) and part.is_set]
    if len(parts) != len(storage.parts):
        return None
    x, y, z = (float(part.value) for part in parts if isinstance(part.value, Constant))
    return x, y, z


def _status(configuration: Configuration[Constant], robot: int) -> str:
    status = configuration.robots[robot].status
    assert isinstance(status, int)
    return Status(status).name.lower()
