"""Asking the engine on bits about a system."""

from __future__ import annotations

from functools import partial
from random import Random

from koord.refinement.generating.programs import system
from koord.semantics.every_number import NotFiniteError
from koord.syntax.system import System
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engines.bits.circuit import Circuit, circuit_of
from koord.verify.engines.bits.engine import BitsEngine
from koord.verify.engines.engine import Task
from koord.verify.ledger import Ledger, VerificationProblem
from koord.verify.verdicts import Bounds
from tests.generators.profiles import FINITE
from tests.verify.asking import SECONDS, judged


def finite_circuit(seed: int) -> Circuit | None:
    """The circuit of a generated program; None if that is not finite."""
    made = system(Random(seed), FINITE)
    try:
        return circuit_of(made, claims_of(made))
    except NotFiniteError:
        return None


def on_bits(of: System, rounds: int, *, sparing: bool = False) -> Ledger:
    """A ledger after the engine worked on it, without simplifying what it found."""
    subject = VerificationProblem(of, partial(judged, of), of)
    ledger = Ledger(subject, Bounds(rounds), Deadline.after(SECONDS), claims_of(of))
    BitsEngine().work(ledger, Task(questions=30_000 if sparing else None))
    return ledger
