"""Seeded mistakes in what is shown and kept of runs."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

GENERATED = "tests/refinement/test_generated.py"
ROUNDS = "tests/refinement/test_rounds.py"
REPLAY = "tests/traces/test_replay.py"
CLAIMS = "tests/verify/test_claims.py"
STORY = "tests/traces/test_story.py"
WITNESS = "tests/verify/test_witness.py"

SHOWN = (
    Mutant(
        "rounds of a changed program are counted from its change",
        "traces.story._moments",
        "step.round + 1 + behind",
        "step.round + 1",
        ("tests/traces/test_reloads.py",),
    ),
    Mutant(
        "the last turn is the one that breaks it",
        "traces.story._breaking",
        "tracks[0].truth.index(False)",
        "len(told) - 1",
        (STORY,),
    ),
    Mutant(
        "late rounds begin with the values of the start",
        "traces.story._moments",
        "table.texts[:] = table.texts_of(before)",
        "pass",
        (STORY,),
    ),
    Mutant(
        "who waits for no lock has found it taken",
        "traces.story._moments",
        "is_open and e.lock_classes & before.taken",
        "is_open or e.lock_classes & before.taken",
        (STORY,),
    ),
    Mutant(
        "operands that the rules do not look at have values",
        "traces.formula_values.FormulaReader._in_turn",
        "found and (found[-1].value in (stop, None))",
        "False",
        (STORY,),
    ),
    Mutant(
        "a quantifier goes on behind what decides it",
        "traces.formula_values.FormulaReader._quantified",
        "if decides:\n    break",
        "pass",
        (STORY,),
    ),
    Mutant(
        "an event that faults has effects",
        "semantics.rounds.run_event",
        "return Stepped(replace(configuration, fault=found), _shown(d, turned))",
        "configuration = replace(configuration, fault=found)",
        (GENERATED,),
    ),
    Mutant(
        "ports are told of a turn of the environment that faults",
        "semantics.rounds.evolved",
        "replace(configuration, fault=found)",
        "replace(configuration, robots=tuple(robots), fault=found)",
        (GENERATED,),
    ),
    Mutant(
        "a start that faults is shown",
        "semantics.rounds.faulted_start",
        "fault is None",
        "fault is None or stepped",
        (GENERATED,),
    ),
    Mutant(
        "output behind a fault is written",
        "semantics.statements.execute",
        "not m.faulted",
        "types",
        (GENERATED,),
    ),
    Mutant(
        "robots move behind a fault in what is kept of it",
        "verify.witness.replayed",
        "recording, phase = until(recording, last), _phase_of(last)",
        "phase = _phase_of(last)",
        (WITNESS,),
    ),
    Mutant(
        "a map that is read again in another order stays as it was",
        "runtime.robot.Robot.evolve",
        "name in self._ordered or value != held[name]",
        "value != held[name]",
        (ROUNDS, GENERATED),
    ),
    Mutant(
        "an argument that is no number is another one each time",
        "semantics.recordings.RecordedOracle.external",
        "not all(map(identical, answer.arguments, arguments))",
        "answer.arguments != arguments",
        (REPLAY,),
    ),
    Mutant(
        "an answer that is no number is another one each time",
        "semantics.recordings._consistent",
        "not identical(known.setdefault(question, answer.value), answer.value)",
        "known.setdefault(question, answer.value) != answer.value",
        (REPLAY,),
    ),
    Mutant(
        "a part of an entry is written without the rest",
        "syntax.analysis.footprint.updates",
        "place.is_below_key or place.variable in _origins(givers, _read(value))",
        "place.variable in _origins(givers, _read(value))",
        (CLAIMS, "tests/verify/test_lost_entries.py"),
    ),
    Mutant(
        "an entry that is written as a whole is updated",
        "syntax.core.Place.is_below_key",
        "self.steps[:-1]",
        "self.steps",
        (CLAIMS,),
    ),
    Mutant(
        "what is popped into a part of an entry updates nothing",
        "syntax.analysis.footprint.updates",
        "into.variable.home is Home.ALLWRITE",
        "into.variable.home is Home.LOCAL",
        (CLAIMS,),
    ),
    Mutant(
        "certificates forget that a part of an entry is written with the rest",
        "recheck.steps.updated",
        (
            "_keeps_the_rest(place) or any(\n"
            "    (read, place.variable) in flows or read == place.variable for read in "
            "_in(value)\n"
            ")"
        ),
        (
            "any(\n"
            "    (read, place.variable) in flows or read == place.variable for read in "
            "_in(value)\n"
            ")"
        ),
        (CLAIMS,),
    ),
    Mutant(
        "ports are named as the library keeps them",
        "syntax.core.Port.shown",
        "self.spelling or self.declaration.variable.name",
        "self.declaration.variable.name",
        ("tests/semantics/test_port_names.py",),
    ),
    Mutant(
        "of two names of a port the last one counts",
        "syntax.elaboration.library.mentioned.note",
        "(span.line, span.column) < (first.line, first.column)",
        "(span.line, span.column) > (first.line, first.column)",
        ("tests/semantics/test_port_names.py",),
    ),
    Mutant(
        "traces with the kept names of ports are not read",
        "traces.run_codec.Decoding.variables",
        "n.older if n.name not in held and n.older in held else n.name",
        "n.name",
        ("tests/semantics/test_port_names.py",),
    ),
    Mutant(
        "what would not be legal is kept",
        "api.traces.write_counterexample",
        "refused is not None",
        "refused is not None and not data",
        ("tests/cli/test_replay.py",),
    ),
    Mutant(
        "a claim is not asked of doubles",
        "refinement.rounding._property",
        "holds is True",
        "holds is None",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "what doubles break, too, departs",
        "refinement.rounding._property",
        "holds is True",
        "holds is not None",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "whether a loop closes is not asked of doubles",
        "refinement.rounding._lasso",
        "flaw is None",
        "flaw is None or True",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "guards are not asked of doubles",
        "traces.lassos._guard",
        "guard_of(d, system, robot, state, event, inputs)",
        "guard_of(EXACT, system, robot, state, event, inputs)",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "a contract is not asked of doubles",
        "refinement.rounding._contract",
        "promised is True",
        "promised is None",
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "a lost update is not asked of doubles",
        "refinement.rounding._update",
        'None if lost else Mended(f"on doubles, no update of {violation.name} is lost there")',
        'None if not lost else Mended(f"on doubles, no update of {violation.name} is lost there")',
        ("tests/refinement/test_rerunning.py",),
    ),
    Mutant(
        "numbers in rows of text have no sign",
        "sim.files.rows.to_parts",
        "whole[parts < 0] += _WHOLE",
        "whole[parts < 0] += 0",
        ("tests/sim/test_rows.py",),
    ),
    Mutant(
        "numbers in rows of text are cut",
        "sim.files.rows.to_parts",
        "np.rint(values.astype(np.float64) * _PARTS)",
        "np.trunc(values.astype(np.float64) * _PARTS)",
        ("tests/sim/test_rows.py",),
    ),
    Mutant(
        "straight paths of a file that grows are drawn in every part",
        "sim.files.mcap._Messages._seldom",
        "last = self._planned_s",
        "last: dict[int, float] = {}",
        ("tests/sim/test_mcap.py",),
    ),
    Mutant(
        "what one file of a campaign has is not known to the other",
        "api.campaign.make_campaign",
        "file.rows = tuple(course.rows())",
        "file.rows = file.rows",
        ("tests/api/test_campaign_parquet.py",),
    ),
    Mutant(
        "a table of runs is not written when a campaign is cut off",
        "api.campaign_parquet.ParquetFile.__exit__",
        "self._is_behind",
        "False",
        ("tests/api/test_campaign_parquet.py",),
    ),
    Mutant(
        "violations in space are told in both orders of their robots",
        "sim.files.space.told_violations",
        "frozenset(one.robots)",
        "one.robots",
        ("tests/sim/test_files.py",),
    ),
    Mutant(
        "labels of violations in space cover each other",
        "sim.files.space._draw_violations",
        "_NEXT_LABEL_M * below",
        "0",
        ("tests/sim/test_files.py",),
    ),
    Mutant(
        "a bag is committed at its end only",
        "sim.files.rosbag._Open.close",
        "self._storage.conn.commit()",
        "pass",
        ("tests/sim/test_files.py",),
    ),
    Mutant(
        "a run on a cluster outlives who asked for it",
        "api.campaign_workers._on_worker",
        "_made(orders, unwanted())",
        "_made(orders)",
        ("tests/cli/test_campaigns.py",),
    ),
    Mutant(
        "who is blocked on its way is not told",
        "sim.standing.Watchman._blocked",
        "self.now_s - since_s >= BLOCKED_S - 1e-9",
        "self.now_s < since_s",
        ("tests/cli/test_standing.py",),
    ),
    Mutant(
        "what is not touched is named",
        "sim.vehicles.contact.Floor.touched",
        "body.each_arbiter(note)",
        "found.update(dict.fromkeys(self._known.values()))",
        ("tests/cli/test_standing.py",),
    ),
    Mutant(
        "a refused run is kept when it has been made smaller",
        "api.refinement.refine_loaded",
        "RefusedRun(one.outcome, _again(request, one)).kept(request.save)",
        "RefusedRun(one.outcome, _again(request, one))",
        ("tests/cli/test_check_refinement.py",),
    ),
    Mutant(
        "a start that is refused leaves the folder of journals",
        "api.deploy_run._noting",
        "one.rmdir()",
        "pass",
        ("tests/cli/test_refused_starts.py",),
    ),
    Mutant(
        "where a model faults other robots have moved",
        "runtime.engine.RoundEngine.environment_turn",
        "vars(robot).update(ports)",
        "pass",
        ("tests/refinement/test_faults.py",),
    ),
    Mutant(
        "what koord has written is refused for its size",
        "api.files.read_written",
        "None if os.path.isfile(path) else LARGEST_FILE",
        "LARGEST_FILE",
        ("tests/cli/test_replay.py",),
    ),
    Mutant(
        "misspelt names of other languages suggest nothing",
        "syntax.elaboration.phrases.did_you_mean",
        "closest(name, known) or _misspelt(name, known)",
        "closest(name, known)",
        ("tests/syntax/test_cures.py",),
    ),
    # time, and what is unknown
    Mutant(
        "what was spent on a claim before does not count",
        "verify.ledger.Ledger.spent",
        "self.before.get(claim, 0.0) + _together(self._spans.get(claim, ()))",
        "_together(self._spans.get(claim, ()))",
        ("tests/verify/test_ledger.py",),
    ),
    Mutant(
        "a claim is charged for those that are looked at before it",
        "verify.ledger.Ledger.waiting",
        "self._since = None",
        "pass",
        ("tests/verify/test_ledger.py",),
    ),
    Mutant(
        "what is spent on all together does not count for each",
        "verify.strategy.time_limits.verify_apart",
        "max(0.0, claim_s - (time.monotonic() - started))",
        "claim_s",
        ("tests/verify/strategy/test_time_limits.py",),
    ),
    Mutant(
        "what a process told of before it was ended is lost",
        "verify.strategy.time_limits._Asking._known",
        "past.verdict(claim.name)",
        "None",
        ("tests/verify/strategy/test_time_limits.py",),
    ),
    Mutant(
        "a variable that cannot be followed is not named",
        "verify.engines.explicit.finiteness._starts",
        "NotFinite(reason, entry.span, name)",
        "NotFinite(reason, entry.span)",
        ("tests/verify/test_obstacles.py",),
    ),
    Mutant(
        "what was not looked at to the end is not told",
        "verify.vacuity.analysis.vacuities",
        "not left.known",
        "left.known and given_up",
        ("tests/verify/vacuity/test_unlooked.py",),
    ),
)
