"""What a system holds, variable by variable, as code changes it in place. [CONFIG]

Each variable is a column of values, by robot; a shared one that any robot writes has one value.
Records and arrays are values as well. Configurations are made of columns when somebody wants one.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

from msgspec import field

from koord.sampling.compiled.columns import Column
from koord.sampling.compiled.expressions import LARGEST, NoCodeError
from koord.sampling.compiled.operations import UNSET, held, whole
from koord.semantics.configurations import Configuration, Robot, Store, Turn
from koord.semantics.domain import Constant, Domain
from koord.semantics.storage import Cell, Storage, Tree, stored
from koord.syntax import core
from koord.syntax.core import Home, Variable, slot_in
from koord.syntax.system import System
from koord.syntax.types import INT, FloatType, Type


class StateColumn(Column, eq=False, kw_only=True):
    """A column with the storage that its values were read from.

    ``round_start`` is what all robots hold as their copy of a shared variable.
    """

    home: Home | None
    slots: tuple[int | None, ...]
    round_start: list[Any] = field(default_factory=list)
    kept: list[Storage[Constant] | None] = field(default_factory=list)
    kept_values: list[Any] = field(default_factory=list)

    def read(self, d: Domain[Constant], index: int, storage: Storage[Constant]) -> bool:
        """Take what storage holds as the value at an index; return whether it could be counted."""
        if self.kept[index] is storage and self.values[index] is self.kept_values[index]:
            return True
        self.kept[index] = storage
        value = self.values[index] = self.kept_values[index] = self._value(d, storage)
        return value is not UNSET or self.unit is None or held(storage) is UNSET

    def _value(self, d: Domain[Constant], storage: Storage[Constant]) -> Any:
        if not isinstance(storage, Cell):
            return whole(d, storage, self.type)
        value = held(storage)
        if value is UNSET:
            return UNSET
        if self.unit is not None:
            # What is no whole number of units is left to the rules.
            if type(value) is not Fraction or self.unit % value.denominator:
                return UNSET
            value = value.numerator * (self.unit // value.denominator)
        if type(value) is int and not -LARGEST < value < LARGEST:
            return UNSET
        return value

    @staticmethod
    def is_set(*values: Any) -> bool:
        """Return whether these are values of the column, known and set."""
        return all(value is not UNSET for value in values)

    def shown(self, value: Any) -> Any:
        """A value as the rules know it."""
        return value if self.unit is None else Fraction(value, self.unit)

    def storage(self, d: Domain[Constant], value: Any, robots: int) -> Storage[Constant]:
        """Storage that holds a value."""
        return stored(d, self.type, self.shown(value), robots)

    def written(self, d: Domain[Constant], index: int, robots: int) -> Storage[Constant]:
        """Storage of what is at an index: that which was read, if it is the same."""
        value = self.values[index]
        kept = self.kept[index]
        if kept is None or value is not self.kept_values[index]:
            kept = self.kept[index] = self.storage(d, value, robots)
            self.kept_values[index] = value
        return kept


class State:
    """The columns of a system. ``unit``: exact floats are counted in units. Raises NoCodeError."""

    def __init__(self, d: Domain[Constant], system: System, unit: int | None) -> None:
        self.d = d
        self.system = system
        self.unit = unit
        self.columns: list[StateColumn] = []
        self.round = 0
        #: Whether some float was no whole number of units.
        self.is_uneven = False
        robots = range(system.robots)
        self.ran = self._added("ran", INT, None, (0,) * system.robots)
        self.status = self._added("status", INT, None, (0,) * system.robots)
        self.allread = [
            self._of(declaration, tuple(declaration.variable.slot for _ in robots))
            for declaration in system.program.allread
        ]
        self.allwrite = [
            self._of(declaration, (declaration.variable.slot,))
            for declaration in system.program.allwrite
        ]
        self._own: dict[tuple[Home, int, int], StateColumn] = {}
        self.locals = self._of_kinds(Home.LOCAL)
        self.ports = self._of_kinds(Home.PORT)

    def _added(
        self, name: str, type_: Type, home: Home | None, slots: tuple[int | None, ...]
    ) -> StateColumn:
        unit = self.unit if isinstance(type_, FloatType) else None
        values: list[Any] = [UNSET] * len(slots)
        column = StateColumn(name, type_, unit, values, home=home, slots=slots)
        column.round_start = list(values)
        column.kept = [None] * len(slots)
        column.kept_values = list(values)
        self.columns.append(column)
        return column

    def _of(self, declaration: core.Declaration, slots: tuple[int | None, ...]) -> StateColumn:
        variable = declaration.variable
        return self._added(f"c{len(self.columns)}", variable.own_type, variable.home, slots)

    def _of_kinds(self, home: Home) -> dict[int, list[StateColumn]]:
        """The columns of each kind's own variables, by slot. Kinds share those of one name."""
        return {kind: self._of_kind(home, kind) for kind in sorted(set(self.system.kinds))}

    def _of_kind(self, home: Home, kind: int) -> list[StateColumn]:
        agent = self.system.program.agents[kind]
        declarations = agent.locals
        if home is Home.PORT:
            declarations = tuple(port.declaration for port in agent.ports)
        found = []
        for declaration in declarations:
            variable = declaration.variable
            slots = tuple(slot_in(self.system.agent(i), variable) for i in self._robots)
            places = [(home, i, slot) for i, slot in enumerate(slots) if slot is not None]
            columns = {id(self._own.get(place)) for place in places}
            column = self._own.get(places[0])
            if len(columns) > 1 or (column is not None and column.type != variable.type):
                raise NoCodeError(f"kinds of robots have different variables {variable.name}")
            if column is None:
                column = self._of(declaration, slots)
                self._own |= dict.fromkeys(places, column)
            found.append(column)
        return found

    @property
    def _robots(self) -> range:
        return range(self.system.robots)

    # --- what the code of claims asks for --------------------------------------------------------

    def of(self, variable: Variable, unit: int | None) -> StateColumn:
        """The column of a variable."""
        assert unit is None or unit == self.unit
        match variable.home:
            case Home.ALLREAD:
                return self.allread[variable.slot]
            case Home.ALLWRITE:
                return self.allwrite[variable.slot]
            case home:
                slots = [slot_in(self.system.agent(i), variable) for i in self._robots]
                places = [(home, i, slot) for i, slot in enumerate(slots) if slot is not None]
                columns = [self._own[place] for place in places]
                if not columns or any(column is not columns[0] for column in columns):
                    raise NoCodeError(f"robots have different variables {variable.name}")
                return columns[0]

    def of_turns(self, what: str, type_: Type) -> StateColumn:
        """The column of the robots' ``ran`` or ``status``."""
        return self.ran if what == "ran" else self.status

    # --- configurations --------------------------------------------------------------------------

    def show(self, configuration: Configuration[Constant]) -> None:
        """Show a configuration between two rounds."""
        d, store, even = self.d, configuration.store, True
        self.round = configuration.round
        for slot, column in enumerate(self.allread):
            entries = store.allread[slot]
            assert isinstance(entries, Tree)
            for index, part in enumerate(entries.parts):
                even &= column.read(d, index, part)
        for slot, column in enumerate(self.allwrite):
            even &= column.read(d, 0, store.allwrite[slot])
        for index, state in enumerate(configuration.robots):
            for column, storage in zip(self.locals[state.kind], state.locals, strict=True):
                even &= column.read(d, index, storage)
            for column, storage in zip(self.ports[state.kind], state.ports, strict=True):
                even &= column.read(d, index, storage)
            self.ran.values[index] = state.ran
            self.status.values[index] = state.status
        self.is_uneven |= not even
        # All robots see what is shared. [REFRESH]
        for column in (*self.allread, *self.allwrite):
            column.round_start[:] = column.values

    def configuration(self) -> Configuration[Constant]:
        """The configuration between two rounds that the columns hold."""
        d, robots = self.d, self.system.robots

        def row(columns: Iterable[StateColumn], index: int) -> tuple[Storage[Constant], ...]:
            return tuple(column.written(d, index, robots) for column in columns)

        allread = tuple(
            Tree(tuple(column.written(d, i, robots) for i in self._robots))
            for column in self.allread
        )
        store = Store(allread, row(self.allwrite, 0))
        states = tuple(
            Robot(
                kind,
                row(self.locals[kind], index),
                row(self.ports[kind], index),
                store,
                self.status.values[index],
                self.ran.values[index],
                Turn.PROG,
            )
            for index, kind in enumerate(self.system.kinds)
        )
        return Configuration(states, store, self.round)
