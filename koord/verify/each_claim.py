"""Parallel work on single claims, each on a ledger of its own, in several processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from koord.verify.claims import Claim
from koord.verify.ledger import Extract, Ledger
from koord.verify.obstacles import Failure
from koord.verify.processes import Pool, Progress, can_fork


def note_end(ledger: Ledger, claim: Claim, who: str, end: str) -> None:
    """Note that the process that worked on a claim has ended."""
    died = ledger.of([claim], ledger.report)
    died.fail(Failure(who, end))
    ledger.take(died.extract([claim]))


def each_alone(
    ledger: Ledger,
    claims: Sequence[Claim],
    pool: Pool,
    work: Callable[[Ledger, Claim], None],
    who: str,
) -> None:
    """Run an engine on some claims, each alone on a ledger of its own."""
    if not can_fork() or len(claims) < 2:
        for claim in claims:
            own = ledger.of([claim], ledger.report)
            try:
                with own.enduring(who):
                    work(own, claim)
            finally:
                ledger.take(own.extract([claim]))
        return

    def ask(claim: Claim, tell: Progress) -> Extract:
        own = ledger.of([claim], tell)
        with own.stopping(), own.enduring(who):
            work(own, claim)
        return own.extract([claim])

    jobs = {claim: pool.submit(claim.name, partial(ask, claim)) for claim in claims}
    with ledger.waiting():
        for claim, said in pool.answers(jobs):
            if said is None:
                note_end(ledger, claim, who, jobs[claim].end)
            else:
                ledger.take(said)
    if ledger.interrupted:
        raise KeyboardInterrupt
