"""Mistakes in machine code: of turns, of rounds, and of the renaming of robots."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

AGREEMENT = "tests/agreement/test_kernels.py"

KERNELS = (
    Mutant(
        "machine code enters a lock class twice",
        "kernels.rounds._Writer._combine",
        "b.and_(entered, before.taken)",
        "b.and_(entered, word(0))",
        (AGREEMENT,),
    ),
    Mutant(
        "machine code writes what was not written",
        "kernels.turn_code.event_code",
        "b.sext(terms.value(write.condition), cells.type)",
        "b.sext(terms.value(True), cells.type)",
        (AGREEMENT,),
    ),
    Mutant(
        "machine code lets the first writer win",
        "kernels.rounds._Writer._apply",
        "b.not_(before)",
        "before",
        (AGREEMENT,),
    ),
    Mutant(
        "machine code takes one order of a race",
        "kernels.rounds._Writer._combined",
        "b.icmp_signed('==', of.met, word(0))",
        "b.icmp_signed('==', word(0), word(0))",
        (AGREEMENT,),
    ),
    Mutant(
        "what is too large for a cell is cut off",
        "kernels.turn_code._noted",
        "b.and_(terms.value(condition), b.not_(fits))",
        "b.and_(terms.value(False), b.not_(fits))",
        (AGREEMENT,),
    ),
    Mutant(
        "machine code renames robots and not their names",
        "kernels.canonical._Renaming._rename",
        "b.select(is_robot, code.get(self.names, place, I64), value)",
        "value",
        (AGREEMENT,),
    ),
)
