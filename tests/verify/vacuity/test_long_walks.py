"""Long walks go by whole rounds of code, and see what walks step by step see."""

from __future__ import annotations

from random import Random

import pytest

from koord.refinement.generating.palette import GENERAL
from koord.refinement.generating.programs import system as generated
from koord.syntax.system import System, dealt
from koord.verify.effort import Deadline, Effort
from koord.verify.reachability_goals import reachability_goals_of
from koord.verify.vacuity import reachability
from koord.verify.vacuity.reaching_runs import ReachingRuns
from koord.verify.verdicts import ReachingRun
from tests.loading import example_program, program_of

#: What happens late: by an event, by a model, and in a claim that one robot alone can meet.
LATE = """\
using Wheel:
  sensors:
    int speed = 0
  environment:
    speed = speed + pid
allwrite:
  int turns = 0
local:
  int n = 0
Up:
  pre: n < 40
  eff:
    atomic:
      turns = turns + 1
      n = n + 1
Fast:
  pre: speed > 70
  eff: n = 0
Dead:
  pre: n > 40
  eff: n = 41
Busy:
  pre: turns > 90 and n == 40
  eff: n = 39
invariant Slow: forall i: speed@i > 90 implies n@i < 41
"""


def seen(system: System, rounds: int) -> tuple[dict[str, int], list[ReachingRun]]:
    """When the goals were met, by what they are about, and the runs that were kept."""
    goals, reaching = reachability_goals_of(system), ReachingRuns()
    nevers = [goal.never for goal in goals.all]
    met = reachability.seen(goals.system, nevers, rounds, Deadline(), 0, reaching)
    return {g.subject: met[g.never] for g in goals.all if g.never in met}, reaching.useful


def both(system: System, rounds: int, patch: pytest.MonkeyPatch) -> dict[str, int]:
    """What long walks see, by code and step by step."""
    broken, runs = seen(system, rounds)
    with patch.context() as patched:
        patched.setattr(reachability, "_LONG", rounds + 1)
        assert (broken, runs) == seen(system, rounds)
    return broken


@pytest.mark.parametrize("name", ["fischer", "leader_elect", "sum_of_ids", "hvac", "traffic"])
def test_examples(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    both(dealt(example_program(name), 3), reachability._LONG, monkeypatch)


@pytest.mark.parametrize("seed", range(12))
def test_generated_programs(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    both(generated(Random(seed), GENERAL), reachability._LONG, monkeypatch)


def test_what_happens_late_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = both(dealt(program_of(LATE), 3), 120, monkeypatch)
    assert max(broken.values()) > 30
    assert {"Fast", "Busy"} <= broken.keys()
    assert "Dead" not in broken


def test_whoever_works_beside_them_walks_are_as_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """They end by the work that they were, and not by the clock."""
    given: list[Deadline] = []
    walk = reachability.seen

    def noted(*arguments, **named):  # type: ignore[no-untyped-def]
        given.append(arguments[3])
        return walk(*arguments, **named)

    monkeypatch.setattr(reachability, "seen", noted)
    system = dealt(program_of(LATE), 3)
    nevers = [goal.never for goal in reachability_goals_of(system).all]
    reachability.unbroken(
        system, nevers, 4, Deadline(), Effort.of_seconds(1.0), runs=100, runs_s=1.0
    )
    assert [deadline.at for deadline in given] == [None] * len(given) != []
    assert all(deadline.cpu_at is not None for deadline in given)
