"""Consequences: claims that follow from known invariants, in any configuration. [T-EVERY-N]

No round is looked at: what is known holds wherever the claim is looked at, so that what follows
from it holds there, too. A claim that says what is known in other words, or less, is one.
"""

from __future__ import annotations

from collections.abc import Sequence

from koord.syntax import core
from koord.syntax.core import PropertyKind
from koord.syntax.system import System
from koord.syntax.walk import reached
from koord.verify.claims import Claim, ClaimKind
from koord.verify.engines.every_n.all_robots import ParameterisedSystem
from koord.verify.engines.every_n.initial_states import ArbitraryState, ParameterisedInit
from koord.verify.engines.every_n.questions import Asking, Means, universal


def consequences(
    system: System, claims: Sequence[Claim], known: Sequence[Claim], means: Means
) -> set[Claim]:
    """Those of the claims that follow from invariants that are known for every number of robots."""
    asked = [claim for claim in claims if _is_of_values(system.program, claim)]
    found: set[Claim] = set()
    # What is known at the ends of rounds only says nothing of what is inside.
    for kind in (PropertyKind.INVARIANT, PropertyKind.AT_ROUND):
        goals = [claim for claim in asked if claim.stated and claim.stated.kind is kind]
        given = [
            claim
            for claim in known
            if claim.stated is not None
            and claim.kind is ClaimKind.PROPERTY
            and (kind is PropertyKind.AT_ROUND or claim.stated.kind is PropertyKind.INVARIANT)
        ]
        if goals and given:
            found |= _following(system, goals, given, means)
    return found


def _following(
    system: System, claims: Sequence[Claim], given: Sequence[Claim], means: Means
) -> set[Claim]:
    world = ParameterisedSystem.of(system)
    opening = ParameterisedInit(world)
    state = ArbitraryState(world, opening)
    asking = Asking(world, means)
    world.book.expect(*asking.robots[:2])
    world.book.note(opening.calm)
    for claim in given:
        universal(claim).suppose(world, state.configuration, True)
    goals = []
    for claim in claims:
        asked = universal(claim)
        names = asking.robots[: asked.arity]
        goals.append((claim, [asked.broken(world, state.configuration, names)]))
    failed = asking.failing(goals)
    return set() if asking.limits else {claim for claim in claims if claim not in failed}


def _is_of_values(program: core.Program, claim: Claim) -> bool:
    """Return whether a claim is about values of variables alone, and not about what robots did."""
    if claim.kind is not ClaimKind.PROPERTY or claim.stated is None:
        return False
    below = reached(program, claim.stated.condition)
    return not any(isinstance(node, core.Ran | core.Stopped) for node in below)
