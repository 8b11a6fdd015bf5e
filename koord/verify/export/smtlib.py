"""The claims about a program as one question for solvers: integers and reals as they are.

The question can be satisfied if and only if a claim breaks in INIT or within a bound. Opaque values
are of uninterpreted sorts.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct

from koord.semantics.domain import disjunction
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.encoding.solver import Layer
from koord.verify.encoding.unrolling import Unrolling, violations


class Script(Struct, frozen=True):
    """A script of SMT-LIB 2, and what it does not cover."""

    text: str
    limits: tuple[str, ...]


def script(system: System, claims: Sequence[Claim], rounds: int) -> Script:
    """The question about some claims, within so many rounds.

    Raises NotFiniteError for what formulas cannot say, and OutOfBudgetError.
    """
    unrolling = Unrolling(system)
    d, layers = unrolling.encoder.d, list[Layer]()
    for moment in unrolling.moments():
        broken = list(violations(system, d, moment, claims).values())
        for _, needed in broken:
            unrolling.solver.add(needed)
        asked = disjunction(d, [violated for violated, _ in broken])
        layers.append(Layer(unrolling.solver.required, asked))
        is_end = moment.phase in (ClaimPhase.INIT, ClaimPhase.END)
        if is_end and moment.configuration.round >= rounds:
            break
    limits = tuple(unrolling.unknowns.uncovered)
    return Script(unrolling.solver.layered(layers), limits)
