"""The induction engine: for every number of rounds."""

from __future__ import annotations

import time

from msgspec import Struct, field

from koord.semantics.every_number import NotFiniteError
from koord.verify.bounded_check import AFTERWARDS_S, Unroller
from koord.verify.claims import Claim
from koord.verify.effort import Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Task, Tools, Worker
from koord.verify.engines.induction.proving import prove
from koord.verify.ledger import Ledger, Reach
from koord.verify.obstacles import Beyond, NotInductive, Obstacle, gave_up
from koord.verify.verdicts import BrokenStep

#: How many rounds an inductive step may span.
MAX_DEPTH = 3

#: What inductive attempts may cost before other engines get their turn: about so many seconds.
PROOF_S = 30.0

#: What a proof for all rounds may cost where all claims were seen to hold as far as was asked.
ANSWERED_S = 5.0


class InductionEngine(Struct):
    """The engine of k-induction: steps over one round, then two, ….

    A step of k rounds proves what holds in the first k - 1 rounds too, which is unrolled for it.
    """

    unroller: Unroller
    effort: Effort = field(default_factory=lambda: Effort.of_seconds(PROOF_S))
    afterwards: Effort = field(default_factory=lambda: Effort.of_seconds(AFTERWARDS_S))
    answered: Effort = field(default_factory=lambda: Effort.of_seconds(ANSWERED_S))
    _done: int = 0
    _shortest: dict[Claim, BrokenStep] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return Engine.INDUCTION.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        return True

    def work(self, ledger: Ledger, task: Task) -> None:
        rounds = MAX_DEPTH if task.rounds is None else task.rounds
        if task.seconds is None:
            self._over(rounds, ledger)
            return
        # What is not enough for it is tried again later.
        own, self.effort = self.effort, Effort.of_seconds(task.seconds)
        self._over(rounds, ledger)
        self._done = 0 if self.effort.left <= 0 else self._done
        self.effort = own

    def _over(self, rounds: int, ledger: Ledger) -> None:
        """Continue from where it stopped, up to steps of so many rounds."""
        started = time.monotonic()
        while self._done < rounds:
            if self._done > 0 and (ledger.deadline.passed() or self._effort(ledger).left <= 0):
                return
            self._done = depth = self._done + 1
            self.unroller.through(ledger, depth - 1, self._effort(ledger))
            bounded = self.unroller.of(ledger)
            # What is not known to hold in those rounds is neither to be proved nor to be assumed.
            claims = [c for c in ledger.open() if c not in bounded.unreplayed]
            if not claims or bounded.completed is None or bounded.completed < depth - 1:
                return
            ledger.progress(f"induction over {depth} round{'s' if depth > 1 else ''}")
            try:
                result = prove(
                    ledger.system,
                    claims,
                    ledger.proved(),
                    ledger.deadline,
                    self._effort(ledger),
                    depth=depth,
                    seed=ledger.seed,
                )
            except NotFiniteError as error:
                self._done = MAX_DEPTH  # longer steps have the same rounds in them
                seconds, why = time.monotonic() - started, str(error)
                beyond = Beyond(Engine.INDUCTION, why)
                ledger.leave(claims, Reach(Engine.INDUCTION, None, why, seconds, obstacle=beyond))
                return
            ledger.settle(result.proved)
            for claim, reason in result.reasons.items():
                seconds = time.monotonic() - started
                if claim in result.steps:
                    self._shortest.setdefault(claim, result.steps[claim])
                step = self._shortest.get(claim)
                obstacle: Obstacle = gave_up(Engine.INDUCTION, ledger.deadline)
                if claim in result.steps:
                    obstacle = NotInductive(Engine.INDUCTION)
                ledger.leave(
                    [claim], Reach(Engine.INDUCTION, None, reason, seconds, step, obstacle)
                )

    def _effort(self, ledger: Ledger) -> Effort:
        if not ledger.wanting():
            return self.answered
        return self.afterwards if ledger.is_violated else self.effort


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return InductionEngine(tools.unroller)
