"""Mistakes in what becomes of verdicts where something fails, and of numbers at extremes."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

ENGINES = "tests/verify/test_failing_engines.py"
PARTS = "tests/cli/test_failing_parts.py"
EXTREMES = "tests/cli/test_extremes.py"
WAYS_OF_PARAMS = "tests/cli/test_params_by_every_way.py"
VARIETIES = "tests/verify/test_varieties.py"
LIMITS = "tests/cli/test_limits.py"
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
        "departure: Rerun = counterexamples.not_compared()",
        "departure: Rerun = None",
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
    Mutant(
        "an engine that hangs has all the time",
        "verify/resuming.py",
        "self.lasting(None if is_last else ended)",
        "self.lasting(None)",
        (ENGINES,),
    ),
    Mutant(
        "whoever took too long is no failure",
        "verify/pool.py",
        "job.is_overdue = not job.is_late",
        "job.is_late = True",
        (ENGINES,),
    ),
    Mutant(
        "a proof that hangs has all the time of the rounds",
        "verify/singly.py",
        "                    tell.lasting(ended)\n",
        "",
        (ENGINES,),
    ),
    Mutant(
        "a configuration rounds numbers",
        "runtime/configuration/params.py",
        "    number, story = None, ",
        "    if isinstance(value, float):\n        return int(value)\n    number, story = None, ",
        (WAYS_OF_PARAMS,),
    ),
    # what makes a violation another one
    Mutant(
        "every violation is a variant of another one",
        "verify/varieties.py",
        "    return all(placed(robot, set()) for robot in wanted)",
        "    return True",
        (VARIETIES,),
    ),
    Mutant(
        "no violation is a variant of another one",
        "verify/varieties.py",
        "    return all(placed(robot, set()) for robot in wanted)",
        "    return False",
        (VARIETIES,),
    ),
    Mutant(
        "a robot stands for another kind of robot",
        "verify/varieties.py",
        "if i in tried or kinds[i] != kinds[robot]:",
        "if i in tried:",
        (VARIETIES,),
    ),
    Mutant(
        "one robot stands for several",
        "verify/varieties.py",
        "if i not in standing or placed(standing[i], tried):",
        "if True:",
        (VARIETIES,),
    ),
    Mutant(
        "the order of events makes no other way",
        "verify/varieties.py",
        "return all(event in left for event in wanted)",
        "return all(event in having for event in wanted)",
        (VARIETIES,),
    ),
    # δ
    Mutant(
        "rounds of any length can be asked for",
        "cli/arguments.py",
        "if not LEAST_DELTA_S <= amount <= MOST_DELTA_S:",
        "if not LEAST_DELTA_S <= amount:",
        (LIMITS,),
    ),
    Mutant(
        "the shortest round is refused",
        "cli/arguments.py",
        "if not LEAST_DELTA_S <= amount <= MOST_DELTA_S:",
        "if not LEAST_DELTA_S < amount <= MOST_DELTA_S:",
        (LIMITS,),
    ),
    Mutant(
        "a program states rounds of any length",
        "syntax/elaborate/instance.py",
        "value is not None and not LEAST_DELTA_S <= value <= MOST_DELTA_S:",
        "value is not None and not value <= MOST_DELTA_S:",
        (LIMITS,),
    ),
    Mutant(
        "a configuration has rounds of any length",
        "runtime/configuration/forms.py",
        "Meta(ge=float(LEAST_DELTA_S), le=float(MOST_DELTA_S))",
        "Meta(gt=0)",
        (LIMITS,),
    ),
)
