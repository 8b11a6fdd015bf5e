"""Sets: what is written of them, and that all roads agree about them. [S-ADD] [E-LIST] [E-MAP]"""

from __future__ import annotations

from fractions import Fraction
from random import Random

import pytest

from koord.api.verdicts import trace_of
from koord.refinement.cases import of_program, tried
from koord.refinement.compiled_replay import rerun
from koord.semantics.recordings import Concrete
from koord.semantics.values import Table
from koord.syntax.types import INT, PRESENT, SetType, show
from koord.traces.codec import decode, encode
from koord.traces.itf import itf_value
from koord.traces.rendering import show_value
from koord.traces.replay import replay
from koord.verify.engine_names import Engine
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome
from tests.sampling import first
from tests.semantics.driving import NO_TEXT
from tests.verify.asking import of_text

CLAIMED = """
allwrite:
  Set<int> seen = {}
  int[] log = []
local:
  bool done = false
Claim:
  pre: not done
  eff:
    atomic:
      if not contains(seen, pid):
        seen.add(pid)
        done = true
Release:
  pre: done
  eff:
    atomic:
      seen.remove(pid)
      done = false
invariant Mine: forall i: done@i implies contains(seen, i)
invariant Small: forall i in seen: 0 <= i and i < numAgents
invariant Counted: length(seen) <= numAgents
invariant Few: length(seen) < 2
"""


def said(text: str, robots: int, choice: Engine | None) -> dict[str, tuple[Outcome, int | None]]:
    """What engines say of each claim that is settled, and the round in which it breaks."""
    report = verify(of_text(text, robots), Bounds(4), choice)
    return {
        v.claim.name: (v.outcome, v.counterexample.round if v.counterexample else None)
        for v in report.verdicts
        if v.outcome is not Outcome.UNKNOWN
    }


@pytest.mark.parametrize("robots", first(1, [2, 3]))
def test_engines_agree_about_a_set_that_robots_enter_and_leave(robots: int) -> None:
    searched = said(CLAIMED, robots, Engine.SEARCH)
    assert searched["Few"] == (Outcome.VIOLATED, 2)
    held = {"Mine", "Small", "Counted", "no fault"}
    assert {name for name, (outcome, _) in searched.items() if outcome is Outcome.HOLDS} >= held
    assert said(CLAIMED, robots, Engine.BITS) == searched
    bounded = said(CLAIMED, robots, Engine.BMC)
    assert {name: searched[name] for name in bounded} == bounded
    assert bounded["Few"] == (Outcome.VIOLATED, 2)


def test_two_robots_that_add_in_one_round_are_both_heard() -> None:
    text = """
allwrite:
  Set<int> seen = {7}
Add:
  pre: true
  eff:
    seen.add(pid)
invariant Lost: not (ran(Add)@0 and ran(Add)@1) or length(seen) == 3
invariant Never: not contains(seen, 1) or not contains(seen, 0)
"""
    report = verify(of_text(text), Bounds(2))
    outcomes = {v.claim.name: v.outcome for v in report.verdicts}
    assert outcomes == {
        "Lost": Outcome.HOLDS,
        "Never": Outcome.VIOLATED,
        "no fault": Outcome.HOLDS,
    }


def test_a_counterexample_about_sets_is_kept_read_and_run_by_the_compiled_program() -> None:
    system = of_text(CLAIMED)
    report = verify(system, Bounds(4))
    (verdict,) = (v for v in report.verdicts if v.claim.name == "Few")
    assert verdict.counterexample is not None
    trace = trace_of(NO_TEXT, system, verdict.claim, verdict.counterexample)
    kept = encode(trace)
    assert b"present" not in kept
    read = decode(kept, "kept.json", lambda sources: system.program)
    assert read.configurations == trace.configurations
    assert replay(read).refused is None
    assert rerun(read) is None


def test_compiled_programs_with_sets_do_what_the_rules_allow() -> None:
    system = of_text(CLAIMED, 3, Fraction(1, 10))
    cases = of_program(NO_TEXT, iter([system] * 6), 8, Random(1))
    assert [outcome for outcome in map(tried, cases) if outcome.failed] == []


def test_sets_are_shown_as_they_are_written() -> None:
    two: Concrete = Table(2, ((3, 0), (1, 0)))
    numbers = SetType(INT, PRESENT)
    assert show(numbers) == "Set<int>"
    assert show_value(two, numbers) == "{3, 1}"
    assert show_value(Table(0, ()), numbers) == "{}"
    assert itf_value(two, numbers) == {"#set": [{"#bigint": "3"}, {"#bigint": "1"}]}
