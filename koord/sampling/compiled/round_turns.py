"""Turns as code on columns: guards, events and models of one robot. [EVENT-TRANS] [ENV-MODEL]

The functions change columns in place, at their end, when nothing can be in doubt any more, and log
what was there before and after.
"""

from __future__ import annotations

from collections.abc import Iterable

from koord.sampling.compiled.column_writer import LETTERS, ColumnWriter, Key, in_order
from koord.sampling.compiled.expressions import Names, NoCodeError
from koord.sampling.compiled.state import State, StateColumn
from koord.sampling.compiled.statements import INDENT, is_tree, tuple_text
from koord.semantics.oracle import Phase
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import Status
from koord.syntax.walk import reached, statements, written

#: What a log has of a robot's copy of a shared variable that it did not write.
UNWRITTEN = object()


def _changed(block: core.Block) -> frozenset[Key]:
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
        self._changed = sorted(_changed(self.event.effect), key=in_order)
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
            name = f"{LETTERS[home]}{slot}"
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
            name = f"{LETTERS[home]}{slot}"
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
        changed = sorted({key for model in models for key in _changed(model)}, key=in_order)
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
            for home, slot in sorted(writer.loaded, key=in_order)
            if home is Home.PORT
        ]
        names.texts += [f"def {self.name}(pid):", *asked, *loads, *after, *writer.lines]
