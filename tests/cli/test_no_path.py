"""No way was found: a value that programs can test, and that proofs cover."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from koord.cli.exits import Exit
from koord.cli.main import main
from koord.runtime.motion.arrays import Floats
from koord.runtime.motion.planning import Straight
from tests.sampling import but_slow

TASK = str(Path(__file__).parents[2] / "specs" / "examples" / "task.krd")

#: The first task is on the ground, where no drone goes; the second is in the air.
ALONE = """\
agents: [{pid: 0, on_device: drone, position: [0, 0, 1]}]
devices: {drone: {bot_type: QUAD, planner: STRAIGHT, speed: 1.0}}
world:
    bounds: {low: [-3, -3, 0], high: [3, 3, 3]}
    tasks: [[2, 0, 0], [1, 0, 1]]
"""

LOOKS = """\
using Motion:
  sensors:
    pos psn
  actuators:
    pos[] path
local:
  float x = 0.0
  pos[] way = []
Go:
  eff:
    way = findPath(Motion.psn, pos(1.0, 1.0, 0.0))
    GUARD
      x = way[0].x
invariant Start: x <= 0.0 or way != []
"""


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, Any]:
    code = main([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_a_drone_alone_does_not_claim_what_it_cannot_reach(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    configuration = tmp_path / "alone.yaml"
    configuration.write_text(ALONE, "utf-8")
    flags = ("--time", "30", "--no-html", "--check-summaries")
    _, run = told(capsys, "sim", TASK, str(configuration), *flags)
    assert run["broken"] == []
    assert [task["robot"] for task in run["tasks"]] == [None, 0]
    assert run["tasks"][1]["visited_s"] is not None


@pytest.mark.parametrize(
    ("guard", "may_fault"),
    but_slow(
        ["if way != []:", "if length(way) > 0:"],
        [("if way != []:", False), ("if length(way) > 0:", False), ("if x == 0.0:", True)],
    ),
)
def test_proofs_cover_both_outcomes(
    guard: str, may_fault: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of lists of any length nothing is proved where a program looks into them: it is `unknown`."""
    program = tmp_path / "looks.krd"
    program.write_text(LOOKS.replace("GUARD", guard), "utf-8")
    few = ("--robots", "1", "--rounds", "2")
    _, document = told(capsys, "verify", str(program), *few, "--property", "no fault")
    (report,) = document["reports"]
    (fault,) = [claim for claim in report["claims"] if claim["kind"] == "fault"]
    assert (fault["outcome"] == "violated") is may_fault


def test_a_path_that_does_not_end_at_the_goal_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def elsewhere(planner: Straight, start: Any, goal: Any, *_: object) -> Floats:
        return np.array([start.position, (goal[0] + 0.5, *goal[1:])])

    monkeypatch.setattr(Straight, "plan", elsewhere)
    configuration = tmp_path / "alone.yaml"
    configuration.write_text(ALONE, "utf-8")
    flags = ("--time", "5", "--no-html", "--check-summaries")
    code, run = told(capsys, "sim", TASK, str(configuration), *flags)
    assert code == Exit.VIOLATED
    assert any("findPath" in one["claim"] for one in run["broken"])
