"""Bounded checks of one claim, on a ledger of its own, here or on other machines.

On other machines a check that takes long is split into cubes: the claim holds through as many
rounds as it does in each of them, and it is violated as the first of them that violates it says.
What was known to hold before is not asked again.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace

from koord.verify.bounded_check import Unroller
from koord.verify.claims import Claim
from koord.verify.each_claim import Alone, alone
from koord.verify.effort import Effort
from koord.verify.encoding.cubes import Cube, cubes
from koord.verify.engine_names import Engine
from koord.verify.helpers import PortableWork
from koord.verify.job_process import JobChannel
from koord.verify.ledger import Extract, Ledger, Reach
from koord.verify.verdicts import Verdict, has_fewest

#: Into how many cubes a check is split at least. More than most clusters have workers would ask
#: again and again what all have in common; the number is the same whoever is there.
CUBES = 16


class Looked(Struct, frozen=True):
    """The result of bounded checks of one claim, round by round. ``tired``: they can go on."""

    found: Alone
    unreplayed: tuple[str, int | None] | None
    tired: bool

    def as_of(self, began: float | None) -> Looked:
        """The same with moments of this machine's clock, by which it began then."""
        said = self.found.as_of(began)
        return replace(self, found=replace(self.found, said=said))

    def violates(self, claim: Claim) -> bool:
        """Return whether the claim is violated."""
        return claim in self.found.said.verdicts


class RoundsQuestion(PortableWork, frozen=True):
    """A bounded check of one claim from INIT on, for so many seconds of a solver's effort.

    With a ``cube`` only of its runs; ``known`` are the rounds through which the claim holds.
    """

    ledger: Ledger  #: of that claim, detached
    claim: Claim
    seconds: float | None
    cube: Cube = Cube()
    known: int | None = None

    def __call__(self, tell: JobChannel) -> Looked:
        own = self.ledger.of([self.claim], tell)
        unroller = Unroller(cube=self.cube, known=self.known)
        return look(own, self.claim, self.seconds, unroller)


def look(own: Ledger, claim: Claim, seconds: float | None, unroller: Unroller) -> Looked:
    """Check a claim round by round, on a ledger of its own."""
    effort = None if seconds is None else Effort.of_seconds(seconds)

    def check(own: Ledger, claim: Claim) -> None:
        unroller.through(own, own.bounds.rounds, effort)

    found = alone(own, claim, check, Engine.BMC.value)
    bounded = unroller.of(own)
    return Looked(found, bounded.unreplayed.get(claim), bounded.tired)


def by_cubes(ledger: Ledger, claim: Claim) -> list[RoundsQuestion]:
    """The checks of a claim that together cover all runs, as far as the bounds go."""
    rounds = ledger.bounds.rounds
    own, known = ledger.detached([claim]), ledger.verdict(claim).rounds
    return [
        RoundsQuestion(own, claim, None, cube, known)
        for cube in cubes(ledger.system, CUBES, rounds)
    ]


def joined(claim: Claim, parts: Sequence[Looked], known: int | None) -> Looked:
    """What the checks of all cubes say together, or of the first ones if the last one violates.

    ``known`` are the rounds through which the claim holds in all of them.
    """
    *_, last = parts
    said = [part.found.said for part in parts]
    verdicts: dict[Claim, Verdict] = {}
    if last.violates(claim):
        verdict = last.found.said.verdicts[claim]
        assert verdict.counterexample is not None
        # In other cubes there may be shorter runs.
        fewest = verdict.fewest and has_fewest(verdict.counterexample, known)
        verdicts = {claim: replace(verdict, fewest=fewest)}
    reaches = [] if verdicts else [_least(claim, said)]
    failures = {failure: claims for each in said for failure, claims in each.failures.items()}
    spans = [span for each in said for span in each.spans.get(claim, ())]
    extract = Extract(
        verdicts,
        {claim: [reach for reach in reaches if reach is not None]},
        next((each.stopped for each in said if each.stopped), ""),
        any(each.interrupted for each in said),
        failures,
        {claim: spans},
    )
    unreplayed = next((part.unreplayed for part in parts if part.unreplayed is not None), None)
    began = last.found.began
    return Looked(Alone(extract, began), unreplayed, any(part.tired for part in parts))


def _least(claim: Claim, said: Sequence[Extract]) -> Reach | None:
    """How far the claim was checked in all cubes; None if in one of them it was not at all."""
    found = []
    for each in said:
        own = [r for r in each.reaches.get(claim, ()) if r.engine is Engine.BMC]
        if not own:
            return None
        found.append(own[-1])
    return min(found, key=lambda r: (-1 if r.rounds is None else r.rounds, not r.reason))
