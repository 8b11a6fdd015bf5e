"""What a run comes to, held against what was recorded of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from koord.sim.run_log import Idle
from tests.sim.recorded import Recorded, task


@pytest.fixture(scope="module")
def run() -> Recorded:
    return task()


def test_events_and_skips_are_those_that_were_recorded(run: Recorded) -> None:
    deeds = np.stack([done.deeds for done in run.recording.rounds if done.number >= 0])
    robots = run.figures.robots
    assert [robot.events for robot in robots] == (deeds >= 0).sum(0).tolist()
    assert [robot.blocked for robot in robots] == (deeds == Idle.BLOCKED).sum(0).tolist()
    skipped = (deeds == Idle.BLOCKED) | (deeds == Idle.SKIPPED)
    assert [robot.skips for robot in robots] == skipped.sum(0).tolist()
    assert sum(robot.blocked for robot in robots) > 0


def test_robots_go_as_far_as_their_positions_say(run: Recorded) -> None:
    steps = np.diff(run.recording.stacked()[:, :, :3].astype(np.float64), axis=0)
    for robot, seen_m in zip(run.figures.robots, np.linalg.norm(steps, axis=2).sum(0), strict=True):
        assert seen_m <= robot.distance_m * (1 + 1e-6)  # every second tick is recorded
        assert robot.distance_m == pytest.approx(seen_m, rel=0.02)


def test_the_smallest_separation_is_no_larger_than_any_that_was_recorded(run: Recorded) -> None:
    near = run.figures.nearest
    assert near is not None
    recorded = [d for d in run.recording.separations_m if not math.isnan(d)]
    assert near.distance_m <= min(recorded) + 1e-6
    assert near.distance_m == pytest.approx(min(recorded), abs=0.05)
