"""Unrolling: rounds appended one by one on an incremental solver. [T-PREFIX]"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import count

from koord.semantics.properties import holds_in
from koord.syntax.core import BinaryOp, UnaryOp
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimKind, broken
from koord.verify.encoding.cubes import Cube
from koord.verify.encoding.moments import SymbolicConfiguration, SymbolicInit, SymbolicRound
from koord.verify.encoding.rounds import Encoder
from koord.verify.encoding.solver import Solver
from koord.verify.encoding.terms import Term, Terms
from koord.verify.encoding.unknowns import Unknowns


class Unrolling:
    """An unrolled system: INIT and some rounds, as constraints of a solver.

    With ``movers`` it is only the runs in which the other robots skip, and with a ``cube`` only
    those of it.
    """

    def __init__(
        self,
        system: System,
        seed: int = 0,
        movers: frozenset[int] | None = None,
        cube: Cube | None = None,
    ) -> None:
        self.system = system
        self.cube = cube or Cube()
        self.seed = seed
        self.movers = movers
        self.rounds: list[SymbolicRound] = []
        d = Terms(self.system.budget)
        self.unknowns = Unknowns(d, self.system.program, self.system.robots)
        self.encoder = Encoder(self.system, self.unknowns, self.movers)
        self.solver = Solver(d, self.unknowns, self.seed)
        self.opening: SymbolicInit = self.encoder.initial()
        self.solver.add(self.opening.moment.constraints)
        self.solver.add(assumed(self.system, self.encoder.d, self.opening.moment))

    def moments(self) -> Iterator[SymbolicConfiguration]:
        """Yield the configurations to check, in order, without end. Unrolls as it goes."""
        yield self.opening.moment
        self._sound(self.opening.moment)
        start = self.opening.moment.configuration
        for number in count():
            taken = self.encoder.round(start, str(number))
            self.rounds.append(taken)
            self.solver.add(taken.middle.constraints)
            self.solver.add(self.cube.met(self.encoder.d, number, taken.options))
            if taken.inside is not None:
                yield taken.inside
                self._sound(taken.inside)
            self.solver.add(taken.urgency)
            yield taken.middle
            self._sound(taken.middle)
            self.solver.add(taken.end.constraints)
            yield taken.end
            self._sound(taken.end)
            start = taken.end.configuration

    def _sound(self, moment: SymbolicConfiguration) -> None:
        """Require that the configuration has no fault: a faulted one has no successors. [FAULT]"""
        self.solver.add([self.encoder.d.unary(UnaryOp.NOT, moment.findings.fault)])


def assumed(system: System, d: Terms, moment: SymbolicConfiguration) -> list[Term]:
    """The assumptions about the configuration after INIT. [PROP-ASSUME]"""
    needed: list[Term] = []
    for assumption in system.program.assumptions:
        holds, legality = holds_in(
            d, system, moment.configuration, assumption.condition, assumption.bound, moment.checks
        )
        needed += [holds, *(x.condition for x in legality)]
    return needed


def violations(
    system: System, d: Terms, moment: SymbolicConfiguration, claims: Sequence[Claim]
) -> dict[Claim, tuple[Term, list[Term]]]:
    """For each claim that a configuration can break: the condition, and what it requires."""
    found: dict[Claim, tuple[Term, list[Term]]] = {}
    sound = d.unary(UnaryOp.NOT, moment.findings.fault)
    for claim in claims:
        if not claim.looked_at(moment.phase):
            continue
        violated, legality = broken(
            d, system, claim, moment.configuration, moment.findings, moment.checks
        )
        if claim.kind is not ClaimKind.FAULT:
            violated = d.binary(BinaryOp.AND, sound, violated)
        violated = d.binary(BinaryOp.AND, moment.real, violated)
        if d.known(violated) is not False:
            found[claim] = (violated, [x.condition for x in legality])
    return found
