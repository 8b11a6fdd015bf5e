"""The explicit search as an engine: what it says of a run that it found."""

from __future__ import annotations

import pytest

from koord.semantics.recordings import Recording
from koord.syntax.system import System, dealt
from koord.verify.claims import Claim, ClaimPhase, claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.explicit.exhaustive import SearchResults, exhaust
from koord.verify.engines.explicit.limits import Limits
from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
from koord.verify.engines.explicit.search import survey
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Counterexample, Outcome
from koord.verify.witness import replayed
from tests.loading import program_of
from tests.verify.asking import of_text

COUNTS = """
local:
    int x = 0
Up:
    eff:
        x = (x + 1) % 4
"""

HEATS = """
using Heater:
    sensors:
        int temp = 0
    environment:
        temp = (temp + 1) % 4
"""


def system_of(text: str) -> System:
    return dealt(program_of(text), 2)


def counterexample(text: str) -> Counterexample:
    (verdict, *_) = verify(system_of(text), Bounds(rounds=5), Engine.SEARCH).verdicts
    assert verdict.engine is Engine.SEARCH
    assert verdict.counterexample is not None
    return verdict.counterexample


@pytest.mark.parametrize(
    ("text", "round_", "phase"),
    [
        (COUNTS + "invariant Low: x < 2", 2, ClaimPhase.MIDDLE),
        (COUNTS + "invariant Low at round: x < 2", 2, ClaimPhase.END),
        (HEATS + "invariant Low: temp < 3", 3, ClaimPhase.END),
        (COUNTS + "invariant Low: x > 0", 0, ClaimPhase.INIT),
    ],
    ids=["a robot's turn", "asked at round ends", "the environment's turn", "the start"],
)
def test_a_violation_is_told_where_it_happens(text: str, round_: int, phase: ClaimPhase) -> None:
    found = counterexample(text)
    assert (found.round, found.phase) == (round_, phase)
    cut = [taken.cut for taken in found.recording.rounds]
    assert cut == [False] * (round_ - 1) + [phase is ClaimPhase.MIDDLE] * min(round_, 1)


def test_a_search_that_found_everything_it_was_asked_about_ends() -> None:
    text = "allwrite:\n  int x = 0\nUp:\n  pre: x < 900\n  eff: atomic: x = x + 1\n"
    system = of_text(text + "invariant Small: x < 3\ninvariant Positive: x >= 0\n", 1)
    small, positive = system.program.properties
    found = survey(system, [small], subjects=frozenset())
    assert [v.claim.name for v in found.violated] == ["Small"]
    assert isinstance(found.end, OutOfBounds)
    assert found.end.states < 10
    both = survey(system, [small, positive], subjects=frozenset())
    assert [v.claim.name for v in both.violated] == ["Small"]
    assert isinstance(both.end, Exhausted)
    assert both.end.states == 901


def test_what_was_found_counts_when_a_search_without_end_is_stopped() -> None:
    system = of_text(
        "local:\n  int x = 0\nUp:\n  eff: x = x + 1\ninvariant A: x < 2\ninvariant B: x < 5\n", 1
    )
    claims = claims_of(system)

    def judge(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
        if claim.name == "B":
            raise KeyboardInterrupt
        return replayed(system, recording, claim, phase)

    said = SearchResults()
    with pytest.raises(KeyboardInterrupt):
        exhaust(system, claims, Limits(), Deadline.after(None), judge, lambda text: None, said)
    assert {c.name: v.outcome for c, v in said.verdicts.items()} == {"A": Outcome.VIOLATED}
    assert said.depth == 4
