"""The round rule of the in-process engine, on programs about one thing each."""

from __future__ import annotations

import numpy as np
import pytest

from koord.refinement.cases import SchedulePolicy
from koord.refinement.running import ready
from koord.runtime.engine import Deployed, RoundEngine
from koord.runtime.robot import Robot, Status
from koord.runtime.shapes import ShapeError
from koord.syntax.system import dealt
from tests.refinement.running import agrees, program, ran


class Nothing:
    """A host for programs that leave nothing open."""

    def start(self, robot: int | None, name: str) -> object:
        raise AssertionError(name)

    def read(self, robot: Robot) -> dict[str, object]:
        return {}

    def ask(self, *question: object) -> object:
        raise AssertionError(question)

    def choose(self, *question: object) -> object:
        raise AssertionError(question)


def fleet(text: str, robots: int = 2) -> RoundEngine:
    """The robots of a program, after INIT."""
    made = ready(program(text))
    system = dealt(made.program, robots)
    started = RoundEngine(made.classes, system.kinds, 0.1, Nothing())
    started.begin()
    return started


COUNTER = (
    "allwrite:\n  int sum = 0\nallread:\n  int[] seen = 0\nlocal:\n  int mine = 0\n"
    "Count:\n  eff:\n    stdout << mine\n    mine = mine + 1\n    seen[pid] = sum\n"
    "    atomic:\n      sum = sum + 1\n"
)


def test_who_loses_a_lock_keeps_nothing_of_the_event() -> None:
    """[ATOMIC] [SKIP]"""
    it = fleet(COUNTER, 3)
    decided = it.program_turns(Deployed())
    assert [taken.robot for taken in decided.ran] == [0]
    assert decided.skipped == (1, 2)
    assert [vars(robot)["mine"] for robot in it.robots] == [1, 0, 0]
    assert [robot.ran for robot in it.robots] == [0, None, None]
    assert [(shown.robot, shown.written[0].values) for shown in it.shown] == [(0, (0,))]
    it.environment_turn()
    assert [taken.robot for taken in it.program_turns(Deployed()).ran] == [1]


def test_nothing_happens_before_the_decision() -> None:
    """[SHARED-ASSIGN]: what a robot wrote is in its buffer alone."""
    it = fleet(COUNTER)
    before = [dict(vars(robot)) for robot in it.robots]
    proposals = [robot.propose(0) for robot in it.robots]
    assert [len(proposal.attempts) for proposal in proposals] == [1, 1]
    assert [dict(vars(robot)) for robot in it.robots] == before
    assert it.store.values["sum"] == 0
    it.robots[0].discard({})
    assert dict(vars(it.robots[0])) == before[0]


def test_robots_share_the_values_that_are_the_same() -> None:
    """Else what is one entry for each robot of an array would be a whole array for each of them."""
    made = ready(program(COUNTER))
    robots = RoundEngine(made.classes, dealt(made.program, 3).kinds, 0.1, Nothing()).robots
    assert len({id(vars(robot)["seen"]) for robot in robots}) == 1
    it = fleet(COUNTER, 3)
    for robot in it.robots:
        robot.propose(0)
        tried = robot.try_event(0)
        assert tried is not None
        assert tried.state["seen"] is it.store.values["seen"]


def test_every_robot_holds_the_same_store_after_a_round() -> None:
    """[REFRESH]"""
    it = fleet(COUNTER.replace("atomic:", "if true:"), 3)
    for _ in range(4):
        it.program_turns(Deployed())
        it.environment_turn()
        for robot in it.robots:
            held = {name: vars(robot)[name] for name in it.store.values}
            assert held == it.store.values
    assert it.store.values == {"seen": (3, 3, 3), "sum": 4}


def test_what_is_read_again_stays_the_same_object() -> None:
    """[ENV-FREE]: so it is seen at once that nothing has changed."""
    text = "using Motion:\n  sensors:\n    pos psn\nSay:\n  eff:\n    stdout << 1\n"
    made = ready(program(text))
    (robot,) = RoundEngine(made.classes, dealt(made.program, 1).kinds, 0.1, Nothing()).robots
    (name,) = robot.SENSORS
    seen = []
    for x in (1.0, 1.0, 2.0):
        assert robot.evolve({name: (x, 0.0, 0.0)}) is None
        seen.append(vars(robot)[name])
    assert robot.evolve({}) is None
    assert seen[0] is seen[1]
    assert [tuple(value) for value in seen[1:]] == [(1.0, 0.0, 0.0), (2.0, 0.0, 0.0)]
    assert vars(robot)[name] is seen[2]
    for wrong in (None, (3, 0.0, 0.0), (3.0, 0.0), (2, 0, 0), np.array([2.0, 0, 0])):
        with pytest.raises(ShapeError):
            robot.evolve({name: wrong})


def test_a_map_that_is_read_again_in_another_order_is_another() -> None:
    """[CONFIG]: a loop over it can tell."""
    text = (
        "using Heard:\n  sensors:\n    Map<bool, string>[] by\n"
        "Say:\n  eff:\n    stdout << length(by)\n"
    )
    made = ready(program(text))
    (robot,) = RoundEngine(made.classes, dealt(made.program, 1).kinds, 0.1, Nothing()).robots
    (name,) = robot.SENSORS
    pairs = (True, "a"), (False, "b")
    for read in (pairs, pairs[::-1]):
        assert robot.evolve({name: (read,)}) is None
        (seen,) = vars(robot)[name]
        assert tuple(seen.items()) == read


def test_a_robot_reads_what_was_there_when_the_round_began() -> None:
    """[LOOKUP]"""
    it = fleet(
        "allwrite:\n  int a = 1\nlocal:\n  int b = 0\nE:\n  eff:\n    b = a\n    a = pid + 5\n"
    )
    it.program_turns(Deployed())
    assert [vars(robot)["b"] for robot in it.robots] == [1, 1]
    assert it.store.values["a"] == 6


def test_stop_and_trystop() -> None:
    """[STOP]"""
    it = fleet("E:\n  eff:\n    if pid == 0: stop\n    else: trystop()\n")
    it.program_turns(Deployed())
    assert it.all_stopped
    alone = fleet("local:\n  int n = 0\nE:\n  eff:\n    n = n + 1\n    if pid == 0: trystop()\n")
    for _ in range(2):
        alone.program_turns(Deployed())
        alone.environment_turn()
    assert [robot.status for robot in alone.robots] == [Status.ASKED, Status.RUNNING]
    assert [vars(robot)["n"] for robot in alone.robots] == [2, 2]


def test_a_stop_outlasts_a_wish_to_stop_together() -> None:
    it = fleet("E:\n  pre: pid == 0\n  eff:\n    stop\n    trystop()\n")
    it.program_turns(Deployed())
    assert [robot.status for robot in it.robots] == [Status.STOPPED, Status.RUNNING]
    assert it.robots[0].propose(1).attempts == ()


URGENT = (
    "allwrite:\n  int a = 0\n  int b = 0\nlocal:\n  int n = 0\n"
    "urgent First:\n  pre: n < 3\n  eff:\n    atomic:\n      a = a + 1\n    n = n + 1\n"
    "urgent Second:\n  pre: n < 3\n  eff:\n    atomic:\n      b = b + 1\n    n = n + 1\n"
    "Third:\n  eff:\n    n = n - 1\n"
)


def test_a_robot_that_loses_an_urgent_event_runs_another() -> None:
    """[SKIP]: it may not skip while the class of the other is free."""
    it = fleet(URGENT, 3)
    decided = it.program_turns(Deployed())
    assert [(taken.robot, taken.event) for taken in decided.ran] == [(0, 0), (1, 1)]
    assert decided.skipped == (2,)
    for policy in SchedulePolicy:
        agrees(ran(URGENT, robots=3, rounds=8, policy=policy, seed=5))


def test_an_urgent_robot_is_not_unwilling() -> None:
    it = fleet(URGENT, 1)
    offered = it.robots[0].propose(0, willing=False)
    assert offered.urgent
    assert [attempt.event for attempt in offered.attempts] == [0, 1]
    free = fleet(URGENT.replace("urgent ", ""), 1).robots[0]
    assert free.propose(0, willing=False).attempts == ()
    assert not free.propose(0, willing=False).urgent


def test_an_urgent_event_whose_pre_cannot_be_evaluated_does_not_oblige() -> None:
    """[SKIP]"""
    it = fleet("local:\n  int n = 0\nurgent E:\n  pre: 1 / n > 0\n  eff:\n    n = 1\n", 1)
    offered = it.robots[0].propose(0, willing=False)
    assert not offered.urgent
    assert offered.attempts == ()
    assert it.robots[0].propose(0).attempts[0].fault is not None


def test_the_deployed_order_of_choice_is_that_of_the_program() -> None:
    """Decision record 0008."""
    it = fleet(URGENT.replace("urgent ", ""), 1)
    assert [attempt.event for attempt in it.robots[0].propose(0).attempts] == [0]
    assert [a.event for a in it.robots[0].propose(0, (2, 0, 1)).attempts] == [2]


class Picky(Nothing):
    """A host that never says the same again."""

    def __init__(self) -> None:
        self.asked = 0

    def ask(self, *question: object) -> object:
        self.asked += 1
        return self.asked


def test_one_evaluation_has_one_answer() -> None:
    """[EXTERNAL]: a list operation looks at its place twice, and asks once."""
    text = (
        "def fun pick(int k) -> int: extern fresh\n"
        "local:\n  int[][] rows = [[], [], [], [], []]\n"
        "E:\n  eff:\n    append(rows[pick(2)], 5)\n    append(rows[pick(2)], 6)\n"
    )
    made = ready(program(text))
    host = Picky()
    it = RoundEngine(made.classes, (0,), 0.1, host)
    it.begin()
    it.program_turns(Deployed())
    assert host.asked == 2
    assert vars(it.robots[0])["rows"] == ((), (5,), (6,), (), ())
    it.environment_turn()
    it.program_turns(Deployed())
    assert host.asked == 4
    assert vars(it.robots[0])["rows"] == ((), (5,), (6,), (5,), (6,))


def test_a_fault_ends_the_run() -> None:
    it = fleet("local:\n  int n = 0\nE:\n  eff:\n    n = 1 / n\n")
    decided = it.program_turns(Deployed())
    assert decided.fault is not None
    assert it.ended is not None
    assert it.ended.robot == 0
    assert it.ended.fault.place == "app.krd:5:13"


def test_what_a_map_holds_below_a_key_is_one_location() -> None:
    """[LOCATION]"""
    text = (
        "def Item:\n  int a = 0\n  int b = 0\n"
        "allwrite:\n  Map<int, Item> items = {1: Item(1, 2)}\n"
        "E:\n  eff:\n    if pid == 0: items[1].a = 7\n    else: items[1].b = 8\n"
    )
    it = fleet(text)
    it.program_turns(Deployed())
    assert it.store.values["items"] == {1: (1, 8)}
    agrees(ran(text, rounds=4))


def test_locations_that_are_gone_are_lost() -> None:
    """Decision record 0007."""
    text = (
        "allwrite:\n  int[] list = [1, 2, 3]\n"
        "E:\n  eff:\n    if pid == 0: list = [9]\n    else: list[2] = 5\n"
    )
    it = fleet(text)
    it.program_turns(Deployed())
    assert it.store.values["list"] == (9,)
