"""Seeded mistakes in what is asked of Spacer, and in what is made of its answers."""

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
)
