"""What has to be shown for claims to hold in every round: one obligation per step of a robot.

The argument that these are enough is T-PER-EVENT of ``specs/certificates/README.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property, partial

from koord.recheck.memory import Fault
from koord.recheck.racing import made
from koord.recheck.rounds import Prefix, Rounds
from koord.recheck.storage import Cell, Crowd, Robot, State, Storage, Storages, Store
from koord.recheck.terms import BOOL, INT, Term, Terms
from koord.recheck.turns import Opening, Turn, Turns
from koord.recheck.updates import meeting
from koord.recheck.values import Values
from koord.recheck.world import Key, World
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.types import EnumType, Type


class Kind(Enum):
    """Why something is claimed."""

    STATEMENT = "property"  #: a statement about configurations
    FAULT = "fault"
    LOST_UPDATE = "lost update"
    CONTRACT = "contract"


@dataclass(frozen=True, slots=True)
class Claim:
    """What is to be shown; ``subject`` is the variable of a lost update, or the contract.

    ``depth`` is over how many rounds it is inductive.
    """

    name: str
    kind: Kind
    stated: core.Property | None = None
    subject: str = ""
    depth: int = 1

    @property
    def at_round(self) -> bool:
        return self.stated is not None and self.stated.kind is core.PropertyKind.AT_ROUND


@dataclass(frozen=True, slots=True)
class Goal:
    """``holds`` has to follow; ``legal`` is what the answers satisfy that it asks for."""

    claim: str
    legal: Term
    holds: Term


@dataclass(frozen=True, slots=True)
class Shown:
    """A part of a configuration, or a choice, to be shown in a counterexample."""

    what: str
    term: Term
    type: Type | None


@dataclass(frozen=True, slots=True)
class Attempt:
    """From the hypotheses each goal follows. ``shown`` is what to tell of a counterexample.

    ``names`` are numbers of robots that it is about, where there is any number of them.
    """

    hypotheses: tuple[Term, ...]
    goals: tuple[Goal, ...]
    shown: tuple[Shown, ...] = ()
    names: tuple[Term, ...] = ()


@dataclass(frozen=True, slots=True)
class Obligation:
    """Something to be shown, in one way or another: the first attempts are quick, and know less.

    A counterexample to the last attempt is one to the obligation. Attempts are made when asked for.
    """

    name: str
    attempts: tuple[Callable[[], Attempt], ...]


@dataclass(frozen=True, slots=True)
class Past:
    """A configuration at the start of a round, and all that is known of how it came about."""

    state: State
    facts: tuple[Term, ...]


@dataclass(slots=True)
class Obligations:
    """All obligations of some claims about a program."""

    world: World
    claims: Sequence[Claim]
    v: Values
    consequences: Sequence[core.Property] = ()
    turns: Turns = field(init=False)
    rounds: Rounds = field(init=False)

    def __post_init__(self) -> None:
        self.turns = Turns(self.world, self.v)
        self.rounds = Rounds(self.turns)

    @property
    def s(self) -> Storages:
        return Storages(self.v)

    def __iter__(self) -> Iterator[Obligation]:
        opening = self.turns.opening()
        yield from self._initiation(opening)
        t = self.v.t
        sound = [t.negation(fault.when) for fault in opening.faults]
        for depth in sorted({claim.depth for claim in self.claims}):
            assumed = [claim for claim in self.claims if claim.depth <= depth]
            asked = [claim for claim in self.claims if claim.depth == depth]
            first = self._followed(Past(opening.state, (*opening.facts, *sound)), assumed)
            past = first
            for number in range(1, depth):
                yield from self._round(past, assumed, asked, f"round {number}")
                past = self._extended(past, assumed, f"round {number}")
            past = self._followed(self._anything(first), assumed)
            for number in range(1, depth):
                past = self._extended(past, assumed, f"an earlier round {number}")
            yield from self._round(past, assumed, asked, "")

        for property_ in self.consequences:
            claim = Claim(property_.name, Kind.STATEMENT, property_)
            yield Obligation(
                f"the invariant implies {claim.name}",
                (partial(self._implied, claim, tuple(self.claims)),),
            )

    def derivation(self, claim: Claim, others: Sequence[Claim]) -> Obligation:
        """That a claim follows from others, in whatever configuration."""
        name = f"{claim.name} follows from the other claims"
        return Obligation(name, (partial(self._implied, claim, tuple(others)),))

    def _implied(self, claim: Claim, others: Sequence[Claim]) -> Attempt:
        opening = self.turns.opening()
        past = self._anything(Past(opening.state, opening.facts))
        at_round = claim.at_round
        facts = _taken(self.goals(past.state, others, between_rounds=at_round))
        goals = self.goals(past.state, [claim], between_rounds=at_round)
        return Attempt((*past.facts, *facts), tuple(goals), tuple(self.parts(past.state)))

    # --- where rounds start ---------------------------------------------------------------------

    def _initiation(self, opening: Opening) -> Iterator[Obligation]:
        if any(claim.kind is Kind.FAULT for claim in self.claims):
            yield Obligation("initiation: no fault", (partial(self._no_fault_at_start, opening),))
        yield Obligation("initiation", (partial(self._starts, opening),))

    def _no_fault_at_start(self, opening: Opening) -> Attempt:
        goals = [_sound(self.turns, fault) for fault in opening.faults]
        return Attempt(opening.facts, tuple(goals), tuple(self.parts(opening.state)))

    def _starts(self, opening: Opening) -> Attempt:
        sound = [self.v.t.negation(fault.when) for fault in opening.faults]
        goals = self.goals(opening.state, self.claims, between_rounds=True)
        shown = tuple(self.parts(opening.state))
        return Attempt((*opening.facts, *sound), tuple(goals), shown)

    def _anything(self, first: Past) -> Past:
        """Any configuration, but for what nobody ever writes: that is as INIT left it."""
        t, facts = self.v.t, []
        state = self.anything_like(first.state, self.world.written, "")
        for i, robot in enumerate(state.robots):
            if self.world.mentions(core.Ran):
                events = t.integer(len(self.world.agent(i).events))
                facts += [t.at_most(t.integer(-1), robot.ran), t.less(robot.ran, events)]
        kept = [
            storage
            for key, storage in self._variables(first.state)
            if key not in self.world.written
        ]
        if any(_has_unknown(storage) for storage in kept):
            # What INIT and the assumptions say of them still holds.
            facts += first.facts
        return Past(state, tuple(facts))

    def _variables(self, state: State) -> Iterator[tuple[Key, Storage]]:
        store = state.store
        for home, kept in ((Home.ALLREAD, store.allread), (Home.ALLWRITE, store.allwrite)):
            for slot, storage in enumerate(kept):
                yield (home, 0, slot), storage
        for i, robot in enumerate(state.robots):
            kind = self.world.kinds[i]
            for home, kept in ((Home.LOCAL, robot.locals), (Home.PORT, robot.ports)):
                for slot, storage in enumerate(kept):
                    yield (home, kind, slot), storage

    def anything_like(self, state: State, changed: frozenset[Key], suffix: str) -> State:
        """Any configuration that differs from one in some variables only."""
        program, v = self.world.program, self.v

        def of(d: core.Declaration, home: Home, kind: int, like: Storage, at: str) -> Storage:
            key = (home, kind, d.variable.slot)
            if key not in changed:
                return like
            if key in self.world.rewritten:
                like = self.s.loosened(like, d.variable.type)
            return self.s.anything(f"{d.variable.name}{at}{suffix}", d.variable.type, like)

        def shared(
            home: Home, declarations: tuple[core.Declaration, ...], kept: tuple[Storage, ...]
        ) -> tuple[Storage, ...]:
            pairs = zip(declarations, kept, strict=True)
            return tuple(of(d, home, 0, like, "") for d, like in pairs)

        robots = []
        for i, own in enumerate(state.robots):
            kind, agent, at = self.world.kinds[i], self.world.agent(i), f"@{i}"
            ports = [port.declaration for port in agent.ports]
            locals_ = zip(agent.locals, own.locals, strict=True)
            both = zip(ports, own.ports, strict=True)
            robots.append(
                Robot(
                    tuple(of(d, Home.LOCAL, kind, like, at) for d, like in locals_),
                    tuple(of(d, Home.PORT, kind, like, at) for d, like in both),
                    v.symbol(f"asked{at}{suffix}", BOOL) if self.world.asks() else own.asked,
                    v.symbol(f"stopped{at}{suffix}", BOOL) if self.world.stops() else own.stopped,
                    v.symbol(f"ran{at}{suffix}", INT) if self.world.mentions(core.Ran) else own.ran,
                )
            )
        store = Store(
            shared(Home.ALLREAD, program.allread, state.store.allread),
            shared(Home.ALLWRITE, program.allwrite, state.store.allwrite),
        )
        return State(tuple(robots), store)

    def _followed(self, past: Past, assumed: Sequence[Claim]) -> Past:
        """The same, with what is assumed at the start of a round."""
        goals = self.goals(past.state, assumed, between_rounds=True)
        return Past(past.state, (*past.facts, *_taken(goals)))

    def _extended(self, past: Past, assumed: Sequence[Claim], label: str) -> Past:
        """What a whole round leads to, in which everything that is assumed held."""
        prefix, end, facts = self.ended(past, assumed, label)
        evolution = self.turns.environment(end)
        t = self.v.t
        sound = [t.negation(fault.when) for fault in evolution.faults]
        known = (*past.facts, *prefix.facts, *facts, *evolution.facts, *sound)
        return self._followed(Past(evolution.state, known), assumed)

    def ended(
        self, past: Past, assumed: Sequence[Claim], label: str
    ) -> tuple[Prefix, State, list[Term]]:
        """The end of the program turns of a round, and what is known of it."""
        prefix = self.rounds.prefix(past.state, label or "the round")
        facts = self.rounds.skips_legally(prefix)
        _, end = self.rounds.stopped_together(prefix.state)
        facts += _taken(self.goals(end, assumed))
        return prefix, end, facts

    # --- one round ------------------------------------------------------------------------------

    def _round(
        self, past: Past, assumed: Sequence[Claim], asked: Sequence[Claim], label: str
    ) -> Iterator[Obligation]:
        """Everything that one more step of a round may break."""
        round_ = Round(self, past, assumed, asked, label)
        for i in range(len(self.world.kinds)):
            for position in range(len(self.world.agent(i).events)):
                yield from round_.event(i, position)
        yield from round_.quiet()
        yield from round_.updates()
        yield from round_.environment()

    # --- claims ---------------------------------------------------------------------------------

    def goals(
        self, state: State, claims: Iterable[Claim], *, between_rounds: bool = False
    ) -> list[Goal]:
        """Statements that are to hold in a configuration."""
        return stated(self.turns, state, claims, between_rounds=between_rounds)

    # --- counterexamples ------------------------------------------------------------------------

    def parts(self, state: State, suffix: str = "") -> Iterator[Shown]:
        """The variables of a configuration, part by part."""
        program = self.world.program
        for d, storage in zip(program.allread, state.store.allread, strict=True):
            yield from self._leaves(d.variable.name, suffix, storage, d.variable.type)
        for d, storage in zip(program.allwrite, state.store.allwrite, strict=True):
            yield from self._leaves(d.variable.name, suffix, storage, d.variable.type)
        for i, robot in enumerate(state.robots):
            agent, where = self.world.agent(i), f"@{i}{suffix}"
            for d, storage in zip(agent.locals, robot.locals, strict=True):
                yield from self._leaves(d.variable.name, where, storage, d.variable.type)
            for port, storage in zip(agent.ports, robot.ports, strict=True):
                v = port.declaration.variable
                yield from self._leaves(f"{port.module}.{v.name}", where, storage, v.type)
            if self.world.stops():
                yield Shown(f"stopped@{i}{suffix}", robot.stopped, None)

    def _leaves(self, name: str, where: str, storage: Storage, type_: Type) -> Iterator[Shown]:
        if isinstance(storage, Cell):
            if storage.is_set.value is False:
                return
            for term, leaf in self.v.leaves(storage.value, type_):
                yield Shown(f"{name}{where}", term, leaf if isinstance(leaf, EnumType) else None)
            return
        parts = self.v.parts(type_)
        assert parts is not None
        assert isinstance(storage, tuple)
        for below, (label, part) in zip(storage, parts, strict=True):
            yield from self._leaves(name + label, where, below, part)


@dataclass
class Round:
    """The obligations of one round. ``within`` says which, where it is not any round."""

    of: Obligations
    past: Past
    assumed: Sequence[Claim]
    asked: Sequence[Claim]
    label: str

    @property
    def world(self) -> World:
        return self.of.world

    @property
    def t(self) -> Terms:
        return self.of.v.t

    @property
    def within(self) -> str:
        return f" in {self.label}" if self.label else ""

    @cached_property
    def shown(self) -> tuple[Shown, ...]:
        return tuple(self.of.parts(self.past.state))

    @cached_property
    def prefix(self) -> Prefix:
        return self.of.rounds.prefix(self.past.state, self.label or "the round")

    @cached_property
    def chosen(self) -> tuple[Shown, ...]:
        return tuple(
            Shown(f"robot {c.turn.robot} has run {c.turn.event.name}", c.runs, None)
            for mine in self.prefix.choices
            for c in mine
        )

    def _attempt(
        self, facts: Iterable[Term], goals: Iterable[Goal], shown: tuple[Shown, ...]
    ) -> Attempt:
        return Attempt((*self.past.facts, *facts), tuple(goals), shown)

    def _faults_asked(self) -> bool:
        return any(claim.kind is Kind.FAULT for claim in self.asked)

    # --- events ---------------------------------------------------------------------------------

    def event(self, robot: int, position: int) -> Iterator[Obligation]:
        turn = self.of.turns.turn(self.past.state, robot, position)
        name = f"event {turn.event.name} of robot {robot}{self.within}"
        if self._faults_asked():
            yield Obligation(f"{name}: no fault", (partial(self._no_fault, turn),))
        attempts = [partial(self._event_exactly, turn)]
        if not self.world.mentions(core.Ran):
            attempts.insert(0, partial(self._event_loosely, turn))
        yield Obligation(name, tuple(attempts))

    def _no_fault(self, turn: Turn) -> Attempt:
        """A fault needs one robot only. [T-FAULT]"""
        awake = self.t.negation(self.past.state.robots[turn.robot].stopped)
        goals = [_sound(self.of.turns, fault, turn.legal) for fault in turn.faults]
        return self._attempt([awake], goals, self.shown)

    def _event_exactly(self, turn: Turn) -> Attempt:
        """The other robots have done what they can do on ``c``."""
        prefix, t = self.prefix, self.t
        facts = [*prefix.facts, *self.inside, prefix.ran_none(turn.robot, self.of.turns)]
        for lock, entered in turn.entered.items():
            free = t.negation(self.of.rounds.taken(prefix, lock))
            facts.append(t.implies(entered, free))
        others = [
            prefix.ran_none(j, self.of.turns)
            for j in range(len(self.world.kinds))
            if j != turn.robot
        ]
        last, after = self._moved(prefix.state, turn)
        if last is not None:
            facts.append(t.either(last, t.disjunction(others)))
            legal = t.conjunction(self.of.rounds.skips_legally(prefix, mover=turn))
            facts.append(t.implies(last, legal))
        facts.append(self.of.rounds.may_run(prefix.start, turn))
        goals = self.of.goals(after, self.asked)
        return self._attempt(facts, goals, (*self.shown, *self.chosen))

    def _event_loosely(self, turn: Turn) -> Attempt:
        """Of what the other robots have done only the claims are known, and the locks."""
        state, i = self.loose, turn.robot
        before, t = self.past.state, self.t
        robots = (*state.robots[:i], before.robots[i], *state.robots[i + 1 :])
        allread = tuple(
            (*x[:i], own[i], *x[i + 1 :])
            for x, own in zip(state.store.allread, before.store.allread, strict=True)
            if isinstance(x, tuple) and isinstance(own, tuple)
        )
        allwrite = []
        for d, x, old in zip(
            self.world.program.allwrite,
            state.store.allwrite,
            before.store.allwrite,
            strict=True,
        ):
            # What only blocks of a class write is as it was, for whoever enters the class.
            lock = self.world.guarding(d.variable.slot)
            alone = turn.entered.get(lock, t.truth(False)) if lock is not None else t.truth(False)
            allwrite.append(self.of.s.merge(alone, old, x, d.variable.type))
        inside = State(robots, Store(allread, tuple(allwrite)))
        _, after = self._moved(inside, turn)
        facts = _taken(self.of.goals(inside, self.assumed))
        facts.append(self.of.rounds.may_run(before, turn))
        return self._attempt(facts, self.of.goals(after, self.asked), ())

    def _moved(self, state: State, turn: Turn) -> tuple[Term | None, State]:
        """One more robot has run an event.

        Where it can be seen, also whether it was the last to move, which ends the program turns.
        """
        i, t = turn.robot, self.t
        robots = (*state.robots[:i], turn.after, *state.robots[i + 1 :])
        store = made(self.of.s, state.store, turn.writes, t.truth(True))
        after = State(robots, store)
        if not self.world.asks():
            return None, after
        # END-PROG comes with the last turn of a round.
        last = t.truth(True)
        if len(self.world.kinds) > 1:
            last = self.of.v.symbol(f"{i} is the last to move", BOOL)
        _, ended = self.of.rounds.stopped_together(after)
        robots = tuple(
            replace(r, stopped=t.ite(last, x.stopped, r.stopped))
            for r, x in zip(after.robots, ended.robots, strict=True)
        )
        return last, State(robots, store)

    @cached_property
    def inside(self) -> list[Term]:
        """What is assumed of the configuration before the last step.

        Where nobody has run yet it is the one that the round started in, but for who ran what in
        the round before.
        """
        facts = _taken(self.of.goals(self.prefix.state, self.assumed))
        if not self.world.mentions(core.Ran):
            return facts
        t = self.t
        begun = t.disjunction(c.runs for mine in self.prefix.choices for c in mine)
        return [t.implies(begun, fact) for fact in facts]

    @cached_property
    def loose(self) -> State:
        """Any configuration that shares with the start of the round what no event writes."""
        return self.of.anything_like(self.past.state, self.world.moved, " inside")

    # --- turns that run nothing -----------------------------------------------------------------

    def quiet(self) -> Iterator[Obligation]:
        """Skips that can be seen: the first turn of a round, and the last."""
        if self.world.mentions(core.Ran):
            name = f"a first turn in which a robot skips{self.within}"
            yield Obligation(name, (self._first_skip,))
        if self.world.asks():
            name = f"a last turn in which a robot skips{self.within}"
            yield Obligation(name, (self._last_skip,))

    def _first_skip(self) -> Attempt:
        never = self.t.integer(-1)
        state = self.past.state
        robots = tuple(replace(robot, ran=never) for robot in state.robots)
        may = self.of.rounds.skips_legally(self.prefix, nobody_moved=True)
        goals = self.of.goals(State(robots, state.store), self.asked)
        return self._attempt([self.t.disjunction(may)], goals, self.shown)

    def _last_skip(self) -> Attempt:
        idle, ended = self.of.rounds.stopped_together(self.prefix.state)
        legal = self.of.rounds.skips_legally(self.prefix)
        facts = (*self.prefix.facts, *self.inside, idle, *legal)
        return self._attempt(facts, self.of.goals(ended, self.asked), (*self.shown, *self.chosen))

    # --- pairs of robots ------------------------------------------------------------------------

    def updates(self) -> Iterator[Obligation]:
        """No two robots write one location in the round, of whom one updates it."""
        if any(claim.kind is Kind.LOST_UPDATE for claim in self.asked):
            yield Obligation(f"updates in one round{self.within}", (self._updates,))

    def _updates(self) -> Attempt:
        t = self.t
        goals = [
            Goal(
                claim.name,
                t.truth(True),
                t.negation(meeting(self.of.turns, self.prefix, claim.subject)),
            )
            for claim in self.asked
            if claim.kind is Kind.LOST_UPDATE
        ]
        return self._attempt(self.prefix.facts, goals, (*self.shown, *self.chosen))

    # --- the environment ------------------------------------------------------------------------

    def environment(self) -> Iterator[Obligation]:
        name = f"the environment's turn{self.within}"
        ways = (self._end_loosely, self._end_exactly)
        if self._faults_asked():
            faults = tuple(partial(self._no_fault_after, end) for end in ways)
            yield Obligation(f"{name}: no fault", faults)
        yield Obligation(name, tuple(partial(self._evolved, end) for end in ways))

    def _end_loosely(self) -> tuple[State, list[Term]]:
        return self.loose, _taken(self.of.goals(self.loose, self.assumed))

    def _end_exactly(self) -> tuple[State, list[Term]]:
        prefix, end, facts = self.of.ended(self.past, self.assumed, self.label)
        return end, [*prefix.facts, *facts]

    def _no_fault_after(self, end: Callable[[], tuple[State, list[Term]]]) -> Attempt:
        state, facts = end()
        evolution = self.of.turns.environment(state)
        goals = [_sound(self.of.turns, fault) for fault in evolution.faults]
        return self._attempt([*facts, *evolution.facts], goals, self.shown)

    def _evolved(self, end: Callable[[], tuple[State, list[Term]]]) -> Attempt:
        state, facts = end()
        t, evolution = self.t, self.of.turns.environment(state)
        goals = self.of.goals(evolution.state, self.asked, between_rounds=True)
        for claim in self.asked:
            if claim.kind is Kind.CONTRACT:
                kept = [x for name, _, x in evolution.promises if name == claim.subject]
                goals.append(Goal(claim.name, t.truth(True), t.conjunction(kept)))
        sound = [t.negation(fault.when) for fault in evolution.faults]
        shown = (*self.shown, *self.of.parts(evolution.state, " after"))
        return self._attempt([*facts, *evolution.facts, *sound], goals, shown)


def stated(
    turns: Turns, state: State | Crowd, claims: Iterable[Claim], *, between_rounds: bool
) -> list[Goal]:
    """The claims that are statements, of a configuration."""
    goals = []
    for claim in claims:
        if claim.stated is not None and (between_rounds or not claim.at_round):
            holds, legal = turns.holds(state, claim.stated.condition, claim.stated.bound)
            goals.append(Goal(claim.name, legal, holds))
    return goals


def _sound(turns: Turns, fault: Fault, legal: Term | None = None) -> Goal:
    t = turns.v.t
    place = f"{fault.span.line}:{fault.span.column}"
    known = t.truth(True) if legal is None else legal
    return Goal(f"no fault ({fault.what}, {place})", known, t.negation(fault.when))


def _taken(goals: Iterable[Goal]) -> list[Term]:
    return [term for goal in goals for term in (goal.legal, goal.holds)]


def _has_unknown(storage: Storage) -> bool:
    """Whether anything below is not a constant."""
    if not isinstance(storage, Cell):
        assert isinstance(storage, tuple)
        return any(_has_unknown(below) for below in storage)
    if storage.is_set.value is None:
        return True
    pending = [storage.value]
    while pending:
        value = pending.pop()
        if isinstance(value, tuple):
            pending += value
        elif not isinstance(value, Term) or value.value is None:
            return bool(storage.is_set.value)
    return False
