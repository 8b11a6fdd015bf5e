"""What the rechecker alone can show: the largest set of claims that prove themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

from koord.recheck import instances
from koord.recheck.claims import Claim, ClaimKind
from koord.recheck.every_number import EveryNumber
from koord.recheck.obligations import Discharged, Obligations, Settling
from koord.recheck.solving import SolverAnswer, SolverSession
from koord.recheck.sorts import NotRecheckedError
from koord.recheck.terms import Terms
from koord.recheck.values import Values
from koord.recheck.world import Instance
from koord.syntax.system import System
from koord.verify.claims import claims_of

SECONDS = 5.0
SOON = 0.5


def restated(system: System) -> list[Claim]:
    """The claims about a system, as the rechecker has them."""
    return [
        Claim(claim.name, ClaimKind(claim.kind.value), claim.stated, claim.subject)
        for claim in claims_of(system)
    ]


def world_of(system: System) -> Instance:
    return Instance(system.program, system.kinds, system.delta_s)


def settled(world: Instance, claims: Sequence[Claim]) -> Iterator[Discharged]:
    """Every obligation of some claims, settled."""
    values = Values(Terms(), world.robots, world.sealed)
    with SolverSession.start() as session:
        settling = Settling(values, session, lambda: SECONDS)
        for obligation in Obligations(world, claims, values):
            yield settling.settled(obligation)


#: How the obligations of some claims are settled.
Settler: TypeAlias = "Callable[[Instance, Sequence[Claim]], Iterator[Discharged]]"


def settled_for_everyone(
    world: Instance, claims: Sequence[Claim], seconds: float = SECONDS
) -> Iterator[Discharged]:
    """Every obligation of some claims for any number of robots, settled."""
    anyone = Instance(world.program, (), world.delta_s)
    values = Values(Terms(), None, anyone.sealed)
    with SolverSession.start() as session:
        settling = Settling(values, session, lambda: seconds)
        for obligation in EveryNumber(anyone, claims, values):
            yield instances.settled(settling, obligation)


def settled_soon(world: Instance, claims: Sequence[Claim]) -> Iterator[Discharged]:
    """The same, where most do not follow, and each would be tried as long as it may be."""
    return settled_for_everyone(world, claims, SOON)


def confirmed(
    system: System,
    settled: Settler = settled,
) -> set[str] | None:
    """The names of the claims that prove themselves; None if a construct is not rechecked."""
    try:
        world = world_of(system)
        claims = restated(system)
        while claims:
            failed = next(
                (s for s in settled(world, claims) if s.answer is not SolverAnswer.UNSAT), None
            )
            if failed is None:
                return {claim.name for claim in claims}
            name = failed.claim.split(" (")[0]
            claims = [claim for claim in claims if claim.name != name]
    except NotRecheckedError:
        return None
    return set()
