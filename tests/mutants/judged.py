"""Seeded mistakes in how deployed runs are judged: what robots tell, and what is made of it."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

MERGE = "tests/api/test_merge.py"
COMMANDS = "tests/cli/test_merge.py"
PARTS = "tests/refinement/test_parts.py"
DEPLOY = "tests/runtime/test_deploy.py"

#: What would let a run pass that is wrong, or blame robots for what was lost.
JUDGED = (
    Mutant(
        "two decisions of a round are as good as one",
        "refinement.hearing.Heard.hear",
        "self.decisions.setdefault(round_, decision) != decision",
        "self.decisions.setdefault(round_, decision) is None",
        (MERGE, COMMANDS),
    ),
    Mutant(
        "what was written is no part of a decision",
        "refinement.reports.shortened",
        "encode(decision)",
        "encode(decision.ran)",
        (PARTS,),
    ),
    Mutant(
        "a robot without a part was seen",
        "refinement.hearing.Heard.coverage",
        "pid not in self.tellers",
        "pid < 0",
        (MERGE,),
    ),
    Mutant(
        "robots are blamed for what others lost",
        "refinement.hearing.Heard.coverage",
        "(round_, robot) not in self.stood",
        "robot < 0",
        (MERGE,),
    ),
    Mutant(
        "a gap in what is known is passed over",
        "refinement.hearing.Heard.coverage",
        "max(self.decisions, default=INIT_ROUND) + 1",
        "next(k for k in range(10_000) if k not in self.decisions)",
        (MERGE, COMMANDS),
    ),
    Mutant(
        "a last round after which nobody looked has a turn of the environment",
        "refinement.trace_merge._Gathering.ran",
        "not self._is_whole(number, decision)",
        "decision.fault is not None",
        (MERGE,),
    ),
    Mutant(
        "lines that are missing are not missed",
        "refinement.part_reading.read_lines",
        "line.n != n",
        "line.n < 0",
        (PARTS, MERGE),
    ),
    Mutant(
        "a robot may tell of another one",
        "refinement.part_reading._Reading._own",
        "robot != self.whose.pid",
        "robot is self",
        (MERGE,),
    ),
    Mutant(
        "a part may go on as that of another run",
        "refinement.part_reading._Reading.read",
        "nameless(line) != nameless(self.head)",
        "line.pid < 0",
        (PARTS,),
    ),
    Mutant(
        "half a line stands before what a robot tells when it is back",
        "refinement.parts.PartWriter._write",
        "os.fstat(self._file).st_size != self._size",
        "self._size < 0",
        (PARTS,),
    ),
    Mutant(
        "a robot that is back numbers its lines anew",
        "refinement.parts.PartWriter._open",
        'begun.count(b"\\n")',
        "0",
        (PARTS,),
    ),
    Mutant(
        "reports that could not be written are missing without a word",
        "refinement.parts.PartWriter.tell",
        "self._untold += 1",
        "self._untold += 0",
        (PARTS,),
    ),
    Mutant(
        "who could not write all is accused of what is missing",
        "refinement.hearing.Heard.coverage",
        "self.gaps.items()",
        "()",
        (MERGE,),
    ),
    Mutant(
        "parts that tell more than the trace are removed",
        "api.deployment._Deployment.traced",
        "not merged.has_all_told",
        "not merged.trace",
        ("tests/cli/test_merge.py",),
    ),
    Mutant(
        "who does not wait for the judge loses what robots told",
        "api.deployment._Deployment.traced",
        "left = parts.unmerged(self.request.trace)",
        "left = parts.unmerged(self.request.trace); parts.remove()",
        ("tests/api/test_deployment.py",),
    ),
    Mutant(
        "a decision is taken for that of another digest",
        "refinement.part_reading._Reading._told",
        "(line.round, line.ran, line.skipped, line.fault or 0, line.digest)",
        "(line.round, line.ran, line.skipped, line.fault or 0)",
        (MERGE,),
    ),
    Mutant(
        "runs of one name are one run",
        "refinement.parts.difference",
        "one.run != other.run",
        "one.pid < 0",
        (MERGE,),
    ),
    Mutant(
        "runs of different programs are one run",
        "refinement.parts.difference",
        "system.program != their_system.program",
        "one.pid < 0",
        (MERGE,),
    ),
    Mutant(
        "of two parts of a robot the longer counts",
        "api.merge._one_of_each",
        "repr(longer.told[: len(shorter.told)]) != repr(shorter.told)",
        "longer is None",
        (MERGE,),
    ),
    Mutant(
        "what nobody saw is taken for a step that is not legal",
        "api.merge._merged",
        "ran.gave_up is not None or unseen",
        "ran.gave_up is not None",
        (MERGE,),
    ),
    Mutant(
        "the last property that a run breaks is told",
        "sampling.monitors.Watch.see",
        "self.violation is None",
        "self.monitor is not None",
        (MERGE,),
    ),
    Mutant(
        "properties that ask what nobody answered are held to be true without a word",
        "sampling.monitors.Monitor.after",
        "self.unjudged[stated.name] = None",
        "self.unjudged.clear()",
        (MERGE,),
    ),
    Mutant(
        "tasks are not where the world has them",
        "runtime.deploy.ideal.IdealHost._spot",
        "number < len(self.world.tasks)",
        "number < 0",
        (DEPLOY,),
    ),
    Mutant(
        "robots begin as they like",
        "runtime.deploy.ideal.IdealHost.start",
        "(robot, name) in self.starts",
        "name in self.starts",
        (DEPLOY, COMMANDS),
    ),
)
