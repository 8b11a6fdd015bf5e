"""Text of turns on storage as it is: guards, events and environments. [EVENT-TRANS] [ENV-TRANS]"""

from __future__ import annotations

from collections.abc import Iterable

from koord.sampling.compiled.expressions import Names, NoCodeError
from koord.sampling.compiled.statements import INDENT, EventWriter, is_tree
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import ArrayType, Type

_LISTS = {Home.LOCAL: "L", Home.PORT: "P", Home.ALLREAD: "R", Home.ALLWRITE: "W"}


class TurnWriter(EventWriter):
    """A writer of a robot's turn. ``loaded`` are the variables that the text has by name."""

    stops = "stop = True"
    asks = "asked = True"

    def __init__(self, names: Names) -> None:
        super().__init__(names)
        self.loaded: dict[tuple[Home, int], core.Variable] = {}
        self.written: dict[tuple[Home, int], core.Variable] = {}

    def pid(self) -> str:
        return "pid"

    # --- places ----------------------------------------------------------------------------------

    def read(self, place: core.Place) -> str:
        """A variable of the robot, or its copy of a shared one. [LOOKUP]"""
        variable = place.variable
        name = self._name(variable, after=place.primed)
        if not is_tree(variable.type):
            return self.below(f"sure({name})", place.steps) if place.steps else name
        return self._in_tree(name, variable.type, place.steps)

    def _in_tree(self, text: str, type_: Type, steps: tuple[core.Step, ...]) -> str:
        """What a place below a tree holds. [LOOKUP]"""
        for at, step in enumerate(steps):
            if not is_tree(type_):
                return self.below(f"sure(held({text}))", steps[at:])
            if isinstance(step, core.FieldStep):
                text = f"{text}.parts[{step.position}]"
            else:
                assert isinstance(step, core.IndexStep)
                text = f"pick({text}.parts, {self.expression(step.index)})"
            type_ = step.type
        if is_tree(type_):
            return f"whole(D, {text}, {self.names.new('k', type_)})"
        return f"held({text})"

    def _name(self, variable: core.Variable, *, after: bool = False) -> str:
        """The name of a variable, or of the port as it is after the environment's turn."""
        key = variable.home, variable.slot
        if after:
            self.written[key] = variable
        self.loaded[key] = variable
        return f"{_LISTS[variable.home].lower()}{'n' if after else ''}{variable.slot}"

    def write(self, place: core.Place, value: str) -> None:
        """Write a place. [LOCAL-ASSIGN] [SHARED-ASSIGN] [ALLREAD] [ACTUATE]"""
        variable, steps = place.variable, place.steps
        if self.in_environment and variable.home is not Home.PORT:
            raise NoCodeError("an environment writes ports")
        name = self._name(variable, after=self.in_environment)
        self.written[variable.home, variable.slot] = variable
        shared = variable.home in (Home.ALLREAD, Home.ALLWRITE)
        masks = f"{_LISTS[variable.home]}M"
        tree = is_tree(variable.type)
        if not steps:
            self.line(f"{name} = {self._stored(variable.type, value) if tree else value}")
            if shared:
                self.line(f"{masks}[{variable.slot}] = WHOLE")
            return
        fresh, locations = self.names.new("t"), self.names.new("t")
        self.line(f"{fresh} = {value}")
        self.line(f"{locations} = {self.locations(steps)}")
        if not tree:
            before = f"Cell(True, {name})"
            changed = f"put_inside(D, {name}, {locations}, {fresh})"
        elif len(steps) == 1 and isinstance(variable.type, ArrayType) and not is_tree(place.type):
            before = name
            changed = f"put_in_array({name}, {locations}[0].index, {fresh})"
        else:
            before = name
            storage = self._fresh(variable.type, steps, place.type, fresh)
            changed = f"put(D, {name}, {locations}, {storage})"
        if shared:
            self.line(f"mark(D, {masks}, {variable.slot}, {before}, {locations})")
        self.line(f"{name} = {changed}")

    def _stored(self, type_: Type, value: str) -> str:
        return f"stored(D, {self.names.new('k', type_)}, {value}, {self.names.system.robots})"

    def _fresh(self, root: Type, steps: tuple[core.Step, ...], type_: Type, value: str) -> str:
        """The value as storage of the written part: a cell where that part lies in an atom."""
        for step in steps:
            if not is_tree(root):
                return f"Cell(True, {value})"
            root = step.type
        return self._stored(type_, value)

    # --- what stands around ----------------------------------------------------------------------

    def load(self) -> list[str]:
        """The lines that name the variables that are used. A cell's is what it holds."""
        lines = []
        for (home, slot), variable in sorted(self.loaded.items(), key=_by_name):
            storage, name = f"{_LISTS[home]}[{slot}]", f"{_LISTS[home].lower()}{slot}"
            if is_tree(variable.type):
                lines.append(f"{INDENT}{name} = {storage}")
            else:
                lines.append(f"{INDENT}{name} = held({storage})")
        return lines

    def stores(self, home: Home, suffix: str = "") -> str:
        """The storage of a home's variables after the turn."""
        source = _LISTS[home]
        slots = sorted(slot for its_home, slot in self.written if its_home is home)
        if not slots:
            return source
        parts, last = [], 0
        for slot in slots:
            if slot > last:
                parts.append(f"*{source}[{last}:{slot}]")
            name, old = f"{source.lower()}{suffix}{slot}", f"{source.lower()}{slot}"
            if is_tree(self.written[home, slot].type):
                parts.append(name)
            else:
                kept = f"{source}[{slot}] if {name} is {old}_ else Cell(True, {name})"
                parts.append(f"({kept})")
            last = slot + 1
        return f"({', '.join([*parts, f'*{source}[{last}:]'])})"


def _by_name(item: tuple[tuple[Home, int], core.Variable]) -> tuple[str, int]:
    (home, slot), _ = item
    return _LISTS[home], slot


_HEAD = (
    f"{INDENT}L, P, copy = state.locals, state.ports, state.copy",
    f"{INDENT}R, W = copy.allread, copy.allwrite",
)


def guards_text(writer: TurnWriter, agent: core.Agent) -> str:
    """A function of a robot's state: the positions of the events that it may select. [SELECT]"""
    name = writer.names.new("guards")
    writer.line("found = []")
    for position, event in enumerate(agent.events):
        writer.bound.clear()
        writer.line(f"if {writer.expression(event.guard)}:")
        writer.line(f"{INDENT}found.append({position})")
    writer.line("return found")
    head = [f"def {name}(state, pid, ask):", *_HEAD]
    writer.names.texts += [*head, *writer.load(), *writer.lines]
    return name


def event_text(writer: TurnWriter, agent: core.Agent, event: core.Event) -> str:
    """A function of a robot's state: what it holds after an event, and what else came of it."""
    name = writer.names.new("event")
    writer.begin(event.bound)
    writer.line(f"if not {writer.expression(event.guard)}:")
    writer.line(f"{INDENT}raise InDoubt")
    for s in event.effect:
        writer.statement(s)
    copy = "copy"
    homes = {home for home, _ in writer.written}
    if homes & {Home.ALLREAD, Home.ALLWRITE}:
        copy = f"Store({writer.stores(Home.ALLREAD)}, {writer.stores(Home.ALLWRITE)})"
    ends = (writer.stores(Home.LOCAL), writer.stores(Home.PORT), copy)
    result = f"return ({', '.join(ends)}, RM, WM, stop, asked, entered, written)"
    start = [
        f"{INDENT}RM, WM, stop, asked = {{}}, {{}}, False, False",
        f"{INDENT}entered, written = {writer.names.new('k', frozenset())}, ()",
    ]
    head = [f"def {name}(state, pid, ask):", *_HEAD]
    writer.names.texts += [
        *head,
        *writer.load(),
        *_kept(writer.written),
        *start,
        *writer.lines,
        INDENT + result,
    ]
    return name


def _kept(written: Iterable[tuple[Home, int]]) -> list[str]:
    """Lines that keep what written variables hold at first."""
    names = sorted(f"{_LISTS[home].lower()}{slot}" for home, slot in written)
    return [f"{INDENT}{name}_ = {name}" for name in names]


def environment_text(writer: TurnWriter, agent: core.Agent) -> str:
    """A function of a robot's ports: those after the environment's turn, and broken contracts.
    [ENV-MODEL] [ENV-FREE] [ENV-CONTRACT]
    """
    name = writer.names.new("environment")
    writer.in_environment = True
    for module in agent.modules:
        if module.environment is not None:
            writer.begin(module.environment_bound)
            for s in module.environment:
                writer.statement(s)
        else:
            _sense(writer, agent, module)
    writer.line("broken = []")
    for module in agent.modules:
        for contract in module.contracts:
            _look_at(writer, contract, promised=module.environment is not None)
    result = f"return {writer.stores(Home.PORT, 'n')}, broken"
    after = [
        f"{INDENT}pn{slot} = p{slot}" for home, slot in sorted(writer.written, key=lambda k: k[1])
    ]
    head = [f"def {name}(P, pid, ask):"]
    writer.names.texts += [
        *head,
        *writer.load(),
        *_kept(writer.written),
        *after,
        *writer.lines,
        INDENT + result,
    ]
    return name


def _sense(writer: TurnWriter, agent: core.Agent, module: core.Module) -> None:
    """A sensor without a model reads what it is given. [ENV-FREE]"""
    for position in module.ports:
        port = agent.ports[position]
        if port.direction is core.Direction.SENSOR:
            value = f"ask.sensor({writer.names.new('k', port)})"
            writer.write(core.Place(port.declaration.variable, span=port.span), value)


def _look_at(writer: TurnWriter, contract: core.Contract, *, promised: bool) -> None:
    """A contract: if what it requires held before, what it ensures holds now. [ENV-CONTRACT]"""
    writer.bound.clear()
    required = " and ".join(writer.expression(e) for e in contract.requires) or "True"
    ensured = " and ".join(writer.expression(e) for e in contract.ensures) or "True"
    writer.line(f"if ({required}) and not ({ensured}):")
    if promised:
        writer.line(f"{INDENT}broken.append({writer.names.new('k', contract)})")
    else:
        # Who finds readings looks for others.
        writer.line(f"{INDENT}raise InDoubt")
