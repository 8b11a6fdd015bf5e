"""`Motion.yaw`: where robots point, of ideal ones and of vehicles in a world. [ENV-FREE]"""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import koord
from koord.runtime.compile import compiled
from koord.runtime.compile.loading import loaded
from koord.runtime.deploy.ideal import IdealHost
from koord.runtime.shapes import Record
from koord.sim.running import Ending
from koord.syntax.source import Source
from tests.loading import program_of

#: A robot turns to its goal, and stops when it points there.
TURNING = """\
using Motion
local: bool sent = false
Go:
  pre: not sent
  eff:
    Motion.target = pos(psn.x, psn.y + 6, psn.z)
    sent = true
Arrive:
  pre: sent and 1.4 < Motion.yaw and Motion.yaw < 1.75
  eff: stop
"""


def test_an_ideal_robot_points_where_it_went_last() -> None:
    (program,) = loaded(compiled(program_of(TURNING)))
    host = IdealHost(program, 0, 1, 0.1, seed=1, position=(0.0, 0.0, 0.0), speed_mps=2.0)
    robot = program(0, (0,), 0.1, host)
    assert host.read(robot)["Motion_yaw"] == 0.0
    shape = robot.PORTS["Motion_target"]
    assert isinstance(shape, Record)
    vars(robot)["Motion_target"] = tuple.__new__(shape.make, (0.0, 6.0, 0.0))
    assert host.read(robot)["Motion_yaw"] == pytest.approx(math.pi / 2)
    host.holding = True
    assert host.read(robot)["Motion_yaw"] == pytest.approx(math.pi / 2)


def test_vehicles_in_a_world_sense_where_they_point(tmp_path: Path) -> None:
    configuration = tmp_path / "turning.yaml"
    configuration.write_text(
        "num_robots: 1\n"
        "device: {bot_name: one, bot_type: DIFF, planner: RRT_DIFF, speed: 0.5}\n"
        "positions: {0: [0, 0, 0]}\nworld: {bounds: {low: [-9, -9, 0], high: [9, 9, 3]}}\n",
        encoding="utf-8",
    )
    found = koord.simulate(Source("turning.krd", TURNING), configuration, duration_s=40)
    assert found.ending is Ending.STOPPED


def test_a_shape_turns_with_its_leader() -> None:
    """Each follower is near its place behind the leader, turned as that points."""
    program = Path(__file__).parents[2] / "specs" / "examples" / "turning_shape.krd"
    found = koord.simulate(program, program.with_suffix(".yaml"), duration_s=25)
    assert not found.broken
    assert found.figures.nearest is not None
    assert found.figures.nearest.distance_m > 0.8
    end = found.recording.poses[-1]
    x, y, _, yaw = end[0, :4].tolist()
    assert yaw > 0.6  # a part of the way around
    for pid, (back, side) in enumerate([(0.8, 0.8), (0.8, -0.8), (1.6, 1.6), (1.6, -1.6)], 1):
        ahead = (end[pid, 0] - x) * math.cos(yaw) + (end[pid, 1] - y) * math.sin(yaw)
        left = (end[pid, 1] - y) * math.cos(yaw) - (end[pid, 0] - x) * math.sin(yaw)
        # In a wedge that did not turn the last two were more than two metres away.
        assert math.dist((ahead, left), (-back, side)) < 1.1
