"""What a configuration holds, variable by variable, kept up to date as a run goes on. [PROP-READ]

A *column* has what one variable holds at each robot, or what a shared one holds.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from msgspec import Struct, field

from koord.sampling.compiled.operations import UNSET, InDoubt, held, scaled, whole
from koord.sampling.conjuncts import Place
from koord.semantics.configurations import Configuration
from koord.semantics.domain import Constant, Domain
from koord.semantics.storage import Cell, Storage, Tree
from koord.syntax.core import Home, Variable, slot_in
from koord.syntax.system import System
from koord.syntax.types import Type


class Column(Struct, eq=False):
    """What a variable holds, by robot. ``watchers`` are told of what changes.

    ``unit``: floats are counted in units; UNSET where they are no whole number of them.
    """

    name: str
    type: Type
    unit: int | None
    values: list[Any]
    watchers: list[Watcher] = field(default_factory=list)


class Watcher(Struct, eq=False):
    """What has to be looked at again after a change.

    ``axes[column]`` are the positions of the bound variables by which a column is read, None for
    one that is read in another way. ``touched`` are the robots, by position, since the last look.
    """

    axes: dict[str, frozenset[int] | None]
    touched: list[set[int]]
    everything: bool = True

    def note(self, column: Column, index: int) -> None:
        """Note that an entry of a column has changed."""
        axes = self.axes[column.name]
        if axes is None:
            self.everything = True
        else:
            for axis in axes:
                self.touched[axis].add(index)

    @property
    def is_stale(self) -> bool:
        return self.everything or any(self.touched)

    def settle(self) -> None:
        """Forget what has changed: it was looked at."""
        self.everything = False
        for robots in self.touched:
            robots.clear()


class Columns(Struct, eq=False):
    """The columns that are read, and the configuration that they show."""

    d: Domain[Constant]
    system: System
    _columns: dict[tuple[Home | None, int, str, int | None], Column] = field(default_factory=dict)
    _feeds: dict[Place, list[tuple[Column, int]]] = field(default_factory=dict)
    _shown: Configuration[Constant] | None = None

    def of(self, variable: Variable, unit: int | None) -> Column:
        """The column of a variable."""
        key = variable.home, variable.slot, variable.name, unit
        if key not in self._columns:
            self._add(key, variable.own_type, self._places(variable))
        return self._columns[key]

    def of_turns(self, what: str, type_: Type) -> Column:
        """The column of the robots' ``ran`` or ``status``."""
        key = None, 0, what, None
        if key not in self._columns:
            robots = range(self.system.robots)
            self._add(key, type_, [(None, 0, robot) for robot in robots])
        return self._columns[key]

    def _add(
        self,
        key: tuple[Home | None, int, str, int | None],
        type_: Type,
        places: list[Place | None],
    ) -> None:
        unit = key[3]
        name = f"c{len(self._columns)}" if key[0] is not None else key[2]
        column = self._columns[key] = Column(name, type_, unit, [UNSET] * len(places))
        for index, place in enumerate(places):
            if place is not None:
                self._feeds.setdefault(place, []).append((column, index))
                if self._shown is not None:
                    column.values[index] = self._held(column, place, self._shown)

    def _places(self, variable: Variable) -> list[Place | None]:
        """Where a column's values are, by index; None for kinds without the variable."""
        robots = range(self.system.robots)
        match variable.home:
            case Home.ALLWRITE:
                return [(Home.ALLWRITE, variable.slot, -1)]
            case Home.ALLREAD:
                return [(Home.ALLREAD, variable.slot, robot) for robot in robots]
            case home:
                slots = [slot_in(self.system.agent(robot), variable) for robot in robots]
                return [
                    None if slot is None else (home, slot, robot)
                    for robot, slot in zip(robots, slots, strict=True)
                ]

    def show(self, configuration: Configuration[Constant], changed: Iterable[Place]) -> None:
        """Show a configuration, of which these places differ from the last one shown."""
        self._shown = configuration
        for place in changed:
            for column, index in self._feeds.get(place, ()):
                column.values[index] = self._held(column, place, configuration)
                for watcher in column.watchers:
                    watcher.note(column, index)

    def _held(self, column: Column, place: Place, configuration: Configuration[Constant]) -> Any:
        home, slot, robot = place
        if home is None:
            state = configuration.robots[robot]
            return state.ran if column.name == "ran" else state.status
        storage = _storage(configuration, home, slot, robot)
        if not isinstance(storage, Cell):
            value = whole(self.d, storage, column.type)
        else:
            value = held(storage)
        if column.unit is None:
            return value
        try:
            return scaled(value, column.unit)
        except InDoubt:
            return UNSET


def _storage(
    configuration: Configuration[Constant], home: Home, slot: int, robot: int
) -> Storage[Constant]:
    match home:
        case Home.LOCAL:
            return configuration.robots[robot].locals[slot]
        case Home.PORT:
            return configuration.robots[robot].ports[slot]
        case Home.ALLREAD:
            entries = configuration.store.allread[slot]
            assert isinstance(entries, Tree)
            return entries.parts[robot]
        case Home.ALLWRITE:
            return configuration.store.allwrite[slot]
        case Home.BOUND:
            raise AssertionError("bound variables belong to no configuration")
