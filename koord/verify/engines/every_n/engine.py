"""The engine for every number of robots, as a worker on a ledger. [T-EVERY-N]"""

from __future__ import annotations

import time

from msgspec import Struct

from koord.verify.effort import Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.every_n.candidates import candidates
from koord.verify.engines.every_n.proving import AFTER_INIT, GENEROUS, Thrift, infer, prove
from koord.verify.ledger import Ledger, Reach
from koord.verify.obstacles import gave_up
from koord.verify.verdicts import Outcome, Verdict

#: So few likely invariants are tried before other engines get their turn: in about 0.1 s.
FEW = 64


class ByEveryN(Struct, frozen=True):
    """Proofs for every number of robots, which are proofs for the number that was asked about."""

    thrift: Thrift = GENEROUS

    @property
    def name(self) -> str:
        return Engine.EVERY_N.value

    def work(self, ledger: Ledger) -> None:
        started = time.monotonic()
        ledger.progress("every N, a proof for every number of robots")
        claims = ledger.open()
        effort = Effort.of_seconds(self.thrift.seconds)
        found = prove(ledger.system, claims, ledger.deadline, effort, self.thrift, ledger.seed)
        seconds = time.monotonic() - started
        ledger.settle(
            {
                claim: Verdict(claim, Outcome.HOLDS, Engine.EVERY_N, seconds)
                for claim in found.proved
            }
        )
        for claim, reason in found.reasons.items():
            obstacle = gave_up(Engine.EVERY_N, ledger.deadline)
            reach = Reach(Engine.EVERY_N, None, reason, seconds, obstacle=obstacle)
            ledger.leave([claim], reach)


class ByInference(Struct, frozen=True):
    """The same with the help of invariants that nobody gave: found among likely ones.

    Where something is violated, rounds that were looked at are enough of the rest. Nothing is done
    where more than ``most`` invariants are likely: each of them costs.
    """

    thrift: Thrift = GENEROUS
    most: int | None = None

    @property
    def name(self) -> str:
        return Engine.EVERY_N.value

    def work(self, ledger: Ledger) -> None:
        if ledger.is_violated and not ledger.wanting():
            return
        started = time.monotonic()
        ledger.progress("every N, looking for invariants")
        # Invariants help from one round to the next, and not with what may fail to begin with.
        claims = [
            claim
            for claim in ledger.open()
            if not ledger.verdict(claim).reason.startswith(AFTER_INIT)
        ]
        known = [
            claim
            for claim, verdict in ledger.verdicts.items()
            if verdict.engine is Engine.EVERY_N and claim.is_state_property
        ]
        likely = candidates(ledger.system.program)
        if not likely or not claims or (self.most is not None and len(likely) > self.most):
            return
        effort = Effort.of_seconds(self.thrift.seconds)
        pool = [*known, *likely]
        found = infer(
            ledger.system, claims, pool, ledger.deadline, effort, self.thrift, ledger.seed
        )
        seconds = time.monotonic() - started
        lemmas = tuple(claim.name for claim in found.invariants if claim not in known)
        ledger.settle(
            {
                claim: Verdict(claim, Outcome.HOLDS, Engine.EVERY_N, seconds, lemmas=lemmas)
                for claim in found.proved
            }
        )
