"""Narrow questions leave out constraints, and so allow all that there is, and more."""

from __future__ import annotations

from random import Random

from koord.refinement.generating.programs import system
from koord.semantics.every_number import NotFiniteError
from koord.verify.claims import claims_of
from koord.verify.engines.bits.circuit import circuit_of
from koord.verify.engines.bits.clauses import QUICK, Clauses
from koord.verify.engines.bits.constraint_selection import everything, narrowed
from tests.generators.profiles import FINITE


def test_every_step_and_every_mistake_is_one_of_the_narrow_question() -> None:
    fewer = 0
    for seed in range(9_000, 9_030):
        made = system(Random(seed), FINITE)
        try:
            circuit = circuit_of(made, claims_of(made))
        except NotFiniteError:
            continue
        for claim in circuit.bad:
            whole, narrow = (ask(circuit, [claim], []) for ask in (everything, narrowed))
            clauses = Clauses(circuit.d.graph, QUICK)
            steps, bad = (clauses.of(of) for of in (whole.steps, whole.bad))
            assert not clauses.solve([steps, clauses.of(narrow.steps ^ 1)]), (seed, claim.name)
            assert not clauses.solve([bad, clauses.of(narrow.bad ^ 1)]), (seed, claim.name)
            fewer += clauses.solve([clauses.of(narrow.steps), -steps])
            clauses.close()
    assert fewer >= 10
