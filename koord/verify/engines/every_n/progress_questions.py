"""Questions of proofs of progress: about one round, and about one configuration. [T-PROGRESS]"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import NO_EVENT, Configuration, Robot
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.expressions import evaluate, statement
from koord.semantics.machine import Machine
from koord.semantics.oracle import Phase
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.semantics.turns import guard_of
from koord.semantics.values import scalar
from koord.syntax import core
from koord.syntax.core import BinaryOp, Home, UnaryOp
from koord.syntax.system import Status, System
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import nodes
from koord.verify.claims import Claim
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem, Universal
from koord.verify.engines.every_n.functions import FunctionTerms, RobotInputs
from koord.verify.engines.every_n.initial_states import ArbitraryState, ParameterisedInit
from koord.verify.engines.every_n.progress_parts import (
    Help,
    HelpKind,
    Measure,
    Phrase,
    is_certain,
)
from koord.verify.engines.every_n.questions import Asking, Means, Step

#: A robot of a kind, with a number, in some configuration.
RobotState: TypeAlias = "Callable[[int, Term], Robot[Term]]"


class Premise(Struct, frozen=True):
    """A premise of a proof of progress, by its name and part."""

    name: str
    part: Measure | Help | None = None


class Statements(Struct):
    """The statements of a claim, of measures and of help, as terms of configurations."""

    world: ParameterisedSystem
    stated: core.Property
    meant: Term  #: the robot that the claim means
    robot: Term  #: any robot

    @property
    def d(self) -> FunctionTerms:
        return self.world.d

    def of_claim(self, said: core.Expr) -> Phrase:
        """A statement of the claim, of the robot that it means."""
        each = self.stated.each
        return Phrase(said, self.stated.bound, None, None if each is None else each.variable.slot)

    @staticmethod
    def of_each(stated: core.Property, said: core.Expr) -> Phrase:
        """A statement of an assumption, of a robot."""
        each = stated.each
        return Phrase(said, stated.bound, None if each is None else each.variable.slot, None)

    def truth(
        self, phrase: Phrase, configuration: Configuration[Term], robot: Term | None = None
    ) -> Term:
        """The condition that a statement holds. [PROP-FAULT]"""
        m = self._machine(phrase, configuration, robot)
        truth = statement(m, phrase.said)
        for needed in m.legality:
            self.world.book.note(needed.condition)
        return truth

    def number(
        self, phrase: Phrase, configuration: Configuration[Term], robot: Term | None = None
    ) -> tuple[Term, Term]:
        """A number, and the condition that it cannot be worked out."""
        m = self._machine(phrase, configuration, robot)
        value = scalar(evaluate(m, phrase.said))
        return value, disjunction(self.d, [fault for fault, _ in m.faults])

    def _machine(
        self, phrase: Phrase, configuration: Configuration[Term], robot: Term | None
    ) -> Machine[Term]:
        world = self.world
        oracle = RobotInputs(world.unknowns, "check", None).oracle(Phase.CHECK, 0)
        m = machine(world.d, world.system, oracle, bound=phrase.bound, view=configuration)
        if phrase.robot is not None:
            m.memory.bound[phrase.robot] = held(world.d, self.robot if robot is None else robot)
        if phrase.meant is not None:
            m.memory.bound[phrase.meant] = held(world.d, self.meant)
        return m

    def is_one(self, robot: Term, each: core.RobotRange) -> Term:
        """The condition that a number is that of a robot of a kind."""
        parts = [self.world.book.between(0, robot, self.world.crowd.count)]
        if each.agent is not None:
            parts.append(self.world.crowd.is_of(robot, each.agent))
        return conjunction(self.d, parts)

    def negated(self, term: Term) -> Term:
        return self.d.unary(UnaryOp.NOT, term)

    def value(
        self, phrase: Phrase, configuration: Configuration[Term], robot: Term | None = None
    ) -> Term:
        if phrase.said.type == BOOL:
            return self.truth(phrase, configuration, robot)
        return self.number(phrase, configuration, robot)[0]

    def pending(self, configuration: Configuration[Term], *, waits: bool) -> list[Term]:
        """The facts of a configuration in which the claim is pending."""
        facts = []
        if self.stated.each is not None:
            facts.append(self.is_one(self.meant, core.RobotRange(self.stated.each.agent)))
        facts.append(self.negated(self.truth(self.of_claim(self.stated.condition), configuration)))
        if waits:
            assert self.stated.trigger is not None
            facts.append(self.truth(self.of_claim(self.stated.trigger), configuration))
        return facts

    def helps(self, help_: Help, robot: Term, configuration: Configuration[Term]) -> Term:
        state = self.truth(help_.state, configuration, robot)
        return self.d.binary(BinaryOp.AND, self.is_one(robot, help_.each), state)

    def ready(self, robot: Term, state: RobotState) -> Term:
        """The condition that a robot can run an event, whatever the answers. [FAIR-ROBOT]"""
        d = self.d
        ways = []
        for kind, here in self.world.cases(robot):
            for event in self.world.program.agents[kind].events:
                if is_certain(self.world.program, event.guard):
                    holds, sound = self._guard(robot, state(kind, robot), event)
                    ways.append(
                        conjunction(d, [here, self._awake(state(kind, robot)), holds, sound])
                    )
        return disjunction(d, ways)

    def unasked(self, robot: Term, state: RobotState, locks: Sequence[int]) -> list[Term]:
        """The facts that a robot does not ask for lock classes. [FAIR-LOCK]

        One asks if it is ready, and no event without the class may be enabled.
        """
        return [self.negated(self._asks(robot, state, lock)) for lock in locks]

    def _asks(self, robot: Term, state: RobotState, lock: int) -> Term:
        d = self.d
        ways = [self.ready(robot, state)]
        for kind, here in self.world.cases(robot):
            for event in self.world.program.agents[kind].events:
                if lock in event.lock_classes:
                    continue
                off: Term = False
                if is_certain(self.world.program, event.guard):
                    holds, sound = self._guard(robot, state(kind, robot), event)
                    off = conjunction(d, [self.negated(holds), sound])
                ways.append(d.binary(BinaryOp.IMPLIES, here, off))
        return conjunction(d, ways)

    def _guard(self, robot: Term, state: Robot[Term], event: core.Event) -> tuple[Term, Term]:
        """The conditions that a guard holds without a fault, and that it has none."""
        inputs = RobotInputs(self.world.unknowns, "round", robot)
        seat = self.world.seat(state.kind, robot)
        holds, sound = guard_of(self.d, seat, 0, state, event, inputs)
        return holds, sound

    def _awake(self, state: Robot[Term]) -> Term:
        stopped = self.d.const(int(Status.STOPPED), INT)
        return self.d.binary(BinaryOp.NE, state.status, stopped)

    def denied(self, help_: Help, configuration: Configuration[Term]) -> Term:
        """A literal under which nobody helps in this way in a configuration."""
        d, book = self.d, self.world.book
        denied = d.fresh("nobody", BOOL)
        parts = [replace(help_.state, said=part) for part in _conjuncts(help_.state.said)]
        # What is not of the robot is worked out once, and not of each.
        common = [part for part in parts if not _mentions(part)]
        always = conjunction(d, [self.truth(part, configuration) for part in common])

        def says(names: tuple[Term, ...]) -> Term:
            own = [self.truth(p, configuration, names[0]) for p in parts if p not in common]
            helps = conjunction(d, [self.is_one(names[0], help_.each), always, *own])
            return book.implied(denied, self.negated(helps))

        book.state(1, says)
        return denied


class StateQuestion:
    """The premise about one configuration: as long as the claim is pending, somebody helps."""

    def __init__(
        self, system: System, stated: core.Property, known: Sequence[Claim], means: Means
    ) -> None:
        world = self.world = ParameterisedSystem.of(system)
        opening = ParameterisedInit(world)
        self._state = ArbitraryState(world, opening)
        self.configuration = self._state.configuration
        self.asking = Asking(world, means)
        self.statements = Statements(world, stated, *self.asking.robots[:2])
        world.book.expect(*self.asking.robots[:2])
        world.book.expect(0, world.last, generation=1)
        world.book.note(opening.calm)
        for claim in known:
            assert claim.stated is not None
            universal = Universal.of(claim.stated.condition, claim.stated.bound)
            universal.suppose(world, self.configuration, True)

    def somebody(self, ways: Sequence[Help], *, waits: bool, locks: Sequence[int]) -> bool:
        """Return whether somebody helps in one of some ways."""
        said = self.statements
        pending = said.pending(self.configuration, waits=waits)
        pending += said.unasked(said.meant, self._state.robot, locks)
        nobody = [said.denied(each, self.configuration) for each in ways]
        asked = [(Premise("somebody helps"), [*pending, *nobody])]
        return not self.asking.failing(asked) and not self.asking.limits


class RoundQuestions:
    """The premises about one round: measures settle, and help is not refused for ever."""

    def __init__(
        self, system: System, stated: core.Property, known: Sequence[Claim], means: Means
    ) -> None:
        self.stated = stated
        self.program = system.program
        self.step = step = Step(system, means)
        self.world, self.d = step.world, step.world.d
        self.before: Configuration[Term] = step.start.configuration
        self.after: Configuration[Term] = step.round.end
        self.said = Statements(self.world, stated, *step.asking.robots[:2])
        self.robot = self.said.robot
        self._winners = list(step.round.commits.winners.values())
        self._known = [step.suppose(claim) for claim in known]
        self._expected = self.program.expectations
        self._given: list[Term] = []

    def waits(self) -> bool:
        """Return whether the trigger holds until the goal does."""
        if self.stated.trigger is None:
            return False
        trigger = self.said.of_claim(self.stated.trigger)
        lost = [
            self.said.truth(trigger, self.before),
            self.said.negated(self.said.truth(trigger, self.after)),
        ]
        asked = [(Premise("the trigger persists"), lost)]
        return not self.step.asking.sift(asked, self._pending(waits=False))

    def pend(self, *, waits: bool, locks: Sequence[int] = ()) -> None:
        """Suppose from now on that the claim is pending before and after the round.

        The robot that is meant asks for none of some lock classes, before and after it.
        """
        self._given = self._pending(waits=waits)
        if locks:
            for state in (self.step.start.robot, self.step.round.robot):
                self._given += self.said.unasked(self.said.meant, state, locks)

    def runs_in_vain(self, lock: int) -> bool:
        """Return whether the robot that is meant may enter a lock class, and stay pending."""
        d, event = self.d, self._event(self.said.meant)
        entering = [
            conjunction(d, [here, d.binary(BinaryOp.EQ, event, position)])
            for kind, here in self.world.cases(self.said.meant)
            for position, each in enumerate(self.program.agents[kind].events)
            if lock in each.lock_classes
        ]
        asked = [(Premise("asks in vain"), [disjunction(d, entering)])]
        return bool(self.step.asking.sift(asked, self._given))

    def keep(self, measure: Measure) -> None:
        """Suppose from now on that a measure stays the same in the round."""
        self._given.append(self._same(measure))

    def settling(self, measures: Sequence[Measure]) -> list[Measure]:
        """The measures of natural numbers and Booleans that do not grow in the round."""
        asked = [(Premise("settles", m), [self._grows(m)]) for m in measures]
        met = {premise.part for premise in self.step.asking.sift(asked, self._given)}
        return [measure for measure in measures if measure not in met]

    def changing(self, measures: Sequence[Measure]) -> list[Measure]:
        """The measures that may change in the round."""
        asked = [(Premise("changes", m), [self._changes(m)]) for m in measures]
        met = {premise.part for premise in self.step.asking.sift(asked, self._given)}
        return [measure for measure in measures if measure in met]

    def _event(self, robot: Term) -> Term:
        """The event that a robot runs in the round, with what is known of its turn."""
        self.step.round.moves(robot)
        return self.step.round.event(robot)

    def helping(self, ways: Sequence[Help]) -> list[Help]:
        """The ways to help that cannot be refused for ever while no measure changes."""
        asked = [(Premise("helps", each), [self._refused(each)]) for each in ways]
        met = {premise.part for premise in self.step.asking.sift(asked, self._given)}
        return [each for each in ways if each not in met]

    def _pending(self, *, waits: bool) -> list[Term]:
        """The facts of a round before and after which the claim is pending."""
        round_ = self.step.round
        return [
            *self._known,
            round_.calm,
            round_.legal,
            round_.gentle,
            *self.said.pending(self.before, waits=waits),
            *self.said.pending(self.after, waits=waits),
        ]

    # --- measures -------------------------------------------------------------------------------

    def _grows(self, measure: Measure) -> Term:
        """The condition that a measure grows, or is no natural number."""
        d = self.d

        def grows(robot: Term) -> Term:
            here = self._is_of(measure, robot)
            if measure.term.said.type == BOOL:
                old, new = (
                    self.said.truth(measure.term, c, robot) for c in (self.before, self.after)
                )
                return conjunction(d, [here, new, self.said.negated(old)])
            pair = [self.said.number(measure.term, c, robot) for c in (self.before, self.after)]
            (old, faulty), (new, fails) = pair
            larger, negative = d.binary(BinaryOp.LT, old, new), d.binary(BinaryOp.LT, old, 0)
            return conjunction(d, [here, disjunction(d, [larger, negative, faulty, fails])])

        return self._of_some(grows, of_robots=measure.each is not None)

    def _changes(self, measure: Measure) -> Term:
        """The condition that a measure changes."""
        d = self.d

        def changes(robot: Term) -> Term:
            old, new = (self.said.value(measure.term, c, robot) for c in (self.before, self.after))
            return conjunction(d, [self._is_of(measure, robot), d.binary(BinaryOp.NE, old, new)])

        return self._of_some(changes, of_robots=measure.each is not None)

    def _is_of(self, measure: Measure, robot: Term) -> Term:
        return True if measure.each is None else self.said.is_one(robot, measure.each)

    def _of_some(self, says: Callable[[Term], Term], *, of_robots: bool = True) -> Term:
        """The condition that something is so of some robot.

        It may be one of those that enter lock classes: asked under these names it takes no
        instances to see that what they do is what the robot does.
        """
        if not of_robots:
            return says(self.robot)
        d = self.d
        others = [d.binary(BinaryOp.NE, self.robot, winner) for winner in self._winners]
        return disjunction(
            d, [conjunction(d, [*others, says(self.robot)]), *(says(w) for w in self._winners)]
        )

    def _same(self, measure: Measure) -> Term:
        """A literal under which a measure is the same after the round, of every robot."""
        d, book = self.d, self.world.book
        same = d.fresh("still", BOOL)

        def equal(names: tuple[Term, ...]) -> Term:
            robot = names[0] if names else None
            old, new = (self.said.value(measure.term, c, robot) for c in (self.before, self.after))
            fact = d.binary(BinaryOp.EQ, old, new)
            if measure.each is not None and robot is not None:
                fact = book.implied(self.said.is_one(robot, measure.each), fact)
            return book.implied(same, fact)

        if measure.each is None:
            book.note(equal(()))
        else:
            book.state(1, equal)
        return same

    # --- help -----------------------------------------------------------------------------------

    def _refused(self, help_: Help) -> Term:
        """The condition that a robot helps before a round that changes no measure, in vain."""
        return self._of_some(partial(self._refuses, help_))

    def _refuses(self, help_: Help, robot: Term) -> Term:
        d = self.d
        ways = [self.said.negated(self.said.helps(help_, robot, self.after))]
        if help_.kind is HelpKind.EXPECTED:
            ways.append(self.said.negated(self._promises(help_, robot, self.before)))
        else:
            runs = d.binary(BinaryOp.NE, self._event(robot), NO_EVENT)
            if help_.kind is HelpKind.AFTER_RUN:
                promised = self._promises(help_, robot, self.after)
                runs = d.binary(BinaryOp.AND, runs, self.said.negated(promised))
            ways += [runs, self.said.negated(self.said.ready(robot, self.step.start.robot))]
        if help_.expectation is not None:
            ways.append(self._kept(help_, robot, self.after))
        return d.binary(
            BinaryOp.AND, self.said.helps(help_, robot, self.before), disjunction(d, ways)
        )

    def _promises(self, help_: Help, robot: Term, configuration: Configuration[Term]) -> Term:
        """The condition that an assumption promises something of the robot from now on."""
        expected = self._expectation(help_)
        assert expected.trigger is not None
        return self.said.truth(self.said.of_each(expected, expected.trigger), configuration, robot)

    def _kept(self, help_: Help, robot: Term, configuration: Configuration[Term]) -> Term:
        """The condition that what an assumption promises of the robot is so."""
        expected = self._expectation(help_)
        return self.said.truth(
            self.said.of_each(expected, expected.condition), configuration, robot
        )

    def _expectation(self, help_: Help) -> core.Property:
        assert help_.expectation is not None
        return self._expected[help_.expectation]


def _conjuncts(said: core.Expr) -> Iterator[core.Expr]:
    """The parts of a conjunction: it holds where each of them does. [PROP-FAULT]"""
    if isinstance(said, core.Binary) and said.op is BinaryOp.AND:
        yield from _conjuncts(said.left)
        yield from _conjuncts(said.right)
    else:
        yield said


def _mentions(phrase: Phrase) -> bool:
    """Return whether a phrase is about a robot."""
    return any(
        isinstance(node, core.Variable) and node.home is Home.BOUND and node.slot == phrase.robot
        for node in nodes(phrase.said)
    )
