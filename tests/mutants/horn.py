"""Seeded mistakes in what is asked of Spacer, and in what is said of the fewest rounds."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

HORN_TEST = "tests/verify/engines/horn/test_engine.py"

HORN = (
    Mutant(
        "spacer: invariants are taken on trust",
        "verify.engines.horn.engine.HornQuery.is_kept",
        "all(self.clauses.impossible(body, deadline, effort) for body in bodies)",
        "bool(bodies)",
        (HORN_TEST,),
    ),
    Mutant(
        "spacer: nobody looks at the start",
        "verify.engines.horn.engine.HornQuery.of",
        "for body in false_starts:\n    clauses.spoil(body)",
        "pass",
        (HORN_TEST,),
    ),
    Mutant(
        "spacer: what never changes is new in each round",
        "verify.engines.horn.engine.HornQuery.of",
        "x.get_id() in ours or _is_symbol(x)",
        "x.get_id() in ours",
        (HORN_TEST,),
    ),
    Mutant(
        "spacer: states are read backwards",
        "verify.engines.horn.clauses.Clauses._facts",
        "reversed(facts)",
        "facts",
        (HORN_TEST,),
    ),
    Mutant(
        "spacer: nobody looks at the rounds below a violation",
        "verify.engines.horn.engine.HornEngine._show",
        "_first(ledger, claim, shown)",
        "_First(shown, fewest=True)",
        ("tests/agreement/test_fewest.py",),
    ),
    Mutant(
        "spacer: rounds that were not looked at count as looked at",
        "verify.engines.horn.engine._first",
        "_First(shown, is_whole and has_fewest(shown, bounded.covered))",
        "_First(shown, fewest=True)",
        (HORN_TEST,),
    ),
    Mutant(
        "fewest: a list that may be longer breaks nothing sooner",
        "verify.bounded_check.BoundedCheck.check",
        "has_fewest(shown, self.covered)",
        "True",
        ("tests/agreement/test_fewest.py",),
    ),
    Mutant(
        "fewest: nor do lists that are longer than circuits have them",
        "verify.engines.bits.engine._Run._found",
        "not self.circuit.limits and has_fewest(counterexample, self.completed)",
        "has_fewest(counterexample, self.completed)",
        ("tests/agreement/test_fewest.py",),
    ),
)
