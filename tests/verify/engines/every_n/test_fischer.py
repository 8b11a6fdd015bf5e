"""Fischer's protocol: somebody enters, of every number of robots; not each, from two robots on.

The clock never shows the same twice, so that no lasso closes: a run is made by the rules after
whose loop everything is as before, but for the clocks and what robots have noted of them, which are
later by the length of the loop. Guards compare differences of these alone, so the loop can
be run again and again. In it every robot runs, which is all that [FAIR-ROBOT] asks for, and there
is no lock.
"""

from __future__ import annotations

from fractions import Fraction
from random import Random

import pytest

from koord.sampling.running import ProgramTurn, Run, new_run
from koord.semantics.domain import Constant
from koord.semantics.storage import Cell, Storage
from koord.syntax.system import dealt
from koord.traces.trace import Numbers
from koord.verify.engine_names import Engine
from koord.verify.strategy import verification
from koord.verify.verdicts import Bounds, Outcome, Verdict
from tests.loading import EXAMPLES, program_of

TEXT = (EXAMPLES / "fischer_enters.krd").read_text(encoding="utf-8")

#: The same program, of which more is claimed than holds.
EACH = TEXT[: TEXT.index("eventually Some")] + (
    "eventually Each: phase == trying leadsto phase == critical\n"
)


def asked(text: str) -> Verdict:
    report = verification.verify(dealt(program_of(text), 2, Fraction(1)), Bounds(6), Engine.EVERY_N)
    (verdict,) = (v for v in report.verdicts if v.claim.kind.value == "liveness")
    return verdict


@pytest.mark.slow
def test_somebody_enters_however_many_there_are() -> None:
    verdict = asked(TEXT)
    assert verdict.outcome is Outcome.HOLDS, verdict.reason
    assert verdict.fairness == ("robots",)


@pytest.mark.slow
def test_that_each_robot_enters_is_not_said() -> None:
    assert asked(EACH).outcome is Outcome.UNKNOWN


#: What the last robot, and all others, run in the rounds of the loop; nothing where they wait.
LOOP = (
    ("Try", "Try"),
    (None, "Set"),
    ("Set", None),
    *((None, None),) * 3,
    ("Look", "Look"),
    ("Leave", None),
)


@pytest.mark.parametrize("robots", [2, 3, 4])
def test_whoever_writes_first_may_wait_for_ever(robots: int) -> None:
    system = dealt(program_of(EACH), robots, Fraction(1))
    run = new_run(system, Numbers.EXACT, Random(0))
    names = [event.name for event in system.program.agents[0].events]
    run.begin()
    if not run.waiting:
        run.evolve()
    starts = []
    for _ in range(3):
        starts.append(state_of(run))
        for last, others in LOOP:
            for robot in list(run.waiting):
                name = last if robot == robots - 1 else others
                event = None if name is None else names.index(name)
                run.make(ProgramTurn(robot, event))
            run.evolve()
            assert run.configuration.fault is None
            phases = [state[0] for state in state_of(run)[1]]
            assert "critical" not in phases[:-1]
    (_, *again) = starts
    first, second = again
    assert first[0] == second[0]
    for (phase, since, now), (later_phase, later_since, later_now) in zip(
        first[1], second[1], strict=True
    ):
        assert phase == later_phase
        assert later_since - since == later_now - now == Fraction(len(LOOP))


def state_of(run: Run) -> tuple[int | Fraction, list[tuple[str, Fraction, Fraction]]]:
    """The shared variable, and of each robot its phase, what it noted, and its clock."""
    here = run.configuration
    phases = ("out", "trying", "waiting", "critical")
    (turn,) = here.store.allwrite
    robots = []
    for robot in here.robots:
        phase, since = map(value, robot.locals)
        (now,) = map(value, robot.ports)
        assert isinstance(phase, int)
        robots.append((phases[phase], Fraction(since), Fraction(now)))
    return value(turn), robots


def value(storage: Storage[Constant]) -> int | Fraction:
    assert isinstance(storage, Cell)
    assert isinstance(storage.value, int | Fraction)
    return storage.value
