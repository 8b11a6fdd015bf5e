"""The bounded model checking engine: all runs of so many rounds. [T-PREFIX]"""

from __future__ import annotations

from msgspec import Struct

from koord.verify.bounded_check import Unroller
from koord.verify.effort import Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Task, Tools, Worker
from koord.verify.ledger import Ledger


class BmcEngine(Struct, frozen=True):
    """The engine that unrolls round after round and searches each for violations."""

    unroller: Unroller

    @property
    def name(self) -> str:
        return Engine.BMC.value

    def suits(self, ledger: Ledger, task: Task) -> bool:
        return bool(ledger.wanting())

    def work(self, ledger: Ledger, task: Task) -> None:
        rounds = ledger.bounds.rounds
        rounds = rounds if task.rounds is None else min(rounds, task.rounds)
        effort = None if task.seconds is None else Effort.of_seconds(task.seconds)
        self.unroller.through(ledger, rounds, effort)


def make(engine: Engine, tools: Tools) -> Worker:
    """Make the engine for a problem."""
    return BmcEngine(tools.unroller)
