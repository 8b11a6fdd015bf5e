"""Statements and expressions as code on columns, as one robot runs them. [EVENT-TRANS] [ENV-MODEL]

Of what is shared a robot reads what was there when the round began, and its own writes.
"""

from __future__ import annotations

from koord.sampling.compiled.expressions import LARGEST, Names, NoCodeError
from koord.sampling.compiled.state import State, StateColumn
from koord.sampling.compiled.statements import INDENT, EventWriter, is_tree
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import Status
from koord.syntax.types import FloatType, GrowingType, IntType, MapType, Type, contains

LETTERS = {Home.LOCAL: "l", Home.PORT: "p", Home.ALLREAD: "r", Home.ALLWRITE: "w"}

#: The order in which changes are told: of what is shared, then of what is a robot's own.
_ORDER = (Home.ALLREAD, Home.ALLWRITE, Home.LOCAL, Home.PORT)

Key = tuple[Home, int]


class ColumnWriter(EventWriter):
    """A writer of one function of a robot of a kind, on the columns of a state."""

    stops = f"stopping = {int(Status.STOPPED)}"
    asks = f"stopping = max(stopping, {int(Status.ASKED)})"

    def __init__(self, names: Names, state: State, kind: int, changed: frozenset[Key]) -> None:
        super().__init__(names)
        self.unit = state.unit
        self.short = True
        self.state = state
        self.kind = kind
        #: What is written anywhere in the text.
        self.changed = changed
        self.loaded: set[Key] = set()
        self._surely: set[Key] = set()
        self._small: dict[Key, bool] = {}

    def pid(self) -> str:
        return "pid"

    def column(self, home: Home, slot: int) -> StateColumn:
        """The column of a variable of this kind, whose values the text may name."""
        match home:
            case Home.LOCAL:
                column = self.state.locals[self.kind][slot]
            case Home.PORT:
                column = self.state.ports[self.kind][slot]
            case Home.ALLREAD:
                column = self.state.allread[slot]
            case Home.ALLWRITE:
                column = self.state.allwrite[slot]
            case Home.BOUND:
                raise AssertionError("bound variables have no column")
        self.names.values[column.name] = column.values
        self.names.values[f"s_{column.name}"] = column.round_start
        return column

    # --- places ----------------------------------------------------------------------------------

    def read(self, place: core.Place) -> str:
        """A variable of the robot, or its copy of a shared one. [LOOKUP]"""
        variable, steps = place.variable, place.steps
        if variable.home is Home.ALLREAD:
            return self._entries(variable, steps)
        name = self._name(variable, after=place.primed)
        return self.below(f"sure({name})", steps) if steps else name

    def _entries(self, variable: core.Variable, steps: tuple[core.Step, ...]) -> str:
        """An array over robots, or the entry of one: the robot's own as it is by now."""
        seen = f"s_{self.column(Home.ALLREAD, variable.slot).name}"
        own = (Home.ALLREAD, variable.slot) in self.changed
        if not steps:
            self.uncounted(variable.type)
            return (
                f"gathered_with({seen}, pid, {self._name(variable)})"
                if own
                else (f"gathered({seen})")
            )
        first, *others = steps
        assert isinstance(first, core.IndexStep)
        index = self.expression(first.index)
        if index == "pid":
            text = self._name(variable) if own else f"{seen}[pid]"
        elif own:
            text = f"pick_with({seen}, {index}, pid, {self._name(variable)})"
        else:
            text = f"pick({seen}, {index})"
        return self.below(f"sure({text})", tuple(others)) if others else text

    def _name(self, variable: core.Variable, *, after: bool = False) -> str:
        """The name of a variable, or of the port as it is after the environment's turn."""
        key = variable.home, variable.slot
        self.loaded.add(key)
        return f"{LETTERS[variable.home]}{'n' if after else ''}{variable.slot}"

    def write(self, place: core.Place, value: str) -> None:
        """Write a place. [LOCAL-ASSIGN] [SHARED-ASSIGN] [ALLREAD] [ACTUATE]"""
        variable, steps = place.variable, place.steps
        key = variable.home, variable.slot
        if self.in_environment and variable.home is not Home.PORT:
            raise NoCodeError("an environment writes ports")
        name = self._name(variable, after=self.in_environment)
        if variable.home is Home.ALLREAD:
            first, *others = steps or (None,)
            if not isinstance(first, core.IndexStep):
                raise NoCodeError("an array over robots is written as a whole")
            index = self.expression(first.index)
            if index != "pid":
                # A robot writes its own entry. [ALLREAD]
                self.line(f"if {index} != pid:")
                self.line(f"{INDENT}raise InDoubt")
            steps = tuple(others)
        if is_tree(place.type):
            type_ = self.names.new("k", place.type)
            value = f"fitted({value}, {type_}, {self.names.system.robots})"
        if self.depth == 1 and not self.loops:
            self._surely.add(key)
        if not steps:
            self.line(f"{name} = {value}")
            if variable.home is Home.ALLWRITE:
                self.line(f"m{name} = True")
            return
        self.uncounted(place.type)
        part, locations = self.names.new("t"), self.names.new("t")
        self.line(f"{part} = {value}")
        self.line(f"{locations} = {self.locations(steps)}")
        self.line(f"{name} = put_inside(D, {name}, {locations}, {part})")
        if variable.home is Home.ALLWRITE:
            if not is_tree(variable.type):
                self.line(f"m{name} = True")
            elif _atoms_from(variable.type, steps) < len(steps):
                raise NoCodeError("a part of an atom inside of what is shared is written")
            else:
                self.line(f"v{name}.append(({locations}, {part}))")

    # --- statements ------------------------------------------------------------------------------

    def statement(self, s: core.Stmt) -> None:
        match s:
            case core.Append() | core.Remove() | core.Pop():
                self.uncounted(s.place.type)
            case core.ForEach():
                self.uncounted(s.sequence.type)
            case core.Output():
                self.uncounted(*(value.type for value in s.values))
            case core.Assign(place=place, value=value):
                key = place.variable.home, place.variable.slot
                inside = len(place.steps) > (place.variable.home is Home.ALLREAD)
                small = not inside and self._short_parts(value) == 1
                self._small[key] = self._small.get(key, True) and small
            case _:
                pass
        super().statement(s)

    def choose(self, e: core.Choose) -> str:
        self.uncounted(e.type)
        return super().choose(e)

    def external(self, e: core.ExternalCall) -> str:
        self.uncounted(e.type, *(argument.type for argument in e.arguments))
        return super().external(e)

    # --- what stands around ----------------------------------------------------------------------

    def load(self) -> list[str]:
        """The lines that name the variables that are used."""
        lines = []
        for home, slot in sorted(self.loaded, key=in_order):
            column, name = self.column(home, slot), f"{LETTERS[home]}{slot}"
            match home:
                case Home.ALLWRITE:
                    lines.append(f"{INDENT}{name} = s_{column.name}[0]")
                case Home.ALLREAD:
                    lines.append(f"{INDENT}{name} = s_{column.name}[pid]")
                case _:
                    lines.append(f"{INDENT}{name} = {column.name}[pid]")
        return lines

    def fit(self, key: Key, name: str) -> None:
        """Leave what is too long to the rules: numbers, and lists."""
        type_ = self.column(*key).type
        unset = "" if key in self._surely else f"{name} is not UNSET and "
        counted = isinstance(type_, FloatType) and self.unit is not None
        if isinstance(type_, IntType) or counted:
            if not self._small.get(key):
                self.line(f"if {unset}not {-LARGEST} < {name} < {LARGEST}:")
                self.line(f"{INDENT}raise InDoubt")
        elif contains(type_, GrowingType) or contains(type_, MapType):
            self.line(f"check_length({name})")


def in_order(key: Key) -> tuple[int, int]:
    home, slot = key
    return _ORDER.index(home), slot


def _atoms_from(type_: Type, steps: tuple[core.Step, ...]) -> int:
    """How many of the steps lead to an atom, or to something above atoms. [ATOM]"""
    for count, step in enumerate(steps):
        if not is_tree(type_):
            return count
        type_ = step.type
    return len(steps)
