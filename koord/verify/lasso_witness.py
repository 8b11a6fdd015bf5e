"""Replay of lassos as counterexamples: closed, fair, and against the property. [LASSO]"""

from __future__ import annotations

from koord.semantics.domain import EXACT
from koord.semantics.oracle import Phase as Asked
from koord.semantics.recordings import Recording, execute
from koord.semantics.rounds import IllegalStepError
from koord.syntax.system import System
from koord.traces.lassos import broken_by, flaw_of
from koord.verify.claims import Claim, ClaimPhase
from koord.verify.promises import unkept
from koord.verify.verdicts import Counterexample, NotReplayedError


def replayed_lasso(system: System, recording: Recording, claim: Claim) -> Counterexample:
    """Replay a lasso on the exact domain, as a counterexample. Raises NotReplayedError.

    Raises :class:`NotReplayedError` where it was not.
    """
    stated, loop = claim.stated, recording.loop
    assert stated is not None
    assert loop is not None
    heard = [a for round_ in recording.rounds for a in round_.answers if a.phase is Asked.CHECK]
    try:
        steps = list(execute(EXACT, system, recording, heard))
    except IllegalStepError as error:
        raise NotReplayedError(str(error)) from error
    found = unkept(system, heard)
    if found is not None:
        raise NotReplayedError(f"no {found.function} keeps its summary with these answers")
    ends = [step.configuration for step in steps if step.is_at_round]
    flaw = flaw_of(system, recording, ends, stated)
    if flaw is not None:
        raise NotReplayedError(f"{flaw.rule}: {flaw.reason}")
    broken = broken_by(system, recording, ends, stated)
    assert broken is not None
    response, since = broken
    last = len(recording.rounds)
    whose = "" if response.robot is None else f" of robot {response.robot}"
    if response.trigger is None:
        detail = f"what {stated.name} waits for never comes true{whose}"
    else:
        when = f"after round {since}" if since else "at the start"
        detail = f"what should lead to {stated.name}{whose} is true {when}, and nothing follows"
        if since > loop:
            detail = f"what should lead to {stated.name}{whose} is true, and nothing follows"
    return Counterexample(recording, last, ClaimPhase.END, detail, response.robot, stated.span)
