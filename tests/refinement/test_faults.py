"""Faults of compiled programs: each kind, the first one, at the place that is named. [FAULT]"""

from __future__ import annotations

import pytest

from koord.refinement.running import ready
from koord.refinement.sampling_hosts import SeededHost
from koord.runtime.engine import RoundEngine
from koord.syntax.faults import FaultKind
from koord.syntax.system import dealt
from tests.refinement.running import agrees, program, ran

HEAD = (
    "local:\n  int zero = 0\n  float nought = 0.0\n  int two = 2\n  int none\n  int[] list = [1]\n"
    "  int[2] pair\n  Map<int, int> map = {}\n  Queue<int> queue = []\n  pos place\n  int to = 0\n"
    "  int[][] rows = [[1], [2]]\n  Map<int, pos> spots = {}\n  int[] empty = []\n"
    "def fun asked(int k) -> int: extern\n  requires: 10 / k > 2\n"
    "def fun untouched(int k) -> int:\n  int[2] some\n  return some[k]\n"
    "def fun touched(int k) -> int:\n  int[2] some\n  some[0] = 1\n  return some[k]\n"
    "def fun plain(int k) -> int:\n  return 1 / k\n"
    "Go:\n  eff:\n    "
)

CASES = {
    "index of a list": ("to = list[two]", FaultKind.INDEX, "two]"),
    "negative index": ("to = list[zero - 1]", FaultKind.INDEX, "zero - 1]"),
    "index of an array": ("to = pair[two]", FaultKind.INDEX, "two]"),
    "constant index of an array": ("to = pair[7]", FaultKind.INDEX, "7]"),
    "write at a constant index": ("pair[7] = 1", FaultKind.INDEX, "7] ="),
    "write at an index": ("list[two] = 1", FaultKind.INDEX, "two] ="),
    "write at a negative index": ("pair[zero - 1] = 1", FaultKind.INDEX, "zero - 1]"),
    "a loop that goes on behind an array": (
        "for k = 0, 3:\n      pair[k] = pair[k - k]",
        FaultKind.UNSET,
        "pair[k - k]",
    ),
    "a loop that writes behind an array": (
        "for k = 0, 3:\n      pair[k] = k",
        FaultKind.INDEX,
        "k] = k",
    ),
    "a loop that reads behind an array": (
        "pair = [1, 2]\n    for k = 0, 3:\n      to = pair[k]",
        FaultKind.INDEX,
        "k]",
    ),
    "write into a row": ("rows[two][0] = 1", FaultKind.INDEX, "two]["),
    "integer division": ("to = 1 / zero", FaultKind.DIVISION, "zero"),
    "division": ("nought = 1.0 / nought", FaultKind.DIVISION, "nought"),
    "remainder": ("to = 1 % zero", FaultKind.DIVISION, "zero"),
    "unset": ("to = none", FaultKind.UNSET, "none"),
    "partly unset": ("place.x = 1.0\n    place = place", FaultKind.UNSET, "place"),
    "unset element": ("pair[0] = 1\n    to = pair[1]", FaultKind.UNSET, "pair[1]"),
    "missing key": ("to = map[two]", FaultKind.KEY, "two]"),
    "write below a missing key": ("spots[two].x = 1.0", FaultKind.KEY, "two]"),
    "pop": ("to = pop(queue)", FaultKind.EMPTY, "pop"),
    "least": ("to = min(empty)", FaultKind.EMPTY, "min"),
    "greatest": ("to = max(empty)", FaultKind.EMPTY, "max"),
    "requires": ("to = asked(5)", FaultKind.PRECONDITION, "asked"),
    "requires that faults": ("to = asked(zero)", FaultKind.PRECONDITION, "asked"),
    "in a function": ("to = plain(zero)", FaultKind.DIVISION, "k\nGo"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_fault_is_the_one_of_the_rules(name: str) -> None:
    statement, kind, place = CASES[name]
    text = f"{HEAD}{statement}\n"
    outcome = ran(text, robots=1)
    agrees(outcome)
    assert outcome.judged is not None
    fault = outcome.judged.trace.configurations[-1].fault
    assert fault is not None
    assert fault.kind is kind
    where = text.rindex(place)
    line = text[:where].count("\n") + 1
    assert outcome.ran is not None
    assert outcome.ran.fault_place is not None
    assert outcome.ran.fault_place.startswith(f"app.krd:{line}:")


@pytest.mark.parametrize(
    ("statement", "kind"),
    [
        ("list[1 / zero] = none", FaultKind.UNSET),  # the value first
        ("list[two] = 1 / zero", FaultKind.DIVISION),
        ("rows[two][1 / zero] = 1", FaultKind.DIVISION),  # all indices before any is looked up
        ("to = rows[two][1 / zero]", FaultKind.INDEX),  # reading: one step after the other
        ("append(rows[two], 1 / zero)", FaultKind.DIVISION),
        ("remove(rows[two], none)", FaultKind.UNSET),
        ("to = none + 1 / zero", FaultKind.UNSET),
        ("to = pair[1 / zero]", FaultKind.DIVISION),
        ("to = untouched(two)", FaultKind.UNSET),
        ("to = touched(two)", FaultKind.INDEX),
        ("to = 1 / zero + none", FaultKind.DIVISION),
        ("to = max(1 / zero, none)", FaultKind.DIVISION),
        ("if contains(rows[two], none): to = 1", FaultKind.INDEX),
        ("if zero == 1 and 1 / zero == 1: to = 1\n    to = none", FaultKind.UNSET),
        ("if zero == 0 or 1 / zero == 1: to = 1\n    to = none", FaultKind.UNSET),
        ("to = asked(none)", FaultKind.UNSET),
        ("stdout << 1 / zero << none", FaultKind.DIVISION),
    ],
)
def test_of_several_faults_it_is_the_first(statement: str, kind: FaultKind) -> None:
    outcome = ran(f"{HEAD}{statement}\n", robots=1)
    agrees(outcome)
    assert outcome.judged is not None
    fault = outcome.judged.trace.configurations[-1].fault
    assert fault is not None
    assert fault.kind is kind


def test_a_fault_before_the_first_round_is_one_too() -> None:
    shared = ran("allwrite:\n  int a = 1 / 0\nGo:\n  eff:\n    a = 1\n")
    agrees(shared)
    own = ran("local:\n  int a\n  int b\ninit:\n  b = a\nGo:\n  eff:\n    b = 1\n", robots=1)
    agrees(own)
    for outcome, robot in ((shared, None), (own, 0)):
        assert outcome.judged is not None
        fault = outcome.judged.trace.configurations[0].fault
        assert fault is not None
        assert fault.robot is robot


def test_a_model_of_the_environment_may_fault() -> None:
    text = (
        "using Wall:\n  sensors:\n    int gap = 2\n  environment:\n    gap = 4 / (gap - 1) - 3\n"
        "Go:\n  eff:\n    stop\n"
    )
    outcome = ran(text, rounds=5)
    agrees(outcome)
    assert outcome.ran is not None
    assert outcome.ran.fault_place is None
    empty = text.replace("gap = 4 / (gap - 1) - 3", "gap = choose(gap, 1)")
    broken = ran(empty, rounds=5)
    agrees(broken)
    assert broken.ran is not None
    assert broken.ran.fault_place == "app.krd:5:11"


def test_where_a_model_faults_no_robot_has_moved() -> None:
    """[FAULT] [ENV-TRANS]: the faulted configuration has the ports of before the turn."""
    text = (
        "using Wall:\n  sensors:\n    int gap = 2\n  environment:\n"
        "    gap = gap + 1 + 0 / (4 - gap - pid)\nGo:\n  eff:\n    stop\n"
    )
    system = dealt(program(text), 3)
    made = ready(system.program)
    fleet = RoundEngine(made.classes, system.kinds, 0.1, SeededHost(system, made.names, "0", 0))
    fleet.begin()
    held = []
    while fleet.ended is None:
        held.append([robot.ports() for robot in fleet.robots])
        fleet.environment_turn()
    assert fleet.ended.robot == 2  # 0 and 1 had evolved by then
    assert fleet.ended.fault.place == "app.krd:5:25"
    assert [robot.ports() for robot in fleet.robots] == held[-1]
    assert fleet.round == len(held) - 1
    outcome = ran(text, rounds=5)
    agrees(outcome)
