"""Obligations of proofs of progress, for any number of robots. [T-PROGRESS]

What a certificate names (measures, lock classes, what lasts, ways to help) is looked at as it is:
each premise of the theorem is an obligation of its own, about one round or one configuration.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cached_property, partial
from typing import assert_never

from msgspec.structs import replace

from koord.recheck.claims import Claim, Entailment, Goal, Obligation, as_facts, stated
from koord.recheck.every_n_rounds import Moves
from koord.recheck.every_number import EveryNumber, StepObligations
from koord.recheck.progress_argument import (
    First,
    Help,
    HelpKind,
    LockClass,
    Phrase,
    ProgressArgument,
)
from koord.recheck.reading import parts_read
from koord.recheck.sorts import Value
from koord.recheck.storage import Cell, ParameterisedState
from koord.recheck.terms import BOOL as BOOLEAN
from koord.recheck.terms import INT, REAL, Term
from koord.recheck.values import Values
from koord.syntax import core
from koord.syntax.types import BOOL
from koord.syntax.types import INT as INTEGER
from koord.syntax.walk import reached

#: What falls as time passes falls in each round by such a part of its length, at least.
_PARTS_OF_DELTA = 16


class ProgressObligations:
    """All obligations of one proof of progress, if the invariant holds in every round."""

    def __init__(self, everyone: EveryNumber, argument: ProgressArgument) -> None:
        self.argument, self.stated = argument, argument.stated
        self.crowds, self.turns = everyone.crowds, everyone.turns
        self.v: Values = everyone.v
        self.t = self.v.t
        self.program = everyone.world.program
        self.claims: Sequence[Claim] = everyone.claims
        self.before, self.facts = everyone.anything(self.crowds.opening())
        self.step = StepObligations(self.crowds, self.claims, self.before, self.facts)
        self.meant = self.v.symbol("the robot that is meant", INT)
        self.robot = self.v.symbol("a robot", INT)

    def __iter__(self) -> Iterator[Obligation]:
        name = self.stated.name
        lasting = list(self.argument.lasting)
        if lasting:
            yield Obligation(f"{name}: what lasts follows", (partial(self._follows, lasting),))
            yield Obligation(f"{name}: what lasts", (partial(self._lasts, lasting),))
        given: list[Term] = []
        for number, part in enumerate(self.argument.order, start=1):
            known = tuple(given)
            if isinstance(part, LockClass):
                what = f"{name}: {number}: lock class {part.index} is granted"
                yield Obligation(what, (partial(self._granted, part.index, known),))
                given += [self._unasked(state, part.index) for state in (self.before, self.after)]
            else:
                what = f"{name}: {number}: a measure settles"
                yield Obligation(what, (partial(self._settles, part.phrase, known),))
                given.append(self._same(part.phrase))
        for number, help_ in enumerate(self.argument.help, start=1):
            if help_.unmoved:
                what = f"{name}: nothing moves that help {number} reads"
                yield Obligation(what, (partial(self._unmoved, help_, tuple(given)),))
            what = f"{name}: help {number} is not refused"
            yield Obligation(what, (partial(self._helps, help_, tuple(given)),))
        yield Obligation(f"{name}: somebody helps", (self._somebody,))

    def _goal(self, name: str, *goals: tuple[Term, Term]) -> tuple[Goal, ...]:
        return tuple(Goal(f"{self.stated.name}: {name}", legal, holds) for holds, legal in goals)

    # --- what is said of configurations -----------------------------------------------------------

    def _holds(
        self, phrase: Phrase, state: ParameterisedState, robot: Term | None = None
    ) -> tuple[Term, Term]:
        """The condition that a statement holds, and the legality of answers in it."""
        bindings = self._bindings(phrase, robot)
        return self.turns.holds(state, phrase.said, phrase.bound, bindings)

    def _number(
        self, phrase: Phrase, state: ParameterisedState, robot: Term | None = None
    ) -> tuple[Term, Term, Term]:
        """A number, the condition that it is none, and the legality of answers in it."""
        bindings = self._bindings(phrase, robot)
        value, faulted, legal = self.turns.worked_out(state, phrase.said, phrase.bound, bindings)
        assert isinstance(value, Term)
        return value, faulted, legal

    def _bindings(self, phrase: Phrase, robot: Term | None) -> Mapping[int, Term]:
        found = {}
        if phrase.robot is not None:
            found[phrase.robot] = self.robot if robot is None else robot
        if phrase.meant is not None:
            found[phrase.meant] = self.meant
        return found

    def _is_one(self, robot: Term, kind: int | None) -> Term:
        """The condition that a number is that of a robot of a kind, or of any."""
        if kind is None:
            return self.v.is_robot(robot)
        return self.crowds.is_one(robot, kind)

    def _claimed(self, said: core.Expr, state: ParameterisedState) -> tuple[Term, Term]:
        """A statement of the claim, of the robot that it means."""
        each = self.stated.each
        slot = None if each is None else each.variable.slot
        return self._holds(Phrase(said, self.stated.bound, None, slot), state)

    def _open(self, state: ParameterisedState) -> list[Term]:
        """The facts of a configuration with the invariant in which the goal is not reached."""
        known = stated(self.turns, state, self.claims, between_rounds=True)
        reached_, legal = self._claimed(self.stated.condition, state)
        facts = [*as_facts(known), legal, self.t.negation(reached_)]
        if self.stated.each is not None:
            facts.append(self._is_one(self.meant, self.stated.each.agent))
        return facts

    def _lasting(self, state: ParameterisedState) -> list[Term]:
        return [term for w in self.argument.lasting for term in self._holds(w, state)]

    @property
    def _names(self) -> tuple[Term, ...]:
        return (self.meant,) if self.stated.each is not None else ()

    # --- rounds -----------------------------------------------------------------------------------

    @cached_property
    def round(self) -> tuple[ParameterisedState, tuple[Term, ...]]:
        """Any whole round: its end, and the facts of it."""
        return self.step.whole_round()

    @property
    def after(self) -> ParameterisedState:
        return self.round[0]

    @cached_property
    def _open_round(self) -> list[Term]:
        """The facts of a round at both ends of which the goal is not reached."""
        return [*self.facts, *self.round[1], *self._open(self.before), *self._open(self.after)]

    @cached_property
    def _pending_round(self) -> list[Term]:
        """The facts of a round before and after which the claim is pending."""
        both = [*self._lasting(self.before), *self._lasting(self.after)]
        return [*self._open_round, *both]

    def _of_round(self, given: Sequence[Term], goals: tuple[Goal, ...], *names: Term) -> Entailment:
        """The obligation that rounds have goals before and after which the claim is pending."""
        return self._follows_from([*self._pending_round, *given], goals, *names)

    def _follows_from(
        self, facts: Sequence[Term], goals: tuple[Goal, ...], *names: Term
    ) -> Entailment:
        winners = self.step.gathering.winners.values()
        return Entailment(tuple(facts), goals, names=(*self._names, *names, *winners))

    # --- what lasts -------------------------------------------------------------------------------

    def _follows(self, lasting: Sequence[Phrase]) -> Entailment:
        """The obligation that what lasts holds where the claim begins to be pending."""
        facts = [*self.facts, *self._open(self.before)]
        if self.stated.trigger is not None:
            facts += self._claimed(self.stated.trigger, self.before)
        goals = self._goal("what lasts", *(self._holds(w, self.before) for w in lasting))
        return Entailment(tuple(facts), goals, names=self._names)

    def _lasts(self, lasting: Sequence[Phrase]) -> Entailment:
        """The obligation that it lasts until the goal is reached."""
        facts = [*self._open_round, *self._lasting(self.before)]
        goals = self._goal("what lasts", *(self._holds(w, self.after) for w in lasting))
        return self._follows_from(facts, goals)

    # --- measures and lock classes ----------------------------------------------------------------

    def _settles(self, phrase: Phrase, given: Sequence[Term]) -> Entailment:
        """The obligation that a measure does not grow, and is a natural number."""
        t = self.t
        about = [self._is_one(self.robot, phrase.kind)] if phrase.robot is not None else []
        names = (self.robot,) if phrase.robot is not None else ()
        if phrase.said.type == BOOL:
            (new, legal), (old, known) = (
                self._holds(phrase, state) for state in (self.after, self.before)
            )
            goals = self._goal("it falls only", (t.implies(new, old), t.both(legal, known)))
            return self._of_round([*given, *about], goals, *names)
        assert phrase.said.type == INTEGER
        old, faulty, known = self._number(phrase, self.before)
        new, fails, legal = self._number(phrase, self.after)
        sound = t.both(t.negation(faulty), t.negation(fails))
        natural = t.both(t.at_most(t.integer(0), old), t.at_most(new, old))
        goals = self._goal("it does not grow", (t.both(sound, natural), t.both(known, legal)))
        return self._of_round([*given, *about], goals, *names)

    def _same(self, phrase: Phrase) -> Term:
        """The fact that a measure is the same at both ends of a round, of every robot."""
        t = self.t

        def same(robot: Term | None) -> Term:
            if phrase.said.type == BOOL:
                (old, known), (new, legal) = (
                    self._holds(phrase, state, robot) for state in (self.before, self.after)
                )
            else:
                old, _, known = self._number(phrase, self.before, robot)
                new, _, legal = self._number(phrase, self.after, robot)
            return t.conjunction([known, legal, t.equal(old, new)])

        if phrase.robot is None:
            return same(None)
        with self.v.within() as robot:
            return t.for_all([robot], t.implies(self._is_one(robot, phrase.kind), same(robot)))

    def _granted(self, lock: int, given: Sequence[Term]) -> Entailment:
        """The obligation that the robot that is meant runs no event with a lock class."""
        t, round_ = self.t, self.step.gathering
        runs = [
            t.both(self.crowds.is_one(self.meant, kind), round_.runs(self.meant, position))
            for kind, agent in enumerate(self.program.agents)
            for position, event in enumerate(agent.events)
            if lock in event.lock_classes
        ]
        vain = t.disjunction(runs)
        goals = self._goal("it is not granted in vain", (t.negation(vain), t.truth(True)))
        return self._of_round(given, goals)

    def _unasked(self, state: ParameterisedState, lock: int) -> Term:
        """The fact that the robot that is meant does not ask for a lock class. [FAIR-LOCK]

        Who asks is ready, and no event without the class may be enabled. It is known of fewer that
        they ask than do.
        """
        t = self.t
        only = [self._ready(state, self.meant)]
        for kind, position, event in self._events():
            if lock in event.lock_classes:
                continue
            off = t.truth(False)
            if self._is_certain(event):
                turn = self._moves(state)[kind][position].of(self.meant)
                faulted = t.disjunction(fault.when for fault in turn.guard_faults)
                off = t.both(t.negation(turn.enabled), t.negation(faulted))
            only.append(t.implies(self.crowds.is_one(self.meant, kind), off))
        return t.negation(t.conjunction(only))

    # --- help -------------------------------------------------------------------------------------

    def _helps(self, help_: Help, given: Sequence[Term]) -> Entailment:
        """The obligation that help is not refused for ever in rounds that are still."""
        t, j = self.t, self.robot
        now, legal = self._holds(help_.state, self.before, j)
        facts = [*given, self._is_one(j, help_.state.kind), now, legal]
        goals: list[Goal] = []
        if not help_.unmoved:
            goals += self._goal("it lasts", self._holds(help_.state, self.after, j))
        idle = self.step.gathering.ran_none(j)
        ready = self._goal("it is ready", (self._ready(self.before, j), t.truth(True)))
        match help_.kind:
            case HelpKind.ROBOT:
                goals += [*ready, *self._goal("it runs nothing", (idle, t.truth(True)))]
            case HelpKind.EXPECTED:
                goals += [*self._missed(help_), *self._owed(help_, self.before)]
            case HelpKind.AFTER_RUN:
                owed = self._owed(help_, self.after)
                goals += [*ready, *self._missed(help_)]
                goals += [replace(one, holds=t.either(idle, one.holds)) for one in owed]
            case HelpKind.TIME:
                goals += self._falls(help_)
            case _:
                assert_never(help_.kind)
        return self._of_round(facts, tuple(goals), j)

    def _unmoved(self, help_: Help, given: Sequence[Term]) -> Entailment:
        """The obligation that what help reads is the same at both ends of rounds that are still.

        It is asked of each robot by itself, whoever helps.
        """
        goals: list[Goal] = []
        for part in parts_read(self.program, help_.state.said):
            goals += self._goal("it is as it was", self._is_as_it_was(part))
        return self._of_round([*given, self.v.is_robot(self.robot)], tuple(goals), self.robot)

    def _is_as_it_was(self, part: Phrase) -> tuple[Term, Term]:
        """The condition that a variable has one value at both ends, and the legality of answers."""
        t = self.t
        (old, faulty, known), (new, fails, legal) = (
            self._number(part, state) for state in (self.before, self.after)
        )
        told = t.both(t.negation(faulty), t.negation(fails))
        return t.both(told, t.equal(old, new)), t.both(known, legal)

    def _missed(self, help_: Help) -> tuple[Goal, ...]:
        """The goal that what is expected is not so behind the round."""
        expected = self._expectation(help_)
        kept, known = self._expected(expected, expected.condition, self.after)
        return self._goal("what is expected is not so", (self.t.negation(kept), known))

    def _owed(self, help_: Help, state: ParameterisedState) -> tuple[Goal, ...]:
        """The goal that what is expected is owed in a configuration."""
        expected = self._expectation(help_)
        assert expected.trigger is not None
        owed = self._expected(expected, expected.trigger, state)
        return self._goal("what is expected is owed", owed)

    def _falls(self, help_: Help) -> tuple[Goal, ...]:
        """The goal that a number is not negative, and falls by a part of a round's length."""
        t, phrase = self.t, help_.falls
        assert phrase is not None
        old, faulty, known = self._number(phrase, self.before)
        new, fails, legal = self._number(phrase, self.after)
        assert old.sort == REAL
        least = t.real(self.step.world.delta_s / _PARTS_OF_DELTA)
        enough = t.conjunction(
            [
                t.negation(faulty),
                t.negation(fails),
                t.at_most(t.real(Fraction(0)), old),
                t.at_most(new, t.minus(old, least)),
            ]
        )
        return self._goal("time passes", (enough, t.both(known, legal)))

    def _expectation(self, help_: Help) -> core.Property:
        assert help_.expected is not None
        return help_.expected

    def _expected(
        self, expected: core.Property, said: core.Expr, state: ParameterisedState
    ) -> tuple[Term, Term]:
        """A statement of an assumption about whole runs, of the robot that helps."""
        assert expected.each is not None
        phrase = Phrase(said, expected.bound, expected.each.variable.slot, None)
        return self._holds(phrase, state)

    def _somebody(self) -> Entailment:
        """The obligation that somebody helps as long as the claim is pending."""
        t, state = self.t, self.before
        facts = [*self.facts, *self._open(state), *self._lasting(state)]
        locks = [part.index for part in self.argument.order if isinstance(part, LockClass)]
        facts += [self._unasked(state, lock) for lock in locks]
        names = [*self._names, *self._shared_numbers()]
        for one in self.argument.first:
            first, known = self._first(one, state)
            names.append(first)
            facts += known
        nobody = []
        for help_ in self.argument.help:
            with self.v.within() as robot:
                holds, legal = self._holds(help_.state, state, robot)
                is_one = self._is_one(robot, help_.state.kind)
                facts.append(t.for_all([robot], t.implies(is_one, legal)))
                nobody.append(t.for_all([robot], t.negation(t.both(is_one, holds))))
        goals = self._goal("somebody helps", (t.negation(t.conjunction(nobody)), t.truth(True)))
        return Entailment(tuple(facts), goals, names=tuple(names))

    def _first(self, one: First, state: ParameterisedState) -> tuple[Term, list[Term]]:
        """The first of some robots, with the facts that it is, if there are any of them.

        Robots are finitely many, no two have one number, and what is compared is a function of
        robots: it stands in variables alone.
        """
        t, there = self.t, self.v.symbol("there are some", BOOLEAN)
        first = self.v.symbol("the first of them", INT)

        def is_one(robot: Term) -> Term:
            holds, _ = self._holds(one.state, state, robot)
            return t.both(self._is_one(robot, one.state.kind), holds)

        with self.v.within() as robot:
            (lowest, _, _), (its, _, _) = (
                self._number(one.number, state, each) for each in (first, robot)
            )
            tie = t.both(t.equal(lowest, its), t.at_most(first, robot))
            later = t.either(t.less(lowest, its), tie)
            others = t.for_all([robot], t.implies(is_one(robot), t.both(there, later)))
        return first, [t.implies(there, is_one(first)), others]

    def _shared_numbers(self) -> Iterator[Term]:
        """Yield the shared integers: of the robots one may have each number."""
        store = self.before.store.allwrite
        for d, storage in zip(self.program.allwrite, store, strict=True):
            if d.variable.type == INTEGER and isinstance(storage, Cell):
                value: Value = storage.value
                assert isinstance(value, Term)
                yield value

    # --- events -----------------------------------------------------------------------------------

    def _events(self) -> Iterator[tuple[int, int, core.Event]]:
        for kind, agent in enumerate(self.program.agents):
            for position, event in enumerate(agent.events):
                yield kind, position, event

    def _is_certain(self, event: core.Event) -> bool:
        """Return whether a guard asks for no answer, so that who may run an event can run it."""
        asks = (core.Choose, core.ExternalCall)
        return not any(isinstance(node, asks) for node in reached(self.program, event.guard))

    def _moves(self, state: ParameterisedState) -> Moves:
        return self.step.moves if state is self.before else self._moves_after

    @cached_property
    def _moves_after(self) -> Moves:
        return [
            [self.crowds.turn(self.after, kind, position) for position in range(len(agent.events))]
            for kind, agent in enumerate(self.program.agents)
        ]

    def _ready(self, state: ParameterisedState, robot: Term) -> Term:
        """The condition that a robot can run an event, whatever the answers. [FAIR-ROBOT]"""
        t, ways = self.t, []
        for kind, position, event in self._events():
            if self._is_certain(event):
                turn = self._moves(state)[kind][position].of(robot)
                faulted = t.disjunction(fault.when for fault in turn.guard_faults)
                awake = t.negation(state.robot(kind, robot).stopped)
                can = [turn.enabled, t.negation(faulted), awake]
                ways.append(t.conjunction([self.crowds.is_one(robot, kind), *can]))
        return t.disjunction(ways)
