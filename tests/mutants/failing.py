"""Mistakes in what becomes of verdicts where something fails, and of numbers at extremes."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

ENGINES = "tests/verify/test_failing_engines.py"
PARTS = "tests/cli/test_failing_parts.py"
EXTREMES = "tests/cli/test_extremes.py"

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
)
