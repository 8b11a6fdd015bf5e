"""Claims of which machine code is sure, held against the reference semantics.

It has to be sure of those only that hold by the rules. What it is not sure of is nobody's concern:
compiled claims look at it.
"""

from __future__ import annotations

from fractions import Fraction

from koord.runtime.columns.engine import ColumnEngine
from koord.runtime.compile.machine.lazy import LazyTurns
from koord.runtime.compile.watching import WatchedKind, watched
from koord.runtime.engine import RoundEngine
from koord.sampling.sampled_inputs import SampledInputs
from koord.semantics.configurations import Configuration
from koord.semantics.domain import DOUBLES, Constant
from koord.semantics.properties import holds_in
from koord.syntax.core import PropertyKind
from koord.syntax.system import System

_KINDS = (PropertyKind.INVARIANT, PropertyKind.AT_ROUND)
_SORTS = (WatchedKind.INVARIANT, WatchedKind.AT_ROUND)


class MistakenClaimError(Exception):
    """Raised where machine code is sure of a property that does not hold by the rules."""


class SureClaims:
    """The properties of a system, as machine code looks at them."""

    def __init__(self, system: System) -> None:
        self.system = system
        self._watched = watched(system.program, Fraction(0))
        self.turns = LazyTurns(system.program, self._watched)
        stated = [one for one in system.program.properties if one.kind in _KINDS]
        claims = [one for one in self._watched.claims if one.sort in _SORTS]
        self._claims = [*zip(stated, claims, strict=True)]

    def check(
        self, engine: RoundEngine, configuration: Configuration[Constant], inputs: SampledInputs
    ) -> None:
        """Hold what code is sure of now against the rules. Raises MistakenClaimError."""
        if not isinstance(engine, ColumnEngine):
            return
        judge = engine.judge(self._watched)
        if judge is None or engine.ended is not None:
            return
        for stated, claim in self._claims:
            if judge.unsure(claim.method) != []:
                continue
            engine.counts.claims_by_code += 1
            condition, bound = stated.condition, stated.bound
            holds, _ = holds_in(DOUBLES, self.system, configuration, condition, bound, inputs)
            if holds is not True:
                story = f"machine code is sure of {stated.name}, which does not hold"
                raise MistakenClaimError(story)
