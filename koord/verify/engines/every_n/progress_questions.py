"""Questions of proofs of progress: about one round, and about one configuration. [T-PROGRESS]"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

from msgspec import Struct

from koord.semantics.configurations import NO_EVENT, Configuration
from koord.semantics.domain import conjunction, disjunction
from koord.semantics.storage import Cell
from koord.semantics.values import scalar
from koord.syntax import core
from koord.syntax.core import BinaryOp
from koord.syntax.system import System
from koord.syntax.types import BOOL, FLOAT, INT
from koord.verify.claims import Claim
from koord.verify.encoding.solver import SolverAnswer
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem
from koord.verify.engines.every_n.initial_states import ArbitraryState, ParameterisedInit
from koord.verify.engines.every_n.progress_least import Least, least_of, read_by
from koord.verify.engines.every_n.progress_parts import (
    Help,
    HelpKind,
    Measure,
    Phrase,
)
from koord.verify.engines.every_n.progress_statements import Statements
from koord.verify.engines.every_n.questions import Asking, Means, Step, universal
from koord.verify.engines.every_n.watching import Watching

if TYPE_CHECKING:
    from koord.verify.engines.every_n.language import Language
    from koord.verify.engines.every_n.literals import Snapshot

#: What falls as time passes falls in each round by such a part of its length, at least.
_PARTS_OF_DELTA = 16

#: Models that lemmas are looked for against know names of so many generations.
_LOOKED_AHEAD = 2


#: That a measure cannot change is worth so much of a solver's work: one that cannot does no harm.
_LITTLE = 100_000

#: Another question is asked of the same facts as long as no more than such a part of what may be
#: said was said.
_ASKED_AGAIN = 4


class Premise(Struct, frozen=True):
    """A premise of a proof of progress, by its name and part."""

    name: str
    part: Measure | Help | None = None


class StateCore(Struct, frozen=True):
    """What it takes that somebody helps: ways by position, lock classes, invariants, the first."""

    ways: list[int]
    locks: list[int]
    known: list[Claim]
    least: list[Least]


class StateQuestion:
    """The premise about one configuration: as long as the claim is pending, somebody helps.

    What is known is known together, or ``apart``: then it is told what of it the premise takes. So
    is that one of those who wait is the first.
    """

    def __init__(
        self,
        system: System,
        stated: core.Property,
        known: Sequence[Claim],
        means: Means,
        *,
        apart: bool = False,
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
        for number in self._shared_numbers():
            world.book.name(number)
        self._known: dict[Claim, Term] = {}
        for claim in known:
            when = world.d.fresh(f"suppose {claim.name}", BOOL) if apart else True
            self._known[claim] = when
            universal(claim).suppose(world, self.configuration, when)
        self._denied: dict[Help, Term] = {}
        self._least: dict[Least, Term] = {}
        for least in least_of(world.program):
            self._least[least] = world.d.fresh("suppose who is first", BOOL) if apart else True
            self._suppose_least(least, self._least[least])

    def _suppose_least(self, least: Least, when: Term) -> None:
        """Suppose that of the robots in a state one is the first, if there are any.

        There are finitely many, and two robots differ in who they are.
        """
        d, book, said, here = self.world.d, self.world.book, self.statements, self.configuration
        there, one = d.fresh("somebody", BOOL), d.fresh("first", INT)
        book.name(one)

        def is_one(robot: Term) -> Term:
            return conjunction(
                d,
                [said.is_one(robot, core.RobotRange()), said.truth(least.state, here, robot)],
            )

        def not_before(names: tuple[Term, ...]) -> Term:
            (other,) = names
            (lowest, _), (number, _) = (
                said.number(least.number, here, robot) for robot in (one, other)
            )
            same = d.binary(BinaryOp.EQ, lowest, number)
            tie = conjunction(d, [same, d.binary(BinaryOp.LE, one, other)])
            later = disjunction(d, [d.binary(BinaryOp.LT, lowest, number), tie])
            waits = conjunction(d, [when, is_one(other)])
            return book.implied(waits, conjunction(d, [there, later]))

        book.note(book.implied(there, is_one(one)))
        book.state(1, not_before)

    @property
    def is_new(self) -> bool:
        """Whether so little was said that there is room for another question."""
        book = self.world.book
        return _ASKED_AGAIN * book.instances <= book.most

    def _shared_numbers(self) -> Iterator[Term]:
        """Yield the shared integers: of the robots one may have each number."""
        for entry in self.world.program.allwrite:
            if entry.variable.type == INT:
                cell = self.configuration.store.allwrite[entry.variable.slot]
                assert isinstance(cell, Cell)
                yield scalar(cell.value)

    def somebody(
        self, ways: Sequence[Help], lasting: Sequence[core.Expr], locks: Sequence[int]
    ) -> bool:
        """Return whether somebody helps in one of some ways."""
        asked = [(Premise("somebody helps"), self._nobody(ways, lasting, locks))]
        return not self.asking.failing(asked) and not self.asking.limits

    def taken(
        self, ways: Sequence[Help], lasting: Sequence[core.Expr], locks: Sequence[int]
    ) -> StateCore | None:
        """What it takes that somebody helps; None if it is not seen that somebody does."""
        said = self.statements
        denied = [self._nobody_in_this(each) for each in ways]
        unasked = [said.unasked(said.meant, self._state.robot, [lock])[0] for lock in locks]
        pending = said.pending(self.configuration, lasting)
        given = [*self._known.values(), *self._least.values()]
        goal = [*given, *denied, *unasked, *pending]
        core_ = self.asking.fewest(goal, len(given))
        if core_ is None or self.asking.limits:
            return None
        known, beyond = len(given), len(given) + len(ways)
        return StateCore(
            [k for k in range(len(ways)) if known + k in core_],
            [lock for k, lock in enumerate(locks) if beyond + k in core_],
            [claim for k, claim in enumerate(self._known) if k in core_],
            [least for k, least in enumerate(self._least, len(self._known)) if k in core_],
        )

    def where_nobody(
        self,
        language: Language,
        ways: Sequence[Help],
        lasting: Sequence[core.Expr],
        locks: Sequence[int],
    ) -> Snapshot | None:
        """The values of a configuration in which nobody does, as far as a model tells them."""
        asked = [(Premise("somebody helps"), self._nobody(ways, lasting, locks))]
        self.asking.look_ahead(_LOOKED_AHEAD)
        if self.asking.counterexample(asked, [])[0] is not SolverAnswer.SAT:
            return None
        from koord.verify.engines.every_n.lemma_search import Place, configuration_of

        watching = Watching(self.world, (), 1)
        where = Place(self.world, self._state, watching)
        return configuration_of(language, where, self.asking.solver.model(), _LOOKED_AHEAD - 1)

    def _nobody(
        self, ways: Sequence[Help], lasting: Sequence[core.Expr], locks: Sequence[int]
    ) -> list[Term]:
        """The facts of a pending configuration in which nobody helps."""
        said = self.statements
        pending = said.pending(self.configuration, lasting)
        pending += said.unasked(said.meant, self._state.robot, locks)
        return [*pending, *map(self._nobody_in_this, ways)]

    def _nobody_in_this(self, way: Help) -> Term:
        """A literal under which nobody helps in this way."""
        if way not in self._denied:
            self._denied[way] = self.statements.denied(way, self.configuration)
        return self._denied[way]


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
        self._changed: dict[Measure, Term] = {}
        self._in_vain: dict[Help, Term] = {}

    def lasting(self, likely: Sequence[core.Expr]) -> list[core.Expr]:
        """The statements that hold until the goal does, once they hold."""
        phrases = {said: self.said.of_claim(said) for said in likely}
        asked = [
            (
                said,
                [
                    self.said.truth(phrase, self.before),
                    self.said.negated(self.said.truth(phrase, self.after)),
                ],
            )
            for said, phrase in phrases.items()
        ]
        lost = self.step.asking.sift(asked, self._pending(()))
        return [said for said in phrases if said not in lost]

    @property
    def given(self) -> Sequence[Term]:
        """The facts that are supposed by now."""
        return tuple(self._given)

    def open_round(self, lasting: Sequence[core.Expr]) -> list[Term]:
        """The facts of a round without the goal that begins with what lasts."""
        begins = [self.said.truth(self.said.of_claim(said), self.before) for said in lasting]
        return [*self._pending(()), *begins]

    def ends(self, said: core.Expr) -> Term:
        """The condition that a statement of the claim does not hold behind the round."""
        return self.said.negated(self.said.truth(self.said.of_claim(said), self.after))

    def vain(self, lock: int) -> Term:
        """The condition that the robot that is meant enters a lock class."""
        d, event = self.d, self._event(self.said.meant)
        entering = [
            conjunction(d, [here, d.binary(BinaryOp.EQ, event, position)])
            for kind, here in self.world.cases(self.said.meant)
            for position, each in enumerate(self.program.agents[kind].events)
            if lock in each.lock_classes
        ]
        return disjunction(d, entering)

    def pend(self, lasting: Sequence[core.Expr]) -> None:
        """Suppose from now on that the claim is pending before and after the round."""
        self._given = self._pending(lasting)

    def ask_no_more(self, lock: int) -> None:
        """Suppose from now on that the robot that is meant asks for a class at neither end."""
        for state in (self.step.start.robot, self.step.round.robot):
            self._given += self.said.unasked(self.said.meant, state, [lock])

    def runs_in_vain(self, lock: int) -> bool:
        """Return whether the robot that is meant may enter a lock class, and stay pending."""
        asked = [(Premise("asks in vain"), [self.vain(lock)])]
        return bool(self.step.asking.sift(asked, self._given))

    def keep(self, measure: Measure) -> None:
        """Suppose from now on that a measure stays the same in the round."""
        self._given.append(self._same(measure))

    def settling(self, measures: Sequence[Measure]) -> list[Measure]:
        """The measures of natural numbers and Booleans that do not grow in the round."""
        asked = [(Premise("settles", m), [self.grows(m)]) for m in measures]
        met = {premise.part for premise in self.step.asking.sift(asked, self._given, halves=True)}
        return [measure for measure in measures if measure not in met]

    def changing(self, measures: Sequence[Measure]) -> list[Measure]:
        """The measures that may change in the round, for all that is seen with little work."""
        asked = [(Premise("changes", m), [self._changes(m)]) for m in measures]
        sifted = self.step.asking.sift(asked, self._given, _LITTLE)
        met = {premise.part for premise in sifted}
        return [measure for measure in measures if measure in met]

    def _event(self, robot: Term) -> Term:
        """The event that a robot runs in the round, with what is known of its turn."""
        self.step.round.moves(robot)
        return self.step.round.event(robot)

    def helping(self, ways: Sequence[Help]) -> list[Help]:
        """The ways to help that cannot be refused for ever while no measure changes."""
        asked = [(Premise("helps", each), [self.refused(each)]) for each in ways]
        met = {premise.part for premise in self.step.asking.sift(asked, self._given, halves=True)}
        return [each for each in ways if each not in met]

    def helping_unmoved(self, ways: Sequence[Help]) -> list[Help]:
        """As ``helping``, of ways of whose state nothing changes in the round: so it lasts."""
        moving: dict[Help, tuple[Measure, ...]] = {}
        for way in ways:
            reads = read_by(self.program, way) if way.kind is HelpKind.ROBOT else None
            if reads is not None:
                moving[way] = reads
        parts = dict.fromkeys(part for reads in moving.values() for part in reads)
        asked = [(Premise("is as it was", part), [self.differs(part)]) for part in parts]
        met = {premise.part for premise in self.step.asking.sift(asked, self._given)}
        still = [way for way, reads in moving.items() if not met.intersection(reads)]
        vain = [(Premise("helps", way), [self.refused_unmoved(way)]) for way in still]
        refused = {premise.part for premise in self.step.asking.sift(vain, self._given)}
        return [way for way in still if way not in refused]

    def refused_unmoved(self, way: Help) -> Term:
        """The condition that a robot helps in vain, if it is known that it still does."""
        return self._of_some(partial(self._refuses, way, lasts=True))

    def differs(self, part: Measure) -> Term:
        """The condition that what a robot has is another after the round, or cannot be told."""
        d = self.d

        def differs(robot: Term) -> Term:
            (old, faulty), (new, fails) = (
                self.said.number(part.term, c, robot) for c in (self.before, self.after)
            )
            other = disjunction(d, [d.binary(BinaryOp.NE, old, new), faulty, fails])
            return conjunction(d, [self._is_of(part, robot), other])

        return self._of_some(differs, of_robots=part.each is not None)

    def against(self, language: Language, ways: Sequence[Help]) -> Snapshot | None:
        """The values before a round in which help is refused, in a model."""
        asked = [(Premise("helps", each), [self.refused(each)]) for each in ways]
        asking = self.step.asking
        if not asked or asking.counterexample(asked, self._given)[0] is not SolverAnswer.SAT:
            return None
        from koord.verify.engines.every_n.lemma_search import configuration_of

        return configuration_of(language, self.step, asking.solver.model(), _LOOKED_AHEAD - 1)

    def _pending(self, lasting: Sequence[core.Expr]) -> list[Term]:
        """The facts of a round before and after which the claim is pending."""
        round_ = self.step.round
        return [
            *self._known,
            round_.calm,
            round_.legal,
            round_.gentle,
            *self.said.pending(self.before, lasting),
            *self.said.pending(self.after, lasting),
        ]

    # --- measures -------------------------------------------------------------------------------

    def grows(self, measure: Measure) -> Term:
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
        """The condition that a measure changes, which is asked for again and again."""
        if measure not in self._changed:
            self._changed[measure] = self._change(measure)
        return self._changed[measure]

    def _change(self, measure: Measure) -> Term:
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

    def refused(self, help_: Help) -> Term:
        """The condition that a robot helps before a round that changes no measure, in vain."""
        if help_ not in self._in_vain:
            self._in_vain[help_] = self._of_some(partial(self._refuses, help_))
        return self._in_vain[help_]

    def _refuses(self, help_: Help, robot: Term, *, lasts: bool = False) -> Term:
        """The condition that a robot helps in vain. ``lasts``: that it still does is known."""
        d = self.d
        ways = [] if lasts else [self.said.negated(self.said.helps(help_, robot, self.after))]
        if help_.falls is not None:
            ways.append(self._stays(help_.falls, robot))
        elif help_.kind is HelpKind.EXPECTED:
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

    def _stays(self, falls: Phrase, robot: Term) -> Term:
        """The condition that a number is negative, or does not fall by as much as in any round."""
        d = self.d
        pair = [self.said.number(falls, c, robot) for c in (self.before, self.after)]
        (old, faulty), (new, fails) = pair
        least = d.const(self.world.system.delta_s / _PARTS_OF_DELTA, FLOAT)
        enough = d.binary(BinaryOp.LE, new, d.binary(BinaryOp.SUB, old, least))
        negative = d.binary(BinaryOp.LT, old, d.const(Fraction(0), FLOAT))
        return disjunction(d, [self.said.negated(enough), negative, faulty, fails])

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
