"""Cars of published configurations go to the place below their goals. (P-PUBLISHED-CAR)"""

from __future__ import annotations

import pytest

import koord
from koord.runtime.motion.planning import Hindrance
from koord.syntax.source import Source

PROGRAM = """\
using Motion:
  sensors:
    pos position
    bool reached
  actuators:
    pos target
    pos[] path
local: int step = 0
Go:
  pre: step == 0
  eff:
    step = 1
    {order}
End:
  pre: step == 1 and Motion.reached
  eff: stop
invariant High: step == 0 or {invariant}
"""

#: A target, and a path, above the ground.
ORDERS = {
    "target": ("Motion.target = pos(2.0, 1.0, 1.0)", "Motion.target.z == 1.0"),
    "path": (
        "Motion.path = [Motion.position, pos(2.0, 1.0, 1.5)]",
        "Motion.path[1].z == 1.5",
    ),
}

CONFIGURATION = """\
agents: [{pid: 0, on_device: car0, motion_automaton: MoatTestCar, position: [0, 0]}]
devices:
  car0: {bot_type: CAR, planner: RRT_CAR, motion_automata: [MoatTestCar]}
world: {bounds: {low: [-5, -5, 0], high: [5, 5, 3]}}
"""


def simulated(order: str, configuration: str) -> koord.Simulated:
    told, invariant = ORDERS[order]
    program = Source("goes.krd", PROGRAM.format(order=told, invariant=invariant))
    return koord.simulate(program, koord.read_configuration(Source("run.yaml", configuration)))


@pytest.mark.parametrize("order", ORDERS)
def test_they_go_to_the_place_below(order: str) -> None:
    done = simulated(order, CONFIGURATION)
    assert done.ok
    assert done.ending.value == "all robots have stopped"
    x, y, z = done.recording.poses[-1][0, :3].tolist()
    assert (x, y, z) == (pytest.approx(2.0, abs=0.3), pytest.approx(1.0, abs=0.3), 0.0)


def test_other_cars_stand_still_and_it_is_told_why() -> None:
    done = simulated("target", CONFIGURATION.replace("MoatTestCar", "Drive"))
    (standing,) = done.standing
    assert standing.hindrance is Hindrance.ABOVE_GROUND


def test_what_flies_goes_where_it_is_sent() -> None:
    flying = CONFIGURATION.replace(
        "bot_type: CAR, planner: RRT_CAR", "bot_type: QUAD, planner: STRAIGHT"
    )
    done = simulated("target", flying.replace("[0, 0]", "[0, 0, 1]"))
    assert done.ok
    assert done.recording.poses[-1][0, 2] == pytest.approx(1.0, abs=0.1)
