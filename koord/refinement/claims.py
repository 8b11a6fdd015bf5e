"""Claims of the rules on the answers of external functions: what has to hold for a legal run.

Each can be asked over any domain: over doubles of answers that are known, and of answers that are
open whether it can hold at all. None has an influence on how the run goes on. The states that they
are about are of constants, which every domain has.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias, TypeVar

from msgspec import Struct

from koord.sampling.conjuncts import Conjunct
from koord.sampling.constraint_guesses import AnswerGuess, guesses
from koord.semantics.configurations import Configuration, Store
from koord.semantics.domain import DOUBLES, Constant, Domain, conjunction
from koord.semantics.environment import Ports, contract_holds
from koord.semantics.expressions import statement
from koord.semantics.machine import Machine
from koord.semantics.oracle import Inputs, Phase
from koord.semantics.properties import holds_in
from koord.semantics.rounds import may_skip
from koord.semantics.statements import machine
from koord.semantics.storage import held
from koord.semantics.turns import initial_turn, program_turn
from koord.syntax import core
from koord.syntax.system import System
from koord.syntax.types import BOOL, INT

V = TypeVar("V")


class InitialTurn(Struct, frozen=True, eq=False):
    """That summaries allow the answers of a robot's initial turn. [INIT]"""

    robot: int
    store: Store[Any]

    def holds(self, d: Domain[V], system: System, inputs: Inputs[V]) -> V:
        turned = initial_turn(d, system, self.robot, self.store, inputs)
        legal: V = conjunction(d, [needed.condition for needed in turned.legality])
        return legal


class Assumed(Struct, frozen=True, eq=False):
    """That an assumption holds after INIT. [PROP-ASSUME]"""

    assumption: core.Assumption
    configuration: Configuration[Any]

    def holds(self, d: Domain[V], system: System, inputs: Inputs[V]) -> V:
        at = self.configuration
        e, bound = self.assumption.condition, self.assumption.bound
        holds, legality = holds_in(d, system, at, e, bound, inputs)
        legal: V = conjunction(d, [holds, *(needed.condition for needed in legality)])
        return legal


class AssumedPart(Struct, frozen=True, eq=False):
    """That a conjunct of an assumption does."""

    part: Conjunct
    bound: int
    configuration: Configuration[Any]

    def holds(self, d: Domain[V], system: System, inputs: Inputs[V]) -> V:
        m = self.machine(d, system, inputs)
        holds = statement(m, self.part.condition)
        return conjunction(d, [holds, *(needed.condition for needed in m.legality)])

    def machine(self, d: Domain[V], system: System, inputs: Inputs[V]) -> Machine[V]:
        """A machine that can look at the conjunct."""
        at = self.configuration
        m = machine(d, system, inputs.oracle(Phase.CHECK, 0), bound=self.bound, view=at)
        m.trail.extend(self.part.trail)
        for slot, robot in self.part.robots.items():
            m.memory.bound[slot] = held(d, d.const(robot, INT))
        return m


class ProgramTurn(Struct, frozen=True, eq=False):
    """That summaries allow the answers of a robot's turn; of a skip, that it may. [SKIP]"""

    robot: int
    event: int | None
    configuration: Configuration[Any]

    def holds(self, d: Domain[V], system: System, inputs: Inputs[V]) -> V:
        at = self.configuration
        if self.event is None:
            return d.const(may_skip(d, system, at, self.robot, inputs), BOOL)
        state = at.robots[self.robot]
        selectable, turned = program_turn(d, system, self.robot, state, self.event, inputs)
        legal: V = conjunction(d, [selectable, *(one.condition for one in turned.legality)])
        return legal


class Kept(Struct, frozen=True, eq=False):
    """That a robot's ports keep a contract from one round to the next. [ENV-CONTRACT]"""

    robot: int
    module: core.Module
    contract: core.Contract
    ports: Ports[Any]

    def holds(self, d: Domain[V], system: System, inputs: Inputs[V]) -> V:
        holds: V = contract_holds(d, system, self.robot, self.ports, self.contract, inputs)
        return holds


Claim: TypeAlias = InitialTurn | Assumed | AssumedPart | ProgramTurn | Kept


def guessed(claim: Claim, system: System, inputs: Inputs[Constant]) -> Iterator[AnswerGuess]:
    """Yield answers that may make a broken claim hold."""
    match claim:
        case Kept(robot=robot, contract=contract, ports=ports):
            oracle = inputs.oracle(Phase.ENV, robot)
            before, after, bound = ports.before, ports.after, contract.bound
            m = machine(
                DOUBLES, system, oracle, robot=robot, ports=before, after=after, bound=bound
            )
            parts = contract.ensures if all(statement(m, e) for e in contract.requires) else ()
        case AssumedPart():
            m = claim.machine(DOUBLES, system, inputs)
            parts = (claim.part.condition,)
        case _:
            return
    for e in parts:
        yield from (one for one in guesses(m, e) if isinstance(one, AnswerGuess))
