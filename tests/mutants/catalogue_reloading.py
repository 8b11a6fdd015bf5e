"""Mistakes in how a run goes on with another program."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

RULES = "tests/semantics/test_reloading.py"

RELOADING = (
    Mutant(
        "a variable of another type keeps its value",
        "semantics.reloading._slots",
        "{(name, entry.variable.type): entry.variable.slot for name, entry in named}",
        "{(name, new[0].variable.type): entry.variable.slot for name, entry in named}",
        (RULES,),
    ),
    Mutant(
        "who goes on with another program has stopped no more",
        "semantics.reloading._going_on",
        "state.status",
        "d.const(0, INT)",
        (RULES,),
    ),
    Mutant(
        "what a robot ran keeps its number in another program",
        "semantics.reloading._going_on",
        "d.const(new, INT)",
        "d.const(old, INT)",
        (RULES,),
    ),
    Mutant(
        "robots go on with copies of what was shared before",
        "semantics.reloading._going_on",
        "store",
        "resumed.copy",
        (RULES,),
    ),
    Mutant(
        "a start that faults is gone on from",
        "semantics.reloading._check_sound",
        "found is not None",
        "found is None and faults is None",
        (RULES,),
    ),
    Mutant(
        "what became a shared variable is told as gone",
        "semantics.reloading._changed",
        "name not in are and name not in elsewhere",
        "name not in are",
        (RULES,),
    ),
)
