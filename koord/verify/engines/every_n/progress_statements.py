"""What a claim, measures and help say of configurations, as terms. [T-PROGRESS]"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.configurations import Configuration, Robot
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
from koord.syntax.system import Status
from koord.syntax.types import BOOL, INT
from koord.syntax.walk import chained, nodes
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem
from koord.verify.engines.every_n.functions import FunctionTerms, RobotInputs
from koord.verify.engines.every_n.progress_parts import ROBOT, Help, Phrase, is_certain

#: A robot of a kind, with a number, in some configuration.
RobotState: TypeAlias = "Callable[[int, Term], Robot[Term]]"


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
        bound = max(self.stated.bound, ROBOT.slot + 1)
        return Phrase(said, bound, None, None if each is None else each.variable.slot)

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

    def pending(
        self, configuration: Configuration[Term], lasting: Sequence[core.Expr]
    ) -> list[Term]:
        """The facts of a configuration in which the claim is pending."""
        facts = []
        if self.stated.each is not None:
            facts.append(self.is_one(self.meant, core.RobotRange(self.stated.each.agent)))
        facts.append(self.negated(self.truth(self.of_claim(self.stated.condition), configuration)))
        facts += [self.truth(self.of_claim(said), configuration) for said in lasting]
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
        # A conjunction holds where each of its parts does. [PROP-FAULT]
        conjuncts = chained(help_.state.said, BinaryOp.AND)
        parts = [replace(help_.state, said=part) for part in conjuncts]
        # What is not of the robot is worked out once, and not of each.
        common = [part for part in parts if not _mentions(part)]
        always = conjunction(d, [self.truth(part, configuration) for part in common])

        def says(names: tuple[Term, ...]) -> Term:
            own = [self.truth(p, configuration, names[0]) for p in parts if p not in common]
            helps = conjunction(d, [self.is_one(names[0], help_.each), always, *own])
            return book.implied(denied, self.negated(helps))

        book.state(1, says)
        return denied


def _mentions(phrase: Phrase) -> bool:
    """Return whether a phrase is about a robot."""
    return any(
        isinstance(node, core.Variable) and node.home is Home.BOUND and node.slot == phrase.robot
        for node in nodes(phrase.said)
    )
