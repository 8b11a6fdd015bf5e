"""Programs say when simulated aircraft take off and land. (P-TAKEOFF)"""

from __future__ import annotations

import math

import pytest

import koord

PROGRAM = """\
using Motion:
    sensors:
        pos psn
        boolean reached
    actuators:
        pos target
        boolean takeoff

local:
    int stage = 0

Rise:
    pre: stage == 0
    eff:
        Motion.takeoff = true
        stage = 1

Go:
    pre: stage == 1 and Motion.psn.z > 0.9
    eff:
        Motion.target = pos(1.0, 1.0, 1.5)
        stage = 2

Down:
    pre: stage == 2 and Motion.reached and Motion.psn.z > 1.3
    eff:
        Motion.takeoff = false
        stage = 3

End:
    pre: stage == 3 and Motion.psn.z < 0.1
    eff: stop
"""

CONFIGURATION = """\
agents:
  - {pid: 0, on_device: quad, position: [0, 0, 0]}
devices:
  quad: {bot_type: QUAD, planner: RRT_DRONE, simulation: {level: %s}}
world: {bounds: {low: [-3, -3, 0], high: [3, 3, 3]}}
"""


@pytest.mark.parametrize("level", ["fast", "full"])
def test_an_aircraft_rises_flies_and_lands_as_its_program_says(level: str) -> None:
    config = koord.read_configuration(koord.Source("one.yaml", CONFIGURATION % level))
    done = koord.simulate(koord.Source("fly.krd", PROGRAM), config, rounds=200)
    assert done.ending.value == "all robots have stopped"
    (robot,) = done.figures.robots
    assert robot.events == 4
    # Straight up, over to the place, and straight down there.
    way_m = 1.0 + math.dist((0, 0, 1.0), (1, 1, 1.5)) + 1.5
    assert robot.distance_m == pytest.approx(way_m, abs=1.0)
