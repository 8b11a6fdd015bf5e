"""What has to be shown for claims to hold in every round: one obligation per step of a robot.

The argument that these are enough is T-PER-EVENT of ``specs/certificates/README.md``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum

from koord.recheck.body import Fault
from koord.recheck.racing import made
from koord.recheck.rounds import Prefix, Rounds
from koord.recheck.storage import Cell, Robot, State, Storage, Storages, Store
from koord.recheck.terms import BOOL, INT, Term
from koord.recheck.turns import Turn, Turns
from koord.recheck.updates import meeting
from koord.recheck.values import Values
from koord.recheck.world import World
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
class Obligation:
    """From the hypotheses each goal follows. ``given`` is what several obligations have in common.

    ``shown`` is what to tell of a counterexample.
    """

    name: str
    given: tuple[Term, ...]
    hypotheses: tuple[Term, ...]
    goals: tuple[Goal, ...]
    shown: tuple[Shown, ...] = ()


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
        yield from self._initiation(opening.state, opening.facts, opening.faults)
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

    # --- where rounds start ---------------------------------------------------------------------

    def _initiation(
        self, state: State, facts: tuple[Term, ...], faults: tuple[Fault, ...]
    ) -> Iterator[Obligation]:
        t = self.v.t
        shown = tuple(self._parts(state))
        if any(claim.kind is Kind.FAULT for claim in self.claims):
            goals = [_sound(self.turns, fault) for fault in faults]
            yield Obligation("initiation: no fault", facts, (), tuple(goals), shown)
        sound = [t.negation(fault.when) for fault in faults]
        goals = self._goals(state, self.claims, between_rounds=True)
        yield Obligation("initiation", (*facts, *sound), (), tuple(goals), shown)

    def _anything(self, first: Past) -> Past:
        """Any configuration, but for what nobody ever writes: that is as INIT left it."""
        program, t = self.world.program, self.v.t
        frozen: list[Storage] = []
        facts: list[Term] = []

        def of(d: core.Declaration, home: Home, kind: int, like: Storage, where: str) -> Storage:
            key = (home, kind, d.variable.slot)
            if key not in self.world.written:
                frozen.append(like)
                return like
            if key in self.world.rewritten:
                like = self.s.loosened(like, d.variable.type)
            return self.s.anything(f"{d.variable.name}{where}", d.variable.type, like)

        robots = []
        for i, own in enumerate(first.state.robots):
            kind, agent = self.world.kinds[i], self.world.agent(i)
            at = f"@{i}"
            ports = [port.declaration for port in agent.ports]
            stopped = asked = t.truth(False)
            if self.world.stops():
                stopped = self.v.symbol(f"stopped{at}", BOOL)
            if self.world.asks():
                asked = self.v.symbol(f"asked to stop{at}", BOOL)
            ran = t.integer(-1)
            if self.world.mentions(core.Ran):
                ran = self.v.symbol(f"ran{at}", INT)
                facts.append(t.at_most(t.integer(-1), ran))
                facts.append(t.less(ran, t.integer(len(agent.events))))
            robots.append(
                Robot(
                    tuple(
                        of(d, Home.LOCAL, kind, like, at)
                        for d, like in zip(agent.locals, own.locals, strict=True)
                    ),
                    tuple(
                        of(d, Home.PORT, kind, like, at)
                        for d, like in zip(ports, own.ports, strict=True)
                    ),
                    asked,
                    stopped,
                    ran,
                )
            )
        store = first.state.store
        shared = Store(
            tuple(
                of(d, Home.ALLREAD, 0, like, "")
                for d, like in zip(program.allread, store.allread, strict=True)
            ),
            tuple(
                of(d, Home.ALLWRITE, 0, like, "")
                for d, like in zip(program.allwrite, store.allwrite, strict=True)
            ),
        )
        if any(_has_unknown(storage) for storage in frozen):
            # What INIT and the assumptions say of them still holds.
            facts += first.facts
        return Past(State(tuple(robots), shared), tuple(facts))

    def _followed(self, past: Past, assumed: Sequence[Claim]) -> Past:
        """The same, with what is assumed at the start of a round."""
        goals = self._goals(past.state, assumed, between_rounds=True)
        return Past(past.state, (*past.facts, *_taken(goals)))

    def _extended(self, past: Past, assumed: Sequence[Claim], label: str) -> Past:
        """What a whole round leads to, in which everything that is assumed held."""
        prefix, end, facts = self._ended(past, assumed, label)
        evolution = self.turns.environment(end)
        t = self.v.t
        sound = [t.negation(fault.when) for fault in evolution.faults]
        known = (*past.facts, *prefix.facts, *facts, *evolution.facts, *sound)
        return self._followed(Past(evolution.state, known), assumed)

    def _ended(
        self, past: Past, assumed: Sequence[Claim], label: str
    ) -> tuple[Prefix, State, list[Term]]:
        """The end of the program turns of a round, and what is known of it."""
        prefix = self.rounds.prefix(past.state, label or "the round")
        facts = self.rounds.skips_legally(prefix)
        _, end = self.rounds.stopped_together(prefix.state)
        facts += _taken(self._goals(end, assumed))
        return prefix, end, facts

    # --- one round ------------------------------------------------------------------------------

    def _round(
        self, past: Past, assumed: Sequence[Claim], asked: Sequence[Claim], label: str
    ) -> Iterator[Obligation]:
        """Everything that one more step of a round may break."""
        within = f" in {label}" if label else ""
        t, world = self.v.t, self.world
        given = past.facts
        shown = tuple(self._parts(past.state))
        prefix = self.rounds.prefix(past.state, label or "the round")
        plain = [claim for claim in assumed if not claim.at_round]
        inside = self._inside(prefix, plain)
        chosen = tuple(
            Shown(f"robot {c.turn.robot} has run {c.turn.event.name}", c.runs, None)
            for mine in prefix.choices
            for c in mine
        )
        for i in range(world.robots):
            for choice in prefix.choices[i]:
                turn = choice.turn
                name = f"event {turn.event.name} of robot {i}{within}"
                if any(claim.kind is Kind.FAULT for claim in asked):
                    awake = t.negation(past.state.robots[i].stopped)
                    goals = [_sound(self.turns, fault, turn.legal) for fault in turn.faults]
                    yield Obligation(f"{name}: no fault", given, (awake,), tuple(goals), shown)
                hypotheses, after = self._moved(prefix, turn)
                goals = self._goals(after, asked)
                facts = (*prefix.facts, *inside, *hypotheses)
                yield Obligation(name, given, facts, tuple(goals), (*shown, *chosen))
        yield from self._quiet(past, prefix, asked, inside, within, (*shown, *chosen))
        yield from self._updates(past, prefix, asked, within, (*shown, *chosen))
        yield from self._environment(past, assumed, asked, label, shown)

    def _inside(self, prefix: Prefix, plain: Sequence[Claim]) -> list[Term]:
        """What is assumed of the configuration before the last step.

        Where nobody has run yet it is the one that the round started in, but for who ran what in
        the round before.
        """
        t = self.v.t
        facts = _taken(self._goals(prefix.state, plain))
        if not self.world.mentions(core.Ran):
            return facts
        begun = t.disjunction(choice.runs for mine in prefix.choices for choice in mine)
        return [t.implies(begun, fact) for fact in facts]

    def _moved(self, prefix: Prefix, turn: Turn) -> tuple[list[Term], State]:
        """One more robot runs an event: what makes that a step, and where it leads to."""
        t, i = self.v.t, turn.robot
        facts = [prefix.ran_none(i, self.turns), self.rounds.may_run(prefix.start, turn)]
        for lock, entered in turn.entered.items():
            free = t.negation(self.rounds.taken(prefix, lock))
            facts.append(t.implies(entered, free))
        robots = (*prefix.state.robots[:i], turn.after, *prefix.state.robots[i + 1 :])
        after = State(robots, made(self.s, prefix.state.store, turn.writes, t.truth(True)))
        if not self.world.asks():
            return facts, after
        # END-PROG comes with the last turn of a round.
        others = [prefix.ran_none(j, self.turns) for j in range(self.world.robots) if j != i]
        last = self.v.symbol("it is the last turn of the round", BOOL) if others else t.truth(True)
        facts.append(t.either(last, t.disjunction(others)))
        legal = t.conjunction(self.rounds.skips_legally(prefix, mover=turn))
        facts.append(t.implies(last, legal))
        _, ended = self.rounds.stopped_together(after)
        robots = tuple(
            Robot(r.locals, r.ports, r.asked, t.ite(last, x.stopped, r.stopped), r.ran)
            for r, x in zip(after.robots, ended.robots, strict=True)
        )
        return facts, State(robots, after.store)

    def _quiet(
        self,
        past: Past,
        prefix: Prefix,
        asked: Sequence[Claim],
        inside: Sequence[Term],
        within: str,
        shown: tuple[Shown, ...],
    ) -> Iterator[Obligation]:
        """Skips that can be seen: the first turn of a round, and the last."""
        t, given = self.v.t, past.facts
        if self.world.mentions(core.Ran):
            robots = tuple(
                Robot(r.locals, r.ports, r.asked, r.stopped, t.integer(-1))
                for r in past.state.robots
            )
            may = self.rounds.skips_legally(prefix, nobody_moved=True)
            goals = self._goals(State(robots, past.state.store), asked)
            name = f"a first turn in which a robot skips{within}"
            yield Obligation(name, given, (t.disjunction(may),), tuple(goals), shown)
        if self.world.asks():
            idle, ended = self.rounds.stopped_together(prefix.state)
            facts = (*prefix.facts, *inside, idle, *self.rounds.skips_legally(prefix))
            goals = self._goals(ended, asked)
            name = f"a last turn in which a robot skips{within}"
            yield Obligation(name, given, facts, tuple(goals), shown)

    def _updates(
        self,
        past: Past,
        prefix: Prefix,
        asked: Sequence[Claim],
        within: str,
        shown: tuple[Shown, ...],
    ) -> Iterator[Obligation]:
        """No two robots write one location in the round, of whom one updates it. [LOST-UPDATE]"""
        t = self.v.t
        goals = []
        for claim in asked:
            if claim.kind is Kind.LOST_UPDATE:
                met = meeting(self.turns, prefix, claim.subject)
                goals.append(Goal(claim.name, t.truth(True), t.negation(met)))
        if goals:
            name = f"updates in one round{within}"
            yield Obligation(name, past.facts, prefix.facts, tuple(goals), shown)

    def _environment(
        self,
        past: Past,
        assumed: Sequence[Claim],
        asked: Sequence[Claim],
        label: str,
        shown: tuple[Shown, ...],
    ) -> Iterator[Obligation]:
        within = f" in {label}" if label else ""
        t = self.v.t
        prefix, end, facts = self._ended(past, assumed, label)
        evolution = self.turns.environment(end)
        given = past.facts
        hypotheses = (*prefix.facts, *facts)
        goals: list[Goal] = []
        shown = (*shown, *self._parts(evolution.state, " after"))
        if any(claim.kind is Kind.FAULT for claim in asked):
            goals = [_sound(self.turns, fault) for fault in evolution.faults]
            name = f"the environment's turn{within}: no fault"
            legal = t.conjunction(evolution.facts)
            yield Obligation(name, given, (*hypotheses, legal), tuple(goals), shown)
        sound = [t.negation(fault.when) for fault in evolution.faults]
        goals = self._goals(evolution.state, asked, between_rounds=True)
        for claim in asked:
            if claim.kind is Kind.CONTRACT:
                kept = [x for name, _, x in evolution.promises if name == claim.subject]
                goals.append(Goal(claim.name, t.truth(True), t.conjunction(kept)))
        evolved = (*hypotheses, *evolution.facts, *sound)
        yield Obligation(f"the environment's turn{within}", given, evolved, tuple(goals), shown)

    # --- claims ---------------------------------------------------------------------------------

    def _goals(
        self, state: State, claims: Iterable[Claim], *, between_rounds: bool = False
    ) -> list[Goal]:
        """Statements that are to hold in a configuration."""
        goals = []
        for claim in claims:
            if claim.stated is not None and (between_rounds or not claim.at_round):
                holds, legal = self.turns.holds(state, claim.stated.condition, claim.stated.bound)
                goals.append(Goal(claim.name, legal, holds))
        return goals

    # --- counterexamples ------------------------------------------------------------------------

    def _parts(self, state: State, suffix: str = "") -> Iterator[Shown]:
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
        for below, (label, part) in zip(storage, parts, strict=True):
            yield from self._leaves(name + label, where, below, part)


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
        return any(_has_unknown(below) for below in storage)
    if storage.is_set.value is None:
        return True
    pending = [storage.value]
    while pending:
        value = pending.pop()
        if isinstance(value, tuple):
            pending += value
        elif value.value is None:
            return bool(storage.is_set.value)
    return False
