"""The explicit search as an engine: what it says of a run that it found."""

from __future__ import annotations

from functools import partial

import pytest

from koord.semantics.recordings import Recording
from koord.syntax.budget import OutOfBudgetError
from koord.syntax.system import System, dealt, resized
from koord.verify.claims import Claim, ClaimPhase, claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.engines.engine import Purpose, Task, Tools
from koord.verify.engines.explicit.engine import ExplicitEngine
from koord.verify.engines.explicit.exhaustive import ClaimSearch, SearchResults, exhaust
from koord.verify.engines.explicit.limits import HANDFUL, Limits
from koord.verify.engines.explicit.property_checks import Exhausted, OutOfBounds
from koord.verify.engines.explicit.search import Search, survey
from koord.verify.ledger import Judge, Ledger
from koord.verify.processes import Pool
from koord.verify.reduction.problems import plain_problem
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Counterexample, NotReplayedError, Outcome
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


# --- asked again ----------------------------------------------------------------------------------


def unshown(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
    raise NotReplayedError("it goes another way")


def left(recording: Recording, claim: Claim, phase: ClaimPhase) -> Counterexample:
    raise OutOfBudgetError


def of_two_claims() -> ClaimSearch:
    system = of_text(
        "allwrite:\n  int x = 0\nUp:\n  pre: x < 9\n  eff: atomic: x = x + 1\n"
        "invariant Small: x < 3\ninvariant Positive: x >= 0\n",
        1,
    )
    return ClaimSearch(system, claims_of(system)[:2])


def within(search: ClaimSearch, states: int, judge: Judge) -> dict[str, Outcome]:
    """What is said of claims once so many states were seen."""
    work = partial(search.work, search.system, Limits(states=states), Deadline.after(None))
    found = work(judge, lambda text: None, compiled_from=None)
    assert not found.verdicts.keys() & found.unreplayed.keys()
    return {claim.name: verdict.outcome for claim, verdict in found.verdicts.items()}


def test_a_search_that_is_asked_again_goes_on() -> None:
    search = of_two_claims()
    judge = plain_problem(search.system).judge
    assert within(search, 2, judge) == {}
    assert search.said.depth == 2
    assert within(search, 5, unshown) == {}
    assert isinstance(search.search, Search)
    seen = search.search.seen
    assert within(search, 20, judge) == {"Positive": Outcome.HOLDS}
    assert search.search.seen is seen
    assert len(seen) == 10
    (small, _) = search.claims
    assert search.said.unreplayed == {
        small: "search: a candidate violation did not replay: it goes another way"
    }


def test_a_search_that_was_left_while_it_looked_does_not_go_on() -> None:
    """Nobody knows what it would have said of the claim that it was at."""
    search = of_two_claims()
    with pytest.raises(OutOfBudgetError):
        within(search, 20, left)
    assert not search.has(search.system, search.claims)


def test_a_search_goes_on_for_claims_that_it_was_begun_for() -> None:
    search = of_two_claims()
    assert search.has(search.system, search.claims)
    assert search.has(search.system, search.claims[1:])
    assert not search.has(search.system, claims_of(search.system))
    assert not search.has(resized(search.system, 2), search.claims)


def test_what_others_know_is_not_looked_for_any_more() -> None:
    """Nor does a search go on that has found all that is left."""
    search = of_two_claims()
    judge = plain_problem(search.system).judge
    assert within(search, 2, judge) == {}
    search.keep(search.claims[:1])
    assert within(search, 20, judge) == {"Small": Outcome.VIOLATED}
    assert search.said.states == 4
    assert within(search, 20, judge) == {"Small": Outcome.VIOLATED}
    assert search.said.states == 4
    assert not search.has(search.system, claims_of(search.system)[:2])


def test_whoever_is_asked_to_settle_goes_on_where_somebody_refuted() -> None:
    search = of_two_claims()
    system = search.system
    ledger = Ledger(plain_problem(system), Bounds(20), Deadline(), claims_of(system))
    tools = Tools(Pool(1))
    engine = ExplicitEngine(tools)
    with ledger.rationing(100):
        engine.work(ledger, Task(Purpose.REFUTE, states=HANDFUL, evaluations=100))
    begun = tools.search
    assert begun is not None
    assert begun.said.depth is not None
    with ledger.rationing(5_000):
        engine.work(ledger, Task(states=HANDFUL, evaluations=5_000))
    assert tools.search is begun
    assert [ledger.verdict(claim).outcome for claim in ledger.claims] == [
        Outcome.VIOLATED,
        Outcome.HOLDS,
        Outcome.HOLDS,
    ]
