"""Who is let through in a round. [EVENT-TRANS] [ATOMIC] [SKIP] [FAULT]"""

from __future__ import annotations

from koord.runtime.proposals import (
    Admitted,
    Attempt,
    EventFault,
    Proposal,
    StopRequests,
    Write,
    decide,
    rotating,
)
from koord.syntax.faults import FaultKind


def attempt(event: int, *locks: int, fault: EventFault | None = None) -> Attempt:
    return Attempt(event, (Write(0, (), event),), locks, fault=fault)


def proposals(*of_robots: tuple[Attempt, ...]) -> dict[int, Proposal]:
    return {robot: Proposal(robot, 4, attempts) for robot, attempts in enumerate(of_robots)}


def test_robots_are_let_through_in_their_order() -> None:
    decided = decide(4, proposals((attempt(0),), (attempt(1),), ()), (1, 2, 0))
    assert decided.round == 4
    assert decided.ran == (Admitted(1, 1), Admitted(0, 0))
    assert decided.skipped == (2,)
    assert [write.value for write in decided.writes] == [1, 0]


def test_one_robot_enters_a_lock_class() -> None:
    given = proposals((attempt(0, 1),), (attempt(1, 1, 2),), (attempt(2, 2),))
    assert [t.robot for t in decide(4, given, (0, 1, 2)).ran] == [0, 2]
    assert [t.robot for t in decide(4, given, (1, 2, 0)).ran] == [1]
    assert decide(4, given, (1, 2, 0)).skipped == (2, 0)


def test_a_robot_that_loses_one_attempt_has_the_next() -> None:
    given = proposals((attempt(0, 1),), (attempt(1, 1), attempt(2, 2)))
    assert decide(4, given, (0, 1)).ran == (Admitted(0, 0), Admitted(1, 2))
    assert decide(4, given, (1, 0)).ran == (Admitted(1, 1),)


def test_who_is_not_heard_skips() -> None:
    decided = decide(4, {1: Proposal(1, 4, (attempt(0),))}, (0, 1, 2))
    assert decided.ran == (Admitted(1, 0),)
    assert decided.skipped == (0, 2)


def test_a_fault_ends_the_round_where_it_happens() -> None:
    fault = EventFault(FaultKind.DIVISION, "app.krd:3:5")
    given = proposals((attempt(0),), (attempt(1, fault=fault),), (attempt(2),))
    decided = decide(4, given, (2, 1, 0))
    assert decided.fault is not None
    assert (decided.fault.robot, decided.fault.event, decided.fault.fault) == (1, 1, fault)
    assert decided.ran == (Admitted(2, 2),)
    assert [write.value for write in decided.writes] == [2]


def test_a_fault_of_a_robot_that_is_kept_out_does_not_happen() -> None:
    fault = EventFault(FaultKind.INDEX, "app.krd:3:5")
    given = proposals((attempt(0, 1),), (attempt(1, 1, fault=fault),))
    assert decide(4, given, (0, 1)).fault is None
    assert decide(4, given, (1, 0)).fault is not None


def test_wishes_to_stop_are_told() -> None:
    given = {0: Proposal(0, 4, (Attempt(0, asked=StopRequests.TO_STOP),))}
    assert decide(4, given, (0,)).ran == (Admitted(0, 0, StopRequests.TO_STOP),)


def test_everyone_is_first_in_turn() -> None:
    assert [rotating(r, 3) for r in range(4)] == [(0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 1, 2)]
    assert rotating(5, 0) == ()
