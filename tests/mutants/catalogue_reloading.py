"""Mistakes in how a run goes on with another program."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

RULES = "tests/semantics/test_reloading.py"
RUNS = "tests/api/test_reloading.py"
EDITS = "tests/sim/test_edits.py"
TRACES = "tests/traces/test_reloads.py"

RELOADING = (
    Mutant(
        "a variable of another type keeps its value",
        "semantics.reloading._slots",
        "{(name, entry.variable.type): entry.variable.slot for name, entry in named}",
        "{(name, new[0].variable.type): entry.variable.slot for name, entry in named}",
        (RULES,),
    ),
    Mutant(
        "who goes on with another program has stopped no more",
        "semantics.reloading._going_on",
        "state.status",
        "d.const(0, INT)",
        (RULES,),
    ),
    Mutant(
        "what a robot ran keeps its number in another program",
        "semantics.reloading._going_on",
        "d.const(new, INT)",
        "d.const(old, INT)",
        (RULES,),
    ),
    Mutant(
        "robots go on with copies of what was shared before",
        "semantics.reloading._going_on",
        "store",
        "resumed.copy",
        (RULES,),
    ),
    Mutant(
        "a start that faults is gone on from",
        "semantics.reloading._check_sound",
        "found is not None",
        "found is None and faults is None",
        (RULES,),
    ),
    Mutant(
        "what became a shared variable is told as gone",
        "semantics.reloading._changed",
        "name not in are and name not in elsewhere",
        "name not in are",
        (RULES,),
    ),
    Mutant(
        "a recording gives numbers of variables away again",
        "sim.reloading.extended",
        "_joined(known.variables, one.variables, _key)",
        "_joined((), one.variables, _key)",
        (EDITS,),
    ),
    Mutant(
        "who asks is asked about new variables, too",
        "api.reloading.Reloading._dropped",
        "one.fate is not Fate.NEW",
        "True",
        (RUNS,),
    ),
    Mutant(
        "an edit that was saved again is asked about again",
        "api.reloading.Reloading.between_rounds",
        "self._asks and not edit.agreed",
        "self._asks",
        (RUNS,),
    ),
    Mutant(
        "a recording counts events as the new program does",
        "sim.reloading.Numbering.deeds",
        "self.events[self.agents[pid]][deeds[pid]]",
        "deeds[pid]",
        (EDITS, RUNS),
    ),
    Mutant(
        "hosts are those of a program that was refused",
        "sim.running.Simulation.reload",
        "host.take_on(were[0])",
        "host.take_on(cast.classes)",
        (RUNS,),
    ),
    Mutant(
        "claims of another program are looked at in the next round",
        "sim.running.Simulation.reload",
        "self._look(WatchPoint.RELOADED)",
        "self._look(WatchPoint.EVENTS) if not self.claims else None",
        (RUNS,),
    ),
    Mutant(
        "a program that was saved as it was is gone on with",
        "api.edits.FileEdits.look",
        "texts == self._texts",
        "texts is self._texts",
        (RUNS,),
    ),
    Mutant(
        "a list of earlier edits is gone on with one by one",
        "api.edits.ListedEdits.take",
        "while self._texts and self._texts[0][0] <= round_: _, text = self._texts.pop(0)",
        "if self._texts and self._texts[0][0] <= round_: _, text = self._texts.pop(0)",
        (RUNS,),
    ),
    Mutant(
        "replay begins anew where another program goes on",
        "traces.replay.replay",
        "Reached(part.system, replaying.last)",
        "None",
        (TRACES,),
    ),
    Mutant(
        "rounds of a later program are counted from its own beginning",
        "traces.replay._later",
        "step.round + first",
        "step.round",
        (TRACES,),
    ),
    Mutant(
        "claims of the first program are asked of later ones",
        "api.replay.replayed",
        "step.rule in ('INIT', 'RELOAD')",
        "step.rule == 'INIT'",
        (TRACES,),
    ),
    Mutant(
        "a cut trace of several programs ends as one of one program",
        "traces.unfinished.mended",
        "_LATER_END if _LATER.encode() in head else _END",
        "_END",
        (TRACES,),
    ),
    Mutant(
        "a trace that grows keeps its version",
        "traces.unfinished.GrowingTrace.grow",
        "self._raise_version()",
        "pass",
        (TRACES,),
    ),
)
