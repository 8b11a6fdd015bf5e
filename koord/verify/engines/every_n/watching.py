"""Booleans that say how conditions are, to be read in a model. [T-EVERY-N]

Each is a function of the robot that a condition is about, and defined by it: so a model of them is
one of the rest, and nothing more follows of the rest than did before.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from msgspec import Struct

from koord.semantics.configurations import Configuration
from koord.semantics.domain import conjunction
from koord.syntax import core
from koord.syntax.core import BinaryOp
from koord.syntax.types import BOOL, INT
from koord.verify.encoding.solver import Model
from koord.verify.encoding.terms import Term
from koord.verify.engines.every_n.all_robots import ParameterisedSystem, Universal
from koord.verify.engines.every_n.bound import I
from koord.verify.engines.every_n.instantiation import Names

if TYPE_CHECKING:
    from koord.verify.engines.every_n.conditions import Asked, Condition

#: Of robots with names of later generations it is not known how conditions are: what these say of
#: all robots would bring up ever more names.
WATCHED = 0


class Watching(Struct, frozen=True):
    """The Booleans of conditions in a configuration of a world; ``size``: so many are indices."""

    world: ParameterisedSystem
    conditions: Sequence[Condition]
    size: int

    def define(self, configuration: Configuration[Term]) -> None:
        """Say of all robots what the Booleans are."""
        for position, x in enumerate(self.conditions):
            for k in range(self._indices(x)):
                self._define(configuration, position, x, k)

    def _define(
        self, configuration: Configuration[Term], position: int, x: Condition, k: int
    ) -> None:
        world, d = self.world, self.world.d
        robots = ((I.slot, None),) if x.of else ()
        asked = Universal(robots, x.at(None, core.Const(k, INT)), x.bound)

        def says(names: Names) -> Term:
            there = asked.of_robots(world, names)
            holds = asked.holds(world, configuration, names)
            atom = self._atom(position, k, names)
            both = conjunction(
                d, [d.binary(BinaryOp.IMPLIES, *pair) for pair in ((atom, holds), (holds, atom))]
            )
            return world.book.implied(there, both)

        world.book.state(asked.arity, says, latest=WATCHED)

    def truths(self, model: Model, robot: Term | None, number: int | None) -> Asked:
        """How conditions are of a robot in a model, or those that are of no robot."""
        names = () if robot is None else (robot,)
        return {
            (position, number, k): model.truth(self._atom(position, k, names))
            for position, x in enumerate(self.conditions)
            if bool(x.of) is bool(names)
            for k in range(self._indices(x))
        }

    def _indices(self, x: Condition) -> int:
        return self.size if x.indexed else 1

    def _atom(self, position: int, k: int, names: Names) -> Term:
        d = self.world.d
        with d.depending_on(names):
            return d.fresh(f"condition {position} of {k}", BOOL)
