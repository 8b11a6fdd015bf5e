"""Robots that come back with their journal: what they have saved, and what they ask."""

from __future__ import annotations

import pytest
from msgspec.structs import replace as changed

from koord.runtime.exploration.claims import saved
from koord.runtime.exploration.exploring import explore
from koord.runtime.exploration.world import Disk, ExplorationBounds
from koord.runtime.protocol.events import (
    Begin,
    Effect,
    Expired,
    Reason,
    RunEnded,
    Save,
    Send,
    Tell,
    Timer,
)
from koord.runtime.protocol.messages import (
    Acknowledge,
    Ask,
    Candidacy,
    Committed,
    Decide,
    Propose,
    Recovery,
    RecoveryAnswer,
    Tentative,
    Vote,
)
from koord.runtime.protocol.state import (
    Candidate,
    Coordinator,
    Rejoining,
    durable,
    fresh,
    recovered,
)
from tests.runtime.fleet import Fleet, begun, fleet
from tests.runtime.walks import wander
from tests.sampling import first

# --- what is saved --------------------------------------------------------------------------------


def place(effects: list[Effect], kind: type[Effect]) -> int:
    return next(i for i, one in enumerate(effects) if isinstance(one, kind))


def test_a_proposal_is_saved_before_it_is_sent() -> None:
    """(R-SAVE)"""
    robots = begun()
    robots.propose(1)
    assert place(robots.effects, Save) < place(robots.effects, Send)
    assert robots.disks[1].mine == robots.states[1].mine


def test_an_entry_is_saved_before_it_is_acknowledged() -> None:
    """(R-SAVE) (R-ACCEPT)"""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide, to=1)
    assert place(robots.effects, Save) < place(robots.effects, Send)
    assert robots.disks[1].tentative == robots.states[1].tentative
    assert robots.disks[0].tentative == robots.states[1].tentative, "and before it is sent"


def test_a_promise_is_saved_before_the_vote() -> None:
    """(R-SAVE) (R-VOTE)"""
    robots = begun()
    robots.off(0)
    for robot in (1, 2):
        robots.fire(robot, Timer.SILENCE)
    robots.fire(1, Timer.SILENCE)
    while not robots.of(Candidacy):
        robots.deliver()
    assert place(robots.effects, Save) < place(robots.effects, Send)
    assert robots.disks[2].promised == robots.states[2].promised == 1
    assert robots.disks[1].promised == 1


def test_what_says_nothing_new_is_not_saved() -> None:
    """(R-SAVE): two writes a round are enough."""
    robots = begun()
    saves = 0
    for robot in range(3):
        robots.propose(robot)
        saves += sum(isinstance(one, Save) for one in robots.effects)
    while robots.mail:
        robots.deliver(robots.mail[0].__eq__)
        saves += sum(isinstance(one, Save) for one in robots.effects)
    assert robots.rounds == [1, 1, 1]
    assert saves == 2 * 3


def test_what_is_said_and_not_saved_is_seen() -> None:
    """(I-SAVED)"""
    robots = begun()
    robots.run_round()
    state = robots.states[1]
    disk = durable(state)
    assert not list(saved(Vote(state.promised, 0), 0, state, disk))
    assert list(saved(Vote(state.promised + 1, 0), 0, state, disk))
    assert list(saved(Vote(state.promised, 0), 5, state, disk))
    robots.propose(1)
    (proposal,) = (p.message for p in robots.mail if isinstance(p.message, Propose))
    assert list(saved(proposal, 0, robots.states[1], disk))
    assert not list(saved(proposal, 0, robots.states[1], robots.disks[1]))
    mark = bytes(16)
    assert list(saved(Acknowledge(0, state.round, mark), 0, state, disk))


# --- robots that are back -------------------------------------------------------------------------


def accepted() -> Fleet:
    """A round that all have accepted, and nobody knows to be committed."""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide)
    robots.lose()
    return robots


def voters(robots: Fleet) -> list[int]:
    return [pid for pid, state in sorted(robots.states.items()) if state.is_voter]


def test_a_robot_is_back_with_what_it_saved() -> None:
    """(R-RESUME)"""
    robots = accepted()
    before = robots.states[2]
    robots.off(2)
    robots.resume(2)
    state = robots.states[2]
    assert (state.promised, state.tentative, state.mine) == (
        before.promised,
        before.tentative,
        before.mine,
    )
    assert state.incarnation == before.incarnation
    assert not state.is_voter
    assert state.holding is Reason.RECOVERING
    robots.settle()
    assert robots.states[2].is_voter


def test_a_robot_that_recovers_votes_for_nobody_and_acknowledges_nothing() -> None:
    """(R-RESUME)"""
    robots = accepted()
    robots.off(2)
    robots.resume(2)
    robots.lose()
    robots.fire(0, Timer.RESEND)
    robots.of(Decide, to=2)
    assert not any(isinstance(p.message, Acknowledge) for p in robots.mail)


def test_all_may_crash_and_the_run_goes_on() -> None:
    """(R-RESUME): what was accepted by a majority is committed, and nothing else."""
    robots = accepted()
    held = robots.states[1].tentative
    assert held is not None
    for robot in range(3):
        robots.off(robot)
    for robot in range(3):
        robots.resume(robot)
    robots.settle()
    assert all(state.is_voter for state in robots.states.values())
    robots.fire(1, Timer.SILENCE)
    robots.settle()
    assert {entries[-1] for entries in robots.acted.values()} == {held.entry}


def test_a_robot_that_nobody_answers_believes_its_journal() -> None:
    """(R-RESUME)"""
    robots = accepted()
    for robot in range(3):
        robots.off(robot)
    robots.resume(1)
    robots.resume(2)
    robots.settle()
    assert voters(robots) == []
    for robot in (1, 2):
        robots.fire(robot, Timer.RECOVERY)
    assert voters(robots) == [1, 2]
    robots.fire(1, Timer.SILENCE)
    robots.settle()
    assert robots.rounds == [1, 1], "two of three are a majority"


def test_what_was_forgotten_is_learned_from_the_others() -> None:
    """(R-RESUME): an old disk, from before the promise and the entry."""
    robots = begun()
    old = durable(robots.states[2])
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide)
    robots.lose()
    robots.off(2)
    robots.resume(2, disk=old)
    assert robots.states[2].tentative is None
    robots.settle()
    assert robots.states[2].tentative == robots.states[0].tentative
    assert robots.states[2].is_voter


def test_a_promise_that_was_forgotten_is_kept() -> None:
    """(R-RESUME): the candidate that it was given to says so."""
    robots = begun()
    old = durable(robots.states[2])
    robots.off(0)
    for robot in (1, 2):
        robots.fire(robot, Timer.SILENCE)
    robots.fire(1, Timer.SILENCE)
    while not any(isinstance(p.message, Vote) for p in robots.mail):
        robots.deliver()
    robots.lose()
    assert isinstance(robots.states[1].office, Candidate)
    robots.off(2)
    robots.resume(2, disk=old)
    assert robots.states[2].promised == 0
    robots.settle()
    assert robots.states[2].promised == 1


def test_rounds_that_were_missed_are_learned_first() -> None:
    """(R-RESUME) (R-ASK)"""
    robots = begun()
    old = durable(robots.states[2])
    for _ in range(3):
        robots.run_round()
    robots.off(2)
    robots.lose()
    robots.resume(2, disk=old)
    robots.settle()
    assert robots.rounds == [3, 3, 3]
    assert robots.states[2].recovery is not None, "the others were ahead when they answered"
    robots.fire(2, Timer.RESEND)
    robots.settle()
    assert robots.states[2].is_voter


def test_a_robot_that_is_still_behind_asks_again() -> None:
    """(R-RESUME) (R-AGAIN): when nobody else does."""
    robots = begun()
    old = durable(robots.states[2])
    robots.run_round()
    robots.off(2)
    robots.lose()
    robots.resume(2, disk=old)
    robots.of(Recovery)
    robots.of(RecoveryAnswer)
    assert robots.states[2].is_behind
    robots.lose()
    robots.fire(2, Timer.RECOVERY)
    robots.fire(0, Timer.RESEND)
    robots.lose(lambda p: isinstance(p.message, Ask))
    robots.settle()
    robots.fire(2, Timer.RESEND)
    robots.settle()
    assert robots.rounds == [1, 1, 1]


def test_no_second_proposal_is_made_for_the_round_that_is_open() -> None:
    """(R-RESUME): an old disk may lack the first one; to be late is a skip."""
    robots = begun()
    robots.off(2)
    robots.resume(2, disk=durable(changed(robots.states[0], pid=2)))
    robots.settle()
    assert robots.work[2] is None
    robots.propose(0)
    robots.propose(1)
    robots.fire(0, Timer.DEADLINE)
    robots.settle()
    assert robots.work[2] == 1, "for the next round it does"


@pytest.mark.parametrize("owing", [frozenset({2}), frozenset()])
def test_who_may_not_be_left_out_proposes(owing: frozenset[int]) -> None:
    """(R-RESUME) (R-OWED)"""
    robots = begun(owing=owing)
    robots.off(2)
    robots.resume(2, disk=durable(robots.states[1]))
    robots.settle()
    assert (robots.work[2] == 0) == bool(owing)


def test_a_proposal_in_the_journal_is_sent_as_it_was() -> None:
    """(R-RESUME) (R-BEGIN)"""
    robots = begun()
    robots.propose(2)
    robots.lose()
    mine = robots.states[2].mine
    robots.off(2)
    robots.resume(2)
    robots.settle()
    robots.fire(0, Timer.RESEND)
    robots.settle()
    office = robots.states[0].office
    assert isinstance(office, Coordinator)
    assert office.proposals.of(2) == mine


def test_init_is_proposed_after_a_crash_before_it() -> None:
    """(R-RESUME): nobody may be left out of it."""
    robots = fleet()
    disk = durable(robots.states[1])
    robots.off(1)
    robots.resume(1, disk=disk)
    robots.settle()
    assert robots.work[1] == -1
    robots.run_round()
    robots.fire(0, Timer.RESEND)
    robots.settle()
    assert robots.rounds == [0, 0, 0]


def test_an_answer_to_an_earlier_start_is_dropped() -> None:
    """(R-RESUME)"""
    robots = begun()
    robots.off(2)
    robots.resume(2, start=3, disk=durable(robots.states[1]))
    robots.lose()
    for robot in (0, 1):
        robots._post(robot, 2, RecoveryAnswer(2, 9, 0, None))
    robots.settle()
    assert robots.states[2].promised == 0
    assert not robots.states[2].is_voter


def test_a_robot_that_was_not_admitted_yet_goes_on_to_rejoin() -> None:
    """(R-REJOIN): it has told nothing that counts."""
    robots = begun()
    disk = changed(durable(robots.states[1]), incarnation=7)
    assert recovered(robots.setup, 1, disk, 2).office == Rejoining()
    robots.off(1)
    robots.resume(1, disk=disk)
    assert robots.states[1].incarnation == 7
    robots.settle()
    robots.run_round()
    assert robots.states[1].is_voter


def test_who_has_forgotten_more_does_not_answer() -> None:
    """(R-RESUME)"""
    robots = begun()
    robots.off(1)
    robots.back(1, incarnation=5)
    robots.settle()
    assert not isinstance(robots.states[1].office, Rejoining), "it has a snapshot, and no more"
    robots.off(2)
    robots.resume(2, disk=durable(robots.states[0]))
    robots.of(Recovery, to=1)
    assert not any(isinstance(p.message, RecoveryAnswer) and p.sender == 1 for p in robots.mail)
    robots.of(Recovery, to=0)
    assert any(isinstance(p.message, RecoveryAnswer) and p.sender == 0 for p in robots.mail)


@pytest.mark.parametrize("theirs", [1, 5])
def test_of_two_entries_the_one_of_the_higher_epoch_counts(theirs: int) -> None:
    """(R-RESUME) (R-ACCEPT)"""
    robots = accepted()
    mine = robots.states[2].tentative
    assert mine is not None
    robots.off(2)
    robots.resume(2, disk=changed(robots.disks[2], tentative=changed(mine, epoch=3)))
    robots.lose()
    other = changed(mine.entry, late=(0, 1))
    robots._post(0, 2, RecoveryAnswer(2, 5, 0, Tentative(theirs, other)))
    robots.deliver()
    held = robots.states[2].tentative
    assert held is not None
    assert held.entry == (other if theirs > 3 else mine.entry)


def test_an_entry_of_another_history_is_not_taken_over() -> None:
    """(R-RESUME)"""
    robots = accepted()
    held = robots.states[0].tentative
    assert held is not None
    robots.off(2)
    robots.resume(2, disk=changed(robots.disks[2], tentative=None))
    robots.lose()
    other = changed(held.entry, previous=bytes(16))
    robots._post(0, 2, RecoveryAnswer(2, 0, 0, Tentative(0, other)))
    robots.deliver()
    assert robots.states[2].tentative is None


def test_a_run_that_was_over_is_over() -> None:
    """(R-RESUME)"""
    robots = fleet(rounds=1)
    robots.run_round()
    robots.run_round()
    disk = durable(robots.states[1])
    robots.off(1)
    robots.resume(1, disk=disk)
    assert any(isinstance(one, RunEnded) for one in robots.effects)
    assert not any(isinstance(one, Begin | Tell) for one in robots.effects)


def test_one_robot_alone_goes_on_by_itself() -> None:
    """(R-RESUME)"""
    robots = begun(1)
    disk = durable(robots.states[0])
    robots.off(0)
    robots.resume(0, disk=disk)
    assert robots.states[0].is_voter
    robots.fire(0, Timer.SILENCE)
    robots.fire(0, Timer.DEADLINE)
    assert robots.rounds == [1]


def test_a_timer_that_comes_after_the_end_of_a_recovery_does_nothing() -> None:
    robots = begun()
    robots.do(1, Expired(0.0, Timer.RECOVERY))
    assert robots.states[1] == changed(robots.states[1])
    assert robots.effects == []


# --- a robot that lost its journal before the run began -------------------------------------------


def test_a_journal_that_is_lost_before_init_is_named() -> None:
    """(R-REJOIN): the robot may have proposed INIT, and must not do so twice."""
    robots = fleet()
    robots.off(2)
    robots.back(2, incarnation=5)
    robots.settle()
    assert robots.states[2].holding is Reason.NEVER_BEGAN
    assert robots.work[2] is None
    assert isinstance(robots.states[2].office, Rejoining)


def test_an_incarnation_of_an_earlier_life_is_outranked() -> None:
    """(R-ADMIT): it was under way when the robot lost its journal once more."""
    robots = begun()
    robots.off(2)
    robots.back(2, incarnation=5)
    robots.settle()
    robots.propose(0)
    robots.propose(1)
    robots.fire(0, Timer.DEADLINE)
    robots.of(Decide, to=1)
    robots.off(2)
    robots.back(2, incarnation=4)
    robots.settle()
    robots.run_round()
    robots.settle()
    state = robots.states[2]
    assert state.incarnation > 5
    robots.run_round()
    assert robots.states[2].is_voter
    assert not any(isinstance(p.message, Committed) for p in robots.mail)


# --- everything that can happen -------------------------------------------------------------------


@pytest.mark.parametrize(
    "bounds",
    [
        pytest.param(
            ExplorationBounds(epoch=1, restarts=1, depth=8, disks=frozenset({Disk.KEPT})),
            id="with its disk",
        ),
        pytest.param(
            ExplorationBounds(epoch=1, restarts=1, depth=8, disks=frozenset({Disk.OLD})),
            id="with an old disk",
        ),
        pytest.param(ExplorationBounds(epoch=1, crashes=0, twins=1, depth=8), id="twice"),
    ],
)
def test_the_invariants_hold_with_every_disk(bounds: ExplorationBounds) -> None:
    """(I-SAVED) (I-AGREE)"""
    explored = explore(bounds)
    assert explored.violation is None
    assert explored.states > 2_500


@pytest.mark.slow
@pytest.mark.parametrize(
    "bounds",
    [
        pytest.param(
            ExplorationBounds(epoch=2, crashes=2, restarts=2, disks=frozenset({disk})),
            id=disk.value,
        )
        for disk in Disk
    ]
    + [
        pytest.param(
            ExplorationBounds(epoch=2, crashes=2, restarts=2, disks=frozenset(Disk)), id="any disk"
        ),
        pytest.param(ExplorationBounds(epoch=2, restarts=1, twins=1), id="twice"),
    ],
)
def test_the_invariants_hold_with_every_disk_further_on(bounds: ExplorationBounds) -> None:
    explored = explore(changed(bounds, states=1_500_000))
    assert explored.violation is None
    assert explored.committed > 2


@pytest.mark.parametrize("seed", first(1, range(8)))
@pytest.mark.parametrize("robots", [3, pytest.param(4, marks=pytest.mark.slow)])
def test_unlucky_walks_with_any_disk(robots: int, seed: int) -> None:
    """Any number of crashes with disks; an old one once, and losses while a majority remembers."""
    bounds = ExplorationBounds(
        robots=robots, rounds=4, epoch=8, crashes=9, restarts=9, disks=frozenset(Disk)
    )
    explored = wander(bounds, seed, 30, 50 * robots)
    assert explored.violation is None
    assert explored.committed >= 2


def test_fresh_robots_have_nothing_to_recover() -> None:
    assert fresh(begun().setup, 1).recovery is None
