"""What takes long is asked singly: each claim in a process of its own, several at a time.

Engines are asked about all claims together first, for so much effort. Claims that are open then
know nothing of each other, so that no answer hangs on another, nor on how many are asked at a time.
Effort is counted in work, not in time: what is asked singly is the same on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from koord.verify.claims import Claim
from koord.verify.engines import AFTERWARDS_S, ByUnrolling
from koord.verify.ledger import Ledger, Reach, Said, Works
from koord.verify.pool import DIED, Job, Pool, Progress, can_fork
from koord.verify.solving import Effort
from koord.verify.verdicts import Engine


@dataclass(frozen=True, slots=True)
class _Slice:
    """What may be spent on each claim, in about seconds of a solver (None: anything).

    ``afresh``: from INIT on, and not from where all claims together were left. What the solver was
    told of the other claims by then helps with some (SATS: 4 s instead of 17 s), and is in the way
    of others (Task: 24 s instead of 1 s).
    """

    seconds: float | None
    afresh: bool


#: What is spent on each claim in turn, until it is known whether another one is violated.
SLICES = (_Slice(5, False), _Slice(2, True), _Slice(50, False), _Slice(20, True))
AT_LAST = _Slice(None, False)


@dataclass(frozen=True, slots=True)
class _Looked:
    """What was found out about one claim, round by round. ``tired``: there is more to be found."""

    said: Said
    unreplayed: tuple[str, int | None] | None
    tired: bool


@dataclass(frozen=True, slots=True)
class ByRounds:
    """Bounded model checking claim by claim, and proofs of all of them at the same time.

    What ``proofs`` say, which are asked in turn, counts first: the rounds that were looked at
    meanwhile count where that settles nothing. ``unrolling`` was asked about all claims together
    for a while.
    """

    unrolling: ByUnrolling
    pool: Pool
    proofs: Sequence[Works] = ()

    def work(self, ledger: Ledger) -> None:
        wanting = ledger.wanting()
        if not can_fork() or not wanting or (not self.proofs and len(wanting) < 2):
            for engine in (*self.proofs, self.unrolling):
                if ledger.open():
                    engine.work(ledger)
            return
        open_ = ledger.open()
        proving = {None: self.pool.hand_in("", partial(asked, ledger, open_, self.proofs))}
        slices = _slices(ledger)
        jobs = self._handed_in(ledger, wanting, slices[0])
        for _, said in self.pool.answers(proving):
            if said is not None:
                ledger.take(said)
        if ledger.open() != open_:
            # What is settled helps with the rest.
            for job in jobs.values():
                self.pool.drop(job)
            slices = _slices(ledger)
            jobs = self._handed_in(ledger, ledger.wanting(), slices[0])
        tired = self._taken(ledger, jobs)
        for slice_ in slices[1:]:
            if ledger.is_violated or not tired:
                break
            tired = self._taken(ledger, self._handed_in(ledger, tired, slice_))

    def _handed_in(
        self, ledger: Ledger, claims: Sequence[Claim], slice_: _Slice
    ) -> dict[Claim, Job[_Looked]]:
        def look(claim: Claim, tell: Progress) -> _Looked:
            own = ledger.of([claim], tell)
            effort = None if slice_.seconds is None else Effort.of_seconds(slice_.seconds)
            unrolling = ByUnrolling() if slice_.afresh else self.unrolling
            with own.stopping():
                unrolling.through(own, own.bounds.rounds, effort)
            bounded = unrolling.of(own)
            return _Looked(own.said([claim]), bounded.unreplayed.get(claim), bounded.tired)

        return {c: self.pool.hand_in(c.name, partial(look, c)) for c in claims}

    def _taken(self, ledger: Ledger, jobs: Mapping[Claim, Job[_Looked]]) -> list[Claim]:
        """Put down what was found out; the claims of which there is more to be found."""
        tired: list[Claim] = []
        with ledger.waiting():
            for claim, looked in self.pool.answers(jobs):
                if looked is None:
                    ledger.leave([claim], Reach(Engine.BMC, None, DIED, 0.0))
                    continue
                ledger.take(looked.said)
                if looked.unreplayed is not None:
                    self.unrolling.of(ledger).unreplayed[claim] = looked.unreplayed
                if looked.tired and claim not in ledger.verdicts:
                    tired.append(claim)
        if ledger.interrupted:
            raise KeyboardInterrupt
        return tired


def _slices(ledger: Ledger) -> Sequence[_Slice]:
    wanting = len(ledger.wanting())
    if ledger.is_violated:
        # Nobody waits long for the others.
        return [_Slice(AFTERWARDS_S / max(1, wanting), False)]
    return [*SLICES, AT_LAST] if wanting > 1 else [AT_LAST]


def singly(
    ledger: Ledger, claims: Sequence[Claim], pool: Pool, work: Callable[[Ledger, Claim], None]
) -> None:
    """Have work done on each of some claims, each on a ledger on which it alone is open."""
    if not can_fork() or len(claims) < 2:
        for claim in claims:
            own = ledger.of([claim], ledger.report)
            try:
                work(own, claim)
            finally:
                ledger.take(own.said([claim]))
        return

    def ask(claim: Claim, tell: Progress) -> Said:
        own = ledger.of([claim], tell)
        with own.stopping():
            work(own, claim)
        return own.said([claim])

    jobs = {claim: pool.hand_in(claim.name, partial(ask, claim)) for claim in claims}
    with ledger.waiting():
        for claim, said in pool.answers(jobs):
            if said is None:
                ledger.leave([claim], Reach(Engine.NONE, None, DIED, 0.0))
            else:
                ledger.take(said)
    if ledger.interrupted:
        raise KeyboardInterrupt


def asked(
    ledger: Ledger, claims: Sequence[Claim], engines: Iterable[Works], tell: Progress
) -> Said:
    """What engines say of some claims, in turn, in a process of its own."""
    own = ledger.of(claims, tell)
    with own.stopping():
        for engine in engines:
            if own.open():
                engine.work(own)
    return own.said(claims)
