"""Closed statements about a crowd: as facts about robots, and as goals to refute."""

from __future__ import annotations

from msgspec import Struct

from koord.semantics.configurations import Configuration
from koord.semantics.domain import conjunction
from koord.semantics.expressions import statement
from koord.semantics.oracle import Phase
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.syntax import core
from koord.syntax.core import QuantifierKind, UnaryOp
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem
from koord.verify.engines.every_n.functions import RobotInputs


class Universal(Struct, frozen=True):
    """``forall x1, …, xk: body`` over robots: the slots and kinds of the x, and the body.

    A statement that holds of some robots and faults of none of them holds; so the quantifiers may
    be taken off one by one. [PROP-FAULT]
    """

    robots: tuple[tuple[int, int | None], ...]
    body: core.Expr
    bound: int

    @staticmethod
    def of(condition: core.Expr, bound: int) -> Universal:
        robots: list[tuple[int, int | None]] = []
        body = condition
        while (
            isinstance(body, core.Quantified)
            and body.quantifier is QuantifierKind.FORALL
            and isinstance(body.domain, core.RobotRange)
        ):
            robots.append((body.variable.slot, body.domain.agent))
            body = body.body
        return Universal(tuple(robots), body, bound)

    @property
    def arity(self) -> int:
        return len(self.robots)

    def of_robots(self, world: ParameterisedSystem, names: tuple[Term, ...]) -> Term:
        """The condition that the names are robots of the quantified kinds."""
        parts = []
        for name, (_, agent) in zip(names, self.robots, strict=True):
            parts.append(world.book.between(0, name, world.crowd.count))
            if agent is not None:
                parts.append(world.crowd.is_of(name, agent))
        return conjunction(world.d, parts)

    def holds(
        self,
        world: ParameterisedSystem,
        configuration: Configuration[Term],
        names: tuple[Term, ...],
    ) -> Term:
        """The condition that the body holds of some robots in a configuration. [PROP-INVARIANT]"""
        oracle = RobotInputs(world.unknowns, "check", None).oracle(Phase.CHECK, 0)
        m = machine(world.d, world.everywhere, oracle, bound=self.bound, view=configuration)
        for name, (slot, _) in zip(names, self.robots, strict=True):
            m.memory.bound[slot] = held(world.d, name)
        truth = statement(m, self.body)
        for needed in m.legality:
            # Of functions, which are the same everywhere: nothing else may be open in a statement.
            world.book.note(needed.condition)
        return truth

    def suppose(
        self, world: ParameterisedSystem, configuration: Configuration[Term], when: Term
    ) -> None:
        """Assume the statement of a configuration from now on, where ``when`` holds."""

        def says(names: tuple[Term, ...]) -> Term:
            applies = conjunction(world.d, [when, self.of_robots(world, names)])
            return world.book.implied(applies, self.holds(world, configuration, names))

        world.book.state(self.arity, says)

    def broken(
        self,
        world: ParameterisedSystem,
        configuration: Configuration[Term],
        names: tuple[Term, ...],
    ) -> Term:
        """The condition that some robots break the statement."""
        fails = world.d.unary(UnaryOp.NOT, self.holds(world, configuration, names))
        return conjunction(world.d, [self.of_robots(world, names), fails])
