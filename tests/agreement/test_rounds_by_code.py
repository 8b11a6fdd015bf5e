"""Rounds by code stop where the rules have to look, and wherever they are interrupted.
[PROP-INVARIANT] [ENV-MODEL] [ENV-CONTRACT] [ATOM] [RECORDING]
"""

from __future__ import annotations

from itertools import count

import pytest
from msgspec.structs import replace

from koord.api.programs import program_of
from koord.api.progress import CancelledError
from koord.api.run import HowToRun, Policy, RunSession, session_of
from koord.sampling.compiled.turns import Turns
from koord.sampling.monitors import Monitor
from koord.sampling.policies import First
from koord.semantics.domain import EXACT
from koord.syntax import core
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import dealt
from koord.traces.replay import replay
from koord.traces.trace import Numbers
from tests.agreement.test_compiled_runs import Judge, compare, story
from tests.sampling import first
from tests.semantics.by_the_rules import ByTheRules

#: Only the last robot moves, and the claim breaks for it as the second of two.
SECOND = """\
local:
  int n = 5
Down:
  pre: pid == numAgents - 1
  eff: n = n - 1
Idle:
  pre: pid < numAgents - 1
  eff: n = n
invariant Rising: forall i, j: i < j implies n@i <= n@j + 3
"""

#: What breaks the claim is what a model does, and no robot.
MODELLED = """\
using Wheel:
  sensors:
    int speed = 0
  environment:
    speed = speed + pid
local:
  int n = 0
Up:
  pre: true
  eff: n = n + 1
invariant Slow: forall i: speed@i < 5
"""

#: The model of the last robot divides by zero, or breaks its contract, after those of others.
BREAKING = """\
using Wheel:
  sensors:
    int speed = 0
    int turn = 0
  environment:
    speed = speed + pid
    turn = 12 / (6 - speed)
  contract Slow:
    ensures: speed' != MOST
local:
  int n = 0
Up:
  pre: true
  eff: n = n + 1
"""

#: The list that is written to the array is of another length in the core programs of the test.
LISTED = """\
allwrite:
  int[3] shared = [1, 2, 3]
local:
  int[3] own = [1, 2, 3]
  int k = 0
Own:
  pre: k == 0
  eff:
    k = k + 1
    own = [pid, k, 7]
Shared:
  pre: k == 1
  eff:
    k = k + 1
    shared = [pid, k, 7]
Read:
  pre: k == 2
  eff:
    k = k + own[k + EXTRA]
    shared = own
"""


def loaded(text: str) -> core.Program:
    program = load(Source("made.krd", text)).program
    assert program is not None
    return program


@pytest.mark.parametrize("numbers", Numbers)
@pytest.mark.parametrize(
    "text",
    [SECOND, MODELLED, BREAKING.replace("MOST", "9"), BREAKING.replace("MOST", "4")],
    ids=["second", "modelled", "faulting", "contract"],
)
def test_what_breaks_is_found_when_it_breaks(text: str, numbers: Numbers) -> None:
    said = compare(dealt(loaded(text), 3), rounds=8, seed=3, numbers=numbers)
    assert said["round"] > 5
    system = dealt(loaded(text), 3)
    turns = Turns(numbers.domain, system)
    told = story(system, turns, Monitor, lambda _: First(), numbers=numbers, rounds=8)
    assert any("Violation(" in line or "fault=Fault(" in line for line in told)


@pytest.mark.parametrize("items", [2, 4])
def test_an_array_takes_what_fits_of_a_list(items: int) -> None:
    """[ATOM]: the rest is unset."""
    program = loaded(LISTED.replace("EXTRA", "1" if items > 3 else "-1"))
    agent = program.agents[0]
    events = tuple(
        replace(event, effect=tuple(_with(items, s) for s in event.effect))
        for event in agent.events
    )
    system = dealt(replace(program, agents=(replace(agent, events=events),)), 3)
    by_code = story(system, Turns(EXACT, system), Monitor, lambda _: First())
    assert by_code == story(system, ByTheRules(EXACT, system), Judge, lambda _: First())
    assert any("fault=Fault(" in line for line in by_code)


def _with(items: int, s: core.Stmt) -> core.Stmt:
    """The statement with so many items in its list."""
    if isinstance(s, core.Assign) and isinstance(s.value, core.MakeList):
        return replace(s, value=replace(s.value, items=(s.value.items * 2)[:items]))
    return s


# --- interruptions -------------------------------------------------------------------------------

#: Turns that take long, functions that are asked, and a claim that breaks at last.
LONG = """\
def fun some(int low, int high) -> int: extern fresh
  requires: low <= high
  ensures: low <= result and result <= high
allwrite:
  int total = 0
local:
  int x = 0
  int drawn = 0
Count:
  pre: x % 2 == 0
  eff:
    drawn = some(0, 9)
    for i = 0, 70:
      drawn = drawn + i
    x = x + 1
Add:
  pre: x % 2 == 1
  eff:
    for i = 0, 130:
      drawn = drawn - i
    atomic:
      total = total + some(1, 3)
    x = x + 1
    stdout << "added by " << pid
invariant Small: total < 15
"""

#: As well, where sensors have no model.
SENSING = LONG.replace(
    "allwrite:",
    """\
using Eye:
  sensors:
    int seen = 0
  contract Near:
    requires: seen >= 0
    ensures: seen' >= 0 and seen' <= seen + 1
allwrite:""",
)


def interrupted(text: str, policy: Policy, looks: int) -> RunSession | None:
    """A run that was told to end when it asked so often; None if there was no start by then."""
    program, asked = program_of(Source("long.krd", text)), count()
    system = dealt(program.core, 3)
    session = session_of(program, system, HowToRun(14, policy), 5, lambda: next(asked) >= looks)
    try:
        for _ in session.parts():
            pass
    except CancelledError:
        return None
    return session


@pytest.mark.parametrize("policy", first(1, Policy))
@pytest.mark.parametrize("text", [LONG, SENSING], ids=["long", "sensing"])
def test_whenever_a_run_is_interrupted_its_trace_is_legal(text: str, policy: Policy) -> None:
    whole = interrupted(text, policy, 10**9)
    assert whole is not None
    last, cuts = whole.recorded(), 0
    assert last.violation is not None
    for looks in range(1, 10**9):
        session = interrupted(text, policy, looks)
        if session is None:
            continue
        trace = session.recorded()
        found = replay(trace)
        assert found.refused is None, (looks, found.refused)
        *rounds, end = trace.recording.rounds or (None,)
        assert tuple(rounds) == last.recording.rounds[: len(rounds)]
        assert trace.outputs == last.outputs[: len(trace.outputs)]
        if not session.interrupted:
            assert trace == last
            break
        assert trace.violation is None or trace == last
        if end is not None and end.cut:
            cuts += 1
            assert end.order == last.recording.rounds[len(rounds)].order[: len(end.order)]
            assert all(answer.robot in end.order for answer in end.answers)
    assert cuts > 4
