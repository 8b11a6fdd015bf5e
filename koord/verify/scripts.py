"""The claims about a program as one question for solvers: integers and reals as they are.

The question can be satisfied if and only if a claim breaks in INIT or within a bound. Values that
merely flow are opaque: of uninterpreted sorts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from koord.semantics.configurations import System
from koord.semantics.domain import disjunction
from koord.verify.abstraction import abstracted
from koord.verify.bmc import Unrolling, violations
from koord.verify.claims import Phase, claims_of
from koord.verify.solving import Layer


@dataclass(frozen=True, slots=True)
class Script:
    """A script of SMT-LIB 2, and what it does not cover."""

    text: str
    limits: tuple[str, ...]


def script(system: System, names: Sequence[str], rounds: int) -> Script:
    """The question about all claims, or the named ones, within so many rounds.

    Raises NotFiniteError for what formulas cannot say, and OutOfPatienceError.
    """
    abstraction = abstracted(system.program)
    if abstraction is not None:
        system = replace(system, program=abstraction.program)
    claims = [claim for claim in claims_of(system) if not names or claim.name in names]
    unrolling = Unrolling(system)
    d, layers = unrolling.encoder.d, list[Layer]()
    for moment in unrolling.moments():
        broken = list(violations(system, d, moment, claims).values())
        for _, needed in broken:
            unrolling.solver.add(needed)
        asked = disjunction(d, [violated for violated, _ in broken])
        layers.append(Layer(unrolling.solver.required, asked))
        is_end = moment.phase in (Phase.INIT, Phase.END)
        if is_end and moment.configuration.round >= rounds:
            break
    limits = tuple(sorted(set(unrolling.unknowns.limits)))
    return Script(unrolling.solver.layered(layers), limits)
