"""Rounds of the protocol: from proposals to acting. Rules by hand, one message at a time."""

from __future__ import annotations

import pytest

from koord.runtime.exploration.world import proposal_of
from koord.runtime.proposals import Attempt, EventFault, Proposal, Write
from koord.runtime.protocol.events import Arm, Begin, Commit, Hold, Reason, Resume, RunEnded, Timer
from koord.runtime.protocol.messages import (
    GENESIS,
    Acknowledge,
    Ask,
    Committed,
    Decide,
    History,
    LogEntry,
    Open,
    Propose,
    digest,
)
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.setup import decided as decide
from koord.runtime.protocol.state import Coordinator, Gathered, StepContext, fresh
from koord.syntax.faults import FaultKind
from tests.runtime.fleet import Fleet, Parcel, begun, fleet

# --- deciding -------------------------------------------------------------------------------------


def attempt(*locks: int, event: int = 0) -> Attempt:
    return Attempt(event, (Write(0, (), event),), locks)


def through(round_: int, *attempts: tuple[Attempt, ...] | None) -> dict[int, int | None]:
    """Who is let through, and with which event."""
    proposals = [
        None if mine is None else Proposal(i, round_, mine) for i, mine in enumerate(attempts)
    ]
    return {taken.robot: taken.event for taken in decide(round_, proposals).ran}


def test_the_order_rotates_so_that_everyone_is_first_once() -> None:
    """(R-DECIDE)"""
    one = (attempt(0),)
    firsts = [next(iter(through(r, one, one, one))) for r in range(-1, 6)]
    assert firsts == [0, 0, 1, 2, 0, 1, 2]


def test_one_robot_is_let_through_per_lock_class() -> None:
    """[ATOMIC] (I-ONE-WINNER)"""
    both = (attempt(0),), (attempt(0),), (attempt(1),)
    assert through(0, *both) == {0: 0, 2: 0}
    assert through(1, *both) == {1: 0, 2: 0}


def test_an_event_that_needs_two_classes_takes_none_if_one_is_taken() -> None:
    """[ATOMIC]"""
    assert through(0, (attempt(0),), (attempt(0, 1),), (attempt(1),)) == {0: 0, 2: 0}


def test_who_loses_a_lock_runs_the_next_attempt() -> None:
    """(R-DECIDE)"""
    urgent = (attempt(0, event=1), attempt(1, event=2))
    assert through(0, urgent, urgent, urgent) == {0: 1, 1: 2}


def test_a_missing_proposal_is_a_skip_and_takes_no_lock() -> None:
    """[T-SKIP] [SKIP]"""
    proposals = [None, Proposal(1, 0, (attempt(0),)), Proposal(2, 0)]
    decision = decide(0, proposals)
    assert [taken.robot for taken in decision.ran] == [1]
    assert decision.skipped == (0, 2)


def test_in_init_nobody_is_excluded() -> None:
    """[INIT]: robots propose it without locks."""
    assert through(-1, (attempt(),), (attempt(),)) == {0: 0, 1: 0}


def test_writes_are_in_the_order_of_the_robots() -> None:
    """[SHARED-ASSIGN]"""
    proposals = [Proposal(i, 1, (Attempt(0, (Write(0, (), i),)),)) for i in range(3)]
    assert [write.value for write in decide(1, proposals).writes] == [1, 2, 0]


def test_a_fault_ends_the_round() -> None:
    """[FAULT]"""
    fault = EventFault(FaultKind.DIVISION, "a.krd:1:1")
    faulty = Proposal(1, 1, (Attempt(4, fault=fault),))
    decision = decide(1, [Proposal(0, 1, (attempt(0),)), faulty])
    assert decision.fault is not None
    assert (decision.fault.robot, decision.fault.event) == (1, 4)
    assert decision.ran == ()
    assert decision.writes == ()


def test_a_digest_stands_for_a_history() -> None:
    first = LogEntry(decide(0, [Proposal(0, 0)]))
    other = LogEntry(decide(0, [Proposal(0, 0, (attempt(),))]))
    assert digest(first) != digest(other)
    assert digest(first) != digest(LogEntry(first.decision, previous=b"x" * 16))
    assert digest(first) != digest(LogEntry(first.decision, late=(0,)))
    assert digest(first) == digest(LogEntry(decide(0, [Proposal(0, 0)]), GENESIS))


# --- a round --------------------------------------------------------------------------------------


def test_init_waits_for_every_robot() -> None:
    """[INIT] (R-OWED)"""
    robots = fleet()
    robots.propose(0)
    robots.propose(1)
    robots.settle()
    robots.fire(0, Timer.DEADLINE)
    robots.settle()
    assert robots.rounds == [-1, -1, -1]
    robots.propose(2)
    robots.settle()
    assert robots.rounds == [0, 0, 0]
    assert [taken.robot for taken in robots.acted[0][0].decision.ran] == [0, 1, 2]


@pytest.mark.parametrize("robots", [1, 2, 3, 4, 7])
def test_a_calm_round_takes_twice_as_many_datagrams_as_robots(robots: int) -> None:
    made = begun(robots)
    before = made.datagrams
    made.run_round()
    assert made.rounds == [1] * robots
    assert made.datagrams - before == (2 * robots if robots > 1 else 0)


def test_nobody_acts_before_a_majority_holds_the_decision() -> None:
    """(R-MAJORITY) (I-ACT)"""
    robots = begun(5)
    for robot in range(5):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide)
    assert all(len(acted) == 1 for acted in robots.acted.values())
    robots.deliver(lambda p: isinstance(p.message, Acknowledge) and p.sender == 1)
    assert all(len(acted) == 1 for acted in robots.acted.values())
    robots.deliver(lambda p: isinstance(p.message, Acknowledge) and p.sender == 2)
    assert [len(robots.acted[i]) for i in range(5)] == [2, 1, 1, 1, 1]
    robots.of(Committed)
    assert all(len(acted) == 2 for acted in robots.acted.values())


def test_the_same_robot_twice_is_no_majority() -> None:
    """(R-MAJORITY)"""
    robots = begun(5)
    for robot in range(5):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide)
    again = lambda p: isinstance(p.message, Acknowledge) and p.sender == 1  # noqa: E731
    robots.deliver(again, keep=True)
    robots.deliver(again, keep=True)
    assert robots.rounds == [0] * 5


def test_acknowledging_another_entry_is_not_acknowledging_this_one() -> None:
    """(R-MAJORITY)"""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.mail = [Parcel(1, 0, 0, Acknowledge(0, 0, b"another digest"))]
    robots.deliver()
    assert robots.rounds == [0, 0, 0]


def test_a_robot_that_is_late_skips_and_throws_its_buffer_away() -> None:
    """[T-SKIP] (R-DECIDE)"""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    robots.deliver(lambda p: p.sender == 1)
    robots.lose()
    robots.fire(0, Timer.DEADLINE)
    robots.settle()
    entry = robots.acted[2][-1]
    assert entry.late == (2,)
    assert 2 in entry.decision.skipped
    assert robots.kept[2] == [-1]
    assert robots.kept[0] == [-1, 0]


def test_a_proposal_that_comes_after_its_round_changes_nothing() -> None:
    """(R-OPEN) (R-TEACH)"""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    late = [p for p in robots.mail if p.sender == 2]
    robots.deliver(lambda p: p.sender == 1)
    robots.lose()
    robots.fire(0, Timer.DEADLINE)
    robots.settle()
    before = robots.states[0]
    robots.mail = late
    robots.deliver()
    after = robots.states[0]
    assert (after.round, after.chain) == (before.round, before.chain)
    assert isinstance(after.office, Coordinator)
    assert after.office.proposals.all == (None, None, None)
    assert [type(p.message) for p in robots.mail] == [History]


def test_the_first_proposal_of_a_robot_counts() -> None:
    """(R-BEGIN)"""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    other = Proposal(1, 0, (Attempt(7),))
    robots.mail = [
        *(p for p in robots.mail if p.sender == 1),
        Parcel(1, 0, 0, Propose(other)),
        *(p for p in robots.mail if p.sender == 2),
    ]
    robots.settle()
    assert all(taken.event != 7 for taken in robots.acted[0][-1].decision.ran)


@pytest.mark.parametrize("robots", [1, 31, 32, 33, 70, 128])
def test_what_is_gathered_is_by_robot(robots: int) -> None:
    gathered = Gathered.nothing(robots)
    assert gathered.all == (None,) * robots
    made = [Proposal(robot, 0) for robot in range(robots)]
    for proposal in made[::2]:
        gathered = gathered.having(proposal)
    assert gathered.all == tuple(None if one.robot % 2 else one for one in made)
    assert [gathered.of(robot) for robot in range(robots)] == [*gathered.all]


def test_nobody_proposes_for_another() -> None:
    robots = begun()
    robots.mail = [Parcel(1, 0, 0, Propose(proposal_of(2, 0)))]
    robots.deliver()
    office = robots.states[0].office
    assert isinstance(office, Coordinator)
    assert office.proposals.all == (None, None, None)


def test_a_proposal_that_is_made_too_late_is_thrown_away() -> None:
    """(R-BEGIN)"""
    robots = begun()
    robots.propose(0)
    robots.propose(1)
    robots.of(Propose)
    robots.fire(0, Timer.DEADLINE)
    robots.settle()
    robots.propose(2, proposal_of(2, 0))
    assert robots.states[2].mine is None
    assert robots.rounds == [1, 1, 1]


def test_with_urgent_events_the_round_stays_open() -> None:
    """(R-OWED) [SKIP]"""
    robots = begun(owing=frozenset({2}))
    for robot in range(3):
        robots.propose(robot)
    lost = [p for p in robots.mail if p.sender == 2]
    robots.deliver(lambda p: p.sender == 1)
    robots.lose()
    robots.fire(0, Timer.DEADLINE)
    assert robots.states[0].tentative is None
    robots.fire(0, Timer.HOLD)
    assert robots.holds[0][-1] is Reason.ROUND_OPEN
    robots.fire(0, Timer.RESEND)
    assert {p.to for p in robots.mail if isinstance(p.message, Open)} == {2}
    robots.mail = lost
    robots.settle()
    assert robots.rounds == [1, 1, 1]
    assert robots.acted[0][-1].late == ()
    assert robots.holds[0][-1] is None


# --- what is lost ---------------------------------------------------------------------------------


def decided(robots: int = 3) -> Fleet:
    """A round that everyone has proposed for, and whose Decide is on its way."""
    made = begun(robots)
    for robot in range(robots):
        made.propose(robot)
    made.of(Propose)
    return made


def test_a_lost_decide_is_sent_again_to_who_has_not_acknowledged() -> None:
    """(R-AGAIN)"""
    robots = decided(5)
    robots.of(Decide, to=1)
    robots.lose(lambda p: isinstance(p.message, Decide))
    robots.of(Acknowledge)
    robots.fire(0, Timer.RESEND)
    assert {p.to for p in robots.mail} >= {2, 3, 4}
    robots.settle()
    assert robots.rounds == [1] * 5


def test_a_lost_acknowledgement_is_sent_again() -> None:
    """(R-AGAIN)"""
    robots = decided()
    robots.of(Decide)
    robots.lose()
    robots.fire(1, Timer.RESEND)
    robots.settle()
    assert robots.rounds[:2] == [1, 1]


def test_a_lost_commit_is_said_again_to_who_asks() -> None:
    """(R-AGAIN) (R-COMMIT)"""
    robots = decided()
    robots.of(Decide)
    robots.of(Acknowledge)
    robots.lose()
    assert robots.rounds == [1, 0, 0]
    robots.fire(1, Timer.RESEND)
    robots.fire(2, Timer.RESEND)
    robots.settle()
    assert robots.rounds == [1, 1, 1]


def test_the_next_decide_says_that_the_last_one_is_committed() -> None:
    """(R-ACCEPT)"""
    robots = decided()
    robots.of(Decide)
    robots.of(Acknowledge)
    robots.lose(lambda p: p.to == 2)
    robots.settle()
    assert robots.rounds == [1, 1, 0]
    robots.propose(0)
    robots.propose(1)
    robots.deliver(lambda p: isinstance(p.message, Propose))
    robots.fire(0, Timer.DEADLINE)
    robots.of(Decide, to=2)
    assert robots.rounds[2] == 1
    assert [e.round for e in robots.acted[2]] == [-1, 0]


def test_who_missed_a_decide_asks_and_does_not_propose_meanwhile() -> None:
    """(R-ASK)"""
    robots = decided()
    robots.lose(lambda p: p.to == 2)
    robots.of(Decide)
    robots.of(Acknowledge)
    robots.of(Committed)
    assert robots.rounds == [1, 1, 0]
    assert [type(p.message) for p in robots.mail] == [Ask]
    assert not any(isinstance(effect, Begin) for effect in robots.effects)
    robots.of(Ask)
    robots.of(History)
    assert robots.rounds == [1, 1, 1]
    assert robots.work[2] == 1
    assert robots.kept[2] == [-1, 0]


def test_a_commit_of_another_entry_than_the_one_held_is_not_acted_on() -> None:
    """(R-COMMIT)"""
    robots = decided()
    robots.of(Decide)
    robots.mail = [Parcel(0, 0, 1, Committed(0, 0, b"another digest"))]
    robots.of(Committed)
    assert robots.rounds == [0, 0, 0]
    assert [type(p.message) for p in robots.mail] == [Ask]


def test_history_out_of_order_is_not_acted_on() -> None:
    """(R-COMMIT)"""
    robots = begun()
    robots.run_round()
    robots.run_round()
    last = robots.acted[0][-1]
    late = begun()
    late.mail = [Parcel(0, 0, 1, History(0, last))]
    late.deliver()
    assert late.rounds == [0, 0, 0]


def test_everything_twice_is_as_good_as_once() -> None:
    """(R-AGAIN)"""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    for _ in range(30):
        if not robots.mail:
            break
        robots.deliver(keep=True)
        robots.deliver()
    assert robots.rounds == [1, 1, 1]
    assert [len(acted) for acted in robots.acted.values()] == [2, 2, 2]
    assert robots.kept == {0: [-1, 0], 1: [-1], 2: [-1, 0]}


# --- holding, pacing, ending ----------------------------------------------------------------------


def test_who_sees_no_commit_holds_and_goes_on_with_the_next() -> None:
    """(R-HOLD)"""
    robots = decided()
    robots.fire(1, Timer.HOLD)
    assert robots.effects == [Hold(Reason.UNDECIDED)]
    robots.settle()
    assert robots.holds[1] == [Reason.UNDECIDED, None]


def test_a_coordinator_without_a_majority_says_so() -> None:
    """(R-HOLD)"""
    robots = decided()
    robots.fire(0, Timer.HOLD)
    assert robots.effects == [Hold(Reason.NO_MAJORITY)]


def test_the_coordinator_paces_the_rounds() -> None:
    """(R-BEGIN)"""
    robots = begun(timing=Timing.of(1.0, 3))
    robots.now = 1.0
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.now = 1.25
    robots.of(Decide)
    robots.of(Acknowledge)
    pauses = {p.message.pause_s for p in robots.mail if isinstance(p.message, Committed)}
    assert pauses == {0.75}
    begin = [effect for effect in robots.effects if isinstance(effect, Begin)]
    robots.of(Committed)
    begin += [effect for effect in robots.effects if isinstance(effect, Begin)]
    assert {effect.after_s for effect in begin} <= {0.75}


def test_a_round_that_took_too_long_is_not_made_up_for() -> None:
    """(R-BEGIN)"""
    robots = begun(timing=Timing.of(1.0, 3))
    robots.now = 9.0
    robots.run_round()
    office = robots.states[0].office
    assert isinstance(office, Coordinator)
    assert office.began == 9.0


def test_the_run_ends_after_its_last_round() -> None:
    """(R-HOLD)"""
    robots = begun(rounds=2)
    robots.run_round()
    assert not robots.states[1].ended
    robots.run_round()
    assert all(state.ended for state in robots.states.values())
    assert all(robots.timers[i].keys().isdisjoint(Timer) for i in range(3))
    assert not robots.mail


def test_a_fault_ends_the_run_for_all() -> None:
    """[FAULT] (R-HOLD)"""
    robots = begun()
    robots.propose(0)
    robots.propose(1)
    fault = EventFault(FaultKind.INDEX, "a.krd:1:1")
    robots.propose(2, Proposal(2, 0, (Attempt(0, fault=fault),)))
    robots.settle()
    assert all(state.ended for state in robots.states.values())
    assert any(isinstance(effect, RunEnded) for effect in robots.effects)


def test_a_commit_is_the_only_effect_that_acts() -> None:
    """(R-COMMIT): a proposal alone moves nothing."""
    robots = begun()
    robots.propose(1)
    assert not any(isinstance(effect, Commit | Resume) for effect in robots.effects)


@pytest.mark.parametrize("robots", [2, 8, 64, 200, 1000])
@pytest.mark.parametrize("delta_s", [0.0, 0.01, 0.1, 1.0])
def test_a_coordinator_is_heard_three_times_before_it_is_given_up(
    robots: int, delta_s: float
) -> None:
    """(R-AGAIN) (R-SILENCE): however long it waits, and however many robots there are."""
    setup = Setup(robots, Timing.of(delta_s, robots))
    turn = StepContext(setup, fresh(setup, 0), 0.0)
    turn.await_answer()
    for _ in range(5):
        turn.await_longer()
    waits_s = [one.after_s for one in turn.effects if isinstance(one, Arm)]
    assert len(waits_s) == 6
    assert 0.0 < max(waits_s) <= setup.timing.silence_s / 3
