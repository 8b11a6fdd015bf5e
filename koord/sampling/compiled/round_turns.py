"""Turns as code on columns: what one robot does with its entries of them. [EVENT-TRANS] [ENV-MODEL]

The functions change columns in place, at their end, when nothing can be in doubt any more, and log
what was there before and after. Of what is shared a robot reads what was there when the round
began.
"""

from __future__ import annotations

from collections.abc import Iterable

from koord.sampling.compiled.expressions import LARGEST, Names, NoCodeError
from koord.sampling.compiled.state import State, StateColumn
from koord.sampling.compiled.statements import INDENT, BodyWriter, is_tree, tuple_text
from koord.semantics.oracle import Phase
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import Status
from koord.syntax.types import FloatType, GrowingType, IntType, MapType, Type, contains
from koord.syntax.walk import reached, statements, written

#: What a log has of a robot's copy of a shared variable that it did not write.
UNWRITTEN = object()

_LETTERS = {Home.LOCAL: "l", Home.PORT: "p", Home.ALLREAD: "r", Home.ALLWRITE: "w"}

#: The order in which changes are told: of what is shared, then of what is a robot's own.
_ORDER = (Home.ALLREAD, Home.ALLWRITE, Home.LOCAL, Home.PORT)

_Key = tuple[Home, int]


class ColumnWriter(BodyWriter):
    """A writer of one function of a robot of a kind, on the columns of a state."""

    def __init__(self, names: Names, state: State, kind: int, changed: frozenset[_Key]) -> None:
        super().__init__(names)
        self.unit = state.unit
        self.short = True
        self.state = state
        self.kind = kind
        #: What is written anywhere in the text.
        self.changed = changed
        self.loaded: set[_Key] = set()
        self.in_environment = False
        self._surely: set[_Key] = set()
        self._small: dict[_Key, bool] = {}

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
        return f"{_LETTERS[variable.home]}{'n' if after else ''}{variable.slot}"

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

    def simple(self, s: core.Atomic | core.Stop | core.TryStop | core.Output) -> None:
        if self.in_environment:
            raise NoCodeError("a statement of events")
        match s:
            case core.Atomic():
                # [ATOMIC]
                self.line(f"entered |= {self.names.new('k', frozenset((s.lock_class,)))}")
                for inner in s.body:
                    self.statement(inner)
            case core.Stop():
                self.line(f"stopping = {int(Status.STOPPED)}")
            case core.TryStop():
                self.line(f"stopping = max(stopping, {int(Status.ASKED)})")
            case core.Output():
                # [OUTPUT]
                values = "".join(f"{self.sure(value)}, " for value in s.values)
                types = self.names.new("k", tuple(value.type for value in s.values))
                self.line(f"written += (Written({s.stream!r}, ({values}), {types}),)")

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
        for home, slot in sorted(self.loaded, key=_in_order):
            column, name = self.column(home, slot), f"{_LETTERS[home]}{slot}"
            match home:
                case Home.ALLWRITE:
                    lines.append(f"{INDENT}{name} = s_{column.name}[0]")
                case Home.ALLREAD:
                    lines.append(f"{INDENT}{name} = s_{column.name}[pid]")
                case _:
                    lines.append(f"{INDENT}{name} = {column.name}[pid]")
        return lines

    def fit(self, key: _Key, name: str) -> None:
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


def _in_order(key: _Key) -> tuple[int, int]:
    home, slot = key
    return _ORDER.index(home), slot


def _atoms_from(type_: Type, steps: tuple[core.Step, ...]) -> int:
    """How many of the steps lead to an atom, or to something above atoms. [ATOM]"""
    for count, step in enumerate(steps):
        if not is_tree(type_):
            return count
        type_ = step.type
    return len(steps)


def _changed(block: core.Block) -> frozenset[_Key]:
    places = [place for s in statements(block) for place in written(s)]
    keys = {(place.variable.home, place.variable.slot) for place in places}
    return frozenset((home, slot) for home, slot in keys if home is not Home.BOUND)


def _asked(phase: Phase, lines: Iterable[str]) -> list[str]:
    """The line that names who is asked, where the text asks."""
    if any("ask" in line for line in lines):
        return [f"{INDENT}ask = ask_{phase.name.lower()}[pid]"]
    return []


def doubt_text(names: Names) -> str:
    """A function that is always in doubt."""
    name = names.new("doubt")
    names.texts += [f"def {name}(*_):", f"{INDENT}raise InDoubt"]
    return name


def guards_text(names: Names, state: State, kind: int) -> str:
    """A function of a robot: the positions of the events that it may select. [SELECT]

    It is in doubt about them all where a guard has no text, as :class:`EventText` is.
    """
    try:
        return _guards_text(names, state, kind)
    except NoCodeError:
        if state.unit is not None:
            raise
        return doubt_text(names)


def _guards_text(names: Names, state: State, kind: int) -> str:
    writer = ColumnWriter(names, state, kind, frozenset())
    name = names.new("guards")
    names.values["status"] = state.status.values
    writer.line(f"if status[pid] == {int(Status.STOPPED)}:")
    writer.line(f"{INDENT}return ()")
    writer.line("found = []")
    for position, event in enumerate(state.system.program.agents[kind].events):
        writer.bound.clear()
        writer.line(f"if {writer.expression(event.guard)}:")
        writer.line(f"{INDENT}found.append({position})")
    writer.line("return found")
    asked = _asked(Phase.PROG, writer.lines)
    names.texts += [f"def {name}(pid):", *asked, *writer.load(), *writer.lines]
    return name


class EventText:
    """The text of an event: a function of a robot and of the lock classes that are taken.

    It returns those taken afterwards, None where the robot loses a lock. ``columns`` are those that
    it writes, in the order of its log. An event without a text is always in doubt, if that is not
    for counting floats in units: that raises NoCodeError.
    """

    def __init__(self, names: Names, state: State, kind: int, position: int) -> None:
        self.event = state.system.program.agents[kind].events[position]
        self._state = state
        self._position = position
        self._changed = sorted(_changed(self.event.effect), key=_in_order)
        self._writer = ColumnWriter(names, state, kind, frozenset(self._changed))
        self.columns = [self._writer.column(*key) for key in self._changed]
        self._kinds_of_statements = set(map(type, statements(self.event.effect)))
        self.stops = bool(self._kinds_of_statements & {core.Stop, core.TryStop})
        if self.stops:
            self.columns.append(state.status)
        try:
            self.name = self._text(names)
        except NoCodeError:
            if state.unit is not None:
                raise
            self.columns, self.name = [], doubt_text(names)

    def _text(self, names: Names) -> str:
        writer = self._writer
        name = names.new("event")
        for key in self._changed:
            writer.loaded.add(key)
        writer.begin(self.event.bound)
        for s in self.event.effect:
            writer.statement(s)
        self._end()
        asked = _asked(Phase.PROG, writer.lines)
        lines = [f"def {name}(pid, taken):", *asked, *writer.load(), *self._start()]
        names.texts += [*lines, *writer.lines]
        return name

    def _start(self) -> list[str]:
        lines = []
        for home, slot in self._changed:
            name = f"{_LETTERS[home]}{slot}"
            if home is Home.ALLWRITE:
                lines += [f"m{name} = False", f"v{name} = []"]
            else:
                lines.append(f"o{name} = {name}")
        if self.stops:
            lines.append("stopping = 0")
        if core.Atomic in self._kinds_of_statements:
            lines.append(f"entered = {self._writer.names.new('k', frozenset())}")
        if core.Output in self._kinds_of_statements:
            lines.append("written = ()")
        return [INDENT + line for line in lines]

    def _end(self) -> None:
        """What is committed, where nothing is in doubt. [SHARED-ASSIGN] [ATOMIC] [STOP]"""
        writer = self._writer
        writes, logged, copies = [], [], []
        for (home, slot), column in zip(self._changed, self.columns, strict=False):
            name = f"{_LETTERS[home]}{slot}"
            writer.fit((home, slot), name)
            if home is Home.ALLWRITE:
                self._join(name, column)
                logged += [f"o{name}", f"n{name}"]
                writes.append(f"{column.name}[0] = n{name}")
                copies.append(f"{name} if m{name} or v{name} else UNWRITTEN")
            else:
                logged += [f"o{name}", name]
                writes.append(f"{column.name}[pid] = {name}")
        if self.stops:
            robots = self._state.system.robots
            writer.line("before = status[pid]")
            writer.line("after = max(before, stopping)")
            # Who is the last to stop, or to ask, ends the run. [STOP]
            writer.line(f"if after and all(status[k] for k in range({robots}) if k != pid):")
            writer.line(f"{INDENT}raise InDoubt")
            logged += ["before", "after"]
            writes.append("status[pid] = after")
        taken, written_ = "taken", "()"
        if core.Atomic in self._kinds_of_statements:
            writer.line("if entered & taken:")
            writer.line(f"{INDENT}return None")
            writer.line("taken = taken | entered")
        if core.Output in self._kinds_of_statements:
            written_ = "written"
        for line in writes:
            writer.line(line)
        writer.line(
            f"log.append((pid, {self._position}, None, {tuple_text(logged)}, "
            f"{tuple_text(copies)}, {written_}, {taken}))"
        )
        writer.line("return taken")

    def _join(self, name: str, column: StateColumn) -> None:
        """What everybody has of a variable after this robot's writes. [SHARED-ASSIGN]"""
        writer = self._writer
        writer.line(f"o{name} = {column.name}[0]")
        writer.line(f"if m{name}:")
        writer.line(f"{INDENT}n{name} = {name}")
        writer.line("else:")
        writer.line(f"{INDENT}n{name} = o{name}")
        if is_tree(column.type):
            writer.line(f"{INDENT}for place, part in v{name}:")
            writer.line(f"{INDENT * 2}n{name} = put_inside(D, n{name}, place, part)")


class EnvironmentText:
    """The text of the models of a kind: a function of a robot. Raises NoCodeError without models.
    [ENV-MODEL] [ENV-CONTRACT]
    """

    def __init__(self, names: Names, state: State, kind: int) -> None:
        agent = state.system.program.agents[kind]
        models = [module.environment for module in agent.modules if module.environment is not None]
        if len(models) < len(agent.modules):
            raise NoCodeError("sensors without a model are read")
        below = reached(state.system.program, agent.modules)
        if any(isinstance(node, core.ExternalCall) for node in below):
            raise NoCodeError("an environment asks for more than a choice")
        changed = sorted({key for model in models for key in _changed(model)}, key=_in_order)
        writer = ColumnWriter(names, state, kind, frozenset(changed))
        writer.in_environment = True
        self.columns = [writer.column(*key) for key in changed]
        for key in changed:
            writer.loaded.add(key)
        for module in agent.modules:
            assert module.environment is not None
            writer.begin(module.environment_bound)
            for s in module.environment:
                writer.statement(s)
        for module in agent.modules:
            for contract in module.contracts:
                writer.bound.clear()
                required = " and ".join(map(writer.expression, contract.requires)) or "True"
                ensured = " and ".join(map(writer.expression, contract.ensures)) or "True"
                writer.line(f"if ({required}) and not ({ensured}):")
                writer.line(f"{INDENT}raise InDoubt")
        logged, writes = [], []
        for (home, slot), column in zip(changed, self.columns, strict=True):
            writer.fit((home, slot), f"pn{slot}")
            logged += [f"p{slot}", f"pn{slot}"]
            writes.append(f"{column.name}[pid] = pn{slot}")
        for line in writes:
            writer.line(line)
        writer.line(f"env_log.append((pid, {tuple_text(logged)}))")
        self.name = names.new("environment")
        asked = _asked(Phase.ENV, writer.lines)
        loads = writer.load()
        after = [
            f"{INDENT}pn{slot} = p{slot}"
            for home, slot in sorted(writer.loaded, key=_in_order)
            if home is Home.PORT
        ]
        names.texts += [f"def {self.name}(pid):", *asked, *loads, *after, *writer.lines]
