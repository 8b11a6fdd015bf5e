"""Runs that reach goals, which are kept, and replayed on a program that has changed since.

A run that reaches what should be possible shows it as well as any search: by the rules. Nothing of
a kept run is trusted. It is executed on the system as it is now, step by step, and what is true at
the ends of its rounds is looked at anew; a run of another program is none, and shows nothing.
[PROP-VACUOUS] [RECORDING]
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from msgspec import Struct, field

from koord.semantics.domain import EXACT, Constant
from koord.semantics.oracle import Phase
from koord.semantics.recordings import Answer, RecordedInputs, Recording, Step, execute
from koord.semantics.rounds import IllegalStepError
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimPhase, StepFindings, broken
from koord.verify.encoding.solver import Model
from koord.verify.encoding.unrolling import Unrolling
from koord.verify.verdicts import ReachingRun

#: So many runs are kept of one system: most reach several goals.
MOST_RUNS = 16

#: What the rules or the evaluation say of a recording that is none of the system.
_NO_RUN = (IllegalStepError, KoordError, AssertionError, LookupError, TypeError)


class Reached(Struct, frozen=True):
    """What kept runs show of a system: denials that they break, that runs start, and go on."""

    claims: frozenset[Claim] = frozenset()
    starts: bool = False
    goes_on: bool = False


class ReachingRuns(Struct):
    """The runs that reach the goals of one system: those kept from before, and those found.

    Of these no more than ``most`` are kept: to read one off a model can take as long as to find it.
    """

    before: Sequence[ReachingRun] = ()
    most: int = MOST_RUNS
    useful: list[ReachingRun] = field(default_factory=list)  #: of both, in order

    def replayed(self, system: System, nevers: Collection[Claim], rounds: int) -> Reached:
        """What the kept runs show within so many rounds of a system as it is now."""
        if not self.before:
            return Reached()
        layout = layout_of(system)
        pending = set(nevers)
        starts = goes_on = False
        # Who goes furthest has most often passed what the others reach.
        for run in sorted(self.before, key=lambda run: -len(run.recording.rounds)):
            if run.layout != layout or not (pending or not goes_on):
                continue
            shown = _shown(system, run.recording, pending, rounds)
            if shown.claims or shown.goes_on > goes_on:
                self.useful.append(run)
            pending -= shown.claims
            starts, goes_on = starts or shown.starts, goes_on or shown.goes_on
        return Reached(frozenset(nevers) - pending, starts, goes_on)

    def note(self, unrolling: Unrolling, model: Model, phase: ClaimPhase) -> None:
        """Keep the run of a model, which breaks claims where it ends, in a phase."""
        from koord.verify.witness import ModelReader, recording_of

        if phase in (ClaimPhase.INIT, ClaimPhase.END) and len(self.useful) < self.most:
            reader = ModelReader(model, unrolling.system)
            recording = recording_of(reader, unrolling.opening, unrolling.rounds, phase)
            self.add(unrolling.system, recording)

    def add(self, system: System, recording: Recording) -> None:
        """Keep a run of a system."""
        if len(self.useful) < self.most:
            self.useful.append(ReachingRun(layout_of(system), recording))


def layout_of(system: System) -> str:
    """A digest of what the values of a recording are of: who there is, and which types they have.

    Everything else, a replay looks at.
    """
    from hashlib import blake2b  # loads a library of ciphers

    program = system.program
    said: list[object] = [system.kinds]
    for agent in program.agents:
        ports = [(p.label, p.declaration.variable.type, p.direction) for p in agent.ports]
        said.append((agent.name, [d.variable.type for d in agent.locals], ports))
    said.append([d.variable.type for d in (*program.allread, *program.allwrite)])
    for external in program.externals:
        types = [p.type for p in (*external.parameters, external.result)]
        said.append((external.name, external.kind, types))
    return blake2b(repr(said).encode(), digest_size=16).hexdigest()


def _shown(system: System, recording: Recording, nevers: Collection[Claim], rounds: int) -> Reached:
    """What a recording shows of a system; nothing if it is no run of it."""
    from koord.verify.promises import unkept

    heard: list[Answer] = []
    found: set[Claim] = set()
    starts = goes_on = False
    try:
        for step in execute(EXACT, system, recording, heard):
            if step.configuration.fault is not None or step.configuration.round > rounds:
                break
            if not step.is_at_round:
                continue
            starts, goes_on = True, goes_on or step.rule == "ENV-TRANS"
            found.update(_broken_by(system, recording, step, nevers, heard))
    except _NO_RUN:
        pass  # what came before is a run all the same
    if unkept(system, heard) is not None:
        return Reached()
    return Reached(frozenset(found), starts, goes_on)


def _broken_by(
    system: System,
    recording: Recording,
    step: Step,
    nevers: Collection[Claim],
    heard: list[Answer],
) -> Iterator[Claim]:
    """The claims that the end of a round breaks, or of INIT."""
    is_start = step.rule == "INIT"
    answers = recording.opening.answers if is_start else recording.rounds[step.round].answers
    checks = [answer for answer in answers if answer.phase is Phase.CHECK]
    promises = tuple((False, contract.name) for _, contract in step.stepped.promises)
    findings: StepFindings[Constant] = StepFindings(False, (), promises)
    phase = ClaimPhase.INIT if is_start else ClaimPhase.END
    for claim in nevers:
        if not claim.looked_at(phase):
            continue
        asked: list[Answer] = []
        inputs = RecordedInputs(answers=checks, heard=asked)
        try:
            violated, legality = broken(EXACT, system, claim, step.configuration, findings, inputs)
        except IllegalStepError:
            continue  # it asks for what nobody has recorded here
        if violated is True and all(needed.condition is True for needed in legality):
            heard += asked
            yield claim
