"""Mistakes in what becomes of verdicts where something fails, and of numbers at extremes."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

ENGINES = "tests/verify/test_failing_engines.py"
PARTS = "tests/cli/test_failing_parts.py"
EXTREMES = "tests/cli/test_extremes.py"
OBSTACLES = "tests/verify/test_obstacles.py"
CLAUSES = "tests/verify/bits/test_clauses.py"

FAILING = (
    Mutant(
        "an engine that fails is not named",
        "verify/ledger.py",
        "            self.fail(failure_of(who, error))",
        "            failure_of(who, error)",
        (ENGINES,),
    ),
    Mutant(
        "Ctrl-C inside a call of Z3 is a failure",
        "verify/pool.py",
        "    return _was_interrupted\n",
        "    return False\n",
        (ENGINES,),
    ),
    Mutant(
        "a run that could not be compared counts as the same",
        "cli/verified.py",
        "departure: Departure | None = counterexamples.not_compared()",
        "departure: Departure | None = None",
        (PARTS,),
    ),
    Mutant(
        "what no double has is the compiled program's mistake",
        "refinement/rerunning.py",
        "    except NumberTooLargeError:",
        "    except ZeroDivisionError:",
        (EXTREMES,),
    ),
    Mutant(
        "shadows that fail leave nothing unknown",
        "verify/instants.py",
        "    unsaid = tuple((claim, hidden) for claim in claims)",
        "    unsaid = tuple((claim, hidden) for claim in claims if not failure)",
        (PARTS,),
    ),
    Mutant(
        "a variable whose numbers grow too long is not named",
        "semantics/statements.py",
        "raise error.about((s.place.variable.name,), s.span) from None",
        "raise error",
        (OBSTACLES,),
    ),
    Mutant(
        "a proof that was given up after the answers is not told",
        "verify/ledger.py",
        "            obstacles=_found(reaches[::-1])\n",
        "            obstacles=()\n",
        (OBSTACLES,),
    ),
    Mutant(
        "a question to the SAT solver has no limit of time",
        "verify/bits/clauses.py",
        "            self._solver.conf_budget(AT_ONCE)",
        "            self._solver.conf_budget(AT_ONCE * 10_000)",
        (CLAUSES,),
    ),
)
