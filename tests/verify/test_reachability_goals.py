"""What is told never to happen, against all runs of generated programs. [PROP-VACUOUS]"""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest
from msgspec.structs import replace

from koord.refinement.generating.programs import system
from koord.semantics.every_number import NotFiniteError
from koord.semantics.recordings import Recording
from koord.syntax.core import PropertyKind
from koord.syntax.system import System
from koord.verify.claims import Claim, ClaimPhase, claims_of
from koord.verify.effort import Deadline, Effort
from koord.verify.ledger import Ledger, VerificationProblem
from koord.verify.reachability_goals import ReachabilityGoals, reachability_goals_of
from koord.verify.vacuity.analysis import look
from koord.verify.vacuity.unreachable import unmet
from koord.verify.verdicts import Bounds, Counterexample
from tests.generators.profiles import FINITE
from tests.sampling import sampled
from tests.verify.reference import Explorer, TooManyError

ROUNDS = 2


def observed(wished: ReachabilityGoals) -> System:
    """The system of the wishes, in which those about invariants are asked at all times."""
    asked = {goal.never.name for goal in wished.all if goal.observed}
    program = wished.system.program
    properties = tuple(
        replace(p, kind=PropertyKind.INVARIANT) if p.name in asked else p
        for p in program.properties
    )
    return replace(wished.system, program=replace(program, properties=properties))


def unasked(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
    raise AssertionError("nobody is shown how a wish comes true")


def agrees(seed: int) -> Counter[str] | None:
    """Compare what is told of one program with all its runs; None where there are too many."""
    made = system(Random(seed), FINITE)
    wished = reachability_goals_of(made)
    try:
        ends = Explorer(wished.system).explore(ROUNDS).first
        ever = Explorer(observed(wished)).explore(ROUNDS + 1).first
    except (TooManyError, NotFiniteError):
        return None
    ledger = Ledger(
        VerificationProblem(made, unasked, made),
        Bounds(ROUNDS),
        Deadline.after(60.0),
        claims_of(made),
    )
    looked = look(ledger)
    if looked.never is None or looked.never.stuck is not None or not looked.never.known:
        return Counter(["not asked"])
    nevers = {goal.never.name for goal in wished.all}
    left = {claim.name for claim in looked.never.claims}
    assert left == nevers - ends.keys(), seed
    count: Counter[str] = Counter(goals=len(nevers), fulfilled=len(nevers - left))
    for goal in wished.all:
        if goal.never in looked.never.claims:
            (*told,) = unmet(ledger, [goal.never], Effort.of_seconds(5))
            count.update(["certain" if v.certain else "not in time" for v in told] or ["between"])
            for vacuity in told:
                if vacuity.certain and "no round" not in vacuity.detail:
                    assert goal.never.name not in ever, (seed, goal)
            if not told:
                assert goal.observed, seed
    return count


def counted(first: int, last: int) -> Counter[str]:
    return sum((agrees(seed) or Counter() for seed in range(first, last)), Counter[str]())


@pytest.mark.parametrize("last", sampled(4, [20]))
def test_what_never_happens_is_told_of_generated_programs(last: int) -> None:
    found = counted(0, last)
    assert found["goals"] >= last // 2
    assert found["certain"] >= last // 4
    assert found["fulfilled"] >= last // 8


@pytest.mark.slow
def test_what_never_happens_is_told_of_many_generated_programs() -> None:
    assert counted(20, 700)["certain"] > 310
