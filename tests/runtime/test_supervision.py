"""The supervisor of robots' processes: whom it restarts, whom it gives up, and when all is over."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from msgspec.structs import replace

from koord.runtime.deploy.status import RobotReport, continued, unheard
from koord.runtime.deploy.supervision import (
    AT_ONCE_S,
    MOST_DEATHS,
    STOP_S,
    STUCK_S,
    EndCause,
    ProcessEnd,
    ProcessState,
    Supervisor,
)


def at(pid: int, round_: int, *, is_over: bool = False) -> RobotReport:
    return replace(unheard(pid), round=round_, is_over=is_over)


@dataclass
class Fleet:
    """A supervisor with a clock of its own, and robots that have all said where they are."""

    robots: int = 3
    owing: frozenset[int] = frozenset()
    restarts: bool = False
    round: int = 5
    now: float = 100.0
    supervisor: Supervisor = field(init=False)

    def __post_init__(self) -> None:
        robots, owing, now = self.robots, self.owing, self.now
        self.supervisor = Supervisor(robots, owing, now, restarts=self.restarts)
        for pid in range(self.robots):
            self.supervisor.heard(at(pid, self.round))

    def kill(self, *pids: int) -> list[bool]:
        return [self.end(pid, EndCause.KILLED) for pid in pids]

    def end(self, pid: int, cause: EndCause) -> bool:
        return self.supervisor.ended(ProcessEnd(pid, cause, self.round, signal=9), self.now)

    def stuck(self) -> str | None:
        """Why the run ends, if robots are left to themselves for long enough."""
        was_soon = self.supervisor.is_stuck(self.now)
        self.now += STUCK_S
        assert not was_soon
        return self.supervisor.stuck if self.supervisor.is_stuck(self.now) else None


# --- restarts -------------------------------------------------------------------------------------


def test_who_is_killed_is_named_and_not_restarted_without_being_asked() -> None:
    fleet = Fleet()
    assert fleet.kill(1) == [False]
    report = fleet.supervisor.processes[1]
    assert report.is_lost
    assert report.story == "its process was killed (signal 9) in round 5"
    assert not fleet.supervisor.processes[0].story


def test_who_is_killed_is_restarted_as_often_as_it_lived_for_a_while() -> None:
    fleet = Fleet(restarts=True)
    for _ in range(3 * MOST_DEATHS):
        fleet.now += AT_ONCE_S
        assert fleet.kill(1) == [True]
    report = fleet.supervisor.processes[1]
    assert not report.is_lost
    assert report.story == ("its process was killed (signal 9) in round 5; restarted 15 times")


def test_who_dies_at_once_again_and_again_is_given_up() -> None:
    fleet = Fleet(restarts=True)
    deaths = [fleet.kill(1)[0] for _ in range(MOST_DEATHS)]
    assert deaths == [True] * (MOST_DEATHS - 1) + [False]
    report = fleet.supervisor.processes[1]
    assert report.is_lost
    assert report.state is ProcessState.GIVEN_UP
    assert report.story.endswith("restarted 4 times; given up, as it died at once 5 times")


def test_a_life_that_is_long_enough_clears_the_record() -> None:
    fleet = Fleet(restarts=True)
    assert fleet.kill(*[1] * (MOST_DEATHS - 1)) == [True] * (MOST_DEATHS - 1)
    fleet.now += AT_ONCE_S
    assert fleet.kill(*[1] * MOST_DEATHS) == [True] * MOST_DEATHS


def test_deaths_of_several_robots_are_counted_for_each() -> None:
    fleet = Fleet(restarts=True)
    assert fleet.kill(0, 1, 2, 0, 1, 2) == [True] * 6


@pytest.mark.parametrize("cause", [EndCause.STOPPED, EndCause.DONE])
def test_who_was_asked_to_stop_or_is_done_is_not_restarted(cause: EndCause) -> None:
    fleet = Fleet(restarts=True)
    assert not fleet.end(1, cause)
    assert fleet.supervisor.processes[1].is_lost == (cause is EndCause.STOPPED)


def test_nobody_is_restarted_who_would_come_back_to_a_run_that_is_over() -> None:
    fleet = Fleet(restarts=True)
    fleet.supervisor.heard(at(0, 6, is_over=True))
    assert fleet.kill(1) == [False]
    assert fleet.supervisor.processes[1].is_lost


def test_nobody_is_restarted_when_all_are_to_stop() -> None:
    fleet = Fleet(restarts=True)
    fleet.supervisor.stop(fleet.now)
    assert fleet.kill(1) == [False]
    assert not fleet.end(0, EndCause.STOPPED)
    assert [one.is_lost for one in fleet.supervisor.processes.values()] == [False, True, False]


# --- runs that cannot go on -----------------------------------------------------------------------


def test_a_run_goes_on_with_a_majority() -> None:
    fleet = Fleet(5)
    fleet.kill(0, 4)
    assert fleet.stuck() is None


def test_a_run_without_a_majority_ends_after_a_while() -> None:
    fleet = Fleet(4)
    fleet.kill(0, 3)
    assert fleet.stuck() == (
        "no round can be decided any more without robots 0 and 3: 2 of 4 is no majority"
    )


def test_a_run_goes_on_if_robots_are_restarted_whatever_their_number() -> None:
    fleet = Fleet(3, restarts=True)
    assert fleet.kill(0, 1, 2) == [True] * 3
    assert fleet.stuck() is None


def test_a_run_whose_robots_were_given_up_ends() -> None:
    fleet = Fleet(3, restarts=True)
    fleet.kill(*[0, 1] * MOST_DEATHS)
    assert fleet.stuck() is not None


def test_a_run_ends_without_a_robot_that_may_not_skip() -> None:
    """(R-OWED)"""
    fleet = Fleet(5, owing=frozenset({3, 4}))
    fleet.kill(2)
    assert fleet.stuck() is None
    fleet.kill(3)
    assert fleet.stuck() == ("no round can be decided any more without robot 3, which may not skip")


def test_a_run_begins_with_all_robots_or_not_at_all() -> None:
    fleet = Fleet(5, round=-1)
    fleet.kill(4)
    assert fleet.stuck() == "the run cannot begin without robot 4"


def test_who_was_never_heard_has_a_status_when_it_has_ended() -> None:
    supervisor = Supervisor(2, frozenset(), 0.0, restarts=False)
    supervisor.ended(ProcessEnd(1, EndCause.CRASHED, detail="no"), 0.0)
    assert supervisor.statuses == {1: unheard(1)}


def test_who_is_done_tells_the_others_before_it_leaves() -> None:
    fleet = Fleet(3)
    fleet.kill(2)
    fleet.supervisor.heard(at(0, 6, is_over=True))
    fleet.end(0, EndCause.DONE)
    fleet.supervisor.heard(at(1, 6, is_over=True))
    assert fleet.stuck() is None
    fleet.supervisor.heard(at(1, 6))
    assert fleet.stuck() is not None


def test_robots_that_are_told_to_stop_are_not_stuck_but_have_only_so_long() -> None:
    fleet = Fleet(3)
    fleet.kill(0, 1)
    fleet.supervisor.stop(fleet.now)
    fleet.supervisor.stop(fleet.now + STOP_S / 2)
    assert fleet.stuck() is None
    assert fleet.supervisor.overdue(fleet.now) == ()
    fleet.now += STOP_S
    assert fleet.supervisor.overdue(fleet.now) == (2,)


# --- what is told ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("end", "said"),
    [
        (ProcessEnd(0, EndCause.KILLED, 7, 11), "its process was killed (signal 11) in round 7"),
        (
            ProcessEnd(0, EndCause.KILLED, -1, 9),
            "its process was killed (signal 9) before it took part",
        ),
        (
            ProcessEnd(0, EndCause.CRASHED, None, detail="OSError: no"),
            "its process crashed before it took part: OSError: no",
        ),
        (
            ProcessEnd(0, EndCause.STOPPED, 0, 15),
            "its process stopped as it was asked to (signal 15) in round 0",
        ),
        (ProcessEnd(0, EndCause.DEAF, 3, 9), "its process did not stop, and was killed in round 3"),
    ],
)
def test_ends_are_told_with_their_round(end: ProcessEnd, said: str) -> None:
    assert str(end) == said


def test_a_robot_that_is_back_goes_on_counting() -> None:
    fleet = Fleet(restarts=True)
    counted = {"ran": 3, "skipped": 2, "late": 1, "overdue": 1, "took_s": 2.0, "sent": 9}
    first = replace(at(1, 9), **counted, longest_s=0.3, received=4, drops=(("forged", 2),))
    fleet.supervisor.heard(first)
    fleet.kill(1)
    assert fleet.supervisor.statuses[1] == first
    again = replace(at(1, 12), **counted, longest_s=0.2, drops=(("forged", 1), ("old", 5)))
    known = fleet.supervisor.heard(again)
    assert known == fleet.supervisor.statuses[1] == continued(first, again)
    assert (known.round, known.ran, known.sent, known.longest_s) == (12, 6, 18, 0.3)
    assert dict(known.drops) == {"forged": 3, "old": 5}
    fleet.supervisor.heard(again)
    assert fleet.supervisor.statuses[1].ran == 6
