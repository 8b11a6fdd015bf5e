"""Mistakes in the engine on bits: its domain, circuit, clauses, unrolling, IC3 and its check."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

AGREEMENT = "tests/agreement/test_bits.py"
NUMBERS = "tests/verify/bits/test_numbers.py"
IC3 = "tests/verify/bits/test_pdr.py"
GENERATED = "tests/agreement/test_engines.py"
EXPORTING = "tests/verify/bits/test_exporting.py"
ENGINE = "tests/verify/bits/test_engine.py"

BITS = (
    # the domain
    Mutant(
        "a carry is lost",
        "verify/bits/numbers.py",
        "carry = g.either(g.both(x, y), g.both(half, carry))",
        "carry = g.both(half, carry)",
        (NUMBERS, AGREEMENT),
    ),
    Mutant(
        "the sign of a factor has positive weight",
        "verify/bits/numbers.py",
        "total = _sum(g, total, tuple(x ^ 1 for x in part), TRUE)",
        "total = _sum(g, total, part, FALSE)",
        (NUMBERS,),
    ),
    Mutant(
        "signs are compared as other bits are",
        "verify/bits/numbers.py",
        "return g.choose(g.differ(left[-1], right[-1]), left[-1], holds)",
        "return g.choose(g.differ(left[-1], right[-1]), right[-1], holds)",
        (NUMBERS, AGREEMENT),
    ),
    Mutant(
        "a fresh number leaves its range",
        "verify/bits/domain.py",
        "return [numbers.at_most(g, low, wide), numbers.at_most(g, wide, high)]",
        "return [numbers.at_most(g, low, wide)]",
        (f"{GENERATED}::test_bits_agree_at_the_ends_of_ranges", NUMBERS),
    ),
    Mutant(
        "what is calculated from any number is that number",
        "verify/bits/domain.py",
        "if number.loose == FALSE:\n            return number\n        if self.is_wild",
        "if number.loose >= FALSE:\n            return number\n        if self.is_wild",
        (NUMBERS,),
    ),
    Mutant(
        "choices that are too wide to be kept are all the same",
        "verify/bits/domain.py",
        "if made.loose == TRUE:  # too wide",
        "if made.loose < FALSE:",
        (NUMBERS, ENGINE),
    ),
    Mutant(
        "comparisons forget that a factor makes numbers wider",
        "verify/bits/numbers.py",
        "return _product(g, a, _constant(factor, 0))._replace(scale=scale)",
        "return multiplied(g, a, _constant(factor, 0))._replace(scale=scale)",
        (NUMBERS,),
    ),
    Mutant(
        "a quotient that is too wide to be kept is zero",
        "verify/bits/numbers.py",
        "return result._replace(loose=g.either(loose, result.loose))",
        "return result._replace(loose=loose)",
        (NUMBERS,),
    ),
    Mutant(
        "a choice of the graph takes the wrong side",
        "verify/bits/graph.py",
        "if constant & 1:\n                return self.either(condition, other)",
        "if constant & 1:\n                return self.either(condition, other ^ 1)",
        (NUMBERS, AGREEMENT),
    ),
    # the circuit
    Mutant(
        "a program turn is legal whoever runs",
        "verify/bits/transition.py",
        "whole = program + [",
        "whole = [",
        (ENGINE,),
    ),
    Mutant(
        "urgent events may wait",
        "verify/bits/transition.py",
        "for x in p.taken.urgency]",
        "for x in p.taken.urgency[:0]]",
        (ENGINE,),
    ),
    Mutant(
        "variables start as they please",
        "verify/bits/transition.py",
        "g.all_of([*opens, fault ^ 1]),",
        "g.all_of([fault ^ 1]),",
        (GENERATED, ENGINE),
    ),
    Mutant(
        "a number that strays is kept as it is cut",
        "verify/bits/transition.py",
        'self._set(f"{path} strays", fresh.loose, strays)',
        'self._set(f"{path} strays", fresh.loose, FALSE)',
        (ENGINE,),
    ),
    Mutant(
        "lists that outgrow their room are cut unseen",
        "verify/bits/transition.py",
        "g_lost = g.any_of(lost)",
        "g_lost = FALSE",
        (ENGINE,),
    ),
    Mutant(
        "narrow questions forget what is about the claim",
        "verify/bits/narrowing.py",
        "steps = g.all_of(kept)",
        "steps = g.all_of(kept) ^ 1",
        ("tests/verify/bits/test_narrowing.py",),
    ),
    # clauses and rounds
    Mutant(
        "a choice is written down on one side",
        "verify/bits/clauses.py",
        "[[me, -c, -t], [me, c, -e], [me, -t, -e]]",
        "[[me, -c, -t], [me, -t, -e]]",
        (IC3,),
    ),
    Mutant(
        "a negation needs the clauses of its node",
        "verify/bits/clauses.py",
        "return (sides & 1) << 1 | sides >> 1",
        "return sides",
        (IC3,),
    ),
    Mutant(
        "each round starts afresh",
        "verify/bits/unrolling.py",
        "_signed(before.of(latch.next), latch.literal)",
        "_signed(before.of(latch.init), latch.literal)",
        (GENERATED, ENGINE),
    ),
    # IC3
    Mutant(
        "a clause is learned one frame too late",
        "verify/bits/pdr.py",
        "enough = self._leads_to(level - 1, wanted)",
        "enough = self._leads_to(level, wanted)",
        (IC3,),
    ),
    Mutant(
        "a clause may keep INIT out",
        "verify/bits/pdr.py",
        "if not self._starts_in(enough):\n            return enough",
        "if enough:\n            return enough",
        (IC3,),
    ),
    Mutant(
        "a smaller cube need not be apart from INIT",
        "verify/bits/pdr.py",
        "            if self._starts_in(cube):\n                return None\n",
        "",
        (IC3,),
    ),
    Mutant(
        "what leads to a cube is lifted without the step",
        "verify/bits/pdr.py",
        "goal = [self.clauses.of(self.question.steps)]",
        "goal: list[int] = []",
        (IC3,),
    ),
    Mutant(
        "clauses are pushed unasked",
        "verify/bits/pdr.py",
        "if self._leads_to(level, cube, but=False) is None:",
        "if not cube:",
        (IC3,),
    ),
    Mutant(
        "the check of an invariant forgets the step",
        "verify/bits/checking.py",
        "return initiated and safe and kept",
        "return initiated and safe",
        (IC3,),
    ),
    Mutant(
        "the check of an invariant forgets INIT",
        "verify/bits/checking.py",
        "return initiated and safe and kept",
        "return safe and kept",
        (IC3,),
    ),
    Mutant(
        "the check of an invariant forgets what is bad",
        "verify/bits/checking.py",
        "return initiated and safe and kept",
        "return initiated and kept",
        (IC3,),
    ),
    # other tools
    Mutant(
        "what is exported is bad before INIT",
        "verify/bits/exporting.py",
        "first = g.both(begun ^ 1, circuit.bad_start.get(claim, FALSE))",
        "first = circuit.bad_start.get(claim, FALSE)",
        (EXPORTING,),
    ),
    Mutant(
        "what is exported goes on behind an illegal step",
        "verify/bits/exporting.py",
        "legal = g.choose(begun, g.both(valid, steps), opens)",
        "legal = g.choose(begun, steps, opens)",
        (EXPORTING,),
    ),
)
