"""Generic turns: the turn of a robot whose number is a variable, computed once.

By T-SNAPSHOT a turn is a function of the robot's own part and of its number. So what robot 7 does
is what the unknown one does, with 7 in its place; and what is new on the way (answers, readings) is
a function of the number, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Generic, TypeVar

from msgspec import Struct, field

from koord.recheck.storage import (
    Fault,
    Many,
    ParameterisedState,
    Robot,
    Storage,
    Storages,
    Store,
)
from koord.recheck.terms import Term
from koord.recheck.turns import EventTurn, Evolved, Turns
from koord.recheck.values import Values
from koord.recheck.world import Instance, Key
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import ArrayType

T = TypeVar("T")


class PerRobot(Struct, Generic[T]):
    """A statement about one robot with the number ``blank``; ``of`` says it of another."""

    blank: Term
    known: T
    s: Storages
    _others: dict[int, tuple[Term, T]] = field(default_factory=dict)

    def of(self, robot: Term) -> T:
        if id(robot) not in self._others:
            self._others[id(robot)] = robot, self.s.of(self.known, self.blank, robot)
        return self._others[id(robot)][1]


class ParameterisedInit(Struct, frozen=True):
    """INIT of any number of robots; each of ``faults`` is that some robot has it."""

    state: ParameterisedState
    facts: tuple[Term, ...]
    faults: tuple[Fault, ...]


class ParameterisedTurns(Struct, frozen=True):
    """A builder of turns and configurations of any number of robots."""

    world: Instance
    turns: Turns

    @property
    def v(self) -> Values:
        return self.turns.v

    @property
    def s(self) -> Storages:
        return self.turns.s

    @property
    def kinds(self) -> range:
        return range(len(self.world.program.agents))

    def per_robot(self, known: Callable[[Term], T]) -> PerRobot[T]:
        """Compute a statement for a robot with a variable as its number."""
        blank = self.v.t.blank()
        with self.v.scoped((blank,)):
            return PerRobot(blank, known(blank), self.s)

    def is_one(self, robot: Term, kind: int) -> Term:
        """The condition that a number is that of a robot of a kind."""
        return self.v.t.both(self.v.is_robot(robot), self.world.is_of(self.v, robot, kind))

    def all_of(self, kind: int, robot: Term, fact: Term) -> Term:
        """A condition for all robots of a kind; ``robot`` is free in it."""
        return self.v.t.for_all([robot], self.v.t.implies(self.is_one(robot, kind), fact))

    # --- INIT -----------------------------------------------------------------------------------

    def opening(self) -> ParameterisedInit:
        """The configuration after INIT, in which all assumptions hold. [INIT] [PROP-ASSUME]"""
        program, t = self.world.program, self.v.t
        shared, base = self.turns.declared()
        facts, faults = list(shared.legal), list(shared.faults)
        robots, entries = [], []
        never = t.integer(-1)
        written: set[int] = set()
        for kind in self.kinds:
            blank, agent = t.blank(), program.agents[kind]
            with self.v.scoped((blank,)):
                made = self.turns.initial(agent, blank, "", base)
            facts += [self.all_of(kind, blank, fact) for fact in made.legal]
            faults += [
                f.of(t.exists([blank], t.both(self.is_one(blank, kind), f.when)))
                for f in made.faults
            ]
            written |= {w.variable.slot for w in made.writes if w.variable.home is Home.ALLWRITE}
            memory = made.memory
            own = Robot(tuple(memory.locals), tuple(memory.ports), made.asked, made.stopped, never)
            robots.append(PerRobot(blank, own, self.s))
            entries.append(PerRobot(blank, tuple(memory.allread), self.s))
        allread = tuple(
            self._by_kind(d.variable.type, partial(_entry, entries, slot))
            for slot, d in enumerate(program.allread)
        )
        allwrite = tuple(
            self._after_init(d, storage) if d.variable.slot in written else storage
            for d, storage in zip(program.allwrite, base.allwrite, strict=True)
        )
        state = ParameterisedState(lambda kind, k: robots[kind].of(k), Store(allread, allwrite))
        for assumption in program.assumptions:
            holds, legal = self.turns.holds(state, assumption.condition, assumption.bound)
            facts += [legal, holds]
        return ParameterisedInit(state, tuple(facts), tuple(faults))

    def _after_init(self, d: core.Declaration, storage: Storage) -> Storage:
        """A shared variable after INIT: if several robots may write it, any value."""
        like = self.s.loosened(storage, d.variable.type)
        return self.s.anything(f"{d.variable.name} after INIT", d.variable.type, like)

    def _by_kind(self, type_: object, entry: Callable[[int, Term], Storage]) -> Many:
        """An allread variable, each element as its robot has it. [T-SNAPSHOT]"""
        assert isinstance(type_, ArrayType)
        element = type_.element

        def at(k: Term) -> Storage:
            found: Storage | None = None
            for kind in self.kinds:
                whole = entry(kind, k)
                assert isinstance(whole, Many)
                own = whole.at(k)
                here = self.world.is_of(self.v, k, kind)
                found = own if found is None else self.s.merge(here, own, found, element)
            assert found is not None
            return found

        return Many(at)

    # --- any configuration ----------------------------------------------------------------------

    def anything_like(
        self, state: ParameterisedState, changed: frozenset[Key], suffix: str
    ) -> ParameterisedState:
        """An arbitrary configuration that agrees with another, except in some variables."""

        def any_robot(kind: int, blank: Term) -> Robot:
            return self.turns.any_robot(state.robot(kind, blank), kind, changed, suffix)

        robots = [self.per_robot(partial(any_robot, kind)) for kind in self.kinds]
        store = self.turns.any_store(state.store, changed, suffix)
        return ParameterisedState(lambda kind, k: robots[kind].of(k), store)

    # --- turns ----------------------------------------------------------------------------------

    def turn(self, state: ParameterisedState, kind: int, position: int) -> PerRobot[EventTurn]:
        """Run an event of any robot of a kind. [EVENT-TRANS]"""

        def turn(blank: Term) -> EventTurn:
            agent, own = self.world.program.agents[kind], state.robot(kind, blank)
            return self.turns.attempt(agent, blank, kind, own, state.store, position)

        return self.per_robot(turn)

    def evolved(self, state: ParameterisedState) -> list[PerRobot[Evolved]]:
        """Take the environment's turn, kind by kind. [ENV-TRANS]"""

        def evolved(kind: int, blank: Term) -> Evolved:
            agent = self.world.program.agents[kind]
            return self.turns.evolved(agent, blank, "", state.robot(kind, blank))

        return [self.per_robot(partial(evolved, kind)) for kind in self.kinds]


def _entry(
    entries: Sequence[PerRobot[tuple[Storage, ...]]], slot: int, kind: int, robot: Term
) -> Storage:
    return entries[kind].of(robot)[slot]
