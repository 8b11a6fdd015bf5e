"""One robot's turns as terms: INIT, a program turn, the environment's turn.

By T-SNAPSHOT a turn is a function of the robot's own part of the configuration at the start of the
round. It is worked out there once, wherever in the round it then takes place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from msgspec import Struct

from koord.recheck import places, statements
from koord.recheck.body import RunningBody
from koord.recheck.races import Racing, WrittenPart
from koord.recheck.sorts import Value
from koord.recheck.storage import (
    Fault,
    Memory,
    OfRobot,
    ParameterisedState,
    Robot,
    State,
    Storage,
    Storages,
    Store,
    Write,
)
from koord.recheck.terms import BOOL, Term
from koord.recheck.terms import INT as NUMBER
from koord.recheck.values import Values
from koord.recheck.world import Instance, Key
from koord.syntax import core
from koord.syntax.core import Direction, Home, Start
from koord.syntax.types import INT, ArrayType


class EventTurn(OfRobot, frozen=True):
    """The effect of one event of one robot, if it runs.

    ``robot`` is its number, or its kind where it is any robot of any number of them.

    ``enabled``: its ``pre`` holds. ``faults`` are those of ``pre`` and ``eff``. ``legal`` is what
    the answers satisfy that it asks for; ``entered`` the lock classes, with their conditions.
    """

    robot: int
    position: int
    event: core.Event
    enabled: Term
    guard_faults: tuple[Fault, ...]
    guard_legal: Term
    faults: tuple[Fault, ...]
    legal: Term
    after: Robot
    writes: tuple[Write, ...]
    entered: dict[int, Term]


class Initialisation(Struct, frozen=True):
    """The result of INIT: a configuration, with facts and faults."""

    state: State
    facts: tuple[Term, ...]
    faults: tuple[Fault, ...]


class Evolution(Struct, frozen=True):
    """The result of the environment's turn; ``promises`` are contracts that models have to keep."""

    state: State
    facts: tuple[Term, ...]
    faults: tuple[Fault, ...]
    promises: tuple[tuple[str, int, Term], ...]


class Evolved(OfRobot, frozen=True):
    """A robot after the environment's turn, with facts and faults."""

    robot: Robot
    facts: tuple[Term, ...]
    faults: tuple[Fault, ...]
    promises: tuple[tuple[str, Term], ...]


class Turns(Struct, frozen=True):
    """A builder of turns."""

    world: Instance
    v: Values

    @property
    def s(self) -> Storages:
        return Storages(self.v)

    # --- INIT -----------------------------------------------------------------------------------

    def opening(self) -> Initialisation:
        """The configuration after INIT, in which all assumptions hold. [INIT] [PROP-ASSUME]"""
        program, t = self.world.program, self.v.t
        shared, base = self.declared()
        bodies = [
            self.initial(self.world.agent(i), t.integer(i), f"{i}", base)
            for i in range(len(self.world.kinds))
        ]
        racing = Racing(self.s, "INIT")
        everyone = [WrittenPart(i, t.truth(True), tuple(b.writes)) for i, b in enumerate(bodies)]
        store = racing.joined(base, everyone)
        never = t.integer(-1)
        robots = tuple(
            Robot(tuple(b.memory.locals), tuple(b.memory.ports), b.asked, b.stopped, never)
            for b in bodies
        )
        state = State(robots, store)
        facts = [*racing.facts, *(fact for b in (shared, *bodies) for fact in b.legal)]
        for assumption in program.assumptions:
            holds, legal = self.holds(state, assumption.condition, assumption.bound)
            facts += [legal, holds]
        faults = [fault for b in (shared, *bodies) for fault in b.faults]
        return Initialisation(state, tuple(facts), tuple(faults))

    def declared(self) -> tuple[RunningBody, Store]:
        """The store before any robot's INIT, and the body that made it."""
        program = self.world.program
        allread = [self.s.unset(d.variable.type) for d in program.allread]
        allwrite = [self.s.unset(d.variable.type) for d in program.allwrite]
        shared = statements.body(self.world, self.v, None, Memory([], [], [*allread], allwrite))
        for d in program.allwrite:
            self._start(shared, d, shared.memory.allwrite, "")
        return shared, Store(tuple(allread), tuple(shared.memory.allwrite))

    def initial(self, agent: core.Agent, robot: Term, name: str, base: Store) -> RunningBody:
        """Run a robot's INIT; ``name`` is a prefix of its unknowns' names."""
        memory = Memory(
            [self.s.unset(d.variable.type) for d in agent.locals],
            [self.s.unset(p.declaration.variable.type) for p in agent.ports],
            [*base.allread],
            [*base.allwrite],
        )
        body = statements.body(self.world, self.v, robot, memory)
        body.bound = [None] * agent.init_bound
        for port in agent.ports:
            entry = port.declaration
            self._start(body, entry, memory.ports, f"@{name}")
        for entry in agent.locals:
            self._start(body, entry, memory.locals, f"@{name}")
        for entry in self.world.program.allread:
            self._start_own(body, entry, name)
        statements.run(body, agent.init)
        return body

    def _start(
        self,
        body: RunningBody,
        entry: core.Declaration,
        storages: list[Storage],
        where: str,
    ) -> None:
        variable = entry.variable
        if entry.initial is Start.UNSET:
            return
        if entry.initial is Start.ARBITRARY:
            name = f"{variable.name}{where} at the start"
            value = self.v.fresh(name, variable.type, entry.length)
        else:
            value = body.value(entry.initial)
        storages[variable.slot] = self.s.stored(value, variable.type)

    def _start_own(self, body: RunningBody, entry: core.Declaration, robot: str) -> None:
        """Write the robot's own entry of an allread variable. [ALLREAD]"""
        variable = entry.variable
        assert isinstance(variable.type, ArrayType)
        element = variable.type.element
        if entry.initial is Start.UNSET:
            return
        if entry.initial is Start.ARBITRARY:
            value = self.v.fresh(f"{variable.name}[{robot}] at the start", element, entry.length)
        else:
            value = body.value(entry.initial)
        place = core.Place(variable, (core.IndexStep(core.Pid(INT), element),), span=entry.span)
        places.assign(body, place, value)

    # --- program turns --------------------------------------------------------------------------

    def turn(self, state: State, robot: int, position: int) -> EventTurn:
        """Run one event of a robot, on a configuration at the start of a round. [EVENT-TRANS]"""
        agent, number = self.world.agent(robot), self.v.t.integer(robot)
        return self.attempt(agent, number, robot, state.robots[robot], state.store, position)

    def attempt(
        self, agent: core.Agent, pid: Term, robot: int, own: Robot, store: Store, position: int
    ) -> EventTurn:
        """Run one event of a robot of a kind, whose number is ``pid``. [ATOMIC]"""
        event, t = agent.events[position], self.v.t
        memory = Memory([*own.locals], [*own.ports], [*store.allread], [*store.allwrite])
        body = statements.body(self.world, self.v, pid, memory)
        body.bound = [None] * event.bound
        enabled = body.condition(event.guard)
        guard_faults, guard_legal = tuple(body.faults), t.conjunction(body.legal)
        body.outside = enabled
        statements.run(body, event.effect)
        after = Robot(
            tuple(memory.locals),
            tuple(memory.ports),
            t.either(own.asked, body.asked),
            t.either(own.stopped, body.stopped),
            t.integer(position),
        )
        return EventTurn(
            robot,
            position,
            event,
            enabled,
            guard_faults,
            guard_legal,
            tuple(body.faults),
            t.conjunction(body.legal),
            after,
            tuple(body.writes),
            dict(body.entered),
        )

    def may_run(self, own: Robot, turn: EventTurn) -> Term:
        """The condition that a robot may select an event, as far as it alone is concerned.

        [SELECT]
        """
        t = self.v.t
        sound = [t.negation(fault.when) for fault in turn.faults]
        return t.conjunction([t.negation(own.stopped), turn.enabled, *sound, turn.legal])

    def off(self, turn: EventTurn) -> Term:
        """The condition that ``pre`` does not hold for some answers."""
        t = self.v.t
        faulted = t.disjunction(fault.when for fault in turn.guard_faults)
        return t.both(turn.guard_legal, t.either(t.negation(turn.enabled), faulted))

    def not_obliged(
        self, turn: EventTurn, taken: Callable[[int], Term], mover: EventTurn | None
    ) -> Term:
        """The condition that an event does not oblige: ``pre`` may fail, or a class of it is taken.


        [SKIP] ``mover`` is what one more robot runs on top of those that took classes.
        """
        locks = [taken(lock) for lock in turn.event.lock_classes]
        if mover is not None:
            mine = mover.entered
            locks += [mine[lock] for lock in turn.event.lock_classes if lock in mine]
        return self.v.t.disjunction([self.off(turn), *locks])

    # --- any configuration ----------------------------------------------------------------------

    def any_store(self, store: Store, changed: frozenset[Key], label: str) -> Store:
        """An arbitrary store that agrees with another, except in some variables."""
        program = self.world.program

        def of(
            home: Home, declarations: tuple[core.Declaration, ...], kept: tuple[Storage, ...]
        ) -> tuple[Storage, ...]:
            pairs = zip(declarations, kept, strict=True)
            return tuple(self._any((home, 0), d, like, changed, label) for d, like in pairs)

        return Store(
            of(Home.ALLREAD, program.allread, store.allread),
            of(Home.ALLWRITE, program.allwrite, store.allwrite),
        )

    def any_robot(self, own: Robot, kind: int, changed: frozenset[Key], label: str) -> Robot:
        """An arbitrary robot that agrees with another, except in some variables and its status."""
        world, v, agent = self.world, self.v, self.world.program.agents[kind]
        locals_ = zip(agent.locals, own.locals, strict=True)
        ports = zip(agent.ports, own.ports, strict=True)
        return Robot(
            tuple(self._any((Home.LOCAL, kind), d, x, changed, label) for d, x in locals_),
            tuple(self._any((Home.PORT, kind), p.declaration, x, changed, label) for p, x in ports),
            v.symbol(f"asked{label}", BOOL) if world.asks() else own.asked,
            v.symbol(f"stopped{label}", BOOL) if world.stops() else own.stopped,
            v.symbol(f"ran{label}", NUMBER) if world.mentions(core.Ran) else own.ran,
        )

    def _any(
        self,
        where: tuple[Home, int],
        d: core.Declaration,
        like: Storage,
        changed: frozenset[Key],
        label: str,
    ) -> Storage:
        key = (*where, d.variable.slot)
        if key not in changed:
            return like
        if key in self.world.rewritten:
            like = self.s.loosened(like, d.variable.type)
        return self.s.anything(f"{d.variable.name}{label}", d.variable.type, like)

    # --- the environment's turn -----------------------------------------------------------------

    def environment(self, state: State) -> Evolution:
        """Take the environment's turn: each robot's ports separately.
        [ENV-TRANS] [ENV-MODEL] [ENV-FREE]
        """
        facts: list[Term] = []
        faults: list[Fault] = []
        promises: list[tuple[str, int, Term]] = []
        robots: list[Robot] = []
        for i, own in enumerate(state.robots):
            mine = self.evolved(self.world.agent(i), self.v.t.integer(i), f"{i}", own)
            facts += mine.facts
            faults += mine.faults
            promises += [(name, i, kept) for name, kept in mine.promises]
            robots.append(mine.robot)
        after = State(tuple(robots), state.store)
        return Evolution(after, tuple(facts), tuple(faults), tuple(promises))

    def evolved(self, agent: core.Agent, robot: Term, name: str, own: Robot) -> Evolved:
        """The ports of one robot after the environment's turn."""
        facts: list[Term] = []
        promises: list[tuple[str, Term]] = []
        memory = Memory(ports=[*own.ports], after=[*own.ports])
        body = statements.body(self.world, self.v, robot, memory)
        for module in agent.modules:
            if module.environment is not None:
                body.bound = [None] * module.environment_bound
                statements.run(body, module.environment)
            else:
                self._sense(agent, module, name, memory)
        faults = tuple(body.faults)
        body.closed = True
        for module in agent.modules:
            for contract in module.contracts:
                kept = self._kept(body, contract)
                if module.environment is None:
                    facts.append(kept)
                else:
                    promises.append((contract.name, kept))
        facts += body.legal
        assert memory.after is not None
        after = Robot(own.locals, tuple(memory.after), own.asked, own.stopped, own.ran)
        return Evolved(after, tuple(facts), faults, tuple(promises))

    def _sense(self, agent: core.Agent, module: core.Module, robot: str, memory: Memory) -> None:
        assert memory.after is not None
        for position in module.ports:
            port = agent.ports[position]
            if port.direction is Direction.SENSOR:
                variable = port.declaration.variable
                read = self.v.fresh(f"{module.name}.{variable.name}@{robot} read", variable.type)
                memory.after[variable.slot] = self.s.stored(read, variable.type)

    def _kept(self, body: RunningBody, contract: core.Contract) -> Term:
        """The condition that ``requires`` before implies ``ensures`` after. [ENV-CONTRACT]"""
        t = self.v.t
        body.bound = [None] * contract.bound
        required = t.conjunction([body.statement(e) for e in contract.requires])
        return t.implies(required, t.conjunction([body.statement(e) for e in contract.ensures]))

    # --- statements about configurations --------------------------------------------------------

    def holds(
        self,
        state: State | ParameterisedState,
        condition: core.Expr,
        bound: int,
        given: Mapping[int, Term] = MappingProxyType({}),
    ) -> tuple[Term, Term]:
        """The condition that a statement holds in a configuration; the legality of its answers.

        Variables may be bound before: ``given`` are numbers of robots, by slot.
        """
        body = self._closed(state, bound, given)
        holds = body.statement(condition)
        return holds, self.v.t.conjunction(body.legal)

    def worked_out(
        self, state: ParameterisedState, e: core.Expr, bound: int, given: Mapping[int, Term]
    ) -> tuple[Value, Term, Term]:
        """The value of an expression in a configuration, and the condition that it faults.

        The last is the legality of answers.
        """
        body = self._closed(state, bound, given)
        value = body.value(e)
        return value, body.faulted(), self.v.t.conjunction(body.legal)

    def _closed(
        self, state: State | ParameterisedState, bound: int, given: Mapping[int, Term]
    ) -> RunningBody:
        """A body that evaluates on a configuration."""
        memory = Memory([], [], [*state.store.allread], [*state.store.allwrite], None, state)
        body = statements.body(self.world, self.v, None, memory)
        body.bound = [None] * bound
        for slot, robot in given.items():
            body.bound[slot] = self.s.stored(robot, INT)
            body.here.append(robot)
        return body
