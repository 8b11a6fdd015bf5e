"""Inductive proofs for every number of robots and of rounds. [T-EVERY-N]

All claims are assumed of some configuration, and each is asked for after one more step. Those that
fail are dropped and the rest asked again, until what is left proves itself. A proof is a proof
whatever was said of whom; what is not proved is *unknown*, never violated.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from msgspec import Struct
from msgspec.structs import replace

from koord.semantics.every_number import NotFiniteError
from koord.syntax import core
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.system import System
from koord.verify.claims import Claim
from koord.verify.effort import Deadline, Effort
from koord.verify.engines.every_n.questions import (
    GENEROUS,
    NOT_COVERED,
    Means,
    ProofBudget,
    Start,
    Step,
)

#: Of what is worked out, so many steps are counted as a second of a solver.
STEPS_PER_SECOND = 10_000


class Proof(Struct, frozen=True):
    """The claims that hold for every number of robots, and the reasons why others are open."""

    proved: tuple[Claim, ...]
    reasons: dict[Claim, str]


def prove(
    system: System,
    claims: Sequence[Claim],
    deadline: Deadline,
    effort: Effort,
    thrift: ProofBudget = GENEROUS,
    seed: int = 0,
    *,
    known: Sequence[Claim] = (),
) -> Proof:
    """Prove the largest inductive subset of the claims, for every number of robots (Houdini).

    How many robots the system has plays no part. What is ``known`` to hold in every round, for
    every number of robots, is assumed; what follows from it alone is not asked of any round.
    """
    from koord.verify.engines.every_n.consequences import consequences

    means = Means(deadline, effort, thrift, seed)
    reasons: dict[Claim, str] = {}
    follows: set[Claim] = set()
    try:
        if known:
            follows = consequences(system, claims, known, means)
            claims = [claim for claim in claims if claim not in follows]
            known = [*known, *follows]
        if not claims:
            return Proof(tuple(follows), {})
        start = Start(system, means)
        reasons |= start.failing(claims)
        step = Step(system, means, after=start.world)
        candidates = [claim for claim in claims if claim not in reasons]
        while candidates:
            failed = step.failing(candidates, known)
            if not failed:
                break
            reasons |= failed
            candidates = [claim for claim in candidates if claim not in failed]
    except NotFiniteError as error:
        return Proof(tuple(follows), dict.fromkeys(claims, str(error)) | reasons)
    limits = sorted({*start.limits, *step.limits})
    if limits:
        reasons |= dict.fromkeys(candidates, f"{NOT_COVERED}: {'; '.join(limits)}")
        candidates = []
    return Proof((*follows, *candidates), reasons)


def prove_over(
    system: System,
    claims: Sequence[Claim],
    known: Sequence[Claim],
    means: Means,
    rounds: int,
) -> tuple[Claim, ...]:
    """Prove claims by induction over several rounds, for every number of robots; those that hold.

    They are asked of the first rounds from INIT, and of the one behind so many in which they hold.
    """
    left = list(claims)
    try:
        start = Start(system, means)
        failing = start.failing(left)
        limits = {*start.limits}
        left = [claim for claim in left if claim not in failing]
        for earlier in range(rounds - 1):
            left = _kept(Step(system, means, earlier=earlier, from_init=True), left, known, limits)
        left = _kept(Step(system, means, earlier=rounds - 1), left, known, limits)
    except NotFiniteError:
        return ()
    return () if limits else tuple(left)


def _kept(
    step: Step, claims: Sequence[Claim], known: Sequence[Claim], limits: set[str]
) -> list[Claim]:
    """The largest set of claims that a step keeps, if they and what is known hold before."""
    left = list(claims)
    while left and (failed := step.failing(left, known)):
        left = [claim for claim in left if claim not in failed]
    limits |= set(step.limits)
    return left


class Inferred(Struct, frozen=True):
    """The claims that hold with the help of inferred invariants, and these invariants."""

    proved: tuple[Claim, ...]
    invariants: tuple[Claim, ...]

    def lemmas(self, known: Collection[Claim]) -> tuple[core.Property, ...]:
        """The invariants that nobody knew, without names."""
        new = (claim.stated for claim in self.invariants if claim not in known)
        return tuple(replace(stated, name="") for stated in new if stated is not None)


def infer(
    system: System,
    claims: Sequence[Claim],
    candidates: Sequence[Claim],
    deadline: Deadline,
    effort: Effort,
    thrift: ProofBudget = GENEROUS,
    seed: int = 0,
) -> Inferred:
    """Find claims that are inductive together with some of the candidates.

    Candidates that do not hold after INIT are dropped, then those that a round may break, until
    the rest prove themselves; of these the ones are kept that the claims' proofs rest on. What is
    worked out on the way may cost as much again as solvers may.
    """
    best = nothing = Inferred((), ())
    whole, steps = system.budget, int(thrift.seconds * STEPS_PER_SECOND)
    system = replace(system, budget=whole.rationed(steps))
    means = Means(deadline, effort, thrift, seed)
    try:
        start = Start(system, means)
        failing = start.failing(claims)
        open_ = [claim for claim in claims if claim not in failing]
        if not open_:
            return nothing
        likely = start.sifted(candidates)
        for generations in (1, 2):
            step = Step(system, means)
            left = step.sifted([*open_, *likely], generations)
            proved = tuple(claim for claim in open_ if claim in set(left))
            if len(proved) > len(best.proved) and not start.limits and not step.limits:
                found = step.lemmas(proved, [claim for claim in left if claim not in proved])
                best = Inferred(proved, tuple(step.fewest(proved, found)))
            if len(proved) == len(open_):
                break
    except NotFiniteError:
        return nothing
    except OutOfBudgetError:
        if whole.is_over():
            raise
    return best
