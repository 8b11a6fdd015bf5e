"""Verdicts that say less than they seem to: what is told of them, what is not. [PROP-VACUOUS]"""

from __future__ import annotations

import pytest

from koord.sampling import initial_state_search
from koord.verify.engine_names import Engine
from koord.verify.vacuity import analysis
from koord.verify.verdicts import Emptiness, Outcome
from tests.sampling import first
from tests.verify.asking import ask, of_text

COUNTER = """
local:
  int x = 0
  bool busy = false
Up:
  pre: x < 3
  eff: x = x + 1
Down:
  pre: x == 3
  eff: x = 0
"""
LIVELY = COUNTER.replace("eff: x = x + 1", "eff:\n    busy = x == 1\n    x = x + 1")

BODY = """
using Body:
  sensors:
    float x = 0.0
  actuators:
    bool up = false
    bool gone = false
{contract}
Flip:
  eff: Body.up = not Body.up
invariant Small: Body.x <= 3.0 or true
"""

NEVER = "can never come true"
RULED_OUT = "can come true, but no round in which it does can end: contracts rule it out"


@pytest.fixture(autouse=True)
def short_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """What happens in these programs at all happens soon."""
    monkeypatch.setattr(analysis, "TURNS", 60)
    monkeypatch.setattr(initial_state_search, "READING_TRIES", 50)


def told(text: str, robots: int = 2, rounds: int = 4, choice: Engine | None = None) -> list[str]:
    """What is certain, but for statements that nothing can break."""
    report = ask(of_text(text), robots, rounds, choice).report
    found = [v for v in report.vacuities if v.certain and v.what.value != "untouched"]
    return [f"{v.subject}: {v.detail}" for v in found]


# --- what statements suppose ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "condition",
    first(
        2,
        [
            "busy implies x == 2",
            "not busy or x == 2",
            "x == 2 or not busy",
            "x == 2 or not busy or x > 5",
            "x >= 0 and (not busy or x == 2)",
            "not busy or (x > 1 implies x == 2)",
            "x >= 0 implies (busy implies x == 2)",
        ],
    ),
)
def test_what_statements_suppose_is_to_come_true(condition: str) -> None:
    assert told(f"{COUNTER}invariant Sure: {condition}\n") == [f"Sure: {NEVER}"]
    assert told(f"{COUNTER}invariant Sure at round: {condition}\n") == [f"Sure: {NEVER}"]
    # Busy robots are what it takes.
    assert told(f"{LIVELY}invariant Sure: {condition}\n") == []


@pytest.mark.parametrize(
    "condition",
    [
        "x == 3 or busy == false",
        "not (busy and x == 2)",
        "not busy or not (x == 7)",
        "numAgents < 2 or not (busy@0 and busy@1)",
        "not (x == 2 and busy) or x == 7",
        "x <= 3 implies x <= 3 or not busy",
        "x < 0 or x >= 0",
    ],
)
def test_what_excludes_or_chooses_supposes_nothing(condition: str) -> None:
    assert told(f"{COUNTER}invariant Sure: {condition}\n") == []


def test_of_what_eventually_holds_no_part_is_supposed_but_by_an_implication() -> None:
    assert told(f"{COUNTER}eventually Done: x == 2 or not busy\n") == []
    assert told(f"{COUNTER}eventually Done: busy implies x == 2\n") == [f"Done: {NEVER}"]
    assert told(f"{COUNTER}eventually Done: busy leadsto x == 2\n") == [f"Done: {NEVER}"]


FUNCTIONS = """
def fun small(int y) -> bool:
  if y == 2:
    return y < 0 implies y == 9
  return y > 2 implies y == 3
"""


def test_a_function_that_is_called_once_is_read_as_if_it_stood_there() -> None:
    once = f"{FUNCTIONS}{COUNTER}invariant Sure: small(x)\n"
    assert told(once) == [f"Sure: {NEVER}"]
    assert told(f"{FUNCTIONS}{COUNTER}invariant Sure: forall i: i == 0 implies small(x@i)\n") == [
        f"Sure: {NEVER}"
    ]
    # Of several places not each means all its cases.
    assert told(f"{once}invariant Too: small(x + 0)\n") == []


def test_what_is_so_between_the_ends_of_rounds_comes_true() -> None:
    """[PROP-INVARIANT]: as the program turns end, robots know what their sensors show."""
    text = """
using Clock:
  sensors:
    int time = 0
  environment:
    time = time + 1
local:
  int seen = -1
urgent Look:
  eff: seen = Clock.time
invariant Sure{when}: seen == Clock.time implies seen >= 0
"""
    assert ask(of_text(text.format(when="")), rounds=2).empty == []
    (late,) = ask(of_text(text.format(when=" at round")), rounds=2).empty
    assert late.startswith("supposition Sure: ")


@pytest.mark.slow
def test_what_is_supposed_of_some_robots_is_looked_for_at_them() -> None:
    """Robots may not change places where one is named, be it in what is supposed alone."""
    text = """
local:
  int x = 0
Up:
  pre: x < 500
  eff: x = x + 1
eventually Ends: x > x@0 + 400 leadsto x == 500
"""
    (late,) = ask(of_text(text, 3), rounds=3, choice=Engine.BMC).report.vacuities
    assert not late.certain


# --- contracts ------------------------------------------------------------------------------------


def body(*lines: str) -> str:
    """A program whose module has one contract."""
    contract = "".join(f"    {line}\n" for line in lines)
    return BODY.format(contract=f"  contract Moves:\n{contract}")


def test_a_contract_whose_requirement_is_never_met_promises_nothing() -> None:
    met = "contract Moves: "
    assert told(body("requires: gone", "ensures: x' == 1.0")) == [met + NEVER]
    assert told(body("requires: up and gone", "ensures: x' == 1.0")) == [met + NEVER]
    assert told(body("requires: up", "requires: gone", "ensures: x' == 1.0")) == [met + NEVER]
    assert told(body("requires: up", "ensures: x' == 1.0")) == []
    assert told(body("requires: true", "ensures: x' == 1.0")) == []


def test_what_a_contract_ensures_on_a_condition_is_looked_at_too() -> None:
    met = "contract Moves: "
    assert told(body("ensures: gone implies x' == 1.0")) == [met + NEVER]
    assert told(body("requires: up", "ensures: not gone or x' == 1.0")) == [met + NEVER]
    assert told(body("ensures: up implies (gone implies x' == 1.0)")) == [met + NEVER]
    assert told(body("ensures: up implies x' == 1.0")) == []
    # What is so only after the turn is for the contract to say.
    assert told(body("ensures: x' > 5.0 implies x' < 3.0")) == []


def test_a_contract_that_lets_no_turn_end_where_it_is_wanted_is_told() -> None:
    """Its promises are those of cases that exclude each other."""
    found = told(body("requires: up", "ensures: x' == x + 1.0", "ensures: x' == x - 1.0"))
    assert f"contract Moves: {RULED_OUT}" in found
    found = told(body("ensures: up implies x' == x + 1.0 and x' == x - 1.0"))
    assert f"contract Moves: {RULED_OUT}" in found
    # It is no matter of the contract that nobody could be gone.
    found = told(body("requires: gone", "ensures: x' == x + 1.0", "ensures: x' == x - 1.0"))
    assert found == [f"contract Moves: {NEVER}"]


MODEL = """
using Body:
  sensors:
    int x = 0
  actuators:
    bool up = false
  environment:
    if x < 2:
      x = x + 1
  contract Moves:
    requires: {required}
    ensures: x' >= x
Flip:
  eff: Body.up = not Body.up
"""


def test_a_contract_that_a_model_keeps_says_something_only_if_it_is_met() -> None:
    assert told(MODEL.format(required="x > 2")) == [f"contract Moves: {NEVER}"]
    # At the start no turn of the environment begins with it: the program turns come before.
    assert told(MODEL.format(required="x == 0")) == []
    urgent = MODEL.replace(
        "Flip:\n  eff: Body.up = not", "urgent Flip:\n  eff: Body.up = Body.up or not"
    )
    assert told(urgent.format(required="not up")) == [f"contract Moves: {NEVER}"]


def test_a_contract_of_several_kinds_of_robots_is_met_if_one_of_them_meets_it() -> None:
    text = """
using Body:
  sensors:
    int x = 0
  actuators:
    bool up = false
  contract Moves:
    requires: up
    ensures: x' == 1
agent Car:
  Wait:
    eff: Body.up = {car}
agent Drone:
  Rise:
    eff: Body.up = {drone}
invariant Small: forall Car c: Body.x@c <= 1 or true
"""
    assert told(text.format(car="false", drone="true")) == []
    assert told(text.format(car="false", drone="false")) == [f"contract Moves: {NEVER}"]


def test_a_run_that_contracts_do_not_let_go_on_is_told_though_others_do() -> None:
    """[ENV-CONTRACT]: they are contradictory where a robot comes to the border."""
    moves = ("ensures: up implies x' == x + 1.0", "ensures: up or x' == x")
    ends = "robot 0 in round 7 of some run, which ends there"
    (ended,) = [
        v
        for v in ask(of_text(body(*moves, "ensures: x' <= 3.0"))).report.vacuities
        if v.what is Emptiness.CONTRACTS
    ]
    assert ended.detail == f"no turn of the environment meets those of {ends}"
    assert not ended.certain
    for free in ("ensures: x <= 3.0 implies x' <= 4.0", "requires: x > 0.0"):
        contracts = [v.what for v in ask(of_text(body(*moves, free))).report.vacuities]
        assert Emptiness.CONTRACTS not in contracts


def test_readings_that_are_hard_to_come_by_are_no_dead_end() -> None:
    """Runs at random do not find them, but there are some."""
    nowhere = "gone implies x' == x and x' == x + 1.0"
    text = body("ensures: x' * 48271.0 == 7.0 + x - x'", f"ensures: {nowhere}")
    assert [v for v in ask(of_text(text)).report.vacuities if v.what is Emptiness.CONTRACTS] == []


# --- what nothing touches -------------------------------------------------------------------------


@pytest.mark.parametrize("choice", [None, Engine.BMC])
def test_what_nothing_touches_is_told_whichever_engine_saw_it_hold(choice: Engine | None) -> None:
    text = f"{COUNTER}invariant Always: x == 2 or x != 2\ninvariant Fixed: not busy\n"
    assert ask(of_text(text), choice=choice).empty == [
        "untouched Fixed: nothing that it reads changes after the start",
        "untouched Always: it is true whatever the events do",
    ]


def test_a_goal_that_is_reached_at_the_start_is_told() -> None:
    """[PROP-EVENTUALLY]: no event has a part in it."""
    goals = {
        "x == 3": "",
        "not busy": "nothing that its goal reads changes after the start",
        "x == 1 leadsto not busy": "nothing that its goal reads changes after the start",
        "x == 0 or x == 3": "its goal is reached at the start already",
        "forall i: x@i == 0": "its goal is reached at the start already",
        "exists i: x@i == 2": "",
        "x == 1 leadsto x == 0": "",
    }
    for goal, why in goals.items():
        asked = ask(of_text(f"{COUNTER}eventually Done: {goal}\n"))
        assert asked.outcome("Done") is Outcome.HOLDS, goal
        assert asked.empty == ([f"untouched Done: {why}"] if why else [])
    # What does not hold needs no reason.
    assert ask(of_text(f"{COUNTER}eventually Done: busy\n")).empty == []


# --- summaries ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("summary", "why"),
    [
        ("ensures: a > 0 implies result > 1 and result < 0", "for a = 1"),
        ("ensures: a < 5 and result == a or a > 5 and result == 7", "for a = 5"),
        ("requires: a > 3\n  ensures: result >= a and result <= 4", "for a = 5"),
        ("requires: a <= 4\n  ensures: result >= a and result <= 4", ""),
        ("ensures: result * result <= a or a < 0", ""),
    ],
)
def test_a_function_that_has_no_answer_for_some_arguments_is_told(summary: str, why: str) -> None:
    """[EXTERNAL]: no function meets such a summary, though some calls may have answers."""
    text = f"def fun f(int a) -> int: extern\n  {summary}\n{COUNTER}"
    shown = f": no answer of f {why} can meet its `ensures`"
    assert told(text) == ([shown] if why else [])
    # Who is answered anew each time may know what not to ask.
    assert told(text.replace("extern", "extern fresh")) == []


def test_a_function_that_others_could_leave_without_an_answer_is_not_told() -> None:
    """There is a function g that lets f have answers."""
    text = """
def fun g(int a) -> int: extern
def fun between(int a, int b) -> bool:
  return g(a) < b and b < a
def fun f(int a) -> int: extern
  ensures: between(a, result)
"""
    assert told(text + COUNTER) == []


def test_a_function_that_nobody_may_call_is_told() -> None:
    text = "def fun f(int a) -> int: extern\n  requires: a > 0 and a < 0\n  ensures: result > a\n"
    assert told(text + COUNTER) == [": no arguments of f can meet its `requires`"]
    text = "def fun f(int a) -> int: extern fresh\n  ensures: result > a and result < a\n"
    assert told(text + COUNTER) == [": no answer of f can meet its `ensures`"]


# --- every number of robots -----------------------------------------------------------------------


def told_of_any(text: str) -> list[tuple[str, bool]]:
    """What is told of the program with any number of robots, and whether it is certain."""
    report = ask(of_text(text), 2, 5, Engine.EVERY_N).report
    return [(f"{v.subject}: {v.detail}", v.certain) for v in report.vacuities]


SUM = """
allwrite:
  int total = 0
local:
  bool done = false
Add:
  pre: not done
  eff: atomic:
    total = total + 1
    done = true
"""


def test_what_takes_more_robots_than_are_looked_at_may_happen() -> None:
    """Two robots and six are looked at; that no number of them can is another thing."""
    many = "Many:\n  pre: total >= {}\n  eff: done = true\n"
    assert told_of_any(SUM + many.format(3)) == []
    few = "Many: cannot run within 5 rounds, with 2 robots or 6 robots"
    assert told_of_any(SUM + many.format(7)) == [(few, False)]
    assert told_of_any(SUM + many.format("7 and total < 0")) == [("Many: can never run", True)]
    assert told_of_any(SUM + "invariant Sure: total >= 3 implies total > 1\n") == []
    assert told_of_any(SUM + "invariant Sure: total < 0 implies total == 5\n") == [
        (f"Sure: {NEVER}", True)
    ]


def test_what_few_robots_cannot_break_more_may() -> None:
    hollow = "it is true whatever the events do"
    assert told_of_any(SUM + "invariant Sure: total > 3 or total < 4\n") == [
        (f"Sure: {hollow}", True)
    ]
    # Of two robots two are always the same.
    pairs = "forall i, j, k: i == j or j == k or k == i or total >= 0"
    text = f"{SUM}invariant Low: total >= 0\ninvariant Sure: {pairs}\n"
    assert ask(of_text(text), 2, 5, Engine.EVERY_N).outcome("Sure") is Outcome.HOLDS
    assert told_of_any(text) == []
    assert ask(of_text(text), 2).empty == [f"untouched Sure: {hollow}"]


def test_assumptions_that_few_robots_cannot_meet_are_no_contradiction() -> None:
    assert told_of_any(f"{SUM}assume Many: numAgents > 3\n") == []
    start = "no initial configuration satisfies them all"
    assert told_of_any(f"{SUM}assume Many: numAgents > 9\n") == [
        (f": {start}, with 2 robots or 6 robots", False)
    ]
    assert told_of_any(f"{SUM}assume None: numAgents < 0\n") == [(f": {start}", True)]


def test_contracts_that_no_number_of_robots_meets_contradict_each_other() -> None:
    text = body("ensures: x' == x + 1.0", "ensures: x' == x - 1.0")
    assert told_of_any(text)[0] == (": no run gets through round 1", True)
    text = body("ensures: x' == x + 1.0", "ensures: numAgents < 7 implies x' == x - 1.0")
    late = ": no run gets through round 1, with 2 robots or 6 robots"
    assert told_of_any(text)[0] == (late, False)
