"""Asking the engine on bits about a system."""

from __future__ import annotations

from functools import partial

from koord.syntax.system import System
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engines.bits.engine import BitsEngine
from koord.verify.engines.engine import Task
from koord.verify.ledger import Ledger, VerificationProblem
from koord.verify.verdicts import Bounds
from tests.verify.asking import SECONDS, judged


def on_bits(system: System, rounds: int, *, sparing: bool = False) -> Ledger:
    """A ledger after the engine worked on it, without simplifying what it found."""
    subject = VerificationProblem(system, partial(judged, system), system)
    ledger = Ledger(subject, Bounds(rounds), Deadline.after(SECONDS), claims_of(system))
    BitsEngine().work(ledger, Task(questions=30_000 if sparing else None))
    return ledger
