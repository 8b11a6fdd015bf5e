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
from msgspec.structs import replace

from koord.recheck.storage import (
    AtKey,
    Crowd,
    Fault,
    Field,
    Location,
    Many,
    Robot,
    Storage,
    Storages,
    Store,
    Write,
)
from koord.recheck.terms import BOOL, INT, Term
from koord.recheck.turns import EventTurn, Evolved, Turns
from koord.recheck.values import Values
from koord.recheck.world import Instance, Key
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import ArrayType

T = TypeVar("T")


class Anyone(Struct, Generic[T]):
    """A statement about one robot with the number ``blank``; ``of`` says it of another."""

    blank: Term
    said: T
    put: Callable[[T, Term, Term], T]
    _known: dict[int, tuple[Term, T]] = field(default_factory=dict)

    def of(self, robot: Term) -> T:
        if id(robot) not in self._known:
            self._known[id(robot)] = robot, self.put(self.said, self.blank, robot)
        return self._known[id(robot)][1]


class Replacing(Struct, frozen=True):
    """A substitution of a term for a variable in all facts about a robot."""

    s: Storages

    def robot(self, robot: Robot, old: Term, new: Term) -> Robot:
        t = self.s.v.t
        return Robot(
            tuple(self.s.of(x, old, new) for x in robot.locals),
            tuple(self.s.of(x, old, new) for x in robot.ports),
            t.put(robot.asked, old, new),
            t.put(robot.stopped, old, new),
            t.put(robot.ran, old, new),
        )

    def faults(self, faults: Sequence[Fault], old: Term, new: Term) -> tuple[Fault, ...]:
        return tuple(fault.of(self.s.v.t.put(fault.when, old, new)) for fault in faults)

    def write(self, w: Write, old: Term, new: Term) -> Write:
        t = self.s.v.t
        locations = tuple(self.location(x, old, new) for x in w.locations)
        return Write(
            t.put(w.when, old, new), w.variable, locations, self.s.v.put(w.value, old, new)
        )

    def location(self, x: Location, old: Term, new: Term) -> Location:
        v = self.s.v
        match x:
            case Field():
                return x
            case AtKey(key=key, type=type_):
                return AtKey(v.put(key, old, new), type_)
            case _:
                return v.t.put(x, old, new)

    def turn(self, turn: EventTurn, old: Term, new: Term) -> EventTurn:
        t = self.s.v.t
        return replace(
            turn,
            enabled=t.put(turn.enabled, old, new),
            guard_faults=self.faults(turn.guard_faults, old, new),
            guard_legal=t.put(turn.guard_legal, old, new),
            faults=self.faults(turn.faults, old, new),
            legal=t.put(turn.legal, old, new),
            after=self.robot(turn.after, old, new),
            writes=tuple(self.write(w, old, new) for w in turn.writes),
            entered={lock: t.put(x, old, new) for lock, x in turn.entered.items()},
        )

    def evolved(self, evolved: Evolved, old: Term, new: Term) -> Evolved:
        t = self.s.v.t
        return Evolved(
            self.robot(evolved.robot, old, new),
            tuple(t.put(fact, old, new) for fact in evolved.facts),
            self.faults(evolved.faults, old, new),
            tuple((name, t.put(kept, old, new)) for name, kept in evolved.promises),
        )


class Begun(Struct, frozen=True):
    """INIT of any number of robots; each of ``faults`` is that some robot has it."""

    state: Crowd
    facts: tuple[Term, ...]
    faults: tuple[Fault, ...]


class Crowds(Struct, frozen=True):
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

    def said(self, said: Callable[[Term], T], put: Callable[[T, Term, Term], T]) -> Anyone[T]:
        """Compute a statement for a robot with a variable as its number."""
        blank = self.v.t.blank()
        with self.v.scoped((blank,)):
            return Anyone(blank, said(blank), put)

    def is_one(self, robot: Term, kind: int) -> Term:
        """The condition that a number is that of a robot of a kind."""
        return self.v.t.both(self.v.is_robot(robot), self.world.is_of(self.v, robot, kind))

    def all_of(self, kind: int, robot: Term, fact: Term) -> Term:
        """A condition for all robots of a kind; ``robot`` is free in it."""
        return self.v.t.for_all([robot], self.v.t.implies(self.is_one(robot, kind), fact))

    # --- INIT -----------------------------------------------------------------------------------

    def opening(self) -> Begun:
        """The configuration after INIT, in which all assumptions hold. [INIT] [PROP-ASSUME]"""
        program, t = self.world.program, self.v.t
        shared, base = self.turns.declared()
        facts, faults = list(shared.legal), list(shared.faults)
        robots, entries = [], []
        replacing, never = Replacing(self.s), t.integer(-1)
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
            robots.append(Anyone(blank, own, replacing.robot))
            entries.append(Anyone(blank, tuple(memory.allread), self._entries))
        allread = tuple(
            self._by_kind(d.variable.type, partial(_entry, entries, slot))
            for slot, d in enumerate(program.allread)
        )
        allwrite = tuple(
            self._after_init(d, storage) if d.variable.slot in written else storage
            for d, storage in zip(program.allwrite, base.allwrite, strict=True)
        )
        state = Crowd(lambda kind, k: robots[kind].of(k), Store(allread, allwrite))
        for assumption in program.assumptions:
            holds, legal = self.turns.holds(state, assumption.condition, assumption.bound)
            facts += [legal, holds]
        return Begun(state, tuple(facts), tuple(faults))

    def _entries(self, entries: tuple[Storage, ...], old: Term, new: Term) -> tuple[Storage, ...]:
        return tuple(self.s.of(x, old, new) for x in entries)

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

    def anything_like(self, state: Crowd, changed: frozenset[Key], suffix: str) -> Crowd:
        """An arbitrary configuration that agrees with another, except in some variables."""
        program = self.world.program

        def of(d: core.Declaration, home: Home, kind: int, like: Storage) -> Storage:
            key = (home, kind, d.variable.slot)
            if key not in changed:
                return like
            if key in self.world.rewritten:
                like = self.s.loosened(like, d.variable.type)
            return self.s.anything(f"{d.variable.name}{suffix}", d.variable.type, like)

        def shared(
            home: Home, declarations: tuple[core.Declaration, ...], kept: tuple[Storage, ...]
        ) -> tuple[Storage, ...]:
            pairs = zip(declarations, kept, strict=True)
            return tuple(of(d, home, 0, like) for d, like in pairs)

        def anyone(kind: int, blank: Term) -> Robot:
            agent, own, v = program.agents[kind], state.robot(kind, blank), self.v
            ports = [port.declaration for port in agent.ports]
            locals_ = zip(agent.locals, own.locals, strict=True)
            both = zip(ports, own.ports, strict=True)
            return Robot(
                tuple(of(d, Home.LOCAL, kind, like) for d, like in locals_),
                tuple(of(d, Home.PORT, kind, like) for d, like in both),
                v.symbol(f"asked{suffix}", BOOL) if self.world.asks() else own.asked,
                v.symbol(f"stopped{suffix}", BOOL) if self.world.stops() else own.stopped,
                v.symbol(f"ran{suffix}", INT) if self.world.mentions(core.Ran) else own.ran,
            )

        replacing = Replacing(self.s).robot
        robots = [self.said(partial(anyone, kind), replacing) for kind in self.kinds]
        store = Store(
            shared(Home.ALLREAD, program.allread, state.store.allread),
            shared(Home.ALLWRITE, program.allwrite, state.store.allwrite),
        )
        return Crowd(lambda kind, k: robots[kind].of(k), store)

    # --- turns ----------------------------------------------------------------------------------

    def turn(self, state: Crowd, kind: int, position: int) -> Anyone[EventTurn]:
        """An event of any robot of a kind. [EVENT-TRANS]"""

        def said(blank: Term) -> EventTurn:
            agent, own = self.world.program.agents[kind], state.robot(kind, blank)
            return self.turns.attempt(agent, blank, kind, own, state.store, position)

        return self.said(said, Replacing(self.s).turn)

    def evolved(self, state: Crowd) -> list[Anyone[Evolved]]:
        """The environment's turn, kind by kind. [ENV-TRANS]"""

        def said(kind: int, blank: Term) -> Evolved:
            agent = self.world.program.agents[kind]
            return self.turns.evolved(agent, blank, "", state.robot(kind, blank))

        return [self.said(partial(said, kind), Replacing(self.s).evolved) for kind in self.kinds]


def _entry(
    entries: Sequence[Anyone[tuple[Storage, ...]]], slot: int, kind: int, robot: Term
) -> Storage:
    return entries[kind].of(robot)[slot]
