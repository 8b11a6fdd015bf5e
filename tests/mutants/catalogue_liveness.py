"""Mistakes in what is said of whole runs: fairness forgotten, cycles accepted that are none."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

MEANING = "tests/semantics/test_liveness.py"
LASSOS = "tests/agreement/test_lassos.py"
LOOKOUT = "tests/agreement/test_fair_lookout.py"
BITS = "tests/verify/engines/bits/test_liveness_engine.py"
ENGINES = "tests/agreement/test_live_engines.py"

LIVENESS = (
    # fairness, and lassos
    Mutant(
        "a robot that is passed over for ever is dealt with fairly",
        "traces.lassos._unfair",
        "here[robot].ready",
        "not here[robot].ready",
        (MEANING,),
    ),
    Mutant(
        "who asks for a lock in vain is dealt with fairly",
        "traces.lassos._unfair",
        "k in classes_of(system, round_, robot)",
        "k not in classes_of(system, round_, robot)",
        (MEANING,),
    ),
    Mutant(
        "what is expected need not come about",
        "traces.lassos._unfair",
        "breaks(lasso, response)",
        "breaks(lasso, response) and response.trigger is None",
        (MEANING,),
    ),
    Mutant(
        "a lasso need not close",
        "traces.lassos._shape",
        (
            "if found:\n"
            '    told = ", ".join(f"{change.name}: {change.old} and {change.new}" for '
            "change in found)\n"
            '    yield Flaw("LASSO", f"the run does not end where its loop begins ({told})")'
        ),
        (
            "if len(found) > 9:\n"
            '    told = ", ".join(f"{change.name}: {change.old} and {change.new}" for '
            "change in found)\n"
            '    yield Flaw("LASSO", f"the run does not end where its loop begins ({told})")'
        ),
        (MEANING,),
    ),
    Mutant(
        "a goal that comes once is enough for ever",
        "traces.lassos._since",
        "range(last + 1, len(met))",
        "range(len(met)) if last < 0 else range(0)",
        (LASSOS, MEANING),
    ),
    # why lassos are fair, and what would exclude them
    Mutant(
        "an event is enabled whenever its robot is ready",
        "traces.fairness._of_robot",
        "able[n].events[position]",
        "able[n].ready",
        ("tests/traces/test_fairness.py",),
    ),
    Mutant(
        "rounds in which a robot is not ready are those in which it skips",
        "traces.fairness._of_robot",
        "not able[n].ready",
        "n not in runs",
        ("tests/traces/test_fairness.py",),
    ),
    Mutant(
        "an expectation is suggested that does not exclude the lasso",
        "verify.fairness_suggestions._under",
        'flaw is None or flaw.rule != "FAIR-ASSUME" or "external function" in flaw.reason',
        (
            'flaw is not None and flaw.rule != "FAIR-ASSUME" or flaw is not None and '
            '"external function" in flaw.reason'
        ),
        ("tests/verify/test_fairness_suggestions.py",),
    ),
    Mutant(
        "an expectation is suggested that no run meets",
        "verify.fairness_suggestions._is_met",
        "not lively(system, (stated,), limits, most_edges=FEW_EDGES).is_empty",
        "bool(lively(system, (stated,), limits, most_edges=FEW_EDGES))",
        ("tests/verify/test_fairness_suggestions.py",),
    ),
    # the search for fair cycles
    Mutant(
        "a stopped robot is ready",
        "verify.engines.explicit.robot_transitions._MenuMaker._consider",
        "self.ready |= guard.is_on",
        "self.ready |= not guard.is_off or guard.is_on\nself.ready |= urgent",
        (LASSOS,),
    ),
    Mutant(
        "the justice of robots is dropped",
        "verify.engines.explicit.fair_answers.FairAnswers._wanted",
        "(1 << count) - 1",
        "0",
        (MEANING, LASSOS),
    ),
    Mutant(
        "the justice of the last robot is dropped",
        "verify.engines.explicit.fair_answers.FairAnswers._wanted",
        "1 << count",
        "1 << count - 1",
        (MEANING, LASSOS),
    ),
    Mutant(
        "locks are granted as it comes",
        "verify.engines.explicit.fair_answers.FairAnswers._wanted",
        "(1 << len(self._locks)) - 1",
        "0",
        (MEANING,),
    ),
    Mutant(
        "shorter lassos are looked for where no cycle is",
        "verify.engines.explicit.fair_answers._Component.__contains__",
        "self._numbers[node] == self._number",
        "self._numbers[node] != self._number",
        (LOOKOUT,),
    ),
    Mutant(
        "what one claim breaks is told of all",
        "verify.engines.explicit.fair_lookout.Lookout._are_violated",
        "not self._answers.is_violated(stated)",
        "not any(map(self._answers.is_violated, self._properties))",
        (LOOKOUT,),
    ),
    Mutant(
        "a lasso is told though a shorter one may follow",
        "verify.engines.explicit.fair_lookout.Lookout.look",
        "is_last or self._longest <= rounds + 1",
        "True",
        (LOOKOUT,),
    ),
    Mutant(
        "rounds that are half looked at count as whole",
        "verify.engines.explicit.fair_search._Search._whole",
        "len(self._nodes.edges) == self._level",
        "True",
        (LOOKOUT,),
    ),
    Mutant(
        "expectations are forgotten",
        "verify.engines.explicit.fair_answers.FairAnswers._wanted",
        "response.name in of.expectations",
        "response.name not in of.expectations",
        (MEANING, LASSOS),
    ),
    Mutant(
        "what was owed is forgotten from round to round",
        "verify.engines.explicit.fair_search._Search.owes",
        "owed & bit or trigger.holds(state)",
        "trigger.holds(state)",
        (LASSOS, MEANING),
    ),
    Mutant(
        "skips count as runs",
        "verify.engines.explicit.fair_search._Search._label_of",
        "course.runs",
        "course.runs or course.skips",
        (MEANING, LASSOS),
    ),
    Mutant(
        "an event that changes nothing is not told from a skip",
        "verify.engines.explicit.fair_search._Search.__init__",
        "Menus(system, vault, self._commits, relaxed=True, labelled=True)",
        "Menus(system, vault, self._commits, relaxed=False, labelled=False)",
        (MEANING, LASSOS),
    ),
    Mutant(
        "events are not told apart by their locks",
        "verify.engines.explicit.robot_transitions._MenuMaker._add",
        "self.menus._labelled",
        "not self.menus._labelled",
        (MEANING, LASSOS),
    ),
    Mutant(
        "one edge stands for all that lead to a node",
        "verify.engines.explicit.fair_cycles.add_edge",
        "[e for e in edges if e.meets & ~new.meets or e.grants & ~new.grants]",
        "[]",
        (MEANING, LASSOS),
    ),
    Mutant(
        "robots that may change places are one state in cycles too",
        "verify.engines.explicit.fair_search._Search.ways",
        "(*robots, *shared)",
        "(*sorted(robots), *shared)",
        (MEANING, LASSOS),
    ),
    Mutant(
        "a set without an inner edge is a cycle",
        "verify.engines.explicit.fair_cycles.fair_set",
        "not inner or wanted.met & ~met",
        "wanted.met & ~met",
        (MEANING, LASSOS),
    ),
    Mutant(
        "a set is accepted though a condition is not met",
        "verify.engines.explicit.fair_cycles.fair_set",
        "wanted.met & ~met",
        "not (wanted.met & met) and wanted.met",
        (MEANING, LASSOS),
    ),
    Mutant(
        "a set in which somebody is denied is not looked into",
        "verify.engines.explicit.fair_cycles.fair_set",
        "left = [node for node in part if not graph.asks[node] & denied]",
        "left: list[int] = [node for node in part if not denied]",
        (LASSOS, MEANING),
    ),
    Mutant(
        "who is denied does not matter",
        "verify.engines.explicit.fair_cycles.fair_set",
        "not denied",
        "denied >= 0",
        (MEANING,),
    ),
    Mutant(
        "what leads to nothing is only looked for at the start",
        "verify.engines.explicit.fair_search._Search.region",
        "[n for n, s in enumerate(nodes.states) if wanting[n] and trigger.holds(s)]",
        "[n for n in nodes.starts if wanting[n] and trigger.holds(nodes.states[n])]",
        (MEANING, LASSOS),
    ),
    Mutant(
        "of robots that may change places nobody is looked at",
        "verify.different_responses.different_responses",
        "group[1:]",
        "group",
        (MEANING, LASSOS),
    ),
    # circuits
    Mutant(
        "on circuits a robot is never ready",
        "verify.engines.bits.liveness_to_safety.Watching._robots",
        "g.both(ready, self._running(robot)) ^ 1",
        "g.both(ready, self._running(robot)) | 1",
        (BITS,),
    ),
    Mutant(
        "on circuits a stopped robot has to run",
        "verify.engines.bits.liveness_to_safety.Watching._robots",
        "g.both(ready, self._running(robot))",
        "ready",
        (BITS,),
    ),
    Mutant(
        "on circuits locks are granted to whoever runs",
        "verify.engines.bits.liveness_to_safety.Watching._grants",
        "self._ran(robot, k)",
        "TRUE",
        (BITS,),
    ),
    Mutant(
        "on circuits what is owed is paid",
        "verify.engines.bits.liveness_to_safety.Watching.watched",
        "owed ^ 1",
        "TRUE",
        (BITS,),
    ),
    Mutant(
        "the goal is pending from the start though something else leads to it",
        "verify.engines.bits.liveness_to_safety.Watching.watched",
        "g.input(name), FALSE",
        "g.input(name), TRUE",
        (BITS, ENGINES),
    ),
    Mutant(
        "whatever changes settles",
        "verify.engines.bits.liveness_to_safety.settling",
        "clauses.solve([-now, then])",
        "now == 0",
        (BITS,),
    ),
    Mutant(
        "there is no more asking though there is",
        "verify.engines.bits.liveness_to_safety.counting",
        "g.both(over, grant.asked) ^ 1",
        "TRUE",
        (BITS,),
    ),
    Mutant(
        "a loop of circuits need not close",
        "verify.engines.bits.lasso_unrolling.LassoSearch.lassos",
        "g.both(choice, self._closes(k) ^ 1) ^ 1",
        "g.both(choice, choice)",
        (BITS, ENGINES),
    ),
    Mutant(
        "a loop of circuits need not be fair",
        "verify.engines.bits.lasso_unrolling.LassoSearch._fair",
        "some(condition.met)",
        "some(condition.met) | 1",
        (BITS, ENGINES),
    ),
    Mutant(
        "a path of one point may be one of none",
        "verify.engines.bits.axioms.Axioms._constructions",
        "self._required[part].append(same ^ 1)",
        "pass",
        (BITS,),
    ),
    Mutant(
        "lassos in which a function contradicts itself are shown to the judge",
        "verify.engines.bits.lasso_unrolling.LassoSearch.lassos",
        "if changed:\n    wanted += changed\n    continue",
        "if not told:\n    wanted += changed\n    continue",
        (BITS,),
    ),
)
