"""Runs by code against runs by the rules alone: steps, draws, traces, violations, faults.
[EVENT-TRANS] [ENV-TRANS] [SELECT] [PROP-INVARIANT]
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import field

from koord.refinement.generating.palette import GENERAL, Profile
from koord.refinement.generating.programs import system as generated
from koord.sampling.compiled.turns import Turns
from koord.sampling.made_rounds import MadeRound
from koord.sampling.monitors import Monitor, Search
from koord.sampling.policies import AtRandom, First, Play, Policy
from koord.sampling.running import new_run
from koord.semantics.configurations import Configuration
from koord.semantics.domain import EXACT, Constant, NumberTooLongError
from koord.semantics.recordings import Step
from koord.semantics.rounds import IllegalStepError
from koord.syntax import core
from koord.syntax.diagnostics import KoordError
from koord.syntax.load import load
from koord.syntax.source import Source
from koord.syntax.system import System, dealt
from koord.traces.trace import Numbers
from tests.generators.profiles import FINITE
from tests.generators.strategies import systems
from tests.loading import example_program
from tests.sampling import blocks, examples, first
from tests.semantics import programs
from tests.semantics.by_the_rules import ByTheRules


class Counting(Turns):
    """Turns that count what code says."""

    said: Counter[str] = field(default_factory=Counter)

    def _count(self, name: str, said: Any) -> Any:
        self.said[name if said is not None else "in doubt"] += 1
        return said

    def enabled(self, *asked: Any) -> Any:
        return self._count("enabled", super().enabled(*asked))

    def run_event(self, *asked: Any) -> Any:
        return self._count("event", super().run_event(*asked))

    def evolved(self, *asked: Any) -> Any:
        return self._count("environment", super().evolved(*asked))


class Judge(Monitor):
    """A monitor that asks the rules alone."""

    def holds(self, stated: core.Property, configuration: Configuration[Constant]) -> bool:
        self._look_at(configuration)
        return self._holds_by_the_rules(stated, configuration)


class Onlooker(Monitor):
    """A monitor that looks at all properties, and lets runs go on."""

    seen: list[str] = field(default_factory=list)

    def after(self, step: Step) -> None:
        if step.configuration.fault is None:
            for stated in self.system.program.properties:
                if not self.holds(stated, step.configuration):
                    self.seen.append(f"{stated.name} after {step.rule} in {step.round}")


class OnlookingJudge(Onlooker):
    def holds(self, stated: core.Property, configuration: Configuration[Constant]) -> bool:
        return Judge.holds(self, stated, configuration)  # type: ignore[arg-type]


def story(
    system: System,
    turns: Turns,
    monitor: Callable[..., Monitor],
    policy: Callable[[Random], Policy],
    *,
    numbers: Numbers = Numbers.EXACT,
    rounds: int = 4,
    seed: int = 0,
    said: Counter[str] | None = None,
) -> list[str]:
    """All that can be told of a run: steps, what was recorded, the violation, how it ended."""
    rng = Random(seed)
    run = new_run(system, numbers, rng, turns)
    play = Play(run, policy(rng), rounds, monitor(run.d, system, run.inputs))
    told: list[str] = []
    before: Configuration[Constant] | None = None
    try:
        for part in play.parts():
            made = isinstance(part, MadeRound)
            for taken in part.steps() if isinstance(part, MadeRound) else (part,):
                # What they look like tells 1, True and Fraction(1) apart, which are equal.
                told.append(repr((taken.step, taken.lost)))
                assert before is None or taken.before is None or taken.before == before
                before = taken.step.configuration
            if isinstance(part, MadeRound):
                assert repr(part.configuration) == repr(before) == repr(run.configuration)
            if said is not None:
                said["round" if made else "step"] += 1
        told.append(repr((play.recording(), play.violation)))
        told += getattr(play.watch, "seen", ())
    except (KoordError, IllegalStepError) as error:
        told.append(str(error))
    return [*told, str(rng.random())]


#: What is told of a run that did not begin: why, and what was drawn next.
_NEVER_BEGUN = 2


def compare(system: System, *, rounds: int, seed: int, numbers: Numbers) -> Counter[str]:
    """Compare runs by code and by the rules; how often code said something."""
    d, said = numbers.domain, Counter[str]()
    code = Counting(d, system, said=said)

    def told(turns: Turns, monitor: Callable[..., Monitor], policy: Any) -> list[str]:
        how = (system, turns, monitor, policy)
        return story(*how, numbers=numbers, rounds=rounds, seed=seed, said=said)

    for policy in (lambda _: First(), AtRandom):
        by_rules = told(ByTheRules(d, system), Judge, policy)
        assert told(code, Monitor, policy) == by_rules
        if len(by_rules) == _NEVER_BEGUN:
            break  # nothing is by code where no start was found, which takes long
        assert told(Turns(d, system), Monitor, policy) == by_rules
        assert told(Turns(d, system), Search, policy) == told(ByTheRules(d, system), Search, policy)
        looked_on = told(ByTheRules(d, system), OnlookingJudge, policy)
        assert told(code, Onlooker, policy) == looked_on
    return said


NUMBERS = pytest.mark.parametrize("numbers", Numbers)


@NUMBERS
@pytest.mark.parametrize("program", first(8, programs.RUNNING), ids=lambda p: p.name)
def test_programs_at_hand(program: core.Program, numbers: Numbers) -> None:
    compare(dealt(program, 3), rounds=4, seed=1, numbers=numbers)


@pytest.mark.slow
@given(system=systems(), seed=st.integers(0, 10**6), numbers=st.sampled_from(Numbers))
@examples(20)
def test_generated_programs(system: System, seed: int, numbers: Numbers) -> None:
    compare(system, rounds=3, seed=seed, numbers=numbers)


@pytest.mark.parametrize("profile", first(1, [GENERAL, FINITE]), ids=["general", "finite"])
@pytest.mark.parametrize("seeds", blocks(10, of=100, count=4))
def test_many_generated_programs(seeds: range, profile: Profile) -> None:
    said: Counter[str] = Counter()
    for seed in seeds:
        made = generated(Random(seed), profile)
        said += compare(made, rounds=3, seed=seed, numbers=list(Numbers)[seed % 2])
    assert said["enabled"] > said["in doubt"]
    assert min(said["event"], said["environment"], said["round"]) > len(seeds), said


@NUMBERS
@pytest.mark.parametrize(
    "name",
    first(3, ["fischer", "hvac", "leader_elect", "lineform", "shortest_path", "delivery", "task"]),
)
def test_examples(name: str, numbers: Numbers) -> None:
    said = compare(dealt(example_program(name), 3), rounds=4, seed=2, numbers=numbers)
    assert said["event"] > 0


GROWING = """\
local:
  TYPE x = START
Grow:
  pre: x > 0
  eff:
    x = x * x + 1
"""

FAULTING = """\
def fun some(int low, int high) -> int: extern fresh
  requires: low <= high
  ensures: low <= result and result <= high
local:
  List<int> xs = [0, 1, 2]
  int k = 0
  int drawn = 9
  int late
More:
  pre: k < 7
  eff:
    k = k + 1
    xs.append(k % 3)
    xs.remove(1)
    xs[0] = 12 / (8 - k)
    if k == 2:
      late = 3
Draw:
  pre: drawn >= 3
  eff: drawn = some(3, drawn)
Wait:
  pre: k > 0 and late > 0 and late < 4
  eff: late = late + 1
Over:
  pre: k == 5
  eff: drawn = some(4, drawn - 1)
Last:
  pre: k == 7
  eff: k = xs[length(xs)]
invariant Few: forall i: length(xs@i) < 9
invariant Early: forall i: k@i < 2 or late@i > 2
"""

UNEVEN = """\
local:
  int n = 0
  float t = 0.0
Up:
  pre: true
  eff:
    n = n + 1
    t = t + 1.0 / 3.0
invariant Rising: forall i, j: i < j implies n@i <= n@j
invariant Falling: forall i, j: i < j implies n@i >= n@j
invariant Three: forall i: t@i + t@i + t@i != 1.0
invariant Long: forall i, j: i < j implies t@i <= t@j + 0.5
"""

KINDS = """\
enum Phase: idle, busy
using Clock
def fun some(int low, int high) -> int: extern fresh
  requires: low <= high
  ensures: low <= result and result <= high
def fun twice(int low, int high) -> int:
  for k = 0, 2:
    if some(low, high) == low:
      return low
  return high
using Wheel:
  sensors:
    int speed = 1
    int free
  actuators:
    int wish = 0
  environment:
    speed = speed + choose(-1, 1) * wish
    if speed > 2:
      speed = wish
  contract Slow:
    ensures: speed' <= 3 and (speed < 0 implies speed' < 2)
using Eye:
  sensors:
    int seen = 0
  contract Near:
    requires: seen >= 0
    ensures: seen' >= 0 and seen' <= seen + 1
allread:
  int[] mark = pid
allwrite:
  int last = -1
  int[4] slots
local:
  Phase phase = idle
  float since = 0.0
  int friend = (pid + 1) % numAgents
init:
  for i = 0, 4:
    slots[i] = 0
Begin:
  pre: phase == idle and Clock.now - since >= 0.5
  eff:
    atomic:
      if last != pid:
        phase = busy
        last = pid
        slots[pid % 4] = slots[pid % 4] + twice(1, 3)
urgent End:
  pre: phase == busy and (Clock.now - since > 1.25 or mark[friend] > mark[pid])
  eff:
    phase = idle
    since = Clock.now
    Wheel.wish = Wheel.speed + Eye.seen
    friend = (friend + 1) % numAgents
    mark[pid] = mark[pid] + 1
    if mark[pid] > 4 + pid:
      trystop()
Rest:
  pre: mark[pid] == 3 and phase == idle
  eff:
    for i = 0, 3:
      if i == pid:
        break
      slots[i] = some(0, i)
invariant One: forall i, j: i != j implies not (phase@i == busy and phase@j == busy and last == i)
invariant Friend: forall i: mark[friend@i] <= mark[i] + 2
invariant Past: forall i: phase@i == busy implies since@i <= Clock.now@i
invariant Ran: forall i, j: ran(Begin)@i and ran(Begin)@j implies i == j or last != j
invariant Some: exists i: mark[i] < 6 and not stopped@i
invariant Late: forall i: phase@i == busy implies forall j: Clock.now@j - 0.25 * 8.0 < since@i + 3.0
"""


@NUMBERS
@pytest.mark.parametrize("text", [FAULTING, UNEVEN], ids=["faulting", "uneven"])
@pytest.mark.parametrize("seed", first(2, range(4)))
def test_what_faults_and_what_is_uneven(text: str, numbers: Numbers, seed: int) -> None:
    """[E-ARITH] [S-REMOVE] [EXTERNAL] [FAULT]"""
    program = load(Source("made.krd", text)).program
    assert program is not None
    said = compare(dealt(program, 3), rounds=20, seed=seed, numbers=numbers)
    assert said["event"] > 0


@pytest.mark.parametrize(("type_", "start"), [("int", "7"), ("float", "1.5")])
def test_what_is_too_long(type_: str, start: str) -> None:
    """[E-ARITH]: it ends at the same step, with the same words."""
    text = GROWING.replace("TYPE", type_).replace("START", start)
    program = load(Source("growing.krd", text)).program
    assert program is not None
    system, ends = dealt(program, 2), []
    for turns in (Turns(EXACT, system), ByTheRules(EXACT, system)):
        run = new_run(system, Numbers.EXACT, Random(0), turns)
        play = Play(run, First(), 20, Monitor(run.d, system, run.inputs))
        with pytest.raises(NumberTooLongError) as met:
            for _ in play.steps():
                pass
        ends.append((run.round, run.waiting, str(met.value)))
    assert ends[0] == ends[1]
    assert 10 < ends[0][0] < 20


@NUMBERS
@pytest.mark.parametrize("seed", first(1, range(12)))
def test_claims_and_locks_and_choices(numbers: Numbers, seed: int) -> None:
    """[ATOMIC] [CHOOSE] [E-QUANT] [PROP-RAN] [STOP] [SKIP]"""
    program = load(Source("kinds.krd", KINDS)).program
    assert program is not None
    said = compare(dealt(program, 3), rounds=30, seed=seed, numbers=numbers)
    assert said["event"] > said["in doubt"]
