"""The engine of proofs for every number of robots. [T-EVERY-N]"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from msgspec import Struct
from msgspec.structs import replace

from koord.syntax.analysis.footprint import stops_show
from koord.verify.claims import Claim
from koord.verify.effort import Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task, Tools, Worker
from koord.verify.engines.every_n.candidates import candidates
from koord.verify.engines.every_n.proving import Inferred, infer, prove, prove_over
from koord.verify.engines.every_n.questions import (
    AFTER_INIT,
    GENEROUS,
    NOT_COVERED,
    NOT_INDUCTIVE,
    SPARING,
    Means,
    ProofBudget,
)
from koord.verify.ledger import Ledger, Reach
from koord.verify.obstacles import gave_up
from koord.verify.verdicts import Outcome, Verdict


class EveryNEngine(Struct, frozen=True):
    """The engine of proofs for every number of robots, which include the given number.

    Asked to infer, it looks for invariants that help: first against counterexamples, then among
    likely ones, the simplest of them where a task allows only a few: each of them costs.
    Where something is violated, rounds that were looked at are enough of the rest.
    """

    @property
    def name(self) -> str:
        return Engine.EVERY_N.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        reasons = [ledger.verdict(claim).reason for claim in ledger.open()]
        hasty = task.evaluations is not None
        # What was found out before is so again: whoever has much time asks, to be sure.
        if hasty and any(reason.startswith(NOT_COVERED) for reason in reasons):
            return False
        if task.purpose is Purpose.INFER:
            return not ledger.is_violated or bool(ledger.wanting())
        return not (hasty and all(reason.startswith(NOT_INDUCTIVE) for reason in reasons))

    def work(self, ledger: Ledger, task: Task) -> None:
        thrift = GENEROUS if task.seconds is None else replace(SPARING, seconds=task.seconds)
        if task.purpose is Purpose.INFER:
            _infer(ledger, thrift, task.candidates)
        else:
            _prove(ledger, thrift)


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return EveryNEngine()


def _prove(ledger: Ledger, thrift: ProofBudget) -> None:
    started = time.monotonic()
    ledger.progress("every N, a proof for every number of robots")
    effort = Effort.of_seconds(thrift.seconds)
    means = ledger.deadline, effort, thrift, ledger.seed
    found = prove(ledger.system, ledger.open(), *means, known=_known(ledger))
    seconds = time.monotonic() - started
    ledger.settle(
        {claim: Verdict(claim, Outcome.HOLDS, Engine.EVERY_N, seconds) for claim in found.proved}
    )
    over = _over_rounds(ledger, found.reasons, thrift)
    for claim, reason in found.reasons.items():
        if claim in over:
            continue
        obstacle = gave_up(Engine.EVERY_N, ledger.deadline)
        ledger.leave([claim], Reach(Engine.EVERY_N, None, reason, seconds, obstacle=obstacle))


#: So often lemmas are looked for against counterexamples where nobody else has an answer: which of
#: them a solver comes upon first is luck, and with other luck others are found.
_ATTEMPTS = 3

#: Over so many rounds what may be hidden between two comes to light.
_ROUNDS = 2


def _over_rounds(
    ledger: Ledger, reasons: Mapping[Claim, str], thrift: ProofBudget
) -> tuple[Claim, ...]:
    """Settle claims by induction over two rounds, where robots stop together. [STOP]

    Properties do not see who has asked to stop: what it has seen is known one round later only.
    """
    system = ledger.system
    left = [claim for claim, why in reasons.items() if not why.startswith(AFTER_INIT)]
    if not left or not stops_show(system.program) or ledger.deadline.passed():
        return ()
    started = time.monotonic()
    means = Means(ledger.deadline, Effort.of_seconds(thrift.seconds), thrift, ledger.seed)
    proved = prove_over(system, left, _known(ledger), means, _ROUNDS)
    seconds = time.monotonic() - started
    ledger.settle(
        {
            claim: Verdict(claim, Outcome.HOLDS, Engine.EVERY_N, seconds, depth=_ROUNDS)
            for claim in proved
        }
    )
    return proved


def _infer(ledger: Ledger, thrift: ProofBudget, most: int | None) -> None:
    # Whoever needs no lemmas does not load what looks for them.
    from koord.verify.engines.every_n.lemma_search import infer_from_counterexamples

    started = time.monotonic()
    ledger.progress("every N, looking for invariants")
    # Invariants help from one round to the next, and not with what may fail to begin with.
    claims = [c for c in ledger.open() if not ledger.verdict(c).reason.startswith(AFTER_INIT)]
    known = _known(ledger)
    if not claims:
        return
    for attempt in range(_ATTEMPTS if thrift is GENEROUS else 1):
        effort = Effort.of_seconds(thrift.seconds)
        means = ledger.deadline, effort, thrift, ledger.seed + attempt
        found = infer_from_counterexamples(ledger.system, claims, known, *means)
        _note(ledger, found, known, started)
        claims = [claim for claim in claims if claim not in found.proved]
        if not claims or ledger.deadline.passed():
            return
    likely = candidates(ledger.system.program)[:most]
    if not likely:
        return
    effort, pool = Effort.of_seconds(thrift.seconds), [*known, *likely]
    found = infer(ledger.system, claims, pool, ledger.deadline, effort, thrift, ledger.seed)
    _note(ledger, found, known, started)


def _known(ledger: Ledger) -> list[Claim]:
    """The claims that are known to hold for every number of robots, and may be assumed."""
    return [
        claim
        for claim, verdict in ledger.verdicts.items()
        if verdict.engine is Engine.EVERY_N
        and verdict.outcome is Outcome.HOLDS
        and claim.is_state_property
    ]


def _note(ledger: Ledger, found: Inferred, known: Sequence[Claim], started: float) -> None:
    seconds = time.monotonic() - started
    lemmas = found.lemmas(known)
    ledger.settle(
        {
            claim: Verdict(claim, Outcome.HOLDS, Engine.EVERY_N, seconds, lemmas=lemmas)
            for claim in found.proved
        }
    )
