"""Parallel work on single claims, each on a ledger of its own, in several processes."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

from msgspec import Struct

from koord.verify.claims import Claim
from koord.verify.helpers import PortableWork
from koord.verify.job_process import Progress
from koord.verify.ledger import Extract, Ledger
from koord.verify.obstacles import Failure
from koord.verify.processes import Pool, can_fork


def note_end(ledger: Ledger, claim: Claim, who: str, end: str) -> None:
    """Note that the process that worked on a claim has ended."""
    died = ledger.of([claim], ledger.report)
    died.fail(Failure(who, end))
    ledger.take(died.extract([claim]))


class Alone(Struct, frozen=True):
    """The results on one claim; they began at a moment of the clock of whoever found them."""

    said: Extract
    began: float

    def as_of(self, began: float | None) -> Extract:
        """The results with moments of this machine's clock, by which they began then."""
        return self.said if began is None else self.said.moved(began - self.began)


def alone(own: Ledger, claim: Claim, work: Callable[[Ledger, Claim], None], who: str) -> Alone:
    """Run an engine on a claim, on a ledger of its own."""
    began = time.monotonic()
    with own.stopping(), own.enduring(who):
        work(own, claim)
    return Alone(own.extract([claim]), began)


def each_alone(
    ledger: Ledger,
    claims: Sequence[Claim],
    pool: Pool,
    work: Callable[[Ledger, Claim], None],
    who: str,
    portable: Callable[[Ledger, Claim], PortableWork] | None = None,
) -> None:
    """Run an engine on some claims, each alone on a ledger of its own.

    ``portable`` makes the same work for another machine, which returns an :class:`Alone`.
    """
    if not can_fork() or len(claims) < 2:
        for claim in claims:
            own = ledger.of([claim], ledger.report)
            try:
                with own.enduring(who):
                    work(own, claim)
            finally:
                ledger.take(own.extract([claim]))
        return

    def ask(claim: Claim, tell: Progress) -> Alone:
        return alone(ledger.of([claim], tell), claim, work, who)

    jobs = {}
    for claim in claims:
        question = None if portable is None else portable(ledger.detached([claim]), claim)
        jobs[claim] = pool.submit(claim.name, partial(ask, claim), portable=question)
    with ledger.waiting():
        for claim, said in pool.answers(jobs):
            if said is None:
                note_end(ledger, claim, who, jobs[claim].end)
            else:
                ledger.take(said.as_of(jobs[claim].started))
    if ledger.interrupted:
        raise KeyboardInterrupt
