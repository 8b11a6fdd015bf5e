"""Seeded mistakes in what is asked of Spacer, and in what is said of the fewest rounds."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

HORN_TEST = "tests/verify/horn/test_engine.py"

HORN = (
    Mutant(
        "spacer: invariants are taken on trust",
        "verify/horn/engine.py",
        "return all(self.clauses.impossible(body, deadline, effort) for body in bodies)",
        "return bool(bodies)",
        (HORN_TEST,),
    ),
    Mutant(
        "spacer: nobody looks at the start",
        "verify/horn/engine.py",
        "        for body in false_starts:\n            clauses.spoil(body)\n",
        "",
        (HORN_TEST,),
    ),
    Mutant(
        "spacer: what never changes is new in each round",
        "verify/horn/engine.py",
        "if x.get_id() in ours or _is_symbol(x)",
        "if x.get_id() in ours",
        (HORN_TEST,),
    ),
    Mutant(
        "spacer: states are read backwards",
        "verify/horn/clauses.py",
        "for fact in reversed(facts):",
        "for fact in facts:",
        (HORN_TEST,),
    ),
    Mutant(
        "spacer: nobody looks at the rounds below a violation",
        "verify/horn/engine.py",
        "first = _first(ledger, claim, shown)",
        "first = _First(shown, fewest=True)",
        ("tests/agreement/test_fewest.py",),
    ),
    Mutant(
        "spacer: rounds that were not looked at count as looked at",
        "verify/horn/engine.py",
        "        return _First(shown, is_whole and has_fewest(shown, bounded.covered))",
        "        return _First(shown, fewest=True)",
        (HORN_TEST,),
    ),
    Mutant(
        "fewest: a list that may be longer breaks nothing sooner",
        "verify/bmc.py",
        "fewest=has_fewest(shown, self.covered),",
        "fewest=True,",
        ("tests/agreement/test_fewest.py",),
    ),
    Mutant(
        "fewest: nor do lists that are longer than circuits have them",
        "verify/bits/engine.py",
        "fewest = not self.circuit.limits and has_fewest(counterexample, self.completed)",
        "fewest = has_fewest(counterexample, self.completed)",
        ("tests/agreement/test_fewest.py",),
    ),
)
