"""Elections, and robots that come back. Rules by hand, one message at a time."""

from __future__ import annotations

from msgspec.structs import replace as changed

from koord.runtime.proposals import Decision
from koord.runtime.protocol.events import Install, Reason, Received, Timer
from koord.runtime.protocol.messages import (
    COMMITTED,
    Acknowledge,
    Candidacy,
    Canvass,
    Committed,
    Decide,
    Hello,
    History,
    LogEntry,
    Open,
    Overruled,
    Position,
    Propose,
    Snapshot,
    Support,
    Vote,
    digest,
)
from koord.runtime.protocol.setup import Setup, Timing
from koord.runtime.protocol.state import (
    Candidate,
    Canvassing,
    Coordinator,
    Follower,
    Rejoining,
    Retired,
    fresh,
)
from tests.runtime.fleet import Fleet, Parcel, begun, fleet


def orphaned(robots: int = 3) -> Fleet:
    """The coordinator is dead, and the others have noticed."""
    made = begun(robots)
    made.off(0)
    made.mail.clear()
    for robot in range(1, robots):
        made.fire(robot, Timer.SILENCE)
    return made


def elected(robots: int = 3) -> Fleet:
    """Robot 1 has succeeded robot 0."""
    made = orphaned(robots)
    made.fire(1, Timer.SILENCE)
    made.settle()
    return made


# --- epochs ---------------------------------------------------------------------------------------


def test_an_epoch_belongs_to_one_robot() -> None:
    setup = Setup(5, Timing.zero(), first=3)
    assert [setup.coordinator(e) for e in range(6)] == [3, 4, 0, 1, 2, 3]
    for robot in range(5):
        epoch = setup.epoch_above(7, robot)
        assert epoch > 7
        assert setup.coordinator(epoch) == robot
        assert all(setup.coordinator(e) != robot for e in range(8, epoch))


def test_positions_compare_rounds_before_epochs() -> None:
    """(R-VOTE)"""
    assert Position(3, 0) > Position(2, COMMITTED)
    assert Position(3, COMMITTED) > Position(3, 9) > Position(3, 2)


# --- the coordinator dies -------------------------------------------------------------------------


def test_silence_makes_followers_follow_nobody_first() -> None:
    """(R-SILENCE)"""
    robots = begun()
    robots.fire(1, Timer.SILENCE)
    assert robots.states[1].office == Follower(None)
    assert not robots.mail
    # the successor first, the others a slot later each
    robots.fire(2, Timer.SILENCE)
    assert robots.timers[1][Timer.SILENCE] < robots.timers[2][Timer.SILENCE]


def test_a_majority_elects_a_coordinator() -> None:
    """(R-CANVASS) (R-STAND) (R-VOTE) (R-OFFICE)"""
    robots = orphaned()
    robots.fire(1, Timer.SILENCE)
    assert isinstance(robots.states[1].office, Canvassing)
    assert robots.states[1].promised == 0
    robots.of(Canvass)
    robots.of(Support)
    assert isinstance(robots.states[1].office, Candidate)
    assert robots.states[1].promised == 1
    robots.of(Candidacy)
    assert robots.states[2].promised == 1
    robots.of(Vote)
    assert isinstance(robots.states[1].office, Coordinator)
    robots.of(Open)
    assert robots.states[2].office == Follower(1)


def test_after_an_election_rounds_go_on() -> None:
    """(R-OFFICE)"""
    robots = elected()
    robots.run_round()
    robots.fire(1, Timer.DEADLINE)
    robots.settle()
    assert robots.rounds == [1, 1]
    assert robots.acted[1][-1].late == (0,)


def test_who_hears_the_coordinator_supports_nobody() -> None:
    """(R-CANVASS)"""
    robots = begun()
    robots.fire(1, Timer.SILENCE)
    robots.fire(1, Timer.SILENCE)
    robots.of(Canvass)
    assert not any(isinstance(p.message, Support) for p in robots.mail)
    assert robots.states[2].office == Follower(0)


def test_who_was_deaf_for_a_while_deposes_nobody() -> None:
    """(R-CANVASS)"""
    robots = begun()
    robots.fire(1, Timer.SILENCE)
    robots.fire(1, Timer.SILENCE)
    robots.settle()
    robots.run_round()
    robots.fire(0, Timer.DEADLINE)
    robots.settle()
    assert robots.rounds == [1, 1, 1]
    assert isinstance(robots.states[0].office, Coordinator)
    assert robots.states[1].office == Follower(0)


def test_fewer_than_a_majority_elect_nobody() -> None:
    """(R-STAND)"""
    robots = orphaned(5)
    robots.off(3)
    robots.off(4)
    robots.off(2)
    for _ in range(5):
        robots.fire(1, Timer.SILENCE)
        robots.settle()
    assert not isinstance(robots.states[1].office, Coordinator | Candidate)
    robots.fire(1, Timer.HOLD)
    assert robots.holds[1][-1] is Reason.NO_COORDINATOR


def test_one_supporter_twice_is_one_supporter() -> None:
    """(R-STAND)"""
    robots = orphaned(5)
    robots.fire(1, Timer.SILENCE)
    robots.of(Canvass, to=2)
    supports = lambda p: isinstance(p.message, Support)  # noqa: E731
    robots.deliver(supports, keep=True)
    robots.deliver(supports, keep=True)
    assert isinstance(robots.states[1].office, Canvassing)


def test_a_candidate_that_holds_less_is_refused_and_taught() -> None:
    """(R-VOTE) (R-TEACH)"""
    robots = begun()
    robots.lose()
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide, to=2)
    robots.of(Acknowledge)
    robots.lose()
    robots.off(0)
    for robot in (1, 2):
        robots.fire(robot, Timer.SILENCE)
    robots.mail = [Parcel(1, 0, 2, Candidacy(1, robots.states[1].position))]
    robots.deliver()
    assert not any(isinstance(p.message, Vote) for p in robots.mail)
    assert robots.states[2].promised == 0


def test_what_one_robot_may_have_acted_on_survives_its_coordinator() -> None:
    """(I-LASTING) (R-OFFICE): the decision that only the dead and one other held."""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide, to=2)
    robots.of(Acknowledge)
    decided = robots.acted[0][-1]
    assert decided.round == 0
    robots.lose()
    robots.off(0)
    for robot in (1, 2):
        robots.fire(robot, Timer.SILENCE)
    for _ in range(6):
        for robot in (1, 2):
            if Timer.SILENCE in robots.timers[robot]:
                robots.fire(robot, Timer.SILENCE)
                robots.settle()
    assert robots.acted[1][1] == decided
    assert robots.acted[2][1] == decided


def test_a_tentative_entry_is_sent_again_in_the_new_epoch() -> None:
    """(R-OFFICE) (R-ACCEPT)"""
    robots = begun(5)
    for robot in range(5):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide, to=1)
    robots.lose()
    robots.off(0)
    held = robots.states[1].tentative
    assert held is not None
    for robot in (1, 2, 3, 4):
        robots.fire(robot, Timer.SILENCE)
    robots.fire(1, Timer.SILENCE)
    robots.settle()
    assert robots.acted[3][-1] == held.entry
    assert robots.states[3].log[-1].epoch == 1


def test_a_promise_shuts_out_lower_epochs() -> None:
    """(R-ACCEPT) (R-OVERRULED)"""
    robots = begun(5)
    for robot in range(5):
        robots.propose(robot)
    robots.of(Propose)
    late = [p for p in robots.mail if isinstance(p.message, Decide) and p.to == 2]
    robots.lose()
    robots.mail = [Parcel(1, 0, 2, Candidacy(1, robots.states[1].position))]
    robots.of(Candidacy)
    robots.lose()
    robots.mail = late
    robots.deliver()
    assert robots.states[2].tentative is None
    assert [type(p.message) for p in robots.mail] == [Overruled]
    robots.settle()
    assert not isinstance(robots.states[0].office, Coordinator)


def test_an_epoch_is_promised_to_one_candidate_only() -> None:
    """(R-VOTE)"""
    robots = begun(5)
    robots.mail = [Parcel(3, 0, 2, Candidacy(1, Position(0, COMMITTED)))]
    robots.of(Candidacy)
    assert robots.states[2].promised == 0
    assert not any(isinstance(p.message, Vote) for p in robots.mail)


def test_an_acknowledgement_of_another_epoch_does_not_count() -> None:
    """(R-MAJORITY)"""
    robots = elected()
    for robot in (1, 2):
        robots.propose(robot)
    robots.settle()
    robots.fire(1, Timer.DEADLINE)
    held = robots.states[1].tentative
    assert held is not None
    robots.mail = [Parcel(2, 0, 1, Acknowledge(0, held.round, held.digest))]
    robots.deliver()
    assert robots.rounds == [0, 0]


def test_a_vote_of_another_epoch_does_not_count() -> None:
    """(R-OFFICE)"""
    robots = orphaned(5)
    robots.fire(1, Timer.SILENCE)
    robots.of(Canvass)
    robots.of(Support)
    robots.lose()
    robots.mail = [Parcel(i, 0, 1, Vote(0, 0)) for i in (2, 3, 4)]
    robots.deliver()
    assert isinstance(robots.states[1].office, Candidate)


def test_a_vote_for_another_process_of_the_pid_does_not_count() -> None:
    """(R-OFFICE)"""
    robots = orphaned(5)
    robots.fire(1, Timer.SILENCE)
    robots.of(Canvass)
    robots.of(Support)
    robots.lose()
    robots.mail = [Parcel(i, 0, 1, Vote(1, 7)) for i in (2, 3, 4)]
    robots.deliver()
    assert isinstance(robots.states[1].office, Candidate)
    robots.mail = [Parcel(i, 0, 1, Vote(1, 0)) for i in (2, 3, 4)]
    robots.deliver()
    assert isinstance(robots.states[1].office, Coordinator)


def test_a_coordinator_that_hears_no_majority_steps_down() -> None:
    """(R-SILENCE)"""
    robots = begun()
    robots.run_round()
    robots.fire(0, Timer.SILENCE)
    assert robots.states[0].leader == 0
    robots.fire(0, Timer.SILENCE)
    assert robots.states[0].leader is None


def test_of_two_that_canvass_the_lower_epoch_is_supported() -> None:
    """(R-CANVASS)"""
    robots = orphaned()
    robots.fire(2, Timer.SILENCE)
    robots.fire(1, Timer.SILENCE)
    robots.settle()
    assert isinstance(robots.states[1].office, Coordinator)
    assert robots.states[2].office == Follower(1)


def test_a_new_coordinator_goes_on_after_a_round_only_it_knows_to_be_committed() -> None:
    """(R-ACCEPT): Open names the history, so the follower commits what it holds."""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide)
    robots.of(Acknowledge)
    robots.of(Committed, to=1)
    robots.lose()
    robots.off(0)
    assert [robots.states[i].round for i in (1, 2)] == [1, 0]
    for robot in (1, 2):
        robots.fire(robot, Timer.SILENCE)
    robots.fire(1, Timer.SILENCE)
    robots.settle()
    assert [robots.states[i].round for i in (1, 2)] == [1, 1]


# --- coming back ----------------------------------------------------------------------------------


def test_a_robot_that_is_back_gets_a_snapshot_and_is_admitted() -> None:
    """(R-REJOIN) (R-SNAPSHOT) (R-ADMIT)"""
    robots = begun()
    robots.run_round()
    robots.off(2)
    robots.lose()
    robots.back(2, incarnation=5)
    assert isinstance(robots.states[2].office, Rejoining)
    assert robots.holds[2][-1] is Reason.REJOINING
    robots.settle()
    assert robots.states[2].round == 1
    assert robots.states[0].roster == (0, 0, 0)
    robots.run_round()
    assert robots.states[2].round == 2
    assert robots.states[2].is_voter
    assert robots.states[0].roster == (0, 0, 5)


def test_who_is_not_admitted_neither_acknowledges_nor_votes() -> None:
    """(R-ACCEPT) (R-VOTE)"""
    robots = begun()
    robots.off(2)
    robots.lose()
    robots.back(2, incarnation=5)
    robots.settle()
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide)
    assert {p.sender for p in robots.mail if isinstance(p.message, Acknowledge)} == {1}
    robots.lose()
    robots.mail = [Parcel(1, 0, 2, Candidacy(1, Position(9, COMMITTED)))]
    robots.deliver()
    assert not any(isinstance(p.message, Vote) for p in robots.mail)


def test_the_round_that_admits_a_robot_is_agreed_on_without_it() -> None:
    """(R-ADMIT) (R-MAJORITY): not even by what it said before the crash."""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    robots.off(2)
    robots.back(2, incarnation=5)
    robots.of(Hello, to=0)
    robots.of(Propose)
    held = robots.states[0].tentative
    assert held is not None
    assert [a.robot for a in held.entry.admitted] == [2]
    robots.lose()
    robots.mail = [Parcel(2, old, 0, Acknowledge(0, 0, held.digest)) for old in (0, 5)]
    robots.deliver()
    assert robots.rounds[0] == 0
    robots.mail = [Parcel(1, 0, 0, Acknowledge(0, 0, held.digest))]
    robots.deliver()
    assert robots.rounds[0] == 1


def test_acknowledgements_from_before_a_restart_do_not_count() -> None:
    """(R-MAJORITY)"""
    robots = begun()
    robots.off(2)
    robots.lose()
    robots.back(2, incarnation=5)
    robots.settle()
    robots.run_round()
    assert robots.states[0].roster[2] == 5
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    held = robots.states[0].tentative
    assert held is not None
    robots.lose()
    robots.mail = [Parcel(2, 0, 0, Acknowledge(0, held.round, held.digest))]
    robots.deliver()
    assert robots.states[0].tentative is not None


def test_a_vote_from_before_a_restart_does_not_elect() -> None:
    """(R-OFFICE)"""
    robots = begun()
    robots.off(2)
    robots.lose()
    robots.back(2, incarnation=5)
    robots.settle()
    robots.run_round()
    robots.off(0)
    robots.fire(1, Timer.SILENCE)
    robots.fire(1, Timer.SILENCE)
    robots.mail = [Parcel(2, 0, 1, Support(1)), Parcel(2, 0, 1, Vote(1, 0))]
    robots.deliver()
    assert isinstance(robots.states[1].office, Canvassing)


def test_a_snapshot_tells_what_the_robot_ran_last() -> None:
    """(R-SNAPSHOT)"""
    robots = begun(kept=2)
    for robot in range(3):
        robots.propose(robot)
    robots.settle_without(2)
    for _ in range(4):
        robots.propose(0)
        robots.propose(1)
        robots.settle_without(2)
        robots.fire(0, Timer.DEADLINE)
        robots.settle_without(2)
    assert robots.rounds == [5, 5, 0]
    robots.fire(2, Timer.RESEND)
    robots.settle()
    assert robots.rounds == [5, 5, 5]
    assert robots.acted[2][-1].round == -1, "it came by a snapshot"
    shown = robots.states[2].last_ran[2]
    assert shown is not None
    assert shown.round == 0


def test_a_snapshot_replaces_the_store_and_says_so() -> None:
    """(R-SNAPSHOT)"""
    robots = begun()
    robots.off(2)
    robots.lose()
    robots.back(2, incarnation=5)
    robots.of(Hello)
    robots.of(Snapshot)
    assert any(isinstance(effect, Install) for effect in robots.effects)


def test_a_robot_whose_pid_was_taken_says_nothing_more() -> None:
    """(R-ADMIT)"""
    robots = begun()
    twin = robots.states[2]
    robots.back(2, incarnation=5)
    robots.settle()
    for robot in (0, 1, 2):
        robots.propose(robot)
    robots.settle()
    admitting = robots.acted[0][-1]
    assert admitting.admitted
    robots.states[2] = twin
    robots.mail = [Parcel(0, 0, 2, History(0, admitting))]
    robots.settle()
    assert isinstance(robots.states[2].office, Retired)
    assert robots.holds[2][-1] is Reason.TWICE
    robots.mail = [Parcel(0, 0, 2, Open(0, 1, robots.states[0].chain))]
    robots.settle()
    assert not robots.mail


def test_an_old_hello_admits_nobody() -> None:
    """(R-ADMIT)"""
    robots = begun()
    robots.off(2)
    robots.lose()
    robots.back(2, incarnation=5)
    robots.settle()
    robots.run_round()
    robots.mail = [Parcel(2, 3, 0, Hello(empty=True))]
    robots.deliver()
    office = robots.states[0].office
    assert isinstance(office, Coordinator)
    assert office.guests == ()


def test_a_majority_is_left_to_admit_those_who_are_back() -> None:
    """(R-ADMIT)"""
    robots = begun()
    for robot in (1, 2):
        robots.off(robot)
        robots.back(robot, incarnation=5 + robot)
    robots.of(Hello)
    robots.propose(0)
    robots.fire(0, Timer.DEADLINE)
    held = robots.states[0].tentative
    assert held is not None
    assert len(held.entry.admitted) == 1


# --- when the run is over -------------------------------------------------------------------------


def over() -> Fleet:
    """Two of three robots have come to the end; the coordinator is switched off since."""
    robots = fleet(3, rounds=1)
    robots.settle()
    robots.run_round()
    robots.run_round()
    assert all(state.ended for state in robots.states.values())
    robots.off(0)
    robots.lose()
    return robots


def test_who_is_back_when_the_run_is_over_learns_that() -> None:
    """(R-TEACH) (R-SNAPSHOT): though there is no coordinator any more to say it."""
    robots = over()
    robots.back(0, incarnation=5)
    robots.settle()
    assert robots.states[0].round == 1
    assert robots.states[0].ended
    assert robots.over.count(0) == 2  # before, and again


def test_a_robot_that_has_yet_to_be_admitted_is_told_as_well() -> None:
    """(R-TEACH)"""
    robots = over()
    state = fresh(robots.setup, 0)
    robots.on(0, changed(state, incarnation=9, round=0, office=Follower(None)))
    robots.lose()
    robots.fire(0, Timer.SILENCE)  # it is no voter, and says Hello
    robots.settle()
    assert robots.states[0].ended


def test_who_holds_a_round_is_taught_that_it_is_committed() -> None:
    """(R-TEACH): from the round on that it does not know to be committed."""
    robots = over()
    held = robots.states[1].log[-1]
    state = changed(
        fresh(robots.setup, 0),
        round=held.round,
        chain=held.entry.previous,
        tentative=held,
        office=Follower(None),
    )
    robots.on(0, state)
    robots.lose()
    robots.fire(0, Timer.SILENCE)
    robots.settle()
    assert robots.states[0].round == held.round + 1
    assert robots.states[0].ended


def test_an_entry_that_another_history_lacks_is_not_committed_by_what_follows() -> None:
    """(R-COMMIT): what is held is committed by an entry whose `previous` it is, and by no other."""
    robots = begun()
    for robot in range(3):
        robots.propose(robot)
    robots.of(Propose)
    robots.of(Decide)  # all hold the coordinator's entry for round 0
    held = robots.states[2].tentative
    assert held is not None
    robots.lose()
    other = LogEntry(Decision(0, (), (0, 1, 2), ()), held.entry.previous)
    following = LogEntry(Decision(1, (), (0, 1, 2), ()), digest(other))
    robots.do(2, Received(0.0, 1, 0, Decide(1, following)))
    assert robots.states[2].round == 0
    assert robots.states[2].tentative == held
    assert robots.states[2].is_behind
    fits = LogEntry(Decision(1, (), (0, 1, 2), ()), held.digest)
    robots.do(2, Received(0.0, 1, 0, Decide(1, fits)))
    assert robots.states[2].round == 1
    assert robots.acted[2][-1] == held.entry
