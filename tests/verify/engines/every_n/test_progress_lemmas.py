"""Lemmas of proofs of progress: who asks enters, of protocols that say nothing else. [T-PROGRESS]

Each protocol is made wrong in ways that let somebody wait for ever, with few robots: the search
shows it, and no proof of progress may be found with whatever lemmas.
"""

from __future__ import annotations

import pytest

from koord.syntax import core
from koord.syntax.types import BOOL
from koord.verify.claims import Claim, ClaimKind
from koord.verify.effort import Deadline, Effort
from koord.verify.engine_names import Engine
from koord.verify.engines.every_n.progress_lemmas import Lemmas
from koord.verify.engines.every_n.questions import GENEROUS, Means
from koord.verify.strategy import verification
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.loading import program_of, protocol_text
from tests.sampling import but_slow, first
from tests.verify.asking import system_of

#: Protocols whose claim about whole runs holds for every number of robots; those take longer.
HOLDING = ("lock_server", "gate", "landing_pad", "token_ring")
LONG = ("decentralized_lock", "lockserv", "readers_writers", "semaphore", "ticket")


def changed(name: str, old: str, new: str) -> str:
    text = protocol_text(name)
    assert old in text
    return text.replace(old, new)


#: Programs in which somebody waits for ever, with so many robots.
VIOLATED = {
    "one robot keeps the lock": (changed("lock_server", "pre: holds", "pre: holds and pid > 0"), 2),
    "who holds the lock may do something else": (
        protocol_text("lock_server") + "\nIdle:\n    pre: holds\n    eff:\n        holds = holds\n",
        2,
    ),
    "who leaves lets the gate shut": (
        changed("gate", "gate = true\n            inside", "gate = false\n            inside"),
        2,
    ),
    "the token passes one robot by": (
        changed("token_ring", "(pid + 1) % numAgents", "(pid + 2) % numAgents"),
        2,
    ),
    "the token comes back": (changed("token_ring", "(pid + 1) % numAgents", "pid"), 2),
    "a ticket is passed over": (
        changed("ticket", "pre: phase == out", "pre: phase == out and next < 4").replace(
            "serving + 1", "serving + 2"
        ),
        2,
    ),
    "what is granted is dropped": (
        protocol_text("lockserv")
        + """
Drop:
    pre: grant_msg[pid]
    eff:
        atomic:
            server_free = true
            grant_msg[pid] = false
""",
        1,
    ),
    "the server forgets that it has the lock": (
        changed(
            "lockserv",
            "unlock_msg[pid] = false\n            server_free = true",
            "unlock_msg[pid] = false\n            server_free = false",
        ),
        2,
    ),
    "who is cleared may go around for ever": (
        changed("landing_pad", "leadsto phase == cleared", "leadsto phase == landed"),
        1,
    ),
    "a place is lost": (changed("semaphore", "left = left + 1", "left = left + 0"), 2),
    "who reads may read on": (
        changed("readers_writers", "leadsto phase != out", "leadsto phase == writing"),
        1,
    ),
}

#: Those of them that take longer.
LONG_VIOLATED = (
    "a place is lost",
    "a ticket is passed over",
    "one robot keeps the lock",
    "the token comes back",
    "the token passes one robot by",
    "what is granted is dropped",
    "who reads may read on",
)


def asked(text: str, robots: int, engine: Engine) -> Verdict:
    """The verdict on the claim about whole runs of a program."""
    report = verification.verify(system_of(program_of(text), robots), Bounds(6), engine)
    (verdict,) = (v for v in report.verdicts if v.claim.kind.value == "liveness")
    return verdict


@pytest.mark.parametrize("name", first(2, but_slow(LONG, (*HOLDING, *LONG))))
def test_who_asks_enters_however_many_there_are(name: str) -> None:
    verdict = asked(protocol_text(name), 2, Engine.EVERY_N)
    assert verdict.outcome is Outcome.HOLDS, verdict.reason
    assert verdict.engine is Engine.EVERY_N
    assert verdict.fairness[0] == "robots"
    assert bool(verdict.lemmas) is (name != "token_ring")


@pytest.mark.parametrize("name", first(2, but_slow(LONG_VIOLATED, VIOLATED)))
def test_nobody_who_may_wait_for_ever_is_said_to_enter(name: str) -> None:
    text, robots = VIOLATED[name]
    assert asked(text, 2, Engine.EVERY_N).outcome is Outcome.UNKNOWN
    assert asked(text, robots, Engine.SEARCH).outcome is Outcome.VIOLATED


def test_a_lemma_is_proved_before_anything_rests_on_it() -> None:
    system = system_of(program_of(protocol_text("lock_server")), 2)
    means = Means(Deadline(), Effort.of_seconds(GENEROUS.seconds), GENEROUS, 0)
    lemmas = Lemmas.of(system, (), means)
    assert lemmas is not None
    wrong = core.Property("", core.PropertyKind.INVARIANT, core.Const(value=False, type=BOOL), 0)
    assert lemmas.proved([Claim("wrong", ClaimKind.PROPERTY, wrong)]) == []
