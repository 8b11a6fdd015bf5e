"""What robots hand on around a ring comes to who waits for it, of any number. [T-PROGRESS]

Where it is handed on otherwise, somebody waits for ever: the search shows it with few robots, and
no proof may be found.
"""

from __future__ import annotations

import pytest

from koord.verify.claims import Claim, ClaimKind
from koord.verify.effort import Deadline, Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.every_n.progress import ProgressProof, progress
from koord.verify.engines.every_n.questions import GENEROUS, Means
from koord.verify.strategy import verification
from koord.verify.verdicts import Bounds, Outcome
from tests.loading import program_of, protocol_text
from tests.sampling import but_slow
from tests.verify.asking import system_of

#: What is known of the lock: there is one, with a robot or on its way.
ONE = """
invariant There: exists i: holds@i or message[i]
invariant Held: forall i, j: i != j and holds@i implies not message[j]
invariant OnItsWay: forall i, j: i != j and message[i] implies not message[j]
invariant Arrived: forall i: message[i] implies not holds@i
"""

NEXT = "(pid + 1) % numAgents"


def handed_to(index: str) -> str:
    """The program in which a robot sends the lock to another, with what is known of it."""
    return protocol_text("decentralized_lock").replace(NEXT, index) + ONE


def proof_of(text: str, seed: int) -> ProgressProof | str:
    """A proof of who waits enters, from what is stated besides."""
    program = program_of(text)
    means = Means(Deadline(), Effort.of_seconds(GENEROUS.seconds), GENEROUS, seed)
    stated = next(each for each in program.properties if each.trigger is not None)
    known = [
        Claim(each.name, ClaimKind.PROPERTY, each)
        for each in program.properties
        if each.trigger is None
    ]
    return progress(system_of(program, 2), stated, known, means)


BACK = ("(pid - 1) % numAgents", "(pid + numAgents - 1) % numAgents")


@pytest.mark.slow
@pytest.mark.parametrize("index", but_slow(BACK, (NEXT, *BACK)))
def test_the_lock_comes_to_who_waits_for_it(index: str) -> None:
    found = [proof_of(handed_to(index), seed) for seed in range(2)]
    assert all(isinstance(proof, ProgressProof) for proof in found), found


@pytest.mark.parametrize("index", ["(pid + 2) % numAgents", "pid"])
def test_a_lock_that_passes_somebody_by_is_not_said_to_come(index: str) -> None:
    text = handed_to(index)
    assert isinstance(proof_of(text, 0), str)
    report = verification.verify(system_of(program_of(text), 2), Bounds(6), Engine.SEARCH)
    (verdict,) = (v for v in report.verdicts if v.claim.kind.value == "liveness")
    assert verdict.outcome is Outcome.VIOLATED


@pytest.mark.slow
def test_who_may_keep_the_lock_is_not_said_to_send_it() -> None:
    text = handed_to(NEXT) + "\nKeep:\n    pre: holds\n    eff:\n        holds = true\n"
    assert isinstance(proof_of(text, 0), str)
