"""Seeded mistakes in what is said of the time between the ends of rounds."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

INSTANTS_TEST = "tests/verify/test_instants.py"

INSTANTS = (
    Mutant(
        "instants: each robot is at one of its own",
        "verify/shadows.py",
        "core.ExternalKind.FUNCTION, (), (low, high), 1",
        "core.ExternalKind.FRESH, (), (low, high), 1",
        (INSTANTS_TEST,),
    ),
    Mutant(
        "instants: the end of the turn is the only one",
        "verify/shadows.py",
        "low = core.Binary(BinaryOp.LE, core.Const(Fraction(0), FLOAT), _read(result), BOOL)",
        "low = core.Binary(BinaryOp.LE, core.Delta(FLOAT), _read(result), BOOL)",
        (INSTANTS_TEST,),
    ),
    Mutant(
        "instants: models that jump are asked all the same",
        "verify/instants.py",
        "        if solved is not Solved.UNSAT:",
        "        if solved is Solved.UNKNOWN:",
        (INSTANTS_TEST,),
    ),
    Mutant(
        "instants: contracts promise nothing in between",
        "verify/shadows.py",
        "ensures=tuple(self._afterwards(e) for e in contract.ensures),",
        "ensures=contract.ensures,",
        (INSTANTS_TEST,),
    ),
)
