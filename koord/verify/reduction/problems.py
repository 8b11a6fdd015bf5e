"""Verification problems: a program, its slices and its abstractions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random

from msgspec import Struct
from msgspec.structs import replace

from koord.sampling.run_extension import Plain, extended
from koord.sampling.values import Sampler
from koord.semantics.recordings import Recording
from koord.semantics.rounds import IllegalStepError
from koord.syntax.diagnostics import KoordError
from koord.syntax.system import System
from koord.traces.trace import Numbers
from koord.verify.claims import Claim, ClaimKind, ClaimPhase, claims_of, liveness_of
from koord.verify.ledger import VerificationProblem
from koord.verify.reduction.abstraction import abstracted
from koord.verify.reduction.concretion import Concretion
from koord.verify.verdicts import Counterexample
from koord.verify.witness import NotReplayedError, OnlyOfSliceError, replayed, simplified

#: So often what a slice left out is made up at random, after it was tried with the plainest values.
TRIES = 3

Identity = tuple[ClaimKind, str, str]


def identity(claim: Claim) -> Identity:
    """The identity of a claim across slices and abstractions of its program."""
    return claim.kind, claim.name, claim.subject


def plain_problem(system: System, part: System | None = None) -> VerificationProblem:
    """The problem of a system or slice; counterexamples are judged on the whole system."""
    return _problem(system, part or system, lambda recording: recording)


def abstract_problem(system: System, part: System | None = None) -> VerificationProblem | None:
    """The problem with merely flowing values made opaque; None if there are none."""
    part = part or system
    abstraction = abstracted(part.program)
    if abstraction is None:
        return None
    problem = _problem(system, part, lambda found: Concretion(abstraction, part).recording(found))
    return replace(problem, system=replace(part, program=abstraction.program))


def problem_of(system: System, part: System | None = None) -> VerificationProblem:
    """The abstract problem if there is one, else the plain one."""
    return abstract_problem(system, part) or plain_problem(system, part)


def _problem(
    system: System, part: System, concrete: Callable[[Recording], Recording]
) -> VerificationProblem:
    claims = {identity(c): c for c in (*claims_of(system), *liveness_of(system))}
    completing = _Completing(system)

    def judge(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
        real, meant = concrete(recording), claims[identity(claim)]
        if part is system:
            return _judged(system, real, meant, phase)
        try:
            return completing.judged(real, meant, phase)
        except NotReplayedError as error:
            if meant.kind is not ClaimKind.LIVENESS:
                raise
            _lasso(part, real, meant)
            raise OnlyOfSliceError(str(error)) from error

    return VerificationProblem(part, judge, part)


def _judged(
    system: System, recording: Recording, claim: Claim, phase: ClaimPhase
) -> Counterexample:
    """The simplified counterexample of a recording that breaks a claim. Raises NotReplayedError."""
    if claim.kind is ClaimKind.LIVENESS:
        return _lasso(system, recording, claim)
    replayed(system, recording, claim, phase)
    return replayed(system, simplified(system, recording, claim), claim, phase)


def _lasso(system: System, recording: Recording, claim: Claim) -> Counterexample:
    # Of runs without end few programs claim something, and it takes a while to load.
    from koord.verify.lasso_witness import replayed_lasso

    return replayed_lasso(system, recording, claim)


class _Completing(Struct):
    """The judge of a slice's runs: completes them to runs of the whole system. [T-CONE]"""

    system: System
    never_starts: bool = False  #: as far as that was tried

    def judged(self, recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
        """The counterexample of a slice's recording, completed with sampled inputs.

        Where no start was found once, none is looked for again: nearly always assumptions
        contradict each other, and otherwise the whole system is asked all the same.
        """
        why = NotReplayedError("no start was found that meets the assumptions")
        starts = False
        for sampler in () if self.never_starts else _samplers(self.system):
            try:
                return _judged(self.system, extended(recording, sampler), claim, phase)
            except NotReplayedError as error:
                why, starts = error, True
            except (KoordError, IllegalStepError) as error:
                starts = starts or not _is_no_start(error)
                why = NotReplayedError(f"what a slice does is not made a run: {error}")
        self.never_starts = not starts
        raise why


def _is_no_start(error: KoordError | IllegalStepError) -> bool:
    return isinstance(error, KoordError) and any(d.code == "K920" for d in error.diagnostics)


def _samplers(system: System) -> Iterator[Sampler]:
    yield Plain(system, Numbers.EXACT, Random(0))
    yield from (_Hasty(system, Numbers.EXACT, Random(seed)) for seed in range(TRIES))


class _Hasty(Sampler):
    """A sampler that tries few starts: if assumptions contradict each other, more do not help."""

    start_tries = 100
