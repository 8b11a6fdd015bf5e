"""Compiled programs are given recorded runs: they do the same, or are found out. [RERUN]"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from msgspec.structs import replace

from koord.api.verdicts import trace_of
from koord.refinement.compiled_replay import Departure, rerun
from koord.refinement.rounding import Unjudged
from koord.refinement.running import ready
from koord.syntax.system import dealt
from koord.traces.trace import BEFORE_ROUNDS, Numbers, Trace, traced
from tests.refinement.running import program, sources
from tests.sampling import first
from tests.verify.asking import ask

BROKEN = Path(__file__).resolve().parents[2] / "specs/examples/broken"

#: Those that take a second or more come last.
EXAMPLES = """
    allstop_alone follow_path_takeoff leader_elect_early leader_elect_restless sum_of_ids_no_lock
    traffic_no_lock waypoints_early lineform_ends cars_and_drones_low delivery_no_lock
    follow_points_ahead mapping_blind mapping_race sats2_out_of_turn task_no_lock
"""

#: Broken in round 3, by the second robot.
ADDING = """\
allwrite:
  int total = 0
local:
  int mine = 0
init:
  mine = 0
Add:
  pre: mine < 2
  eff:
    mine = mine + 1
    atomic: total = total + pid + 1
    stdout << "total " << total
Double:
  pre: mine == 2
  eff: atomic: total = 2 * total
invariant Small: total < 7
"""

#: Exact numbers reach it, doubles do not: 0.1 + 0.1 + 0.1 is more than 0.3.
ROUNDING = """\
local:
  float total = 0.0
Add:
  pre: total < 0.3
  eff: total = total + 0.1
Exactly:
  pre: total == 0.3
  eff: total = 9.0
invariant Less: total < 1.0
"""


@cache
def counterexamples(
    text: str, robots: int = 2, rounds: int = 5, name: str = "app.krd"
) -> list[Trace]:
    """The runs that break what a program claims."""
    system = dealt(program(text, name), robots)
    return [
        trace_of(sources(text, name), system, verdict.claim, verdict.counterexample)
        for verdict in ask(system, rounds=rounds)
        if verdict.counterexample is not None
    ]


def departed(trace: Trace, wrong: str = "", right: str = "") -> Departure:
    """Where a program departs that is compiled wrongly."""
    text = trace.sources.program.text
    assert wrong in text
    found = rerun(trace, ready(program(text.replace(wrong, right, 1))))
    assert isinstance(found, Departure)
    return found


@pytest.mark.parametrize(
    "name",
    first(1, EXAMPLES.split()),
)
def test_counterexamples_of_examples_are_runs_of_the_compiled_program(name: str) -> None:
    text = (BROKEN / f"{name}.krd").read_text("utf-8")
    traces = counterexamples(text, name=f"{name}.krd")
    assert traces
    for trace in traces:
        assert rerun(trace) is None


def test_a_run_that_ends_inside_a_round() -> None:
    (trace,) = counterexamples(ADDING)
    assert trace.recording.rounds[-1].cut
    assert rerun(trace) is None


@pytest.mark.parametrize(
    ("wrong", "right", "round_", "reason"),
    [
        ("int total = 0", "int total = 1", BEFORE_ROUNDS, "it comes to another configuration"),
        ("mine = mine + 1", "mine = mine + 2", 0, "it comes to another configuration"),
        ("total + pid + 1", "total + pid", 0, "it comes to another configuration"),
        ("pre: mine < 2", "pre: mine < 1", 1, "robot 1 runs Add in the recording, and cannot here"),
        ('"total "', '"sum "', 0, "it writes 'sum 2' of robot 1 on stdout; recorded"),
        ('    stdout << "total " << total\n', "", 0, "it writes nothing; recorded is 'total 2'"),
        (
            "  mine = 0\n",
            "  mine = choose(0, 1)\n",
            BEFORE_ROUNDS,
            "it asks for a choice from 0 to 1",
        ),
        ("2 * total", "total / 0", 2, "it comes to another configuration"),
        ("2 * total", "2 * total + 1", 2, "it comes to another configuration"),
    ],
)
def test_what_is_compiled_wrongly_departs(wrong: str, right: str, round_: int, reason: str) -> None:
    (trace,) = counterexamples(ADDING)
    found = departed(trace, wrong, right)
    assert found.round == round_
    assert found.reason.startswith(reason)


def test_what_differs_is_told() -> None:
    (trace,) = counterexamples(ADDING)
    found = departed(trace, "mine = mine + 1", "mine = mine + 2")
    assert [(c.robot, c.name, c.old, c.new) for c in found.changes] == [(1, "mine", "1", "2")]


def test_a_fault_is_the_same_fault() -> None:
    text = ADDING.replace("2 * total", "total / (mine - 2)")
    trace = next(t for t in counterexamples(text) if t.configurations[-1].fault is not None)
    assert rerun(trace) is None
    found = departed(trace, "total / (mine - 2)", "total / (mine - 1)")
    assert ("the fault", "division by zero of robot 0", "none") in [
        (c.name, c.old, c.new) for c in found.changes
    ]


def test_who_does_not_run_an_urgent_event_may_ask_what_nobody_recorded() -> None:
    """A robot tries the events that oblige it, and runs another that does as well."""
    text = """\
def fun go(int n) -> int: extern
local:
  int n = 0
urgent Hurry:
  pre: n == 0
  eff:
    if go(n) > 0:
      n = 1
urgent Haste:
  pre: n == 0
  eff: n = 3
invariant NotThree: n != 3
"""
    (trace,) = counterexamples(text, robots=1)
    (only,) = trace.recording.rounds
    assert only.events == (1,)
    untold = replace(trace.recording, rounds=(replace(only, answers=()),))
    assert rerun(traced(trace.sources, trace.system, Numbers.EXACT, untold)) is None


def test_of_a_turn_that_faults_the_beginning_is_written() -> None:
    """[OUTPUT] [FAULT]"""
    text = """\
local:
  int n = 0
Go:
  eff:
    stdout << "before"
    n = 1 / n
    stdout << "after"
"""
    (trace,) = counterexamples(text, robots=1)
    assert [emitted.written.values for emitted in trace.outputs] == [("before",)]
    assert rerun(trace) is None
    assert departed(trace, '"before"', '"long before"').reason.startswith("it writes 'long before'")


def test_functions_of_maps_answer_as_was_recorded() -> None:
    text = """\
def fun size(Map<int, int> m) -> int: extern
local:
  Map<int, int> m = {1: 2}
  int n = 0
Go:
  eff: n = size(m) - n
invariant Same: n < 1
"""
    for trace in counterexamples(text, robots=1):
        assert rerun(trace) is None


def test_a_program_that_rounds_may_depart() -> None:
    """The verdict is one of exact numbers: that the road is another one is told."""
    (trace,) = counterexamples(ROUNDING, robots=1)
    found = departed(trace)
    assert found.round == 3
    assert found.reason == (
        "robot 0 runs Exactly in the recording, and cannot here; "
        "it computes with doubles, and the recording is of exact numbers"
    )


def test_floats_are_the_same_up_to_rounding() -> None:
    text = ROUNDING.replace("total == 0.3", "total > 0.25")
    (trace,) = counterexamples(text, robots=1)
    assert rerun(trace) is None
    found = departed(trace, "total + 0.1", "total + 0.1000001")
    assert [c.name for c in found.changes] == ["total"]


@pytest.mark.parametrize("kind", first(1, ["", " at round"]))
def test_a_property_that_rounding_mends_is_told(kind: str) -> None:
    """[RERUN]: 0.1 + 0.1 + 0.1 is not 0.3 on doubles; two thirds of it are in both."""
    steps = "local:\n  float x = 0.0\nGo:\n  eff:\n    x = x + 0.1\n"
    mended = f"{steps}invariant A{kind}: forall i: x@i != 0.3\n"
    (trace,) = counterexamples(mended, robots=1)
    departure = rerun(trace)
    assert isinstance(departure, Departure)
    assert (departure.round, departure.reason) == (2, "on doubles, A holds there")
    assert [(c.robot, c.name, c.old, c.new) for c in departure.changes] == [
        (0, "x", "0.3", "0.30000000000000004")
    ]
    (broken,) = counterexamples(mended.replace("0.3", "0.2"), robots=1)
    assert rerun(broken) is None
    (apart,) = counterexamples(mended.replace("x@i != 0.3", "x@i < 0.25"), robots=1)
    assert rerun(apart) is None


#: x is 0.3 after three steps, and 0.30000000000000004 on doubles.
STEPS = """\
allwrite:
  int c = 0
local:
  float x = 0.0
  bool done = false
Step:
  pre: x < 0.25
  eff: x = x + 0.1
"""


@pytest.mark.parametrize(
    ("rest", "reason"),
    [
        (
            "Back:\n  pre: x >= 0.25\n  eff: x = x - 0.3\neventually A: forall i: x@i > 1\n",
            "on doubles, the run does not end where its loop begins (x: 0 and ≈5.5",
        ),
        (
            "Back:\n  pre: x >= 0.25\n  eff: x = 0.0\neventually A: forall i: x@i > 0.3\n",
            "on doubles, A is not broken by the run",
        ),
        (
            "Late:\n  pre: x == 0.30000000000000004\n  eff: done = true\n"
            "eventually A: forall i: done@i\n",
            "on doubles, robot 0 could run an event, and never does",
        ),
    ],
)
def test_a_run_without_end_that_rounding_mends_is_told(rest: str, reason: str) -> None:
    """[RERUN] [LASSO]: it is closed, fair and breaks what it says on doubles as well, or not."""
    (trace,) = counterexamples(STEPS + rest, robots=1, rounds=8)
    assert trace.recording.loop is not None
    departure = rerun(trace)
    assert isinstance(departure, Departure)
    assert departure.reason.startswith(reason)
    assert departure.round == len(trace.recording.rounds) - 1
    broken = STEPS + rest.replace("x = x - 0.3", "x = 0.0").replace("> 0.3", "> 5")
    broken = broken.replace("== 0.30000000000000004", "> 5")
    (trace,) = counterexamples(broken, robots=1, rounds=8)
    assert rerun(trace) is None


def test_a_lost_update_that_rounding_mends_is_told() -> None:
    """[RERUN] [LOST-UPDATE]: who updates c at 0.3 does not on doubles."""
    lost = STEPS + "Touch:\n  pre: x >= 0.25\n  eff:\n    if x == 0.3:\n      c = c * 1\n"
    (trace,) = counterexamples(lost, rounds=8)
    departure = rerun(trace)
    assert isinstance(departure, Departure)
    assert departure.reason == "on doubles, no update of c is lost there"
    (trace,) = counterexamples(lost.replace("x == 0.3", "x > 0.25"), rounds=8)
    assert rerun(trace) is None


#: The model comes to 0.3 in the third round.
MODEL = """\
using Clock:
  sensors:
    float passed = 0.0
  environment:
    passed = passed + 0.1
  contract Odd:
    ensures: passed' != 0.3
local:
  int n = 0
Wait:
  eff: n = 1
"""


def test_a_contract_that_rounding_mends_is_told() -> None:
    """[RERUN] [PROP-CONTRACT]"""
    (trace,) = counterexamples(MODEL, robots=1)
    departure = rerun(trace)
    assert isinstance(departure, Departure)
    assert departure.reason == "on doubles, robot 0 keeps contract Odd"
    (trace,) = counterexamples(MODEL.replace("!= 0.3", "< 0.25"), robots=1)
    assert rerun(trace) is None


def test_what_nobody_recorded_about_rounded_numbers_is_not_judged() -> None:
    """[RERUN]: the property asks a function about 0.3, and nobody about its double."""
    text = """\
def fun far(float x) -> bool: extern
local:
  float x = 0.0
Go:
  pre: x < 0.25
  eff: x = x + 0.1
invariant A: forall i: x@i < 0.25 or far(x@i)
"""
    (trace,) = counterexamples(text, robots=1)
    assert isinstance(rerun(trace), Unjudged)
