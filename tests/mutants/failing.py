"""Mistakes in what becomes of verdicts where something fails, and of numbers at extremes."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

ENGINES = "tests/verify/strategy/test_failing_engines.py"
PARTS = "tests/cli/test_failing_parts.py"
EXTREMES = "tests/cli/test_extremes.py"
WAYS_OF_PARAMS = "tests/cli/test_params_by_every_way.py"
VARIETIES = "tests/verify/engines/bmc/test_counterexample_enumeration.py"
LIMITS = "tests/cli/test_limits.py"
OBSTACLES = "tests/verify/test_obstacles.py"
CLAUSES = "tests/verify/engines/bits/test_clauses.py"

FAILING = (
    Mutant(
        "an engine that fails is not named",
        "verify.ledger.Ledger.enduring",
        "self.fail(failure_of(who, error))",
        "failure_of(who, error)",
        (ENGINES,),
    ),
    Mutant(
        "Ctrl-C inside a call of Z3 is a failure",
        "verify.job_process.was_interrupted",
        "return _was_interrupted",
        "return False",
        (ENGINES,),
    ),
    Mutant(
        "a run that could not be compared counts as the same",
        "api.verdicts.Verdict._violation",
        'Departure(0, "the run could not be compared")',
        "None",
        (PARTS,),
    ),
    Mutant(
        "what no double has is the compiled program's mistake",
        "refinement.compiled_replay.rerun",
        (
            "try:\n"
            "    made = ready(trace.system.program) if made is None else made\n"
            "except NumberTooLargeError:\n"
            "    return Departure(nobody.round, _TOO_LARGE)"
        ),
        (
            "try:\n"
            "    made = ready(trace.system.program) if made is None else made\n"
            "except ZeroDivisionError:\n"
            "    return Departure(nobody.round, _TOO_LARGE)"
        ),
        (EXTREMES,),
    ),
    Mutant(
        "shadows that fail leave nothing unknown",
        "verify.instants.shadowed",
        "((claim, hidden) for claim in claims)",
        "((claim, hidden) for claim in claims if not failure)",
        (PARTS,),
    ),
    Mutant(
        "a variable whose numbers grow too long is not named",
        "semantics.statements.execute",
        "raise error.about(names, s.span) from None",
        "raise error",
        (OBSTACLES,),
    ),
    Mutant(
        "a variable whose product grows too long in a guard is not named",
        "semantics.expressions.condition",
        "raise error.about(variables_in(e), e.span) from None",
        "raise error",
        ("tests/cli/test_run.py",),
    ),
    Mutant(
        "that IC3 gave up is not told",
        "verify.engines.bits.engine._Run._search",
        "self.no_invariant = NoInvariant(self.engine, who)",
        "pass",
        (OBSTACLES,),
    ),
    Mutant(
        "a proof that was given up after the answers is not told",
        "verify.ledger.Ledger.verdict",
        "_found(reaches[::-1])",
        "()",
        (OBSTACLES,),
    ),
    Mutant(
        "a question to the SAT solver has no limit of time",
        "verify.engines.bits.clauses.Clauses._solved_by_and_by",
        "self._solver.conf_budget(AT_ONCE)",
        "self._solver.conf_budget(AT_ONCE * 10_000)",
        (CLAUSES,),
    ),
    Mutant(
        "an engine that hangs has all the time",
        "verify.strategy.resumption.Steps.take",
        "None if is_last else ended",
        "None",
        (ENGINES,),
    ),
    Mutant(
        "whoever took too long is no failure",
        "verify.processes.Pool._end_late",
        "job.is_overdue = not job.is_late",
        "job.is_late = True",
        (ENGINES,),
    ),
    Mutant(
        "a proof that hangs has all the time of the rounds",
        "verify.strategy.each_claim_turn.asked",
        "tell.lasting(ended)",
        "pass",
        (ENGINES,),
    ),
    Mutant(
        "a configuration rounds numbers",
        "runtime.configuration.model._value",
        (
            "if isinstance(value, bool) or (isinstance(value, str) and not is_number(word "
            'or "")):\n'
            "    return value"
        ),
        (
            "if isinstance(value, bool) or (isinstance(value, str) and not is_number(word "
            'or "")):\n'
            "    return value\n"
            "# YAML would round it to a double, to 0 for one, and does not see that 1e300 "
            "is a number.\n"
            "if isinstance(value, float):\n"
            "    return int(value)"
        ),
        (WAYS_OF_PARAMS,),
    ),
    # what makes a violation another one
    Mutant(
        "every violation is a variant of another one",
        "verify.engines.bmc.engine.is_variant",
        "all(placed(robot, set()) for robot in wanted)",
        "True",
        (VARIETIES,),
    ),
    Mutant(
        "no violation is a variant of another one",
        "verify.engines.bmc.engine.is_variant",
        "all(placed(robot, set()) for robot in wanted)",
        "False",
        (VARIETIES,),
    ),
    Mutant(
        "a robot stands for another kind of robot",
        "verify.engines.bmc.engine.is_variant.placed",
        "i in tried or kinds[i] != kinds[robot]",
        "i in tried",
        (VARIETIES,),
    ),
    Mutant(
        "one robot stands for several",
        "verify.engines.bmc.engine.is_variant.placed",
        "i not in standing or placed(standing[i], tried)",
        "True",
        (VARIETIES,),
    ),
    Mutant(
        "the order of events makes no other way",
        "verify.engines.bmc.engine._within",
        "event in left",
        "event in having",
        (VARIETIES,),
    ),
    # δ
    Mutant(
        "rounds of any length can be asked for",
        "cli.arguments.delta",
        "LEAST_DELTA_S <= amount <= MOST_DELTA_S",
        "LEAST_DELTA_S <= amount",
        (LIMITS,),
    ),
    Mutant(
        "the shortest round is refused",
        "cli.arguments.delta",
        "LEAST_DELTA_S <= amount <= MOST_DELTA_S",
        "LEAST_DELTA_S < amount <= MOST_DELTA_S",
        (LIMITS,),
    ),
    Mutant(
        "a program states rounds of any length",
        "syntax.elaboration.instance._delta",
        "LEAST_DELTA_S <= value <= MOST_DELTA_S",
        "value <= MOST_DELTA_S",
        (LIMITS,),
    ),
    Mutant(
        "a configuration has rounds of any length",
        "runtime.configuration.forms",
        "Meta(ge=float(LEAST_DELTA_S), le=float(MOST_DELTA_S))",
        "Meta(gt=0)",
        (LIMITS,),
    ),
)
