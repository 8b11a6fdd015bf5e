"""Turns as code: guards, events and environments, on storage as it is. [EVENT-TRANS] [ENV-TRANS]

What a robot holds in atoms the code has as values; records and arrays stay storage.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar
from weakref import ReferenceType

from msgspec import Struct, field

from koord.sampling.compiled.asking import Asking
from koord.sampling.compiled.configurations import misses_code
from koord.sampling.compiled.expressions import Names, NoCodeError
from koord.sampling.compiled.operations import Code, Made
from koord.sampling.compiled.round_ends import ended, opened
from koord.sampling.compiled.turn_text import (
    TurnWriter,
    environment_text,
    event_text,
    guards_text,
)
from koord.semantics.configurations import (
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
from koord.syntax.system import Status, System

if TYPE_CHECKING:
    from koord.sampling.compiled.rounds import RoundCode

T = TypeVar("T")


class Turns(Struct, eq=False):
    """The turns of a system as code, made when they are first asked for.

    Each method returns None where only the reference semantics can tell.
    """

    d: Domain[Constant]
    system: System
    #: Code of whole rounds, each with a reference to the run that uses it.
    rounds: list[tuple[ReferenceType[Any], RoundCode]] = field(default_factory=list)
    _guards: dict[int, Code] = field(default_factory=dict)
    _events: dict[tuple[int, int], Code] = field(default_factory=dict)
    _environments: dict[int, Code] = field(default_factory=dict)
    _assumptions: dict[int, Code] = field(default_factory=dict)

    def missed(self, configuration: Configuration[Constant], position: int) -> int | None:
        """How many conjuncts and instances of an assumption do not hold. [INIT]"""
        code = self._assumptions.get(position)
        if code is None:
            condition = self.system.program.assumptions[position].condition
            code = self._assumptions[position] = misses_code(self.d, self.system, condition)
        self.system.budget.spend()
        found: int | None = code.ask(configuration)
        return found

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
        robots = opened(configuration.robots)
        robots = (*robots[:robot], after, *robots[robot + 1 :])
        return Stepped(ended(configuration, robots, store, taken), written)

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
