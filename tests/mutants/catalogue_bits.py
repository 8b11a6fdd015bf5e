"""Mistakes in the engine on bits: its domain, circuit, clauses, unrolling, IC3 and its check."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

AGREEMENT = "tests/agreement/test_bits.py"
NUMBERS = "tests/verify/engines/bits/test_numbers.py"
IC3 = "tests/verify/engines/bits/test_ic3.py"
GENERATED = "tests/agreement/test_engines.py"
EXPORTING = "tests/verify/engines/bits/test_circuit_files.py"
ENGINE = "tests/verify/engines/bits/test_engine.py"
CLAUSES = "tests/verify/engines/bits/test_clauses.py"
STATES = "tests/verify/engines/bits/test_state_claims.py"

BITS = (
    # the domain
    Mutant(
        "a carry is lost",
        "verify.engines.bits.numbers._sum",
        "g.either(g.both(x, y), g.both(half, carry))",
        "g.both(half, carry)",
        (NUMBERS, AGREEMENT),
    ),
    Mutant(
        "the sign of a factor has positive weight",
        "verify.engines.bits.numbers._product",
        "_sum(g, total, tuple(x ^ 1 for x in part), TRUE)",
        "_sum(g, total, part, FALSE)",
        (NUMBERS,),
    ),
    Mutant(
        "signs are compared as other bits are",
        "verify.engines.bits.numbers.at_most",
        "g.choose(g.differ(left[-1], right[-1]), left[-1], holds)",
        "g.choose(g.differ(left[-1], right[-1]), right[-1], holds)",
        (NUMBERS, AGREEMENT),
    ),
    Mutant(
        "bits that tell a number from some of a range tell it from all",
        "verify.engines.bits.numbers._is",
        "all(x & fewer for x in others)",
        "any(x & fewer for x in others)",
        (NUMBERS,),
    ),
    Mutant(
        "the greatest number of a range is left out of what its bits may be",
        "verify.engines.bits.constraint_selection.projected",
        "range(number.low, number.high + 1)",
        "range(number.low, number.high)",
        ("tests/verify/engines/bits/test_constraint_selection.py",),
    ),
    Mutant(
        "a fresh number leaves its range",
        "verify.engines.bits.domain.BitDomain.in_range",
        "[numbers.at_most(g, low, wide), numbers.at_most(g, wide, high)]",
        "[numbers.at_most(g, low, wide)]",
        (f"{GENERATED}::test_bits_agree_at_the_ends_of_ranges", NUMBERS),
    ),
    Mutant(
        "what is calculated from any number is that number",
        "verify.engines.bits.domain.BitDomain._another",
        "number.loose == FALSE",
        "number.loose >= FALSE",
        (NUMBERS,),
    ),
    Mutant(
        "choices that are too wide to be kept are all the same",
        "verify.engines.bits.domain.BitDomain.ite",
        "made.loose == TRUE",
        "made.loose < FALSE",
        (NUMBERS, ENGINE),
    ),
    Mutant(
        "comparisons forget that a factor makes numbers wider",
        "verify.engines.bits.numbers.rescaled",
        "_product(g, a, _constant(factor, 0))",
        "multiplied(g, a, _constant(factor, 0))",
        (NUMBERS,),
    ),
    Mutant(
        "a quotient that is too wide to be kept is zero",
        "verify.engines.bits.numbers.divided",
        "g.either(loose, result.loose)",
        "loose",
        (NUMBERS,),
    ),
    Mutant(
        "a choice of the graph takes the wrong side",
        "verify.engines.bits.graph.Graph.choose",
        "self.either(condition, other)",
        "self.either(condition, other ^ 1)",
        (NUMBERS, AGREEMENT),
    ),
    # the circuit
    Mutant(
        "a program turn is legal whoever runs",
        "verify.engines.bits.circuit._Builder.finished",
        "program + _literals(p.taken.urgency)",
        "_literals(p.taken.urgency)",
        (ENGINE,),
    ),
    Mutant(
        "urgent events may wait",
        "verify.engines.bits.circuit._Builder.finished",
        "p.taken.urgency",
        "p.taken.urgency[:0]",
        (ENGINE,),
    ),
    Mutant(
        "variables start as they please",
        "verify.engines.bits.circuit._Builder.finished",
        "[*opens, fault ^ 1]",
        "[fault ^ 1]",
        (GENERATED, ENGINE),
    ),
    Mutant(
        "a number that strays is kept as it is cut",
        "verify.engines.bits.circuit._Landing._number",
        'self._set(f"{path} strays", fresh.loose, strays)',
        'self._set(f"{path} strays", fresh.loose, FALSE)',
        (ENGINE,),
    ),
    Mutant(
        "lists that outgrow their room are cut unseen",
        "verify.engines.bits.circuit._Builder.finished",
        "g.any_of(lost)",
        "FALSE",
        (ENGINE,),
    ),
    Mutant(
        "narrow questions forget what is about the claim",
        "verify.engines.bits.constraint_selection.narrowed",
        "steps = g.all_of(kept)",
        "steps = g.all_of(kept) ^ 1",
        ("tests/verify/engines/bits/test_constraint_selection.py",),
    ),
    Mutant(
        "a mistake is in a round that ends",
        "verify.engines.bits.legal_choices.with_legal_choices",
        "legal_mistakes(g, question.bad, choices)",
        "_legal(g, question.steps, (question.bad,), choices)[0]",
        (ENGINE, "tests/verify/engines/bits/test_legal_choices.py"),
    ),
    Mutant(
        "a forbidden choice is made all the same",
        "verify.engines.bits.legal_choices._legal",
        "g.all_of([2 * choices[k], *kept])",
        "2 * choices[k]",
        ("tests/verify/engines/bits/test_legal_choices.py",),
    ),
    Mutant(
        "a constraint is left to a choice that alone does not keep it",
        "verify.engines.bits.legal_choices._shares",
        "g.both(made, not_made ^ 1) != FALSE",
        "g.both(made, not_made ^ 1) == TRUE",
        ("tests/verify/engines/bits/test_legal_choices.py",),
    ),
    Mutant(
        "what a constraint says without its last choice is forgotten",
        "verify.engines.bits.legal_choices._shares",
        "part = not_made",
        "part = TRUE",
        ("tests/verify/engines/bits/test_legal_choices.py",),
    ),
    Mutant(
        "what breaks on the way is looked for behind the round",
        "verify.engines.bits.state_claims.broken_in_state",
        "left and (not _implies(circuit, {when, *needed[phase]}, g.all_of(left)))",
        "left - {after}",
        (STATES, EXPORTING),
    ),
    Mutant(
        "what a round that has no end breaks is looked for behind it",
        "verify.engines.bits.state_claims.broken_in_state",
        "{*g.conjuncts(after), *whole}",
        "{*g.conjuncts(after)}",
        (STATES, EXPORTING),
    ),
    # clauses and rounds
    Mutant(
        "a choice is written down on one side",
        "verify.engines.bits.clauses.Clauses._write",
        "[[me, -c, -t], [me, c, -e], [me, -t, -e]]",
        "[[me, -c, -t], [me, -t, -e]]",
        (IC3,),
    ),
    Mutant(
        "a negation needs the clauses of its node",
        "verify.engines.bits.clauses._turned",
        "(sides & 1) << 1 | sides >> 1",
        "sides",
        (IC3,),
    ),
    Mutant(
        "a hard question is asked of its first part",
        "verify.engines.bits.clauses.Clauses._asked_in_parts",
        "if found is not SolverAnswer.UNSAT:\n    return found",
        "return found",
        (CLAUSES,),
    ),
    Mutant(
        "the core of parts is that of the last",
        "verify.engines.bits.clauses.Clauses._asked_in_parts",
        "core |= dict.fromkeys(self.core())",
        "core = dict.fromkeys(self.core())",
        (CLAUSES,),
    ),
    Mutant(
        "each round starts afresh",
        "verify.engines.bits.unrolling.UnrolledCircuit.begin",
        "latch.next",
        "latch.init",
        (GENERATED, ENGINE),
    ),
    # IC3
    Mutant(
        "a clause is learned one frame too late",
        "verify.engines.bits.ic3.Ic3Run._blocked",
        "self._leads_to(level - 1, wanted)",
        "self._leads_to(level, wanted)",
        (IC3,),
    ),
    Mutant(
        "questions of all frames count as those of one",
        "verify.engines.bits.ic3.Ic3Run._open_frame",
        "self._opened = self.queries",
        "pass",
        (IC3,),
    ),
    Mutant(
        "nobody tells IC3 how many questions a frame may take",
        "verify.engines.bits.engine._Run._searched",
        "self.frame_questions",
        "None",
        ("tests/verify/test_obstacles.py",),
    ),
    Mutant(
        "a clause may keep INIT out",
        "verify.engines.bits.ic3.Ic3Run._apart",
        "not self._starts_in(enough)",
        "enough",
        (IC3,),
    ),
    Mutant(
        "a smaller cube need not be apart from INIT",
        "verify.engines.bits.ic3.Ic3Run._dropped",
        "if self._starts_in(cube):\n    return None",
        "pass",
        (IC3,),
    ),
    Mutant(
        "what leads to a cube is lifted without the step",
        "verify.engines.bits.ic3._Lifting.before",
        "goal = [self.clauses.of(self.question.steps)]",
        "goal: list[int] = []",
        (IC3,),
    ),
    Mutant(
        "clauses are pushed unasked",
        "verify.engines.bits.ic3.Ic3Run._pushed",
        "self._leads_to(level, cube, but=False) is None",
        "not cube",
        (IC3,),
    ),
    Mutant(
        "the check of an invariant forgets the step",
        "verify.engines.bits.unrolling.keeps",
        "initiated and safe and kept",
        "initiated and safe",
        (IC3,),
    ),
    Mutant(
        "what is said to be kept is believed",
        "verify.engines.bits.unrolling.holds_always",
        "[*left_out, *question.kept]",
        "left_out",
        (IC3,),
    ),
    Mutant(
        "bits that tell robots apart have images",
        "verify.engines.bits.robot_permutations._Renaming._is_above",
        "(self.system.robots - 1).bit_length()",
        "0",
        ("tests/verify/engines/bits/test_robot_permutations.py",),
    ),
    Mutant(
        "some ways to be bad are not looked at",
        "verify.engines.bits.ic3._ways",
        "range(0, len(ways), max(1, size))",
        "range(0, len(ways) - 1, max(1, size))",
        ("tests/verify/engines/bits/test_robot_permutations.py",),
    ),
    Mutant(
        "what cannot be said counts as looked at",
        "verify.engines.bits.invariants.Lemmas.is_checked",
        "not self.unsaid",
        "True",
        ("tests/verify/engines/bits/test_engine.py",),
    ),
    Mutant(
        "the check of an invariant forgets INIT",
        "verify.engines.bits.unrolling.keeps",
        "initiated and safe and kept",
        "safe and kept",
        (IC3,),
    ),
    Mutant(
        "the check of an invariant forgets what is bad",
        "verify.engines.bits.unrolling.keeps",
        "initiated and safe and kept",
        "initiated and kept",
        (IC3,),
    ),
    # other tools
    Mutant(
        "what is exported is bad before INIT",
        "verify.engines.bits.circuit_files._with_init",
        "g.both(begun ^ 1, x.first)",
        "x.first",
        (EXPORTING,),
    ),
    Mutant(
        "what is exported goes on behind an illegal step",
        "verify.engines.bits.circuit_files._with_init",
        "g.both(valid, steps)",
        "steps",
        (EXPORTING,),
    ),
    Mutant(
        "INIT is left out though it breaks a claim",
        "verify.engines.bits.circuit_files._is_determined",
        "x.first != FALSE",
        "x.first == TRUE",
        (EXPORTING,),
    ),
    Mutant(
        "latches that abc negates are taken as they are",
        "verify.engines.bits.abc._cubes",
        "latch.init == TRUE",
        "latch.init > TRUE",
        ("tests/verify/engines/bits/test_abc.py",),
    ),
)
