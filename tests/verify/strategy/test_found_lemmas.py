"""What was found for claims about states is tried for whole runs, and proved anew. [T-PROGRESS]"""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from koord.syntax import core
from koord.syntax.system import dealt
from koord.verify.claims import Claim
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.every_n import progress_lemmas
from koord.verify.reduction.slicing import Slices, speaks_of
from koord.verify.strategy import verification
from koord.verify.strategy.liveness import settled
from koord.verify.strategy.table import LIVENESS, LivenessRow
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.loading import program_of, protocol_text

LOCK = protocol_text("lock_server")

#: A lock with a count that has nothing to do with it.
COUNTED = LOCK.replace("bool free = true", "bool free = true\n    int count = 0").replace(
    "holds = false\n\ninv", "holds = false\n            count = 1\n\ninv"
)

HELD = "not free implies exists j: holds@j"

#: What is not true: nobody would ask for long.
WRONG = "forall i: holds@i"


def said(text: str, *statements: str) -> list[core.Property]:
    """Statements about a program, with the numbers of its variables."""
    program = program_of(text + "".join(f"\ninvariant: {each}\n" for each in statements))
    return list(program.properties[-len(statements) :])


@pytest.fixture(autouse=True)
def no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody finds other lemmas."""

    def nothing(*given: object) -> None:
        return None

    monkeypatch.setattr(progress_lemmas.Lemmas, "of", nothing)


def asked(
    text: str, found: list[core.Property], rows: Sequence[LivenessRow] = LIVENESS[Engine.EVERY_N]
) -> Verdict:
    """The verdict on who asks enters."""
    slices = Slices(dealt(program_of(text), 2))
    (verdict,) = settled(slices, Bounds(3), rows, Deadline(), found=found).verdicts
    return verdict


def test_what_was_found_is_enough_where_it_is() -> None:
    assert asked(LOCK, []).outcome is Outcome.UNKNOWN
    verdict = asked(LOCK, said(LOCK, HELD))
    assert verdict.outcome is Outcome.HOLDS
    assert verdict.engine is Engine.EVERY_N
    assert len(verdict.lemmas) == 1


def test_it_is_tried_where_lemmas_are_looked_for() -> None:
    """Others are asked before who may have an answer in no time."""
    first, *_ = LIVENESS[Engine.EVERY_N]
    assert asked(LOCK, said(LOCK, HELD), [first]).outcome is Outcome.UNKNOWN


def test_what_was_found_is_proved_anew() -> None:
    assert asked(LOCK, said(LOCK, WRONG)).outcome is Outcome.UNKNOWN
    verdict = asked(LOCK, said(LOCK, WRONG, HELD))
    assert verdict.outcome is Outcome.HOLDS
    assert len(verdict.lemmas) == 1


def test_what_a_slice_has_no_words_for_is_left_out() -> None:
    text = COUNTED
    of_count, held = said(text, "count <= 1", HELD)
    slices = Slices(dealt(program_of(text), 2))
    (enters,) = (c for c in slices.claims.values() if c.name == "Enters")
    part = slices.slice_of(slices.cone([enters]))
    assert part is not slices.system
    assert [speaks_of(part.program, each) for each in (of_count, held)] == [False, True]
    verdict = asked(text, [of_count, held])
    assert verdict.outcome is Outcome.HOLDS
    assert [lemma.condition for lemma in verdict.lemmas] == [held.condition]


def test_functions_that_a_slice_does_not_have_are_no_words_of_it() -> None:
    text = "def fun small(int x) -> bool:\n    return x < 3\n" + LOCK
    (stated,) = said(text, "forall i: small(i)")
    program = program_of(text)
    assert not speaks_of(program_of(LOCK), stated)
    assert speaks_of(program, stated)


def test_claims_about_states_hand_on_what_was_found_for_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (held,) = said(LOCK, HELD)
    whole = verification._Verification._of_states

    def of_states(self: object, *given: object) -> object:
        verdicts, *ledgers = whole(self, *given)  # type: ignore[arg-type]
        assert all(verdict.engine is Engine.EVERY_N for verdict in verdicts)
        first, *others = verdicts
        found = Verdict(first.claim, Outcome.HOLDS, Engine.EVERY_N, 0.0, lemmas=(held,))
        return ([found, *others], *ledgers)

    monkeypatch.setattr(verification._Verification, "_of_states", of_states)
    system = dealt(program_of(LOCK), 2)
    report = verification.verify(system, Bounds(3), Engine.EVERY_N)
    outcomes = {verdict.claim.name: verdict.outcome for verdict in report.verdicts}
    assert outcomes["Enters"] is Outcome.HOLDS
    assert isinstance(report.verdicts[0].claim, Claim)
