"""Seeded mistakes in what is said of the time between the ends of rounds."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

INSTANTS_TEST = "tests/verify/test_instants.py"

INSTANTS = (
    Mutant(
        "instants: each robot is at one of its own",
        "verify.reduction.shadows.Shadows.program",
        "core.ExternalKind.FUNCTION",
        "core.ExternalKind.FRESH",
        (INSTANTS_TEST,),
    ),
    Mutant(
        "instants: the end of the turn is the only one",
        "verify.reduction.shadows.Shadows.program",
        "core.Const(Fraction(0), FLOAT)",
        "core.Delta(FLOAT)",
        (INSTANTS_TEST,),
    ),
    Mutant(
        "instants: models that jump are asked all the same",
        "verify.instants._jumps",
        "solved is not Solved.UNSAT",
        "solved is Solved.UNKNOWN",
        (INSTANTS_TEST,),
    ),
    Mutant(
        "instants: contracts promise nothing in between",
        "verify.reduction.shadows.Shadows._module",
        "tuple(self._afterwards(e) for e in contract.ensures)",
        "contract.ensures",
        (INSTANTS_TEST,),
    ),
)
