"""One turn of a strategy: somebody works on a ledger."""

from __future__ import annotations

from typing import Protocol

from msgspec import Struct

from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Task, Workers
from koord.verify.ledger import Ledger


class AnyTurn(Protocol):
    """Somebody who settles the open claims of a ledger, or says how far it came with them."""

    @property
    def name(self) -> str:
        """What it is called where it fails."""

    def work(self, ledger: Ledger) -> None: ...


class EngineTurn(Struct, frozen=True):
    """An engine is asked for a task; it is loaded when its turn comes."""

    engine: Engine
    task: Task
    workers: Workers
    quick: bool = False

    @property
    def name(self) -> str:
        return self.engine.value

    def work(self, ledger: Ledger) -> None:
        worker = self.workers.of(self.engine)
        if worker.suits(ledger, self.task):
            worker.work(ledger, self.task)
