"""What takes long is asked singly: each claim in a process of its own, several at a time.

Engines are asked about all claims together first, for so much effort. Claims that are open then
know nothing of each other, so that no answer hangs on another, nor on how many are asked at a time.
Effort is counted in work, not in time: what is asked singly is the same on every machine.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial

from msgspec import Struct

from koord.verify.bounded_check import AFTERWARDS_S, Unroller
from koord.verify.claims import Claim
from koord.verify.each_claim import note_end
from koord.verify.effort import Effort
from koord.verify.engine_names import Engine
from koord.verify.failures import Failure
from koord.verify.ledger import Extract, Ledger, reach_of
from koord.verify.processes import Job, Pool, Progress, Teller, can_fork
from koord.verify.strategy.turns import AnyTurn
from koord.verify.verdicts import Outcome, Verdict


class _Slice(Struct, frozen=True):
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


class _Looked(Struct, frozen=True):
    """What was found out about one claim, round by round. ``tired``: there is more to be found."""

    said: Extract
    unreplayed: tuple[str, int | None] | None
    tired: bool


class EachClaimTurn(Struct, frozen=True):
    """Bounded model checking claim by claim, and proofs of all of them at the same time.

    What ``proofs`` say, which are asked in turn, counts first: the rounds that were looked at
    meanwhile count where that settles nothing. ``unrolling`` was asked about all claims together
    for a while.
    """

    unrolling: Unroller
    pool: Pool
    proofs: Sequence[AnyTurn] = ()

    @property
    def name(self) -> str:
        return Engine.BMC.value

    def work(self, ledger: Ledger) -> None:
        wanting, open_ = ledger.wanting(), ledger.open()
        if not can_fork():
            for engine in self.proofs:
                if ledger.open():
                    with ledger.enduring(engine.name):
                        engine.work(ledger)
            self.unrolling.work(ledger)
            return
        proving = self._proving(ledger, open_, 0) if self.proofs else None
        slices = _slices(ledger)
        alone = not wanting or (not self.proofs and len(wanting) < 2)
        jobs = {} if alone else self._submitted(ledger, wanting, slices[0])
        while proving is not None:
            for _, said in self.pool.answers({None: proving}):
                if said is not None:
                    ledger.take(said)
            proving = self._behind(ledger, open_, proving)
        if alone:
            self.unrolling.work(ledger)
            return
        if ledger.open() != open_:
            # What is settled helps with the rest.
            for job in jobs.values():
                self.pool.drop(job)
            slices = _slices(ledger)
            jobs = self._submitted(ledger, ledger.wanting(), slices[0])
        tired = self._taken(ledger, jobs)
        for slice_ in slices[1:]:
            if ledger.is_violated or not tired:
                break
            tired = self._taken(ledger, self._submitted(ledger, tired, slice_))

    def _proving(self, ledger: Ledger, claims: Sequence[Claim], first: int) -> Job[Extract]:
        """The proofs from one of them on, in a process of their own."""
        proofs = list(enumerate(self.proofs))[first:]
        return self.pool.submit("", partial(asked, ledger, claims, proofs))

    def _behind(
        self, ledger: Ledger, claims: Sequence[Claim], died: Job[Extract]
    ) -> Job[Extract] | None:
        """Where the process of proofs died, what it had told of counts, and the next one is asked.

        None if there is nothing to go on with.
        """
        begun = [turn for turn in died.noted if isinstance(turn, int)]
        if died.found is not None or died.is_late:
            return None
        for verdict in died.noted:
            if isinstance(verdict, Verdict) and verdict.claim not in ledger.verdicts:
                if verdict.outcome is not Outcome.UNKNOWN:
                    ledger.settle({verdict.claim: verdict})
                else:
                    ledger.leave([verdict.claim], reach_of(verdict))
        name = self.proofs[begun[-1]].name if begun else "koord"
        ledger.fail(Failure(name, died.end))
        if not begun or begun[-1] + 1 >= len(self.proofs) or not ledger.open():
            return None
        return self._proving(ledger, claims, begun[-1] + 1)

    def _submitted(
        self, ledger: Ledger, claims: Sequence[Claim], slice_: _Slice
    ) -> dict[Claim, Job[_Looked]]:
        def look(claim: Claim, tell: Progress) -> _Looked:
            own = ledger.of([claim], tell)
            effort = None if slice_.seconds is None else Effort.of_seconds(slice_.seconds)
            unrolling = Unroller() if slice_.afresh else self.unrolling
            with own.stopping(), own.enduring(self.name):
                unrolling.through(own, own.bounds.rounds, effort)
            bounded = unrolling.of(own)
            return _Looked(own.extract([claim]), bounded.unreplayed.get(claim), bounded.tired)

        until = ledger.deadline.at_last()
        return {c: self.pool.submit(c.name, partial(look, c), until=until) for c in claims}

    def _taken(self, ledger: Ledger, jobs: Mapping[Claim, Job[_Looked]]) -> list[Claim]:
        """Put down what was found out; the claims of which there is more to be found."""
        tired: list[Claim] = []
        with ledger.waiting():
            for claim, looked in self.pool.answers(jobs):
                if looked is None:
                    note_end(ledger, claim, self.name, jobs[claim].end)
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


def asked(
    ledger: Ledger, claims: Sequence[Claim], engines: Iterable[tuple[int, AnyTurn]], tell: Teller
) -> Extract:
    """What engines say of some claims, in turn, in a process of its own.

    It tells whose turn it is, and what is known by then.
    """
    own = ledger.of(claims, tell)
    own.noted = tell.note
    proofs = list(engines)
    with own.stopping():
        for n, (turn, engine) in enumerate(proofs):
            if own.open():
                tell.note(turn)
                # The rounds wait, too.
                with own.deadline.sharing(1 / (1 + len(proofs) - n)) as ended:
                    tell.lasting(ended)
                    with own.enduring(engine.name):
                        engine.work(own)
    return own.extract(claims)
