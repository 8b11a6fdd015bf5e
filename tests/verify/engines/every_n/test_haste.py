"""What proofs for every number of robots are not asked in haste. [T-EVERY-N]"""

from __future__ import annotations

import pytest

from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task, Workers
from koord.verify.ledger import Ledger, Reach
from koord.verify.processes import Pool
from koord.verify.reduction.problems import plain_problem
from koord.verify.verdicts import Bounds
from tests.verify.engines.every_n.asking import system_of

TEXT = """
allread:
    bool[numAgents] on = false
Switch:
    eff: on[pid] = true
invariant Off: forall i: not on[i]
"""

HASTY = Task(seconds=0.1, evaluations=1_000)


@pytest.mark.parametrize(
    ("reason", "proofs", "lemmas"),
    [
        ("", True, True),
        ("not inductive for every number of robots", False, True),
        ("not covered: lists of more than 3", False, False),
        ("too much for the solver", True, True),
    ],
)
def test_what_is_known_is_not_asked_again_in_haste(reason: str, proofs: bool, lemmas: bool) -> None:
    system = system_of(TEXT)
    problem = plain_problem(system)
    ledger = Ledger(problem, Bounds(3), Deadline(), claims_of(system))
    engine = Workers(Pool()).of(Engine.EVERY_N)
    ledger.leave(ledger.open(), Reach(Engine.EVERY_N, None, reason, 0.0))
    assert engine.suits(ledger, HASTY) is proofs
    hasty = Task(Purpose.INFER, seconds=0.1, evaluations=1_000)
    assert engine.suits(ledger, hasty) is lemmas
    for task in (Task(seconds=3.0), Task(Purpose.INFER)):  # there is time
        assert engine.suits(ledger, task)
