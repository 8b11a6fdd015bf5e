"""Verdicts on a program that has changed since: by them it is decided who is asked first.

Nothing of them is taken to be true: what is said of the program is what is said without them.
"""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from koord.syntax import core
from koord.syntax.system import System, dealt
from koord.syntax.types import BOOL
from koord.verify.cache.verifying import CachedVerification
from koord.verify.claims import Claim, ClaimKind
from koord.verify.engine_names import Engine
from koord.verify.processes import Job, Pool
from koord.verify.strategy import verification
from koord.verify.strategy.resumption import PastVerification
from koord.verify.strategy.table import AskEngine
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Emptiness, Outcome, Report, Verdict
from tests.loading import program_of
from tests.sampling import first
from tests.verify.cache.caching import SHORT, new_cache

#: With few robots everything happens; that `Done` holds rests on `Small`.
TEXT = """
local:
    int n = 0
    int m = 0
Up:
    pre: n != 3 and n < 9
    eff: n = n + 1
Rare:
    pre: m < 1 and numAgents < 5
    eff: m = m + 1
invariant Small: forall i: n@i <= 3
invariant Other: forall i: m@i <= 3
eventually Done: forall i: n@i == 3
"""


def of(text: str, robots: int = 2) -> System:
    return dealt(program_of(text), robots)


def changed_after(first: System, second: System) -> CachedVerification:
    """What is known of a second system, of which nothing is kept, after a first one."""
    cache = new_cache()
    begun = CachedVerification.begun(cache, first, SHORT)
    begun.ended(verify(first, SHORT, past=begun.past, jobs=2))
    begun = CachedVerification.begun(cache, second, SHORT)
    assert begun.answer is None
    assert not begun.known
    assert begun.past.likely
    return begun


def after(first: System, second: System) -> Report:
    """What is said of a second system after a first one, by two processes."""
    begun = changed_after(first, second)
    return begun.ended(verify(second, SHORT, past=begun.past, jobs=2))


def outcomes(report: Report) -> dict[str, tuple[Outcome, Engine]]:
    return {v.claim.name: (v.outcome, v.engine) for v in report.verdicts}


EDITS = {
    "nothing breaks": ("n != 3 and n < 9", "n < 3"),
    "a claim about states breaks, on which one about runs rests": ("int n = 0", "int n = 5"),
    "a claim about runs breaks": ("n < 9", "n != 2"),
}


@pytest.mark.parametrize(("old", "new"), first(1, EDITS.values()), ids=EDITS)
def test_of_a_changed_program_the_same_is_said_as_without(old: str, new: str) -> None:
    changed = of(TEXT.replace(old, new))
    found, fresh = after(of(TEXT), changed), verify(changed, SHORT)
    assert outcomes(found) == outcomes(fresh)
    assert found.vacuities == fresh.vacuities


def test_what_rests_on_a_claim_that_does_not_hold_any_more_counts_for_nothing() -> None:
    found = outcomes(after(of(TEXT), of(TEXT.replace("int n = 0", "int n = 5"))))
    assert found["Small"][0] is Outcome.VIOLATED
    assert found["Done"][0] is not Outcome.HOLDS


@pytest.mark.slow
def test_few_robots_show_nothing_where_a_proof_is_for_these_alone_after_all() -> None:
    """Six robots never run what fewer can; that is told where `Done` is not of every number."""
    changed = of(TEXT.replace("n < 9", "n != 2"), 6)
    first = after(of(TEXT, 6), of(TEXT.replace("n != 3 and n < 9", "n < 3"), 6))
    assert not first.vacuities
    found = after(of(TEXT, 6), changed)
    assert [(v.what, v.subject) for v in found.vacuities] == [(Emptiness.EVENT, "Rare")]


def test_who_proved_all_is_asked_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """With one row in the table, which is for where its engine proved the same before."""
    row = AskEngine(Engine.EVERY_N, again=True)
    changed = of(TEXT.replace("m < 1", "m < 2"))
    begun = changed_after(of(TEXT), changed)
    monkeypatch.setattr(verification, "SAFETY", {None: (row,)})
    assert outcomes(verify(changed, SHORT))["Small"] == (Outcome.UNKNOWN, Engine.NONE)
    found = outcomes(verify(changed, SHORT, past=begun.past))
    assert found["Small"] == (Outcome.HOLDS, Engine.EVERY_N)


def test_whoever_ends_it_while_others_are_waited_for_is_told_what_is_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def ended(pool: Pool, job: Job[object]) -> None:
        raise KeyboardInterrupt

    changed = of(TEXT.replace("m < 1", "m < 2"))
    begun = changed_after(of(TEXT), changed)
    monkeypatch.setattr(Pool, "answer", ended)
    found = verify(changed, SHORT, past=begun.past, jobs=2)
    assert found.interrupted
    assert outcomes(found)["Small"] == (Outcome.HOLDS, Engine.EVERY_N)
    assert outcomes(found)["Done"][0] is Outcome.UNKNOWN


# --- who proved all -------------------------------------------------------------------------------

TRUE = core.Const(True, BOOL)
LEMMA = core.Property("", core.PropertyKind.INVARIANT, TRUE, 0)


def verdict(name: str, engine: Engine = Engine.EVERY_N) -> Verdict:
    return Verdict(Claim(name, ClaimKind.FAULT), Outcome.HOLDS, engine, 0.0)


def test_claims_were_proved_for_every_number_where_each_of_them_was() -> None:
    past = PastVerification((verdict("known"),), likely=(verdict("likely"), verdict("both")))
    assert past.was_for_every_n(["known", "likely"])
    assert not past.was_for_every_n(["known", "new"])


@pytest.mark.parametrize(
    "other",
    [
        verdict("likely", Engine.BITS),
        replace(verdict("likely"), outcome=Outcome.UNKNOWN),
        replace(verdict("likely"), lemmas=(LEMMA,)),
    ],
    ids=["another engine", "unknown", "with lemmas"],
)
def test_what_was_not_proved_for_every_number_is_not_asked_so(other: Verdict) -> None:
    assert not PastVerification(likely=(other,)).was_for_every_n(["likely"])
    assert not PastVerification((other,), likely=(verdict("likely"),)).was_for_every_n(["likely"])


def test_claims_that_are_new_are_asked_as_those_of_which_something_was_found() -> None:
    past = PastVerification((verdict("known"),), likely=(verdict("likely"),))
    assert past.speaks_for_every_n(["known", "likely", "new"])
    assert not past.speaks_for_every_n(["new"])
    mixed = replace(past, likely=(verdict("likely", Engine.BITS),))
    assert not mixed.speaks_for_every_n(["known", "likely", "new"])
