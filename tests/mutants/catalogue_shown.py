"""Seeded mistakes in what is shown and kept of runs."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

GENERATED = "tests/refinement/test_generated.py"
ROUNDS = "tests/refinement/test_rounds.py"
REPLAY = "tests/semantics/test_replay.py"
CLAIMS = "tests/verify/test_claims.py"
WITNESS = "tests/verify/test_witness.py"

SHOWN = (
    Mutant(
        "an event that faults has effects",
        "semantics/rounds.py",
        "        return Stepped(replace(configuration, fault=found), _shown(d, turned))\n",
        "        configuration = replace(configuration, fault=found)\n",
        (GENERATED,),
    ),
    Mutant(
        "ports are told of a turn of the environment that faults",
        "semantics/rounds.py",
        "        return Stepped(replace(configuration, fault=found))\n",
        "        return Stepped(\n"
        "            replace(configuration, robots=tuple(robots), fault=found)\n"
        "        )\n",
        (GENERATED,),
    ),
    Mutant(
        "a start that faults is shown",
        "semantics/rounds.py",
        "    if fault is None:\n        return stepped\n",
        "    if fault is None or stepped:\n        return stepped\n",
        (GENERATED,),
    ),
    Mutant(
        "output behind a fault is written",
        "semantics/statements.py",
        "            if not m.faulted:\n",
        "            if types:\n",
        (GENERATED,),
    ),
    Mutant(
        "robots move behind a fault in what is kept of it",
        "verify/witness.py",
        "        recording, phase = until(recording, last), _phase_of(last)\n",
        "        phase = _phase_of(last)\n",
        (WITNESS,),
    ),
    Mutant(
        "a map that is read again in another order stays as it was",
        "runtime/robot.py",
        "if name in self._ordered or value != held[name]:",
        "if value != held[name]:",
        (ROUNDS, GENERATED),
    ),
    Mutant(
        "an argument that is no number is another one each time",
        "semantics/execution.py",
        "if not all(map(identical, answer.arguments, arguments)):",
        "if answer.arguments != arguments:",
        (REPLAY,),
    ),
    Mutant(
        "an answer that is no number is another one each time",
        "semantics/execution.py",
        "if not identical(known.setdefault(question, answer.value), answer.value):",
        "if known.setdefault(question, answer.value) != answer.value:",
        (REPLAY,),
    ),
    Mutant(
        "a part of an entry is written without the rest",
        "semantics/races.py",
        "place.is_below_key or place.variable in _origins(givers, _read(value))",
        "place.variable in _origins(givers, _read(value))",
        (CLAIMS, "tests/verify/test_lost_entries.py"),
    ),
    Mutant(
        "an entry that is written as a whole is updated",
        "syntax/core.py",
        "return any(isinstance(step, KeyStep) for step in self.steps[:-1])",
        "return any(isinstance(step, KeyStep) for step in self.steps)",
        (CLAIMS,),
    ),
    Mutant(
        "what is popped into a part of an entry updates nothing",
        "semantics/races.py",
        "if into is not None and into.variable.home is Home.ALLWRITE and into.is_below_key:",
        "if into is not None and into.variable.home is Home.LOCAL and into.is_below_key:",
        (CLAIMS,),
    ),
    Mutant(
        "certificates forget that a part of an entry is written with the rest",
        "recheck/updates.py",
        "if _keeps_the_rest(place) or any(",
        "if any(",
        (CLAIMS,),
    ),
    Mutant(
        "ports are named as the library keeps them",
        "syntax/core.py",
        "return self.spelling or self.declaration.variable.name",
        "return self.declaration.variable.name",
        ("tests/semantics/test_port_names.py",),
    ),
    Mutant(
        "of two names of a port the last one counts",
        "syntax/elaborate/survey.py",
        "if (span.line, span.column) < (first.line, first.column):",
        "if (span.line, span.column) > (first.line, first.column):",
        ("tests/semantics/test_port_names.py",),
    ),
    Mutant(
        "traces with the kept names of ports are not read",
        "semantics/traces/decode_runs.py",
        "names = [n.older if n.name not in held and n.older in held else n.name for n in among]",
        "names = [n.name for n in among]",
        ("tests/semantics/test_port_names.py",),
    ),
    Mutant(
        "what would not be legal is kept",
        "cli/traces.py",
        "    if refused is not None:\n        step",
        "    if refused is not None and not data:\n        step",
        ("tests/cli/test_replay.py",),
    ),
    Mutant(
        "a claim is not asked of doubles",
        "refinement/rounding.py",
        "if holds is True else None",
        "if holds is None else None",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "what doubles break, too, departs",
        "refinement/rounding.py",
        "if holds is True else None",
        "if holds is not None else None",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "whether a loop closes is not asked of doubles",
        "refinement/rounding.py",
        "return None if flaw is None else Mended(",
        "return None if flaw is None or True else Mended(",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "guards are not asked of doubles",
        "semantics/lassos.py",
        "guard_of(d, system",
        "guard_of(EXACT, system",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "a contract is not asked of doubles",
        "refinement/rounding.py",
        "promised is True and of.name",
        "promised is None and of.name",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "a lost update is not asked of doubles",
        "refinement/rounding.py",
        "None if lost else Mended",
        "None if not lost else Mended",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "a bag is committed at its end only",
        "sim/files/rosbag.py",
        "        self._storage.conn.commit()\n",
        "        pass\n",
        ("tests/sim/test_files.py",),
    ),
    Mutant(
        "a run on a cluster outlives who asked for it",
        "cli/campaigns.py",
        "    return _tried(order, is_unwanted)\n",
        "    return _tried(order)\n",
        ("tests/cli/test_campaigns.py",),
    ),
    Mutant(
        "who is blocked on its way is not told",
        "sim/standing.py",
        "elif self.now_s - known[1] >= _BLOCKED_S - 1e-9:",
        "elif self.now_s < known[1]:",
        ("tests/cli/test_standing.py",),
    ),
    Mutant(
        "what is nearest is not what blocks",
        "sim/standing.py",
        "apart, why, what = min(near, key",
        "apart, why, what = max(near, key",
        ("tests/cli/test_standing.py",),
    ),
    Mutant(
        "where a model faults other robots have moved",
        "runtime/engine/fleet.py",
        "            vars(robot).update(ports)",
        "            pass",
        ("tests/refinement/test_faults.py",),
    ),
    Mutant(
        "what koord has written is refused for its size",
        "cli/files.py",
        "largest = None if path != DASH and os.path.isfile(path) else LARGEST_FILE",
        "largest = LARGEST_FILE",
        ("tests/cli/test_replay.py",),
    ),
    Mutant(
        "misspelt names of other languages suggest nothing",
        "syntax/elaborate/suggest.py",
        "closest(name, known) or _misspelt(name, known)",
        "closest(name, known)",
        ("tests/syntax/test_cures.py",),
    ),
    # time, and what is unknown
    Mutant(
        "what was spent on a claim before does not count",
        "verify/ledger.py",
        "self.before.get(claim, 0.0) + _together(",
        "_together(",
        ("tests/verify/test_ledger.py",),
    ),
    Mutant(
        "a claim is charged for those that are looked at before it",
        "verify/ledger.py",
        "        self._put_down_time()\n        self._since = None\n",
        "        self._put_down_time()\n",
        ("tests/verify/test_ledger.py",),
    ),
    Mutant(
        "what is spent on all together does not count for each",
        "verify/apart.py",
        "own_s = max(0.0, claim_s - (time.monotonic() - started))",
        "own_s = claim_s",
        ("tests/verify/test_apart.py",),
    ),
    Mutant(
        "what a process told of before it was ended is lost",
        "verify/apart.py",
        "            verdict = past.verdict(claim.name)\n",
        "            verdict = None\n",
        ("tests/verify/test_apart.py",),
    ),
    Mutant(
        "a variable that cannot be followed is not named",
        "semantics/search/finite.py",
        "yield NotFinite(reason, entry.span, name)",
        "yield NotFinite(reason, entry.span)",
        ("tests/verify/test_obstacles.py",),
    ),
    Mutant(
        "what was not looked at to the end is not told",
        "verify/vacuity.py",
        "    if not left.known:\n        given_up",
        "    if left.known and given_up:\n        given_up",
        ("tests/verify/test_unlooked.py",),
    ),
)
