"""Further ways to break a claim: runs that do without some event of each run found so far."""

from __future__ import annotations

from collections.abc import Iterator

from koord.semantics.domain import conjunction
from koord.semantics.traces.recording import Recording
from koord.syntax.core import UnaryOp
from koord.verify.bmc import Unrolling, violations
from koord.verify.claims import Claim
from koord.verify.ledger import Ledger
from koord.verify.moments import Moment
from koord.verify.solving import Answer
from koord.verify.terms import Term
from koord.verify.verdicts import Counterexample
from koord.verify.witness import NotReplayedError, Reader, recording_of


def others(ledger: Ledger, claim: Claim, first: Counterexample) -> Iterator[Counterexample]:
    """Counterexamples that are no variant of ``first`` or of one another, the shortest first.

    Each leaves out some event that the others all need: robots that run more besides, other values
    and other orders make no difference. Ends where there is none within the bound or in time.
    """
    unrolling = Unrolling(ledger.system, ledger.seed)
    solver = unrolling.solver
    known = [first.recording]
    for moment in unrolling.moments():
        asked = violations(ledger.system, unrolling.encoder.d, moment, [claim])
        for violated, needed in asked.values():
            solver.add(needed)
            while True:
                different = [_different(unrolling, recording) for recording in known]
                if solver.check([violated, *different], ledger.deadline) is not Answer.SAT:
                    break
                found = _read(ledger, claim, unrolling, moment)
                if found is None:
                    break
                known.append(found.recording)
                yield found
            # A run that went on from here would be a longer way to what was found.
            solver.add([unrolling.encoder.d.unary(UnaryOp.NOT, violated)])
        if ledger.deadline.passed() or moment.configuration.round > ledger.bounds.rounds:
            return


def _read(
    ledger: Ledger, claim: Claim, unrolling: Unrolling, moment: Moment
) -> Counterexample | None:
    reader = Reader(unrolling.solver.model(), ledger.system)
    recording = recording_of(reader, unrolling.opening, unrolling.rounds, moment.phase)
    try:
        return ledger.subject.judge(recording, claim, moment.phase)
    except NotReplayedError:
        return None


def _different(unrolling: Unrolling, recording: Recording) -> Term:
    """Some event of a recorded run does not run, as far as the rounds are there yet."""
    if len(recording.rounds) > len(unrolling.rounds):
        # The run is longer than what is asked about, which can be no variant of it.
        return True
    d = unrolling.encoder.d
    ran = []
    for taken, round_ in zip(unrolling.rounds, recording.rounds, strict=False):
        for option in taken.options:
            if round_.events[option.robot] == option.position:
                ran.append(option.chosen)
    return d.unary(UnaryOp.NOT, conjunction(d, ran))
