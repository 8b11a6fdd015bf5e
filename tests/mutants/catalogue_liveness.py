"""Mistakes in what is said of whole runs: fairness forgotten, cycles accepted that are none."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

MEANING = "tests/semantics/test_liveness.py"
LASSOS = "tests/agreement/test_lassos.py"
BITS = "tests/verify/live/test_bits.py"
ENGINES = "tests/agreement/test_live_engines.py"

LIVENESS = (
    # fairness, and lassos
    Mutant(
        "a robot that is passed over for ever is dealt with fairly",
        "semantics/lassos.py",
        "if all(here[robot].ready and not ran(round_, robot)",
        "if all(not here[robot].ready and not ran(round_, robot)",
        (MEANING,),
    ),
    Mutant(
        "who asks for a lock in vain is dealt with fairly",
        "semantics/lassos.py",
        "if asked and not any(k in classes_of(system, round_, robot)",
        "if asked and not any(k not in classes_of(system, round_, robot)",
        (MEANING,),
    ),
    Mutant(
        "what is expected need not come about",
        "semantics/lassos.py",
        "        if breaks(lasso, response):\n            whose",
        "        if breaks(lasso, response) and response.trigger is None:\n            whose",
        (MEANING,),
    ),
    Mutant(
        "a lasso need not close",
        "semantics/lassos.py",
        "    if found:\n        told",
        "    if len(found) > 9:\n        told",
        (MEANING,),
    ),
    Mutant(
        "a goal that comes once is enough for ever",
        "semantics/lassos.py",
        "    after = range(last + 1, len(met))\n",
        "    after = range(len(met)) if last < 0 else range(0)\n",
        (LASSOS, MEANING),
    ),
    # why lassos are fair, and what would exclude them
    Mutant(
        "an event is enabled whenever its robot is ready",
        "semantics/excuses.py",
        "if able[n].events[position])",
        "if able[n].ready)",
        ("tests/semantics/test_excuses.py",),
    ),
    Mutant(
        "rounds in which a robot is not ready are those in which it skips",
        "semantics/excuses.py",
        "if not able[n].ready),",
        "if n not in runs),",
        ("tests/semantics/test_excuses.py",),
    ),
    Mutant(
        "an expectation is suggested that does not exclude the lasso",
        "verify/live/expecting.py",
        'if flaw is None or flaw.rule != "FAIR-ASSUME" or',
        'if flaw is not None and flaw.rule != "FAIR-ASSUME" or flaw is not None and',
        ("tests/verify/live/test_expecting.py",),
    ),
    Mutant(
        "an expectation is suggested that no run meets",
        "verify/live/expecting.py",
        "return not lively(system, (stated,), limits, most_edges=FEW_EDGES).is_empty",
        "return bool(lively(system, (stated,), limits, most_edges=FEW_EDGES))",
        ("tests/verify/live/test_expecting.py",),
    ),
    # the search for fair cycles
    Mutant(
        "a stopped robot is ready",
        "semantics/search/menus.py",
        "        self.ready |= guard.is_on\n",
        "        self.ready |= not guard.is_off or guard.is_on\n        self.ready |= urgent\n",
        (LASSOS,),
    ),
    Mutant(
        "the justice of robots is dropped",
        "semantics/search/live.py",
        "met = (1 << count) - 1 if of.robots else 0",
        "met = 0 if of.robots else 0",
        (MEANING, LASSOS),
    ),
    Mutant(
        "the justice of the last robot is dropped",
        "semantics/search/live.py",
        "met = (1 << count) - 1 if of.robots else 0",
        "met = (1 << count - 1) - 1 if of.robots else 0",
        (MEANING, LASSOS),
    ),
    Mutant(
        "locks are granted as it comes",
        "semantics/search/live.py",
        "return Wanted(met, (1 << len(self._locks)) - 1 if of.locks else 0)",
        "return Wanted(met, 0 if of.locks else 0)",
        (MEANING,),
    ),
    Mutant(
        "expectations are forgotten",
        "semantics/search/live.py",
        "met |= (1 << count + k) if response.name in of.expectations else 0",
        "met |= (1 << count + k) if response.name not in of.expectations else 0",
        (MEANING, LASSOS),
    ),
    Mutant(
        "what was owed is forgotten from round to round",
        "semantics/search/live.py",
        "if owed & bit or trigger.holds(state):",
        "if trigger.holds(state):",
        (LASSOS, MEANING),
    ),
    Mutant(
        "skips count as runs",
        "semantics/search/live.py",
        "ran = [course.runs for course in joint.courses]",
        "ran = [course.runs or course.skips for course in joint.courses]",
        (MEANING, LASSOS),
    ),
    Mutant(
        "an event that changes nothing is not told from a skip",
        "semantics/search/live.py",
        "menus = Menus(system, vault, self._commits, relaxed=True, labelled=True)",
        "menus = Menus(system, vault, self._commits, relaxed=False, labelled=False)",
        (MEANING, LASSOS),
    ),
    Mutant(
        "events are not told apart by their locks",
        "semantics/search/menus.py",
        "        elif self.menus._labelled:\n            apart = classes_of",
        "        elif not self.menus._labelled:\n            apart = classes_of",
        (MEANING, LASSOS),
    ),
    Mutant(
        "one edge stands for all that lead to a node",
        "semantics/search/live.py",
        "    edges[:] = [e for e in edges if e.meets & ~new.meets or e.grants & ~new.grants]\n",
        "    edges[:] = []\n",
        (MEANING, LASSOS),
    ),
    Mutant(
        "robots that may change places are one state in cycles too",
        "semantics/search/live.py",
        "                target = self._number((*robots, *shared), nodes.owed[node])\n",
        "                target = self._number((*sorted(robots), *shared), nodes.owed[node])\n",
        (MEANING, LASSOS),
    ),
    Mutant(
        "a set without an inner edge is a cycle",
        "semantics/search/fair_cycles.py",
        "if not inner or wanted.met & ~met:",
        "if wanted.met & ~met:",
        (MEANING, LASSOS),
    ),
    Mutant(
        "a set is accepted though a condition is not met",
        "semantics/search/fair_cycles.py",
        "if not inner or wanted.met & ~met:",
        "if not inner or not (wanted.met & met) and wanted.met:",
        (MEANING, LASSOS),
    ),
    Mutant(
        "a set in which somebody is denied is not looked into",
        "semantics/search/fair_cycles.py",
        "        left = [node for node in part if not graph.asks[node] & denied]",
        "        left: list[int] = [node for node in part if not denied]",
        (LASSOS, MEANING),
    ),
    Mutant(
        "who is denied does not matter",
        "semantics/search/fair_cycles.py",
        "        if not denied:\n            return part",
        "        if denied >= 0:\n            return part",
        (MEANING,),
    ),
    Mutant(
        "what leads to nothing is only looked for at the start",
        "semantics/search/live.py",
        "starts = [n for n, s in enumerate(nodes.states) if wanting[n] and trigger.holds(s)]",
        "starts = [n for n in nodes.starts if wanting[n] and trigger.holds(nodes.states[n])]",
        (MEANING, LASSOS),
    ),
    # circuits
    Mutant(
        "on circuits a robot is never ready",
        "verify/live/monitors.py",
        "met = g.either(self._ran(robot, None), g.both(ready, self._running(robot)) ^ 1)",
        "met = g.either(self._ran(robot, None), g.both(ready, self._running(robot)) | 1)",
        (BITS,),
    ),
    Mutant(
        "on circuits a stopped robot has to run",
        "verify/live/monitors.py",
        "g.both(ready, self._running(robot)) ^ 1)",
        "ready ^ 1)",
        (BITS,),
    ),
    Mutant(
        "on circuits locks are granted to whoever runs",
        "verify/live/monitors.py",
        'found.append(Grant(f"lock {k}@{robot}", asked, self._ran(robot, k)))',
        'found.append(Grant(f"lock {k}@{robot}", asked, TRUE))',
        (BITS,),
    ),
    Mutant(
        "on circuits what is owed is paid",
        "verify/live/monitors.py",
        "conditions.append(Condition(other.name, name, owed ^ 1))",
        "conditions.append(Condition(other.name, name, TRUE))",
        (BITS,),
    ),
    Mutant(
        "the goal is pending from the start though something else leads to it",
        "verify/live/monitors.py",
        "begun, latch = g.input(name), FALSE\n",
        "begun, latch = g.input(name), TRUE\n",
        (BITS, ENGINES),
    ),
    Mutant(
        "whatever changes settles",
        "verify/live/counting.py",
        "            if clauses.solve([now, -then]) and clauses.solve([-now, then]):\n"
        "                continue\n",
        "            if clauses.solve([now, -then]) and now == 0:\n                continue\n",
        (BITS,),
    ),
    Mutant(
        "there is no more asking though there is",
        "verify/live/counting.py",
        "required.append(g.both(over, grant.asked) ^ 1)",
        "required.append(TRUE)",
        (BITS,),
    ),
    Mutant(
        "a loop of circuits need not close",
        "verify/live/loops.py",
        "wanted.append(g.both(choice, self._closes(k) ^ 1) ^ 1)",
        "wanted.append(g.both(choice, choice))",
        (BITS, ENGINES),
    ),
    Mutant(
        "a loop of circuits need not be fair",
        "verify/live/loops.py",
        "wanted += [some(condition.met) for condition in watched.conditions]",
        "wanted += [some(condition.met) | 1 for condition in watched.conditions]",
        (BITS, ENGINES),
    ),
    Mutant(
        "a path of one point may be one of none",
        "verify/bits/axioms.py",
        "                self._required[part].append(same ^ 1)\n",
        "                pass\n",
        (BITS,),
    ),
    Mutant(
        "lassos in which a function contradicts itself are shown to the judge",
        "verify/live/loops.py",
        "            if changed:\n",
        "            if not told:\n",
        (BITS,),
    ),
)
