"""Invariants between the ends of rounds: what models and contracts say of each instant.

[ENV-INSTANT]
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import pytest
from msgspec.structs import replace

from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant
from koord.semantics.properties import holds_in
from koord.semantics.recordings import RecordedInputs, Recording, execute
from koord.semantics.rounds import evolved
from koord.syntax.system import System
from koord.verify.claims import claims_of
from koord.verify.effort import Deadline
from koord.verify.engine_names import Engine
from koord.verify.instants import Shadowed, instant_of, shadowed, verified
from koord.verify.strategy.verification import verify
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.verify.asking import of_text

EXAMPLES = Path(__file__).parents[2] / "specs" / "examples"


def shadows_of(text: str, robots: int = 2, delta: Fraction = Fraction(1)) -> Shadowed:
    return shadowed(of_text(text, robots, delta), Deadline())


def asked(shadows: Shadowed, choice: Engine | None = None) -> dict[str, Verdict]:
    report = verified(shadows, Bounds(4, 60, 1), choice)
    return {verdict.claim.name: verdict for verdict in report.verdicts}


def outcomes(text: str, robots: int = 2) -> dict[str, Outcome]:
    return {n: v.outcome for n, v in asked(shadows_of(text, robots)).items()}


RAIL = """
using Rail:
  sensors:
    float x
  actuators:
    float v = 0.0
  environment:
    x = x + delta * v
local:
  bool gone = false
Go:
  pre: not gone
  eff:
    gone = true
    Rail.v = if_right(pid)
def fun if_right(int me) -> float:
  if me == 0:
    return 2.0
  return -2.0
assume: Rail.x == 2.0 * pid
invariant Apart: forall i, j: i != j implies abs(Rail.x@i - Rail.x@j) > 0.5
"""


def violated(text: str, name: str) -> tuple[Shadowed, Verdict]:
    shadows = shadows_of(text)
    verdict = asked(shadows, Engine.BMC)[name]
    assert verdict.outcome is Outcome.VIOLATED
    return shadows, verdict


def ends(system: System, recording: Recording) -> list[Configuration[Constant]]:
    """The configurations after INIT and after each turn of the environment."""
    steps = execute(EXACT, system, recording)
    return [s.configuration for s in steps if s.rule in ("INIT", "ENV-TRANS")]


def middles(system: System, recording: Recording) -> Iterator[Configuration[Constant]]:
    before = None
    for step in execute(EXACT, system, recording):
        if step.rule == "ENV-TRANS":
            assert before is not None
            yield before
        before = step.configuration


def test_robots_that_are_apart_at_the_ends_meet_in_between() -> None:
    """Robots that pass each other in one round: each end of it is safe."""
    text = (
        RAIL.replace("-2.0\ndef", "-2.0\ndef")
        .replace("return 2.0", "return 4.0")
        .replace("return -2.0", "return -4.0")
    )
    program = of_text(text)
    report = verify(program, Bounds(1, 60, 1), Engine.BMC, names=["Apart"])
    assert [v.outcome for v in report.verdicts] == [Outcome.HOLDS]
    shadows, verdict = violated(text, "Apart between rounds")
    found = verdict.counterexample
    assert found is not None
    # The model itself, run for so long and no longer, comes to a configuration that breaks it.
    instant = instant_of(found.recording)
    assert instant is not None
    assert 0 < instant < 1
    own = shadows.unshadowed(found.recording)
    *_, middle = middles(shadows.original, own)
    short = replace(shadows.original, delta_s=instant)
    there = evolved(EXACT, short, middle, RecordedInputs()).configuration
    stated = next(p for p in shadows.original.program.properties if p.name == "Apart")
    holds, _ = holds_in(EXACT, short, there, stated.condition, stated.bound, RecordedInputs())
    assert holds is False
    # At the ends of the very same run all is well.
    for end in ends(shadows.original, own):
        held, _ = holds_in(
            EXACT, shadows.original, end, stated.condition, stated.bound, RecordedInputs()
        )
        assert held is True


@pytest.mark.slow
def test_what_holds_at_each_instant_is_proved() -> None:
    text = RAIL + "invariant Inside: Rail.v == 0.0 implies 0 <= Rail.x\n"
    assert outcomes(
        text.replace("return 2.0", "return 0.0").replace("return -2.0", "return 0.0")
    ) == {
        "Apart between rounds": Outcome.HOLDS,
        "Inside between rounds": Outcome.HOLDS,
    }


def test_the_instant_is_the_same_for_all_robots() -> None:
    """Clocks that go alike show the same at each instant."""
    text = """
using Clock:
  sensors:
    float now = 0.0
  environment:
    now = now + delta
invariant Together: forall i, j: Clock.now@i == Clock.now@j
"""
    assert outcomes(text) == {"Together between rounds": Outcome.HOLDS}


DRIFT = """
using Clock:
  sensors:
    float now = 0.0
    float true_time = 0.0
  environment:
    now = now + delta * choose(0.75, 1.25)
    true_time = true_time + delta
invariant Near: Clock.now <= 1.25 * Clock.true_time and Clock.now >= 0.75 * Clock.true_time
invariant Far: Clock.true_time <= 2.0 implies Clock.now <= 2.0
"""


def test_drift_in_a_range() -> None:
    said = outcomes(DRIFT, 1)
    assert said == {"Near between rounds": Outcome.HOLDS, "Far between rounds": Outcome.VIOLATED}


@pytest.mark.parametrize(
    ("block", "reason"),
    [
        ("x = 0.0", "jumps"),
        ("x = x + 1.0", "jumps"),
        ("x = x + choose(0.5, 1.0)", "jumps"),
        ("if x > 3.0:\n      x = 0.0\n    else:\n      x = x + delta", "jumps"),
        ("x = x * (1.0 / delta)", "jumps"),
        ("v = 1.0", "actuator"),
    ],
)
def test_models_that_say_nothing_of_instants(block: str, reason: str) -> None:
    text = RAIL.replace("x = x + delta * v", block)
    shadows = shadows_of(text)
    assert shadows.names == ()
    ((claim, hidden),) = shadows.unsaid
    assert claim.name == "Apart between rounds"
    assert reason in hidden.reason
    assert asked(shadows)["Apart between rounds"].outcome is Outcome.UNKNOWN


@pytest.mark.parametrize(
    "block",
    [
        "x = x + delta * v + choose(-0.1, 0.1)",
        "if x > 3.0:\n      x = max(x - delta, 3.0)\n    else:\n      x = x + delta",
        "x = x * (1.0 + delta)",
        "float step = delta * v\n    if step > 0.5:\n      step = 0.5\n    x = x + step",
        "pass",
    ],
)
def test_models_that_say_what_is_in_between(block: str) -> None:
    shadows = shadows_of(RAIL.replace("x = x + delta * v", block))
    assert shadows.names == ("Apart between rounds",)
    assert shadows.unsaid == ()


CONTRACT = """
using Body:
  sensors:
    float x
  actuators:
    float goal = 0.0
  contract Direct:
    ensures: min(x, goal) <= x' and x' <= max(x, goal)
Go:
  pre: true
  eff:
    Body.goal = 1.0
assume: Body.x == 0.0
invariant Within: 0 <= Body.x and Body.x <= 1
"""


@pytest.mark.slow
def test_contracts_hold_at_each_instant() -> None:
    assert outcomes(CONTRACT) == {"Within between rounds": Outcome.HOLDS}
    loose = CONTRACT.replace("x' <= max(x, goal)", "x' <= max(x, goal) + delta")
    assert outcomes(loose)["Within between rounds"] is Outcome.VIOLATED


def test_models_keep_their_contracts_at_each_instant() -> None:
    """A model that ends where its contract wants it may be elsewhere on the way."""
    text = """
using Body:
  sensors:
    float x = 0.0
  environment:
    x = x + delta * (1.0 - delta)
  contract Low:
    ensures: x' - x <= 0.1
invariant Positive: Body.x >= 0
"""
    assert outcomes(text) == {
        "Positive between rounds": Outcome.HOLDS,
        "contract Low between rounds": Outcome.VIOLATED,
    }


def test_invariants_of_ends_and_of_programs_are_not_asked() -> None:
    text = RAIL + "invariant End at round: Rail.x >= -100\ninvariant Own: gone or not gone\n"
    assert shadows_of(text).names == ("Apart between rounds",)


@pytest.mark.slow
def test_kinds_of_robots_have_shadows_of_their_own() -> None:
    text = (EXAMPLES / "cars_and_drones.krd").read_text(encoding="utf-8")
    shadows = shadows_of(text, 3, Fraction(1, 10))
    assert {n.split()[0] for n in shadows.names} == {"Apart", "Ground", "Aloft"}
    assert all(v.outcome is Outcome.HOLDS for v in asked(shadows).values())


def test_shadows_change_no_verdict_of_the_ends_of_rounds() -> None:
    shadows = shadows_of(DRIFT, 1)
    own = {c.name for c in claims_of(shadows.original)}
    bounds = Bounds(4, 60, 1)
    without = {v.claim.name: v.outcome for v in verify(shadows.original, bounds).verdicts}
    joined = {v.claim.name: v.outcome for v in verify(shadows.system, bounds).verdicts}
    assert without == {name: joined[name] for name in own}
