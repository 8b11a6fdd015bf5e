"""Seeded mistakes in the proofs for every number of robots: each makes them prove too much."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

PROVING = "tests/verify/engines/every_n/test_proving.py"
LOOPS = "tests/verify/engines/every_n/test_loops.py"
SEARCH = "tests/verify/engines/every_n/test_lemma_search.py"
SUMS = "tests/verify/engines/every_n/test_sums.py"
ARRAYS = "tests/verify/engines/every_n/test_shared_arrays.py"

EVERY_N = (
    Mutant(
        "every N: what fails of nobody is said to fail of one robot, the same each time",
        "verify.engines.every_n.functions.FunctionTerms.fresh",
        "if self.open:\n    return self.applied(self.unused(name), self.open, type_)",
        "if self.open and not name:\n    return super().fresh(name, type_)",
        (PROVING, LOOPS),
    ),
    Mutant(
        "every N: faults are assumed away where they are asked for",
        "verify.engines.every_n.questions.Step._negation",
        "[round_.faults(robot)]",
        "[round_.calm, round_.faults(robot)]",
        (PROVING,),
    ),
    Mutant(
        "every N: the environment's turn is not asked about",
        "verify.engines.every_n.questions.Step.moments",
        "[ClaimPhase.INSIDE, ClaimPhase.END]",
        "[ClaimPhase.INSIDE]",
        (PROVING,),
    ),
    Mutant(
        "every N: inside a round nobody is urgent any more",
        "verify.engines.every_n.questions.Step._negation",
        "[] if moment is ClaimPhase.INSIDE else [round_.calm, round_.legal]",
        "[round_.legal]",
        (PROVING,),
    ),
    Mutant(
        "every N: two robots are always one",
        "verify.engines.every_n.questions.Step._negation",
        "self.asking.robots[: asked.arity]",
        "self.asking.robots[:1] * asked.arity",
        (PROVING,),
    ),
    Mutant(
        "every N: who wants a taken lock has to act nevertheless",
        "verify.engines.every_n.rounds.ParameterisedRound._urge",
        "d.unary(UnaryOp.NOT, self._taken(robot, urgent))",
        "d.const(True, BOOL)",
        (PROVING,),
    ),
    Mutant(
        "every N: robots that have stopped are the only ones",
        "verify.engines.every_n.initial_states.ArbitraryState._any",
        "sorted(statuses(self.world.program)[kind])",
        "sorted(statuses(self.world.program)[kind])[-1:]",
        (PROVING,),
    ),
    Mutant(
        "every N: sensors never change",
        "verify.engines.every_n.initial_states.ArbitraryState._own",
        "self._footprint.get((home, kind, slot), WriteExtent.NEVER)",
        "self._footprint.get((home, -1, slot), WriteExtent.NEVER)",
        (PROVING,),
    ),
    Mutant(
        "every N: one robot at most writes a variable without a lock",
        "verify.engines.every_n.commits.Commits._after_all",
        "slot in self.guards.classes and not self.guards.is_racy(slot)",
        "slot in self.guards.classes",
        (PROVING,),
    ),
    Mutant(
        "every N: no location is racy that some block writes",
        "verify.engines.every_n.commits.Guards.is_racy",
        "a is None or a == b",
        "a == b",
        (PROVING,),
    ),
    Mutant(
        "every N: a whole is racy only where it is written as a whole",
        "verify.engines.every_n.commits.Guards.is_racy",
        "slot == its_slot and all(a is None or a == b for a, b in zip(way, place, strict=False))",
        (
            "slot == its_slot and len(way) in (0, len(place)) and all(\n"
            "    a is None or a == b for a, b in zip(way, place, strict=False)\n"
            ")"
        ),
        (PROVING,),
    ),
    Mutant(
        "every N: what nobody wrote last, nobody wrote",
        "verify.engines.every_n.commits.Commits._nobody_else.law",
        "self.world.book.implied(theirs, self.writes(slot, place, writer))",
        "self.world.d.unary(core.UnaryOp.NOT, theirs)",
        (PROVING,),
    ),
    Mutant(
        "every N: what is said of robots of a kind holds of all",
        "verify.engines.every_n.all_robots.Universal.of_robots",
        "agent is not None",
        "agent is not None and not parts",
        (PROVING,),
    ),
    Mutant(
        "every N: lists are as short as they are looked at",
        "verify.engines.every_n.proving.prove",
        "sorted({*start.limits, *step.limits})",
        "sorted({*start.limits, *step.limits})[:0]",
        (PROVING,),
    ),
    Mutant(
        "every N: statements say the same of numbers that are no robots",
        "verify.engines.every_n.instantiation.Book._equivalent",
        "d.binary(BinaryOp.AND, holds, inside)",
        "holds",
        (LOOPS, PROVING),
    ),
    Mutant(
        "every N: a flag may hang on what the loop changes",
        "verify.engines.every_n.loops.LoopEffect.as_flag",
        "self._is(self._put(self._seen(), False), False)",
        "not self._is(self._put(self._seen(), True), True)",
        (LOOPS,),
    ),
    Mutant(
        "every N: trips do not fault",
        "verify.engines.every_n.loops.MachineLoop._log_faults",
        "self._d.is_valid(self.facts.book.glimpse(quiet))",
        "self._d is not None",
        (LOOPS,),
    ),
    Mutant(
        "every N: what is not understood of a loop stays as it was",
        "verify.engines.every_n.loops.MachineLoop._summary",
        "if path not in self._old:\n    return self._anything(path)",
        "if path in self._old and path[0] == 'locals':\n    return self._old[path]",
        (LOOPS,),
    ),
    Mutant(
        "every N: sums change by one part whatever the others do",
        "verify.engines.every_n.sums.Sums._compare.says.alike",
        "self._equal(one.part(k), two.part(k))",
        "True",
        (SUMS,),
    ),
    Mutant(
        "every N: the sum of k over k < n is n squared",
        "verify.engines.every_n.sums._summed",
        "range(len(polynomial) + 1)",
        "range(1, len(polynomial) + 2)",
        (SUMS,),
    ),
    Mutant(
        "every N: lemmas are found by what solvers leave open",
        "verify.engines.every_n.lemma_search._Loop.proved",
        "answer is SolverAnswer.UNSAT",
        "answer is not SolverAnswer.SAT",
        (SEARCH,),
    ),
    Mutant(
        "every N: lemmas found need not hold after INIT",
        "verify.engines.every_n.lemma_search._Loop._add",
        "self.start.sifted([claim])",
        "claim",
        (SEARCH,),
    ),
    Mutant(
        "every N: what breaks lemmas found is looked for inside rounds only",
        "verify.engines.every_n.lemma_search._Loop._ask",
        "self.step.moments()",
        "self.step.moments()[:1]",
        (SEARCH,),
    ),
    Mutant(
        "every N: lemmas found need not be kept by rounds",
        "verify.engines.every_n.lemma_search._Loop.proved",
        "not hit",
        "hit is not None",
        (SEARCH,),
    ),
    Mutant(
        "every N: what all robots of one range are, those of any other are",
        "verify.engines.every_n.instantiation.Book._once",
        "d.key(low), d.key(high), d.key(said)",
        "d.key(low), d.key(said)",
        (LOOPS,),
    ),
    Mutant(
        "every N: what robots are is the same whoever asks",
        "verify.engines.every_n.instantiation.Book.every",
        "not frame.inner and not frame.brings_up and not d.mentions(said, frame.outer)",
        "not frame.inner and not frame.brings_up",
        (LOOPS, PROVING),
    ),
    Mutant(
        "every N: loops that go on alike are left in one trip, whatever their ranges",
        "verify.engines.every_n.instantiation.Book.first",
        "d.key(through), d.key(low), d.key(high)",
        "(0,)",
        (LOOPS,),
    ),
    Mutant(
        "every N: elements of shared arrays stay as they were",
        "semantics.locations._joined_elements.at",
        "d.binary(BinaryOp.EQ, i, index)",
        "d.binary(BinaryOp.NE, i, i)",
        (ARRAYS,),
    ),
    Mutant(
        "every N: nobody meets another at an element of a shared array",
        "semantics.properties.overlap",
        "mine.elements",
        "mine.elements[:0]",
        (ARRAYS,),
    ),
    Mutant(
        "every N: elements of shared arrays that robots race for stay as they were",
        "verify.engines.every_n.commits.masked",
        "mask.elements",
        "mask.elements[:0]",
        (ARRAYS,),
    ),
    Mutant(
        "every N: all elements of a shared array have one last writer",
        "verify.engines.every_n.commits.Commits._last_writer",
        "step is None",
        "step is None and not place",
        (ARRAYS,),
    ),
)
