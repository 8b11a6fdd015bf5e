"""Mistakes in machine code: of turns, of rounds, and of the renaming of robots."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

AGREEMENT = "tests/agreement/test_kernels.py"
TERMS = "tests/agreement/test_terms.py"

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
    Mutant(
        "machine code rounds quotients to zero",
        "kernels.assembling.Evaluation._divided",
        "b.zext(uneven, I64)",
        "word(0)",
        (TERMS,),
    ),
    Mutant(
        "a remainder has the sign of what is divided",
        "kernels.assembling.Evaluation._divided",
        "b.select(uneven, right, word(0))",
        "word(0)",
        (TERMS,),
    ),
    Mutant(
        "machine code takes at most for less",
        "kernels.assembling.Evaluation._made",
        "b.icmp_signed('<', *args)",
        "b.icmp_signed('<=', *args)",
        (TERMS,),
    ),
    Mutant(
        "ranges that touch are strictly in order",
        "kernels.terms.TermDomain._ordered",
        "not strict and a[1] == b[0]",
        "a[1] == b[0]",
        (TERMS,),
    ),
    Mutant(
        "ranges that touch are in no order",
        "kernels.terms.TermDomain._ordered",
        "strict and a[0] == b[1]",
        "a[0] == b[1]",
        (TERMS,),
    ),
    Mutant(
        "the range of a difference is that of ends of one side",
        "kernels.terms._calculated",
        "(a[0] - b[1], a[1] - b[0])",
        "(a[0] - b[0], a[1] - b[1])",
        (TERMS,),
    ),
    Mutant(
        "a magnitude is in the range of its number",
        "kernels.terms.TermDomain.unary",
        "max(abs(low), abs(high))",
        "high",
        (TERMS,),
    ),
    Mutant(
        "machine code takes any answer to a call",
        "kernels.turns.TurnMaker.event",
        "conjunction(d, [selectable, *legal])",
        "selectable",
        (AGREEMENT,),
    ),
    Mutant(
        "machine code lets sensors read what no contract allows",
        "kernels.turns.TurnMaker.environment",
        "conjunction(d, legal)",
        "conjunction(d, [])",
        (AGREEMENT,),
    ),
    Mutant(
        "robots that have stopped run events in machine code",
        "kernels.rounds._Writer._courses",
        "word(int(Status.STOPPED))",
        "word(-1)",
        (AGREEMENT,),
    ),
)
