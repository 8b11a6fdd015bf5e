"""Every example does, compiled, what the rules allow. [REPLAY]"""

from __future__ import annotations

from pathlib import Path

import pytest

from koord.refinement.cases import SchedulePolicy
from tests.loading import example_files
from tests.refinement.running import agrees, ran
from tests.sampling import first

EXAMPLES = Path(__file__).resolve().parents[2] / "specs/examples"
FILES = example_files()


@pytest.mark.parametrize("file", first(8, FILES), ids=lambda path: path.stem)
def test_a_compiled_example_refines_its_program(file: Path) -> None:
    text = file.read_text("utf-8")
    for policy, robots in ((SchedulePolicy.DEPLOYED, 2), (SchedulePolicy.RANDOM, 3)):
        outcome = ran(text, robots=robots, rounds=4, policy=policy, seed=robots, name=file.name)
        assert outcome.refused is None
        assert outcome.judged is not None


def test_the_examples_are_all_there() -> None:
    assert len(FILES) >= 40


def test_a_whole_run_of_an_example_is_judged() -> None:
    outcome = ran((EXAMPLES / "sum_of_ids.krd").read_text("utf-8"), robots=3, rounds=5)
    agrees(outcome)
    assert outcome.judged is not None
    assert outcome.judged.steps == 1 + 5 * 4
    last = outcome.judged.trace.configurations[-1]
    assert [robot.locals[0].value for robot in last.robots] == [6, 6, 6]  # type: ignore[union-attr]


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES, ids=lambda path: path.stem)
def test_many_runs_of_an_example(file: Path) -> None:
    text = file.read_text("utf-8")
    for seed in range(12):
        policy = SchedulePolicy.RANDOM if seed % 3 else SchedulePolicy.DEPLOYED
        outcome = ran(
            text, robots=1 + seed % 4, rounds=15, policy=policy, seed=seed, name=file.name
        )
        assert outcome.refused is None
