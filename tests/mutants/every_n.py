"""Seeded mistakes in the proofs for every number of robots: each makes them prove too much."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

PROVING = "tests/verify/every_n/test_proving.py"
LOOPS = "tests/verify/every_n/test_loops.py"
SUMS = "tests/verify/every_n/test_sums.py"

EVERY_N = (
    Mutant(
        "every N: what fails of nobody is said to fail of one robot, the same each time",
        "verify/every_n/functions.py",
        "if self.open:\n            return self.applied(self.unused(name), self.open, type_)",
        "if self.open and not name:\n            return super().fresh(name, type_)",
        (PROVING, LOOPS),
    ),
    Mutant(
        "every N: faults are assumed away where they are asked for",
        "verify/every_n/proving.py",
        "return [round_.faults(robot)] if moment is Phase.INSIDE else []",
        "return [round_.calm, round_.faults(robot)] if moment is Phase.INSIDE else []",
        (PROVING,),
    ),
    Mutant(
        "every N: the environment's turn is not asked about",
        "verify/every_n/proving.py",
        "return [Phase.INSIDE, Phase.END]",
        "return [Phase.INSIDE]",
        (PROVING,),
    ),
    Mutant(
        "every N: inside a round nobody is urgent any more",
        "verify/every_n/proving.py",
        "before: list[Term] = [] if moment is Phase.INSIDE else [round_.calm, round_.legal]",
        "before: list[Term] = [round_.legal]",
        (PROVING,),
    ),
    Mutant(
        "every N: two robots are always one",
        "verify/every_n/proving.py",
        "                names = self._asking.robots[: asked.arity]\n",
        "                names = self._asking.robots[:1] * asked.arity\n",
        (PROVING,),
    ),
    Mutant(
        "every N: who wants a taken lock has to act nevertheless",
        "verify/every_n/rounds.py",
        "taken = d.unary(UnaryOp.NOT, self._taken(robot, urgent))",
        "taken = d.const(True, BOOL)",
        (PROVING,),
    ),
    Mutant(
        "every N: robots that have stopped are the only ones",
        "verify/every_n/opening.py",
        "for s in sorted(statuses(self.world.program)[kind])",
        "for s in sorted(statuses(self.world.program)[kind])[-1:]",
        (PROVING,),
    ),
    Mutant(
        "every N: sensors never change",
        "verify/every_n/opening.py",
        "written = self._footprint.get((home, kind, slot), Written.NEVER)",
        "written = self._footprint.get((home, -1, slot), Written.NEVER)",
        (PROVING,),
    ),
    Mutant(
        "every N: one robot at most writes a variable without a lock",
        "verify/every_n/commits.py",
        "if slot in self.guards.classes and not self.guards.is_racy(slot):",
        "if slot in self.guards.classes:",
        (PROVING,),
    ),
    Mutant(
        "every N: no location is racy that some block writes",
        "verify/every_n/commits.py",
        "all(a is None or a == b for",
        "all(a == b for",
        (PROVING,),
    ),
    Mutant(
        "every N: a whole is racy only where it is written as a whole",
        "verify/every_n/commits.py",
        "            slot == its_slot and all(a is None",
        "            slot == its_slot and len(way) in (0, len(place)) and all(a is None",
        (PROVING,),
    ),
    Mutant(
        "every N: what nobody wrote last, nobody wrote",
        "verify/every_n/commits.py",
        "return self.world.book.implied(theirs, self.writes(slot, place, writer))",
        "return self.world.d.unary(UnaryOp.NOT, theirs)",
        (PROVING,),
    ),
    Mutant(
        "every N: what is said of robots of a kind holds of all",
        "verify/every_n/statements.py",
        "            if agent is not None:\n",
        "            if agent is not None and not parts:\n",
        (PROVING,),
    ),
    Mutant(
        "every N: lists are as short as they are looked at",
        "verify/every_n/proving.py",
        "limits = sorted({*start.limits, *step.limits})",
        "limits = sorted({*start.limits, *step.limits})[:0]",
        (PROVING,),
    ),
    Mutant(
        "every N: statements say the same of numbers that are no robots",
        "verify/every_n/book.py",
        "frame.facts.append(self.implied(d.binary(BinaryOp.AND, holds, inside), holds_of))",
        "frame.facts.append(self.implied(holds, holds_of))",
        (LOOPS, PROVING),
    ),
    Mutant(
        "every N: a flag may hang on what the loop changes",
        "verify/every_n/loops.py",
        "        if self._is(self._put(self._seen(), False), False):",
        "        if not self._is(self._put(self._seen(), True), True):",
        (LOOPS,),
    ),
    Mutant(
        "every N: trips do not fault",
        "verify/every_n/loops.py",
        "        if self._d.is_valid(self.crowd.book.glimpse(quiet)):",
        "        if self._d is not None:",
        (LOOPS,),
    ),
    Mutant(
        "every N: what is not understood of a loop stays as it was",
        "verify/every_n/loops.py",
        "        if path not in self._old:\n            return self._anything(path)",
        "        if path in self._old and path[0] == 'locals':\n            return self._old[path]",
        (LOOPS,),
    ),
    Mutant(
        "every N: sums change by one part whatever the others do",
        "verify/every_n/sums.py",
        "return d.binary(BinaryOp.OR, here, self._equal(one.part(k), two.part(k)))",
        "return d.binary(BinaryOp.OR, here, True)",
        (SUMS,),
    ),
    Mutant(
        "every N: the sum of k over k < n is n squared",
        "verify/every_n/sums.py",
        "    for k in range(len(polynomial) + 1):\n        at =",
        "    for k in range(1, len(polynomial) + 2):\n        at =",
        (SUMS,),
    ),
)
