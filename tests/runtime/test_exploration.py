"""Everything that can happen to three robots, to a bound, and the invariants in all of it.

The network is the set of what was sent, so that loss, delay, duplication and reordering are all in;
timers run down whenever they like; robots crash and come back, with their disks or without.
"""

from __future__ import annotations

import pytest
from msgspec.structs import replace
from msgspec.structs import replace as changed

from koord.runtime.exploration.claims import (
    Accepted,
    acted_rightly,
    agree,
    lasting,
    one_winner,
    valid,
)
from koord.runtime.exploration.exploring import explore
from koord.runtime.exploration.world import ExplorationBounds, proposal_of
from koord.runtime.proposals import Admitted, Decision
from koord.runtime.protocol.messages import Held, LogEntry, digest
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import Coordinator, fresh
from tests.runtime.walks import wander
from tests.sampling import first

SETUP = Setup(3, Timing.zero())


@pytest.mark.parametrize(
    ("bounds", "least_states"),
    first(
        1,
        [
            pytest.param(
                ExplorationBounds(rounds=1, epoch=0, crashes=0, eager=False),
                1_500,
                id="one round, whole",
            ),
            pytest.param(  # the test of several ways goes further, and is not slow
                ExplorationBounds(rounds=1, epoch=1, crashes=1, depth=11),
                8_000,
                id="an election",
                marks=pytest.mark.slow,
            ),
            pytest.param(
                ExplorationBounds(rounds=1, epoch=2, crashes=1, restarts=1, depth=9),
                8_000,
                id="a restart",
            ),
            pytest.param(
                ExplorationBounds(
                    rounds=0, epoch=1, crashes=0, settled=False, resends=True, depth=10
                ),
                3_000,
                id="from switching on",
            ),
        ],
    ),
)
def test_the_invariants_hold_however_it_comes(bounds: ExplorationBounds, least_states: int) -> None:
    explored = explore(bounds)
    assert explored.violation is None
    assert explored.states > least_states
    assert explored.complete == (bounds.depth is None)


@pytest.mark.slow
@pytest.mark.parametrize(
    "bounds",
    [
        pytest.param(ExplorationBounds(rounds=2, epoch=0, crashes=0), id="two rounds, whole"),
        pytest.param(ExplorationBounds(rounds=1, epoch=1, crashes=0), id="an election, whole"),
        pytest.param(
            ExplorationBounds(rounds=1, epoch=2, crashes=1, states=2_500_000), id="elections"
        ),
        pytest.param(
            ExplorationBounds(rounds=1, epoch=2, crashes=1, restarts=1, states=2_500_000),
            id="restarts",
        ),
    ],
)
def test_the_invariants_hold_further_on(bounds: ExplorationBounds) -> None:
    explored = explore(bounds)
    assert explored.violation is None
    assert explored.committed > 2
    assert explored.complete == (bounds.crashes == 0)


@pytest.mark.parametrize("seed", first(1, range(4)))
def test_unlucky_walks_keep_the_invariants(seed: int) -> None:
    """Crashes and returns, and everything that was ever sent may still arrive."""
    explored = wander(ExplorationBounds(rounds=4, epoch=8, crashes=4, restarts=4), seed, 40, 150)
    assert explored.violation is None
    assert explored.epochs >= 3


@pytest.mark.slow
@pytest.mark.parametrize("robots", [3, 4, 5])
def test_many_unlucky_walks_keep_the_invariants(robots: int) -> None:
    bounds = ExplorationBounds(robots=robots, rounds=5, epoch=12, crashes=5, restarts=5)
    explored = wander(bounds, robots, 2_000, 250)
    assert explored.violation is None


def test_entries_are_committed_in_several_ways() -> None:
    """The exploration reaches rounds with late robots, and elections."""
    explored = explore(ExplorationBounds(rounds=1, epoch=1, crashes=1, depth=13, states=30_000))
    assert explored.violation is None
    assert explored.committed >= 2
    assert explored.epochs == 2


def test_a_bound_on_states_is_kept() -> None:
    explored = explore(ExplorationBounds(rounds=1, states=500))
    assert 500 < explored.states < 1_500
    assert not explored.complete


def test_a_violation_comes_with_its_story() -> None:
    """[ATOMIC]: a coordinator that excludes nobody is found out."""
    wrong = replace(SETUP, decide=_let_all_through)
    explored = explore(ExplorationBounds(rounds=1, epoch=1, crashes=0, depth=6), wrong)
    assert explored.violation is not None
    assert explored.violation.broken.claim == "I-ONE-WINNER"
    assert explored.violation.story


def _let_all_through(round_: int, proposals: object) -> Decision:
    """A wrong decision: nobody is excluded by a lock."""
    ran = tuple(Admitted(i, None if round_ < 0 else 0) for i in range(3))
    return Decision(round_, ran, (), ())


# --- the claims themselves ------------------------------------------------------------------------


def entry(*ran: int, late: tuple[int, ...] = ()) -> LogEntry:
    taken = tuple(Admitted(i, 0) for i in ran)
    skipped = tuple(i for i in range(3) if i not in ran)
    return LogEntry(Decision(0, taken, skipped, ()), late=late)


def test_two_winners_of_a_class_are_seen() -> None:
    """(I-ONE-WINNER)"""
    assert not list(one_winner(entry(0, 2), proposal_of))
    assert list(one_winner(entry(0, 1), proposal_of))


def test_what_nobody_proposed_is_seen() -> None:
    """(I-VALID)"""
    assert not list(valid(entry(0, 2), proposal_of))
    made_up = LogEntry(Decision(0, (Admitted(0, 7),), (1, 2), ()), late=(1, 2))
    assert list(valid(made_up, proposal_of))


def test_a_skip_without_a_reason_is_seen() -> None:
    """(I-VALID)"""
    assert not list(valid(entry(0, late=(2,)), proposal_of))
    assert list(valid(entry(0), proposal_of))
    assert list(valid(entry(0, 2, late=(2,)), proposal_of))


def test_disagreement_is_seen() -> None:
    """(I-AGREE)"""
    assert not list(agree(entry(0), entry(0)))
    assert list(agree(entry(0), entry(1)))


def test_acting_without_a_majority_is_seen() -> None:
    """(I-ACT)"""
    held = Held(0, entry(0), digest(entry(0)))
    roster = (0, 0, 0)
    assert not list(acted_rightly(SETUP, held, roster, [Accepted(0, 1, 0)]))
    assert list(acted_rightly(SETUP, held, roster, []))
    assert list(acted_rightly(SETUP, held, roster, [Accepted(0, 1, 3)]))
    # two epochs, half a majority each
    five = Setup(5, Timing.zero())
    split = [Accepted(0, 1, 0), Accepted(1, 2, 0)]
    assert list(acted_rightly(five, held, (0,) * 5, split))


def test_a_coordinator_that_lost_a_round_is_seen() -> None:
    """(I-LASTING)"""
    held = Held(0, entry(0), digest(entry(0)))
    state = fresh(SETUP, 0)
    assert isinstance(state.office, Coordinator)
    late = changed(state, round=0, promised=3)
    assert list(lasting(late, [held]))
    assert not list(lasting(changed(late, tentative=held), [held]))
    assert not list(lasting(changed(late, round=1), [held]))
