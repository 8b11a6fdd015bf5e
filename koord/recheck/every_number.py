"""Obligations for claims in every round, of any number of robots. [T-EVERY-N]

The obligations are those of ``obligations.py``, of a robot of whatever number in place of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial

from msgspec.structs import replace

from koord.recheck.claims import (
    NO_END,
    NO_START,
    Claim,
    ClaimKind,
    Entailment,
    Goal,
    Obligation,
    as_facts,
    fault_name,
    stated,
)
from koord.recheck.claims import sound as without_fault
from koord.recheck.every_n_rounds import Moves, ParameterisedPrefix, PrefixBuilder, stopped_together
from koord.recheck.generic_turn import ParameterisedInit, ParameterisedTurns, PerRobot
from koord.recheck.races import made
from koord.recheck.steps import meeting, updated
from koord.recheck.storage import Many, ParameterisedState, Robot
from koord.recheck.terms import BOOL, INT, Term
from koord.recheck.turns import EventTurn, Evolved, Turns
from koord.recheck.values import Values
from koord.recheck.world import Instance
from koord.syntax import core


class EveryNumber:
    """All obligations of claims about a program with any number of robots."""

    def __init__(
        self,
        world: Instance,
        claims: Sequence[Claim],
        v: Values,
        consequences: Sequence[core.Property] = (),
    ) -> None:
        self.world = world
        self.claims = claims
        self.v = v
        self.consequences = consequences
        self.turns = Turns(self.world, self.v)
        self.crowds = ParameterisedTurns(self.world, self.turns)

    def __iter__(self) -> Iterator[Obligation]:
        t, opening = self.v.t, self.crowds.opening()
        sound = [t.negation(fault.when) for fault in opening.faults]
        if any(claim.kind is ClaimKind.FAULT for claim in self.claims):
            goals = [without_fault(self.turns, fault) for fault in opening.faults]
            yield _once("initiation: no fault", Entailment(opening.facts, tuple(goals)))
        goals = stated(self.turns, opening.state, self.claims, between_rounds=True)
        starts = Entailment((*opening.facts, *sound), tuple(goals))
        yield replace(_once("initiation", starts), hollow=NO_START)
        for depth in sorted({claim.depth for claim in self.claims} or {1}):
            yield from self._over(depth, opening, [*opening.facts, *sound])
        for property_ in self.consequences:
            claim = Claim(property_.name, ClaimKind.STATEMENT, property_)
            name = f"the invariant implies {claim.name}"
            yield Obligation(name, (partial(self._implied, claim, opening),))

    def _over(
        self, depth: int, opening: ParameterisedInit, begun: Sequence[Term]
    ) -> Iterator[Obligation]:
        """The obligations of claims that are inductive over so many rounds."""
        assumed = [claim for claim in self.claims if claim.depth <= depth]
        asked = [claim for claim in self.claims if claim.depth == depth]
        state, facts = opening.state, list(begun)
        for number in range(1, depth):
            step = StepObligations(self.crowds, assumed, state, facts, asked, f", round {number}")
            yield from step
            state, facts = step.followed()
        state, facts = self.anything(opening)
        for _ in range(1, depth):
            state, facts = StepObligations(self.crowds, assumed, state, facts).followed()
        yield from StepObligations(self.crowds, assumed, state, facts, asked)

    def _implied(self, claim: Claim, opening: ParameterisedInit) -> Entailment:
        state, facts = self.anything(opening)
        at_round = claim.at_round
        known = stated(self.turns, state, self.claims, between_rounds=at_round)
        goals = stated(self.turns, state, [claim], between_rounds=at_round)
        return Entailment((*facts, *as_facts(known)), tuple(goals))

    def anything(self, opening: ParameterisedInit) -> tuple[ParameterisedState, list[Term]]:
        """An arbitrary configuration, with variables that are never written as INIT left them."""
        t = self.v.t
        state = self.crowds.anything_like(opening.state, self.world.written, "")
        facts = [*opening.facts]
        if self.world.mentions(core.Ran):
            for kind in self.crowds.kinds:
                with self.v.within() as robot:
                    ran = state.robot(kind, robot).ran
                    last = t.integer(len(self.world.program.agents[kind].events))
                    inside = t.both(t.at_most(t.integer(-1), ran), t.less(ran, last))
                    facts.append(self.crowds.all_of(kind, robot, inside))
        return state, facts


class StepObligations:
    """The obligations of one step of a round, from any configuration with the invariant.

    Of the ``claims``, which hold there, some may be ``asked`` for alone.
    """

    def __init__(
        self,
        crowds: ParameterisedTurns,
        claims: Sequence[Claim],
        start: ParameterisedState,
        facts: Sequence[Term],
        asked: Sequence[Claim] | None = None,
        label: str = "",
    ) -> None:
        self.asked, self.label = claims if asked is None else asked, label
        self.crowds, self.claims, self.start, self.facts = crowds, claims, start, facts
        self.turns, self.world = crowds.turns, crowds.world
        self.s, self.v, self.t = crowds.s, crowds.v, crowds.v.t

    def __iter__(self) -> Iterator[Obligation]:
        for kind in self.crowds.kinds:
            for position in range(len(self.world.program.agents[kind].events)):
                yield from self._event(kind, position)
        yield from self._quiet()
        if any(claim.kind is ClaimKind.LOST_UPDATE for claim in self.asked):
            yield from self._updates()
        yield from self._environment()

    @cached_property
    def known(self) -> list[Term]:
        """The facts at the start of the round."""
        goals = self._stated(self.start, between_rounds=True)
        return [*self.facts, *as_facts(goals)]

    def _stated(self, state: ParameterisedState, *, between_rounds: bool = False) -> list[Goal]:
        return stated(self.turns, state, self.claims, between_rounds=between_rounds)

    def _goals(self, state: ParameterisedState, *, between_rounds: bool = False) -> list[Goal]:
        return stated(self.turns, state, self.asked, between_rounds=between_rounds)

    @cached_property
    def moves(self) -> Moves:
        return [
            [
                self.crowds.turn(self.start, kind, position)
                for position in range(len(self.world.program.agents[kind].events))
            ]
            for kind in self.crowds.kinds
        ]

    @cached_property
    def gathering(self) -> ParameterisedPrefix:
        return PrefixBuilder(self.crowds, self.start, self.moves).gathering()

    @cached_property
    def loose(self) -> ParameterisedState:
        """An arbitrary configuration that agrees with the round's start where no event writes."""
        return self.crowds.anything_like(self.start, self.world.moved, " inside")

    def _one(self, name: str, kind: int) -> tuple[Term, Term]:
        """A robot of a kind, with the fact that it is one."""
        robot = self.v.symbol(name, INT)
        return robot, self.crowds.is_one(robot, kind)

    # --- events ---------------------------------------------------------------------------------

    def _event(self, kind: int, position: int) -> Iterator[Obligation]:
        move = self.moves[kind][position]
        agents = self.world.program.agents
        whose = f" of {agents[kind].name}" if len(agents) > 1 else ""
        name = f"event {move.known.event.name}{whose}{self.label}"
        robot, is_one = self._one(f"who runs {name}", kind)
        turn = move.of(robot)
        if any(claim.kind is ClaimKind.FAULT for claim in self.asked):
            yield Obligation(f"{name}: no fault", (partial(self._no_fault, robot, is_one, turn),))
        attempts = [partial(self._exactly, robot, is_one, turn)]
        if not self.world.mentions(core.Ran) and not self.world.asks():
            attempts.insert(0, partial(self._loosely, robot, is_one, turn))
        yield Obligation(name, tuple(attempts))

    def _no_fault(self, robot: Term, is_one: Term, turn: EventTurn) -> Entailment:
        """The obligation that no turn faults, for one robot. [T-FAULT]"""
        awake = self.t.negation(self.start.robot(turn.robot, robot).stopped)
        goals = [without_fault(self.turns, fault, turn.legal) for fault in turn.faults]
        return Entailment((*self.known, is_one, awake), tuple(goals), names=(robot,))

    def _loosely(self, robot: Term, is_one: Term, turn: EventTurn) -> Entailment:
        """The step after others' turns, of which only the claims and the locks are known."""
        t, before, inside, s = self.t, self.start, self.loose, self.s
        program, agent = self.world.program, self.world.program.agents[turn.robot]
        facts = [is_one, *as_facts(self._stated(inside))]
        own, its = before.robot(turn.robot, robot), inside.robot(turn.robot, robot)
        ports = [port.declaration for port in agent.ports]
        for declarations, old, new in (
            (agent.locals, own.locals, its.locals),
            (ports, own.ports, its.ports),
        ):
            for d, x, y in zip(declarations, old, new, strict=True):
                facts.append(s.same(x, y, d.variable.type))
        facts += [t.equal(own.asked, its.asked), t.equal(own.stopped, its.stopped)]
        for d, x, y in zip(
            program.allread, before.store.allread, inside.store.allread, strict=True
        ):
            assert isinstance(x, Many)
            assert isinstance(y, Many)
            facts.append(s.same(x.at(robot), y.at(robot), self.v.element(d.variable.type)))
        for d, x, y in zip(
            program.allwrite, before.store.allwrite, inside.store.allwrite, strict=True
        ):
            # What only blocks of a class write is as it was, for whoever enters the class.
            lock = self.world.guarding(d.variable.slot)
            if lock is not None and lock in turn.entered:
                facts.append(t.implies(turn.entered[lock], s.same(x, y, d.variable.type)))
        facts.append(self.turns.may_run(own, turn))
        after = self._moved(inside, robot, turn)
        return Entailment((*self.known, *facts), tuple(self._goals(after)), names=(robot,))

    def _exactly(self, robot: Term, is_one: Term, turn: EventTurn) -> Entailment:
        """The step after others' turns, which are those possible at the start of the round."""
        round_, t = self.gathering, self.t
        facts = [is_one, *round_.facts, *self.inside, round_.ran_none(robot)]
        for lock, entered in turn.entered.items():
            facts.append(t.implies(entered, t.negation(round_.taken(lock))))
        facts.append(self.turns.may_run(self.start.robot(turn.robot, robot), turn))
        after = self._moved(round_.state, robot, turn)
        if self.world.asks():
            # END-PROG comes with the last turn of a round.
            last = self.v.symbol("nobody moves after it", BOOL)
            facts += [t.implies(last, fact) for fact in round_.skips_legally(but=robot, mover=turn)]
            after = self._ended(after, last)
        names = (robot, *round_.winners.values())
        return Entailment((*self.known, *facts), tuple(self._goals(after)), names=names)

    def _ended(self, state: ParameterisedState, last: Term) -> ParameterisedState:
        """The configuration after END-PROG, if the last robot has moved."""
        _, ended = stopped_together(self.crowds, state)

        def robot(kind: int, k: Term) -> Robot:
            own = state.robot(kind, k)
            stopped = self.t.ite(last, ended.robot(kind, k).stopped, own.stopped)
            return replace(own, stopped=stopped)

        return ParameterisedState(robot, state.store)

    def _moved(self, state: ParameterisedState, mover: Term, turn: EventTurn) -> ParameterisedState:
        """The step of one more robot."""
        t, s = self.t, self.s
        agent = self.world.program.agents[turn.robot]

        def robot(kind: int, k: Term) -> Robot:
            own = state.robot(kind, k)
            if kind != turn.robot:
                return own
            return s.merge_robots(t.equal(k, mover), turn.after, own, agent)

        return ParameterisedState(robot, made(s, state.store, turn.writes, t.truth(True)))

    @cached_property
    def inside(self) -> list[Term]:
        """The facts assumed of the configuration before the last step.

        Where nobody has run yet it is the one that the round started in, but for who ran what in
        the round before.
        """
        facts = as_facts(self._stated(self.gathering.state))
        if not self.world.mentions(core.Ran):
            return facts
        t = self.t
        with self.v.within() as robot:
            idle = t.implies(self.v.is_robot(robot), self.gathering.ran_none(robot))
            begun = t.negation(t.for_all([robot], idle))
        return [t.implies(begun, fact) for fact in facts]

    # --- turns that run nothing -----------------------------------------------------------------

    def _quiet(self) -> Iterator[Obligation]:
        """Observable skips: the first turn of a round, and the last."""
        if self.world.mentions(core.Ran):
            yield Obligation(
                f"a first turn in which a robot skips{self.label}", (self._first_skip,)
            )
        if self.world.asks():
            yield Obligation(f"a last turn in which a robot skips{self.label}", (self._last_skip,))

    def _first_skip(self) -> Entailment:
        t, never = self.t, self.t.integer(-1)

        def robot(kind: int, k: Term) -> Robot:
            return replace(self.start.robot(kind, k), ran=never)

        skipping = []
        for kind in self.crowds.kinds:
            one, is_one = self._one("who skips", kind)
            free = [self.turns.off(m.of(one)) for m in self.moves[kind] if m.known.event.urgent]
            may = t.either(self.start.robot(kind, one).stopped, t.conjunction(free))
            skipping.append(t.both(is_one, may))
        goals = self._goals(ParameterisedState(robot, self.start.store))
        return Entailment((*self.known, t.disjunction(skipping)), tuple(goals))

    def _last_skip(self) -> Entailment:
        round_ = self.gathering
        idle, ended = stopped_together(self.crowds, round_.state)
        facts = [*round_.facts, *self.inside, idle, *round_.skips_legally()]
        return Entailment((*self.known, *facts), tuple(self._goals(ended)))

    # --- pairs of robots ------------------------------------------------------------------------

    def _updates(self) -> Iterator[Obligation]:
        """The obligation that no robot's update meets another's write in the round."""
        flat = [move for mine in self.moves for move in mine]
        for mine in flat:
            names = set(updated(mine.known.event.effect))
            asked = [
                c for c in self.asked if c.kind is ClaimKind.LOST_UPDATE and c.subject in names
            ]
            for other in flat if asked else ():
                pair = f"{mine.known.event.name} and {other.known.event.name}"
                name = f"updates of {pair}{self.label}"
                yield Obligation(name, (partial(self._update, mine, other, asked),))

    def _update(
        self, mine: PerRobot[EventTurn], other: PerRobot[EventTurn], asked: Sequence[Claim]
    ) -> Entailment:
        t = self.t
        facts, pair = [], []
        for number, move in enumerate((mine, other)):
            robot, is_one = self._one(f"writer {number}", move.known.robot)
            turn = move.of(robot)
            own = self.start.robot(turn.robot, robot)
            facts += [is_one, self.turns.may_run(own, turn)]
            pair.append((robot, turn))
        (one, a), (two, b) = pair
        facts.append(t.negation(t.equal(one, two)))
        for lock, entered in a.entered.items():
            if lock in b.entered:
                facts.append(t.negation(t.both(entered, b.entered[lock])))
        goals = [
            Goal(c.name, t.truth(True), t.negation(meeting(self.v, a, b, c.subject))) for c in asked
        ]
        return Entailment((*self.known, *facts), tuple(goals), names=(one, two))

    # --- the environment ------------------------------------------------------------------------

    def _environment(self) -> Iterator[Obligation]:
        name = f"the environment's turn{self.label}"
        ways = (self._end_loosely, self._end_exactly)
        if any(claim.kind is ClaimKind.FAULT for claim in self.asked):
            faults = tuple(partial(self._no_fault_after, end) for end in ways)
            yield Obligation(f"{name}: no fault", faults)
        hollow = NO_END if self.world.promised else ""
        yield Obligation(name, tuple(partial(self._evolved, end) for end in ways), hollow)

    def _end_loosely(self) -> tuple[ParameterisedState, list[Term]]:
        return self.loose, as_facts(self._stated(self.loose))

    def _end_exactly(self) -> tuple[ParameterisedState, list[Term]]:
        round_ = self.gathering
        _, end = stopped_together(self.crowds, round_.state)
        facts = [*round_.facts, *round_.skips_legally()]
        return end, [*facts, *as_facts(self._stated(end))]

    def _no_fault_after(
        self, end: Callable[[], tuple[ParameterisedState, list[Term]]]
    ) -> Entailment:
        state, facts = end()
        goals = []
        for kind, one in enumerate(self.crowds.evolved(state)):
            legal = [self.crowds.all_of(kind, one.blank, fact) for fact in one.known.facts]
            for fault in one.known.faults:
                never = self.crowds.all_of(kind, one.blank, self.t.negation(fault.when))
                goals.append(Goal(fault_name(fault), self.t.conjunction(legal), never))
        return Entailment((*self.known, *facts), tuple(goals))

    def _evolved(self, end: Callable[[], tuple[ParameterisedState, list[Term]]]) -> Entailment:
        t = self.t
        after, facts, evolved = self._ended_by(end)
        goals = self._goals(after, between_rounds=True)
        for claim in self.asked:
            if claim.kind is ClaimKind.CONTRACT:
                kept = [
                    self.crowds.all_of(kind, one.blank, promise)
                    for kind, one in enumerate(evolved)
                    for name, promise in one.known.promises
                    if name == claim.subject
                ]
                goals.append(Goal(claim.name, t.truth(True), t.conjunction(kept)))
        return Entailment((*self.known, *facts), tuple(goals))

    def _ended_by(
        self, end: Callable[[], tuple[ParameterisedState, list[Term]]]
    ) -> tuple[ParameterisedState, list[Term], list[PerRobot[Evolved]]]:
        """The configuration after the environment's turn, with facts, and that turn."""
        state, facts = end()
        evolved = self.crowds.evolved(state)
        for kind, one in enumerate(evolved):
            calm = [self.t.negation(fault.when) for fault in one.known.faults]
            facts += [self.crowds.all_of(kind, one.blank, x) for x in (*one.known.facts, *calm)]
        after = ParameterisedState(lambda kind, k: evolved[kind].of(k).robot, state.store)
        return after, facts, evolved

    def whole_round(self) -> tuple[ParameterisedState, tuple[Term, ...]]:
        """The end of any whole round, with what is known of it. [LIVE-RUN]"""
        after, facts, _ = self._ended_by(self._end_exactly)
        return after, tuple(facts)

    def followed(self) -> tuple[ParameterisedState, list[Term]]:
        """Where a round that follows this one starts, with what is known of both."""
        after, facts = self.whole_round()
        return after, [*self.known, *facts]


def _once(name: str, attempt: Entailment) -> Obligation:
    return Obligation(name, (lambda: attempt,))
