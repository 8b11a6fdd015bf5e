"""The engine for every number of robots, as a worker on a ledger. [T-EVERY-N]"""

from __future__ import annotations

import time
from dataclasses import dataclass

from koord.verify.every_n.proving import GENEROUS, Thrift, prove
from koord.verify.ledger import Ledger, Reach
from koord.verify.solving import Effort
from koord.verify.verdicts import Engine, Outcome, Verdict


@dataclass(frozen=True, slots=True)
class ByEveryN:
    """Proofs for every number of robots, which are proofs for the number that was asked about."""

    thrift: Thrift = GENEROUS

    def work(self, ledger: Ledger) -> None:
        started = time.monotonic()
        ledger.progress("every number of robots")
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
            ledger.leave([claim], Reach(Engine.EVERY_N, None, reason, seconds))
