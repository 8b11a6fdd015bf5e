"""Mistakes in the machine code of claims, and in who believes it."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

CLAIMS_BY_CODE = "tests/runtime/test_claims_by_code.py"
REFINED = "tests/refinement/test_kernels.py"
TURNS = "tests/runtime/test_columns.py"
LATE = "tests/sim/test_late_sensors.py"
RUNS = "tests/sim/test_kernels.py"

JUDGING = (
    Mutant(
        "machine code that is sure of one claim is sure of all",
        "runtime.monitors.StateMonitor.is_sure",
        "all(map(judge.is_sure, some.methods))",
        "any(map(judge.is_sure, some.methods))",
        (RUNS, CLAIMS_BY_CODE),
    ),
    Mutant(
        "machine code takes doubt about a claim for a yes",
        "runtime.compile.machine.claims.ClaimsCode._look",
        "b.icmp_unsigned('!=', said, word(YES))",
        "b.icmp_unsigned('==', said, word(0))",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "machine code takes all claims to hold",
        "runtime.compile.machine.claims.ClaimsCode._look",
        "b.icmp_unsigned('!=', said, word(YES))",
        "b.icmp_unsigned('>', said, word(IN_DOUBT))",
        (REFINED,),
    ),
    Mutant(
        "claims by code read what robots have that there are not",
        "runtime.compile.machine.expressions._held_cells",
        "body.doubt_if(body.b.icmp_unsigned('>=', robot, body.count))",
        "robot = body.b.urem(robot, body.count)",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "claims about other robots read the first one's variables",
        "runtime.compile.machine.claims.ClaimsCode._holds",
        "(robot, kind)",
        "(one, kind)",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "kinds of robots have the columns of the first",
        "runtime.compile.machine.expressions._held_cells",
        "body.layout.column(kind, _of_kind(body, kind, place.variable))",
        "body.layout.column(0, _of_kind(body, 0, place.variable))",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "by code some is all",
        "runtime.compile.machine.expressions._quantified",
        "(head, decided) if is_forall else (decided, head)",
        "(head, decided)",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "by code some of nobody is so",
        "runtime.compile.machine.expressions._quantified",
        "body.bit(is_forall)",
        "body.bit(True)",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "robots that have no room are not told",
        "runtime.columns.judging.CodeJudge._found_by",
        "count > self._room",
        "False",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "what was broken once is so for good by code",
        "runtime.monitors.StateMonitor._broken",
        "broken.clear()",
        "pass",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "changes that nobody asked about are forgotten",
        "runtime.monitors.StateMonitor.see",
        "only if self._is_noted else None",
        "only",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "claims are judged as other claims are",
        "runtime.columns.engine.ColumnEngine.judge",
        "self._judge is None or self._judge[0] is not watched",
        "self._judge is None",
        (CLAIMS_BY_CODE,),
    ),
    Mutant(
        "robots that are looked at have not been told where they are",
        "runtime.columns.engine.ColumnEngine.robots",
        "self._tell()",
        "pass",
        (LATE,),
    ),
    Mutant(
        "claims ask robots that do not know where they are",
        "runtime.columns.judging.CodeJudge.unsure",
        "self._tell()",
        "pass",
        (LATE,),
    ),
    Mutant(
        "events in doubt run where the robot was",
        "runtime.columns.engine.ColumnEngine._by_itself",
        "self._tell()",
        "pass",
        (LATE,),
    ),
    Mutant(
        "of two late places the last has its sign",
        "sim.reading.Reader._write_places",
        "column.told[late]",
        "self._host.sensed.position[late]",
        (LATE,),
    ),
    Mutant(
        "recordings do not hear of what is sensed",
        "runtime.columns.engine.ColumnEngine._sense",
        "one.values.ndim == 1",
        "False",
        (LATE,),
    ),
    Mutant(
        "recordings do not hear of what events change",
        "runtime.columns.engine.ColumnEngine._conclude",
        "self._touched.update(self._ran)",
        "pass",
        (LATE,),
    ),
    Mutant(
        "robots that were locked out seem to have skipped",
        "sim.observing.deeds_in",
        "deeds[had_events] = Idle.BLOCKED",
        "pass",
        (RUNS,),
    ),
    Mutant(
        "robots that have stopped seem to skip",
        "sim.observing.deeds_in",
        "deeds[stopped] = Idle.STOPPED",
        "pass",
        (RUNS,),
    ),
    Mutant(
        "what robots share they are never told",
        "runtime.columns.engine.ColumnEngine._conclude",
        "self._late |= changed",
        "pass",
        (TURNS,),
    ),
    Mutant(
        "columns begin with integers of more than 64 bits",
        "runtime.columns.columns._are_known",
        "bool(min(parts) >= _LEAST and max(parts) <= _GREATEST)",
        "True",
        (TURNS,),
    ),
    Mutant(
        "columns begin with what is not set",
        "runtime.columns.columns._are_known",
        "None in parts",
        "False",
        (TURNS,),
    ),
)
