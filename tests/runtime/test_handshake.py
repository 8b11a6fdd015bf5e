"""The handshake before a run: who takes part, which run it is, and what robots name."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from msgspec.structs import replace

from koord.runtime.exploration.handshakes import HandshakeBounds, HandshakeExplorer
from koord.runtime.protocol.handshake import (
    NO_RUN,
    Differs,
    Enter,
    EnterLate,
    HandshakeMessage,
    Higher,
    Join,
    Known,
    Outcome,
    OutOfStep,
    Party,
    RefusalReason,
    Refused,
    Roll,
    Running,
    Say,
    StartedTwice,
    TurnedAway,
    answer,
    call_the_roll,
    differing,
    join,
    receive,
    waiting,
)
from koord.runtime.protocol.messages import INCARNATION_STEP, incarnation_above

PROGRAM = (("program", "one"), ("delta", "0.1 s"))


def party(pid: int, robots: int = 3, start: int = 0, *, insists: bool = False) -> Party:
    nonce = bytes([robots, pid, start]) + bytes(13)
    return Party(pid, robots, 0, nonce, PROGRAM, b"key", insists)


@dataclass
class Hall:
    """Robots that hear all that is said once they are on. Those in a run answer as such."""

    parties: list[Party]
    runs: dict[int, bytes] = field(default_factory=dict)  #: of journals
    outcomes: dict[int, list[Outcome]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.states = [waiting(one, self.runs.get(one.pid, NO_RUN)) for one in self.parties]
        self.on: set[int] = set()
        self.loses: type | None = None  #: messages of this kind are lost
        self.rolls: dict[int, tuple[bytes, ...]] = {}
        self.mail: list[tuple[int, int | None, HandshakeMessage]] = []

    def start_again(self, pid: int, start: int) -> None:
        robots = len(self.parties)
        self.parties[pid] = party(pid, robots, start)
        self.states[pid] = waiting(self.parties[pid])
        self.rolls.pop(pid, None)

    def off(self, pid: int) -> None:
        self.on.discard(pid)

    def join(self, *pids: int) -> None:
        for pid in pids:
            self.on.add(pid)
            self.mail.append((pid, None, join(self.parties[pid], self.states[pid])))
            state, outcomes = call_the_roll(self.parties[pid], self.states[pid])
            self.states[pid] = state
            self._note(pid, outcomes)
            self.settle()

    def settle(self) -> None:
        while self.mail:
            sender, to, message = self.mail.pop(0)
            for pid in range(len(self.parties)) if to is None else (to,):
                if pid != sender and pid in self.on and type(message) is not self.loses:
                    self.hear(pid, sender, message)

    def hear(self, pid: int, sender: int, message: HandshakeMessage) -> tuple[Outcome, ...]:
        one, state = self.parties[pid], self.states[pid]
        if state.run != NO_RUN and isinstance(message, Join):
            known = Known(0, 1, is_heard=False)
            outcomes = answer(one, state.run, self.rolls.get(pid, ()), sender, message, known)
        else:
            self.states[pid], outcomes = receive(one, state, sender, message)
        self._note(pid, outcomes)
        return outcomes

    def _note(self, pid: int, outcomes: tuple[Outcome, ...]) -> None:
        self.outcomes.setdefault(pid, []).extend(outcomes)
        for one in outcomes:
            if isinstance(one, Say):
                self.mail.append((pid, one.to, one.message))
            elif isinstance(one, Enter):
                self.rolls[pid] = one.nonces
                if pid == 0:
                    self.mail.append((pid, None, Roll(one.nonces)))

    def ended(self, pid: int, kind: type) -> list[Outcome]:
        return [one for one in self.outcomes.get(pid, ()) if isinstance(one, kind)]


def hall(robots: int = 3) -> Hall:
    return Hall([party(pid, robots) for pid in range(robots)])


# --- a run begins ---------------------------------------------------------------------------------


@pytest.mark.parametrize("robots", [1, 2, 3, 7])
def test_robots_enter_one_run(robots: int) -> None:
    """(R-JOIN) (R-ROLL) (R-ENTER)"""
    made = hall(robots)
    made.join(*range(robots - 1, -1, -1))
    made.join(0)
    runs = {state.run for state in made.states}
    assert len(runs) == 1
    assert NO_RUN not in runs
    assert all(len(made.ended(pid, Enter)) == 1 for pid in range(robots))


def test_another_start_is_another_run() -> None:
    """(R-ROLL)"""
    seen = set()
    for start in range(5):
        made = hall()
        made.start_again(1, start)
        made.join(1, 2, 0)
        seen.add(made.states[2].run)
    assert len(seen) == 5


def test_nobody_begins_without_all() -> None:
    """(R-ROLL)"""
    made = hall()
    made.join(0, 1)
    assert all(state.run == NO_RUN for state in made.states[:2])


def test_a_roll_that_was_lost_is_said_again() -> None:
    """(R-ROLL) (R-RUNNING): by whoever is in the run."""
    made = hall()
    made.loses = Roll
    made.join(1, 2, 0)
    assert made.states[0].run != NO_RUN
    assert made.states[2].run == NO_RUN
    made.loses = None
    made.join(2)
    assert made.states[2].run == made.states[0].run
    made.off(0)
    made.join(1)
    assert made.states[1].run == made.states[2].run


def test_a_join_of_an_earlier_handshake_does_not_count() -> None:
    """(I-FRESH): its ``heard`` is not the leader's nonce of now."""
    before = hall()
    before.start_again(0, 7)
    before.join(0)
    old = join(before.parties[1], before.states[1])
    made = hall()
    made.join(0, 2)
    assert made.hear(0, 1, old) == ()
    assert made.states[0].run == NO_RUN


def test_a_roll_without_one_s_own_nonce_is_dropped() -> None:
    """(R-ENTER) (I-FRESH)"""
    before = in_a_run()
    made = hall()
    for pid in range(3):
        made.start_again(pid, 1)
    made.join(0)
    assert made.hear(1, 0, Roll(before.rolls[0])) == ()
    assert made.states[1].run == NO_RUN


def test_a_roll_of_a_leader_that_has_started_again_is_dropped() -> None:
    """(R-ENTER)"""
    made = hall()
    made.loses = Roll
    made.join(1, 2, 0)
    late = Roll(made.rolls[0])
    made.start_again(0, 1)
    made.join(0)
    assert made.hear(1, 0, late) == ()


def test_a_join_of_an_earlier_leader_between_join_and_roll_keeps_nobody_out() -> None:
    """(R-ROLL) (R-ENTER): who would drop the roll is told again who leads."""
    before = hall()
    before.start_again(0, 7)
    old = join(before.parties[0], before.states[0])
    made = hall()
    made.loses = Roll
    made.join(1, 2, 0)
    made.loses = None
    made.hear(1, 0, old)
    assert made.states[1].heard == old.nonce
    made.join(1)
    assert made.states[1].run == made.states[0].run != NO_RUN


# --- late robots ----------------------------------------------------------------------------------


def in_a_run(robots: int = 3) -> Hall:
    made = hall(robots)
    made.join(*range(robots), 0)
    assert made.states[-1].run != NO_RUN
    return made


def test_a_robot_without_its_journal_comes_late() -> None:
    """(R-LATE) (R-RUNNING): once as many say so as can admit it again."""
    made = in_a_run()
    run = made.states[0].run
    made.start_again(2, 1)
    joined = join(made.parties[2], made.states[2])
    (said,) = answer(made.parties[0], run, made.rolls[0], 2, joined, Known(9, 4, False))
    assert said == Say(2, Running(joined.nonce, run, 9, 4))
    assert isinstance(said, Say)
    assert made.hear(2, 0, said.message) == (OutOfStep(0, run),)
    assert made.hear(2, 0, said.message) == (OutOfStep(0, run),), "it counts once"
    other = Running(joined.nonce, run, 2, 6)
    assert made.hear(2, 1, other) == (EnterLate(run, 9, 6),)


def test_an_answer_to_another_start_is_dropped() -> None:
    """(R-LATE) (I-FRESH)"""
    made = in_a_run()
    made.start_again(2, 1)
    old = Running(party(2).nonce, made.states[0].run)
    assert made.hear(2, 0, old) == ()
    assert made.hear(2, 1, old) == ()


def test_a_new_run_is_refused_to_one_robot_of_a_fleet_that_is_in_one() -> None:
    """(R-LATE)"""
    made = in_a_run()
    made.start_again(1, 1)
    made.parties[1] = replace(made.parties[1], insists=True)
    made.join(1)
    assert made.ended(1, TurnedAway) == [TurnedAway(2, None)]


def test_incarnations_are_above_those_that_others_know() -> None:
    """(R-LATE) (R-ADMIT): and of two with the same count none is the other."""
    one, other = incarnation_above(0, 12), incarnation_above(0, 13)
    assert 0 < one != other < 2 * INCARNATION_STEP
    assert incarnation_above(one, 1) > max(one, other)


def test_a_journal_of_another_run_gives_way_to_the_run_of_the_others() -> None:
    """(R-LATE)"""
    made = in_a_run()
    made.start_again(1, 1)
    made.states[1] = waiting(made.parties[1], bytes([7]) * 16)
    made.join(1)
    assert [type(one) for one in made.outcomes[1][-2:]] == [OutOfStep, EnterLate]


def test_a_start_as_high_as_one_s_own_is_told() -> None:
    """(R-START)"""
    made = in_a_run()
    run = made.states[0].run
    made.start_again(1, 1)
    made.states[1] = waiting(made.parties[1], run)
    assert made.hear(1, 0, Running(made.parties[1].nonce, run, 0, 5)) == (Higher(5),)


def test_robots_with_a_journal_and_robots_without_name_each_other() -> None:
    """(R-NAME)"""
    run = bytes([7]) * 16
    made = Hall([party(pid, 4) for pid in range(4)], {2: run, 3: run})
    made.join(0, 2)
    assert OutOfStep(2, run) not in made.outcomes[0], "that may be a Join of long ago"
    made.states[2] = replace(made.states[2], heard=made.parties[0].nonce)
    made.join(2)
    assert OutOfStep(2, run) in made.outcomes[0]
    assert OutOfStep(0, NO_RUN) in made.outcomes[2]
    assert made.states[0].run == NO_RUN


# --- what differs ---------------------------------------------------------------------------------


def test_another_program_is_named_on_both_sides_and_refused() -> None:
    """(R-NAME)"""
    made = hall()
    theirs = (("program", "two"), ("delta", "0.1 s"))
    made.parties[1] = replace(made.parties[1], fingerprint=theirs)
    made.join(0, 1, 2)
    made.join(0, 1)
    assert Differs(1, theirs) in made.outcomes[0]
    assert Differs(0, PROGRAM) in made.outcomes[1]
    assert Differs(1, theirs) in made.outcomes[2]
    assert TurnedAway(0, PROGRAM) in made.outcomes[1]
    assert made.states[0].run == NO_RUN


def test_an_old_join_refuses_nobody() -> None:
    """(R-NAME) (I-FRESH): a refusal is of a start of the leader that the robot has heard."""
    made = hall()
    theirs = (("program", "two"),)
    made.join(0)
    old = Join(made.parties[1].nonce, bytes(16), NO_RUN, theirs)
    assert made.hear(0, 1, old) == (Differs(1, theirs),)
    assert made.hear(1, 0, Refused(bytes(16), RefusalReason.DIFFERS, theirs)) == ()


def test_two_processes_with_one_pid_are_named() -> None:
    """(R-NAME)"""
    made = hall()
    made.join(0)
    leader = made.parties[0].nonce
    first, second = (Join(party(1, 3, k).nonce, leader, NO_RUN, PROGRAM) for k in (1, 2))
    assert made.hear(0, 1, first) == ()
    assert made.hear(0, 1, second) == (), "it was started again"
    assert made.hear(0, 1, first) == (StartedTwice(1),)
    own = Join(party(1, 3, 9).nonce, leader, NO_RUN, PROGRAM)
    assert made.hear(1, 1, own) == (StartedTwice(1),)
    assert made.hear(1, 1, join(made.parties[1], made.states[1])) == (), "it hears itself"


def test_a_robot_that_is_heard_in_the_run_is_not_let_in_a_second_time() -> None:
    """(R-NAME)"""
    made = in_a_run()
    run, joined = made.states[0].run, Join(bytes([9]) * 16, bytes(16), NO_RUN, PROGRAM)
    heard = Known(0, 1, is_heard=True)
    twice, refused = answer(made.parties[0], run, made.rolls[0], 1, joined, heard)
    assert twice == StartedTwice(1)
    assert refused == Say(1, Refused(joined.nonce, RefusalReason.TWICE))
    back = replace(joined, run=run)  # with its journal, and in its place
    assert answer(made.parties[0], run, made.rolls[0], 1, back, heard) == (
        Say(1, Running(joined.nonce, run, 0, 1)),
    )


def test_what_differs_is_said_for_both() -> None:
    """A program differs when a param does, and that is said instead."""
    here = (("program", "a"), ("param k", "1"), ("delta", "0.1 s"))
    there = (("program", "b"), ("param k", "2"), ("delta", "0.1 s"))
    assert differing(here, there) == ("param k: 1 here, 2 there",)
    assert differing(here[::2], there[::2]) == ("program: a here, b there",)
    assert differing(here, here[:2]) == ("delta: 0.1 s here, none there",)


# --- everything that can happen -------------------------------------------------------------------


@pytest.mark.parametrize(
    "bounds",
    [
        HandshakeBounds(robots=2, starts=3, other=True),
        pytest.param(HandshakeBounds(robots=2, starts=4, states=2_000_000), marks=pytest.mark.slow),
        pytest.param(HandshakeBounds(robots=3, starts=4, states=1_000_000), marks=pytest.mark.slow),
    ],
)
def test_the_invariants_hold_whatever_old_datagrams_arrive(bounds: HandshakeBounds) -> None:
    """(I-ONE-RUN) (I-FRESH): crashes, returns with disks, old disks and none."""
    explored = HandshakeExplorer(bounds).run()
    assert explored.violation is None
    assert explored.runs > 2
    assert explored.complete or explored.states > bounds.states
