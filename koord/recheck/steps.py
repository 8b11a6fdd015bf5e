"""The obligations of one round: what one more step of it may break, and lost updates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property, partial

from msgspec import Struct
from msgspec.structs import replace

from koord.recheck.claims import (
    NO_END,
    Claim,
    ClaimKind,
    Entailment,
    Goal,
    History,
    Obligation,
    ShownTerm,
    as_facts,
    sound,
)
from koord.recheck.races import made
from koord.recheck.rounds import Prefix, Rounds
from koord.recheck.storage import AtKey, Field, State, Store, Write
from koord.recheck.terms import BOOL, Term, Terms
from koord.recheck.turns import EventTurn, Turns
from koord.recheck.values import Values
from koord.recheck.world import Instance
from koord.syntax import core
from koord.syntax.core import Home
from koord.syntax.walk import nodes, statements


def lost(turns: Turns, prefix: Prefix, name: str) -> Term:
    """The condition that two robots write one location of a variable that one of them updates."""
    t = turns.v.t
    flat = [choice for mine in prefix.choices for choice in mine]
    return t.disjunction(
        t.conjunction([mine.runs, other.runs, meeting(turns.v, mine.turn, other.turn, name)])
        for mine in flat
        if name in set(updated(mine.turn.event.effect))
        for other in flat
        if other.turn.robot != mine.turn.robot
    )


def meeting(v: Values, one: EventTurn, other: EventTurn, name: str) -> Term:
    """The condition that two turns write one location of an allwrite variable."""
    mine, theirs = (
        [w for w in turn.writes if w.variable.home is Home.ALLWRITE and w.variable.name == name]
        for turn in (one, other)
    )
    return v.t.disjunction(_overlap(v, a, b) for a in mine for b in theirs)


def _overlap(v: Values, a: Write, b: Write) -> Term:
    """The condition that two writes happen, to locations one of which is a prefix of the other."""
    t, same = v.t, [a.when, b.when]
    for x, y in zip(a.locations, b.locations, strict=False):
        if isinstance(x, Field) or isinstance(y, Field):
            same.append(t.truth(x == y))
        elif isinstance(x, AtKey) or isinstance(y, AtKey):
            assert isinstance(x, AtKey)
            assert isinstance(y, AtKey)
            # Two that add entries of different keys decide about their order, and lose nothing.
            same.append(v.equal(x.key, y.key, x.type.key))
        else:
            same.append(t.equal(x, y))
    return t.conjunction(same)


def updated(effect: core.Block) -> Iterator[str]:
    """The allwrite variables that an effect updates outside of its atomic blocks."""
    flows = _flows(effect)
    for s in statements(effect, atomic=False):
        match s:
            case core.Assign(place=place, value=value) if place.variable.home is Home.ALLWRITE:
                if _keeps_the_rest(place) or any(
                    (read, place.variable) in flows or read == place.variable for read in _in(value)
                ):
                    yield place.variable.name
            case core.Append(place=place) | core.Remove(place=place) | core.Pop(place=place):
                if place.variable.home is Home.ALLWRITE:
                    yield place.variable.name
                if isinstance(s, core.Pop) and s.into is not None and _keeps_the_rest(s.into):
                    yield s.into.variable.name
            case _:
                pass


def _keeps_the_rest(place: core.Place) -> bool:
    """Return whether a write keeps the rest of a shared map's entry as it was read."""
    keys = [n for n, step in enumerate(place.steps, 1) if isinstance(step, core.KeyStep)]
    return place.variable.home is Home.ALLWRITE and keys != [] and keys[0] < len(place.steps)


def _flows(effect: core.Block) -> set[tuple[core.Variable, core.Variable]]:
    """Pairs of variables with a flow: the first is computed from the second."""
    pairs: set[tuple[core.Variable, core.Variable]] = set()
    for s in statements(effect):
        match s:
            case core.Assign(place=place, value=value) | core.Append(place=place, value=value):
                pairs |= {(place.variable, read) for read in _in(value)}
            case core.Pop(place=place, into=into) if into is not None:
                pairs.add((into.variable, place.variable))
            case core.ForEach(key=key, value=element, sequence=sequence):
                own = [v for v in (key, element) if v is not None]
                pairs |= {(v, read) for v in own for read in _in(sequence)}
            case _:
                pass
    while True:
        further = {(a, d) for a, b in pairs for c, d in pairs if b == c} - pairs
        if not further:
            return pairs
        pairs |= further


def _in(value: core.Expr) -> Iterator[core.Variable]:
    return (node.variable for node in nodes(value) if isinstance(node, core.Place))


class RoundObligations(Struct, dict=True):
    """The obligations of one round. ``within`` selects the round, where it is not any."""

    of: Rounds
    past: History
    assumed: Sequence[Claim]
    asked: Sequence[Claim]
    label: str

    @property
    def world(self) -> Instance:
        return self.of.turns.world

    @property
    def t(self) -> Terms:
        return self.of.turns.v.t

    @property
    def within(self) -> str:
        return f" in {self.label}" if self.label else ""

    @cached_property
    def shown(self) -> tuple[ShownTerm, ...]:
        return tuple(self.of.parts(self.past.state))

    @cached_property
    def prefix(self) -> Prefix:
        return self.of.prefix(self.past.state, self.label or "the round")

    @cached_property
    def chosen(self) -> tuple[ShownTerm, ...]:
        return tuple(
            ShownTerm(f"robot {c.turn.robot} has run {c.turn.event.name}", c.runs, None)
            for mine in self.prefix.choices
            for c in mine
        )

    def _attempt(
        self, facts: Iterable[Term], goals: Iterable[Goal], shown: tuple[ShownTerm, ...]
    ) -> Entailment:
        return Entailment((*self.past.facts, *facts), tuple(goals), shown)

    def _faults_asked(self) -> bool:
        return any(claim.kind is ClaimKind.FAULT for claim in self.asked)

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

    def _no_fault(self, turn: EventTurn) -> Entailment:
        """The obligation that no turn faults, for one robot. [T-FAULT]"""
        awake = self.t.negation(self.past.state.robots[turn.robot].stopped)
        goals = [sound(self.of.turns, fault, turn.legal) for fault in turn.faults]
        return self._attempt([awake], goals, self.shown)

    def _event_exactly(self, turn: EventTurn) -> Entailment:
        """The step after others' turns, which are those possible on ``c``."""
        prefix, t = self.prefix, self.t
        facts = [*prefix.facts, *self.inside, prefix.ran_none(turn.robot, self.of.turns)]
        for lock, entered in turn.entered.items():
            free = t.negation(self.of.taken(prefix, lock))
            facts.append(t.implies(entered, free))
        others = [
            prefix.ran_none(j, self.of.turns)
            for j in range(len(self.world.kinds))
            if j != turn.robot
        ]
        last, after = self._moved(prefix.state, turn)
        if last is not None:
            facts.append(t.either(last, t.disjunction(others)))
            legal = t.conjunction(self.of.skips_legally(prefix, mover=turn))
            facts.append(t.implies(last, legal))
        facts.append(self.of.turns.may_run(prefix.start.robots[turn.robot], turn))
        goals = self.of.goals(after, self.asked)
        return self._attempt(facts, goals, (*self.shown, *self.chosen))

    def _event_loosely(self, turn: EventTurn) -> Entailment:
        """The step after others' turns, of which only the claims and the locks are known."""
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
            allwrite.append(self.of.turns.s.merge(alone, old, x, d.variable.type))
        inside = State(robots, Store(allread, tuple(allwrite)))
        _, after = self._moved(inside, turn)
        facts = as_facts(self.of.goals(inside, self.assumed))
        facts.append(self.of.turns.may_run(before.robots[turn.robot], turn))
        return self._attempt(facts, self.of.goals(after, self.asked), ())

    def _moved(self, state: State, turn: EventTurn) -> tuple[Term | None, State]:
        """The step of one more robot.

        Where it can be seen, also whether it was the last to move, which ends the program turns.
        """
        i, t = turn.robot, self.t
        robots = (*state.robots[:i], turn.after, *state.robots[i + 1 :])
        store = made(self.of.turns.s, state.store, turn.writes, t.truth(True))
        after = State(robots, store)
        if not self.world.asks():
            return None, after
        # END-PROG comes with the last turn of a round.
        last = t.truth(True)
        if len(self.world.kinds) > 1:
            last = self.of.turns.v.symbol(f"{i} is the last to move", BOOL)
        _, ended = self.of.stopped_together(after)
        robots = tuple(
            replace(r, stopped=t.ite(last, x.stopped, r.stopped))
            for r, x in zip(after.robots, ended.robots, strict=True)
        )
        return last, State(robots, store)

    @cached_property
    def inside(self) -> list[Term]:
        """The facts assumed of the configuration before the last step.

        Where nobody has run yet it is the one that the round started in, but for who ran what in
        the round before.
        """
        facts = as_facts(self.of.goals(self.prefix.state, self.assumed))
        if not self.world.mentions(core.Ran):
            return facts
        t = self.t
        begun = t.disjunction(c.runs for mine in self.prefix.choices for c in mine)
        return [t.implies(begun, fact) for fact in facts]

    @cached_property
    def loose(self) -> State:
        """An arbitrary configuration that agrees with the round's start where no event writes."""
        return self.of.anything_like(self.past.state, self.world.moved, " inside")

    # --- turns that run nothing -----------------------------------------------------------------

    def quiet(self) -> Iterator[Obligation]:
        """Observable skips: the first turn of a round, and the last."""
        if self.world.mentions(core.Ran):
            name = f"a first turn in which a robot skips{self.within}"
            yield Obligation(name, (self._first_skip,))
        if self.world.asks():
            name = f"a last turn in which a robot skips{self.within}"
            yield Obligation(name, (self._last_skip,))

    def _first_skip(self) -> Entailment:
        never = self.t.integer(-1)
        state = self.past.state
        robots = tuple(replace(robot, ran=never) for robot in state.robots)
        may = self.of.skips_legally(self.prefix, nobody_moved=True)
        goals = self.of.goals(State(robots, state.store), self.asked)
        return self._attempt([self.t.disjunction(may)], goals, self.shown)

    def _last_skip(self) -> Entailment:
        idle, ended = self.of.stopped_together(self.prefix.state)
        legal = self.of.skips_legally(self.prefix)
        facts = (*self.prefix.facts, *self.inside, idle, *legal)
        return self._attempt(facts, self.of.goals(ended, self.asked), (*self.shown, *self.chosen))

    # --- pairs of robots ------------------------------------------------------------------------

    def updates(self) -> Iterator[Obligation]:
        """The obligation that no robot's update meets another's write in the round."""
        if any(claim.kind is ClaimKind.LOST_UPDATE for claim in self.asked):
            yield Obligation(f"updates in one round{self.within}", (self._updates,))

    def _updates(self) -> Entailment:
        t = self.t
        goals = [
            Goal(
                claim.name,
                t.truth(True),
                t.negation(lost(self.of.turns, self.prefix, claim.subject)),
            )
            for claim in self.asked
            if claim.kind is ClaimKind.LOST_UPDATE
        ]
        return self._attempt(self.prefix.facts, goals, (*self.shown, *self.chosen))

    # --- the environment ------------------------------------------------------------------------

    def environment(self) -> Iterator[Obligation]:
        name = f"the environment's turn{self.within}"
        ways = (self._end_loosely, self._end_exactly)
        if self._faults_asked():
            faults = tuple(partial(self._no_fault_after, end) for end in ways)
            yield Obligation(f"{name}: no fault", faults)
        hollow = NO_END if self.of.turns.world.promised else ""
        yield Obligation(name, tuple(partial(self._evolved, end) for end in ways), hollow)

    def _end_loosely(self) -> tuple[State, list[Term]]:
        return self.loose, as_facts(self.of.goals(self.loose, self.assumed))

    def _end_exactly(self) -> tuple[State, list[Term]]:
        prefix, end, facts = self.of.ended(self.past, self.assumed, self.label)
        return end, [*prefix.facts, *facts]

    def _no_fault_after(self, end: Callable[[], tuple[State, list[Term]]]) -> Entailment:
        state, facts = end()
        evolution = self.of.turns.environment(state)
        goals = [sound(self.of.turns, fault) for fault in evolution.faults]
        return self._attempt([*facts, *evolution.facts], goals, self.shown)

    def _evolved(self, end: Callable[[], tuple[State, list[Term]]]) -> Entailment:
        state, facts = end()
        t, evolution = self.t, self.of.turns.environment(state)
        goals = self.of.goals(evolution.state, self.asked, between_rounds=True)
        for claim in self.asked:
            if claim.kind is ClaimKind.CONTRACT:
                kept = [x for name, _, x in evolution.promises if name == claim.subject]
                goals.append(Goal(claim.name, t.truth(True), t.conjunction(kept)))
        sound = [t.negation(fault.when) for fault in evolution.faults]
        shown = (*self.shown, *self.of.parts(evolution.state, " after"))
        return self._attempt([*facts, *evolution.facts, *sound], goals, shown)
