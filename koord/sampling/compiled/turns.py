"""Turns as code: guards, events and environments, on storage as it is. [EVENT-TRANS] [ENV-TRANS]

What a robot holds in atoms the code has as values; records and arrays stay storage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from msgspec import Struct, field

from koord.sampling.compiled.asking import Asking
from koord.sampling.compiled.expressions import Names, NoCodeError
from koord.sampling.compiled.operations import InDoubt
from koord.sampling.compiled.statements import INDENT, BodyWriter, is_tree
from koord.semantics.configurations import (
    NO_EVENT,
    Configuration,
    Robot,
    Store,
    Turn,
    Written,
)
from koord.semantics.domain import Constant, Domain
from koord.semantics.locations import Mask, joined
from koord.semantics.oracle import Inputs, Phase
from koord.semantics.rounds import Stepped
from koord.semantics.storage import Storage
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.system import Status, System
from koord.syntax.types import ArrayType, Type

Made = Callable[..., Any]
T = TypeVar("T")

#: So often a turn is asked of the reference after doubts, before it is asked at once.
_MOST_DOUBTS = 50

_LISTS = {Home.LOCAL: "L", Home.PORT: "P", Home.ALLREAD: "R", Home.ALLWRITE: "W"}


class Code(Struct, eq=False):
    """A function that is certain or in doubt; None once it was in doubt too often."""

    function: Made | None
    doubts: int = 0

    def ask(self, *arguments: Any) -> Any:
        """What the function says; None in doubt."""
        if self.function is None:
            return None
        try:
            return self.function(*arguments)
        except (InDoubt, ArithmeticError):
            self.doubts += 1
            if self.doubts > _MOST_DOUBTS:
                self.function = None
            return None


class Turns(Struct, eq=False):
    """The turns of a system as code, made when they are first asked for.

    Each method returns None where only the reference semantics can tell.
    """

    d: Domain[Constant]
    system: System
    _guards: dict[int, Code] = field(default_factory=dict)
    _events: dict[tuple[int, int], Code] = field(default_factory=dict)
    _environments: dict[int, Code] = field(default_factory=dict)

    def enabled(
        self, configuration: Configuration[Constant], robot: int, inputs: Inputs[Constant]
    ) -> list[int] | None:
        """The events that a robot may select, in program order. [SELECT]"""
        state = configuration.robots[robot]
        if state.turn is not Turn.PROG or state.status == Status.STOPPED:
            return []
        code = self._guards.get(state.kind)
        if code is None:
            agent = self.system.program.agents[state.kind]
            code = self._guards[state.kind] = Code(_made(self.d, self.system, agent, guards_text))
        self.system.budget.spend()
        found: list[int] | None = code.ask(state, robot, self._asking(Phase.PROG, robot, inputs))
        return found

    def run_event(
        self,
        configuration: Configuration[Constant],
        robot: int,
        position: int,
        inputs: Inputs[Constant],
    ) -> Stepped[Constant] | None:
        """One event of a robot that may select it, and no other may hinder it. [EVENT-TRANS]"""
        state = configuration.robots[robot]
        if configuration.fault is not None or state.turn is not Turn.PROG:
            return None
        if state.status == Status.STOPPED:
            return None
        key = state.kind, position
        code = self._events.get(key)
        if code is None:
            agent = self.system.program.agents[state.kind]
            event = agent.events[position]

            def text(writer: TurnWriter, agent: core.Agent) -> str:
                return event_text(writer, agent, event)

            code = self._events[key] = Code(_made(self.d, self.system, agent, text))
        self.system.budget.spend()
        ran = code.ask(state, robot, self._asking(Phase.PROG, robot, inputs))
        if ran is None:
            return None
        locals_, ports, copy, allread, allwrite, stop, asked, entered, written = ran
        if entered & configuration.taken:
            return None
        status = state.status
        if asked:
            status = max(int(status), int(Status.ASKED))
        if stop:
            status = int(Status.STOPPED)
        after = Robot(state.kind, locals_, ports, copy, status, position, Turn.ENV)
        store = configuration.store
        if allread or allwrite:
            store = Store(
                _joined(self.d, store.allread, copy.allread, allread),
                _joined(self.d, store.allwrite, copy.allwrite, allwrite),
            )
        taken = configuration.taken | entered if entered else configuration.taken
        robots = _opened(configuration.robots)
        robots = (*robots[:robot], after, *robots[robot + 1 :])
        return Stepped(_ended(configuration, robots, store, taken), written)

    def evolved(
        self, configuration: Configuration[Constant], inputs: Inputs[Constant]
    ) -> Stepped[Constant] | None:
        """The environment's turn, where it has models. [ENV-TRANS] [REFRESH]"""
        if configuration.turn is not Turn.ENV or configuration.fault is not None:
            return None
        store = configuration.store
        robots, broken = [], []
        for number, state in enumerate(configuration.robots):
            self.system.budget.spend()
            asking = self._asking(Phase.ENV, number, inputs)
            made = self._environment(state.kind).ask(state.ports, number, asking)
            if made is None:
                return None
            ports, its = made
            broken += [(number, contract) for contract in its]
            robots.append(
                Robot(state.kind, state.locals, ports, store, state.status, state.ran, Turn.PROG)
            )
        after = Configuration(tuple(robots), store, configuration.round + 1)
        return Stepped(after, promises=tuple(broken))

    def keeps_contracts(self, state: Robot[Constant], robot: int, inputs: Inputs[Constant]) -> bool:
        """Return whether a robot's sensors read what contracts allow; False in doubt."""
        asking = self._asking(Phase.ENV, robot, inputs)
        return self._environment(state.kind).ask(state.ports, robot, asking) is not None

    def _asking(self, phase: Phase, robot: int, inputs: Inputs[Constant]) -> Asking:
        return Asking(self.d, self.system, phase, robot, inputs)

    def _environment(self, kind: int) -> Code:
        code = self._environments.get(kind)
        if code is None:
            agent = self.system.program.agents[kind]
            made = _made(self.d, self.system, agent, environment_text)
            code = self._environments[kind] = Code(made)
        return code


def _made(
    d: Domain[Constant],
    system: System,
    agent: core.Agent,
    text: Callable[[TurnWriter, core.Agent], str],
) -> Made | None:
    """A function of a robot's turn; None where there is none."""
    names = Names(d, system)
    names.values |= {"spend": system.budget.spend, "Store": Store, "Written": Written}
    try:
        name = text(TurnWriter(names), agent)
        return names.made(name)
    except NoCodeError:
        return None


def _opened(robots: tuple[Robot[Constant], ...]) -> tuple[Robot[Constant], ...]:
    """The robots at the start of a turn: a round's first turn clears ``ran``. [EVENT-TRANS]"""
    for state in robots:
        if state.turn is Turn.ENV:
            return robots
    return tuple(
        state
        if state.ran == NO_EVENT
        else Robot(
            state.kind,
            state.locals,
            state.ports,
            state.copy,
            state.status,
            NO_EVENT,
            state.turn,
        )
        for state in robots
    )


def _ended(
    before: Configuration[Constant],
    robots: tuple[Robot[Constant], ...],
    store: Store[Constant],
    taken: frozenset[int],
) -> Configuration[Constant]:
    """Begin the environment's turn once every robot has had its own. [END-PROG] [STOP]"""
    turn = Turn.ENV
    for state in robots:
        if state.turn is Turn.PROG:
            turn = before.turn
            break
    else:
        if all(state.status != Status.RUNNING for state in robots):
            stopped = int(Status.STOPPED)
            robots = tuple(
                Robot(s.kind, s.locals, s.ports, s.copy, stopped, s.ran, s.turn) for s in robots
            )
    return Configuration(robots, store, before.round, turn, taken, before.fault)


def _joined(
    d: Domain[Constant],
    target: tuple[Storage[Constant], ...],
    source: tuple[Storage[Constant], ...],
    masks: dict[int, Mask[Constant]],
) -> tuple[Storage[Constant], ...]:
    if not masks:
        return target
    changed = list(target)
    for slot, mask in masks.items():
        changed[slot] = joined(d, target[slot], source[slot], mask)
    return tuple(changed)


# --- text ----------------------------------------------------------------------------------------


class TurnWriter(BodyWriter):
    """A writer of a robot's turn. ``loaded`` are the variables that the text has by name."""

    def __init__(self, names: Names) -> None:
        super().__init__(names)
        self.loaded: dict[tuple[Home, int], core.Variable] = {}
        self.written: dict[tuple[Home, int], core.Variable] = {}
        self.in_environment = False

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

    # --- statements ------------------------------------------------------------------------------

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
                self.line("stop = True")
            case core.TryStop():
                self.line("asked = True")
            case core.Output():
                # [OUTPUT]
                values = "".join(f"{self.sure(value)}, " for value in s.values)
                types = self.names.new("k", tuple(value.type for value in s.values))
                self.line(f"written += (Written({s.stream!r}, ({values}), {types}),)")

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
