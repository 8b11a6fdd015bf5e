"""Programs say when simulated aircraft take off and land. (P-TAKEOFF)"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

import koord
from koord.runtime.motion.bodies import VEHICLES, Level, PlannerName
from koord.runtime.motion.world import Box, Point, World
from koord.sim.fleet import Fleet, Placed
from koord.sim.squads import DeviceModel

EXAMPLE = Path(__file__).parents[2] / "specs" / "examples" / "takeoff.krd"

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


# --- sent before it flies -------------------------------------------------------------------------

FREE = World((-3.0, -3.0, 0.0), (3.0, 3.0, 3.0))
WALLED = World((-3.0, -3.0, 0.0), (3.0, 3.0, 3.0), (Box((1.0, -3.0, 0.0), (1.4, 2.0, 1.2)),))

#: Where it goes: as a target, as a path from where it stands, and as one from elsewhere.
GOAL = (2.0, 1.0, 1.5)
WAYS = (GOAL, ((0.0, 0.0, 0.0), GOAL), ((0.0, -2.0, 1.2), (0.0, 2.0, 1.5), GOAL))


def fleet(world: World = FREE) -> Fleet:
    model = DeviceModel(VEHICLES["QUAD"].body, PlannerName.RRT_DRONE, Level.FULL)
    made = Fleet(world, [Placed(model, (0.0, 0.0, 0.0))])
    made.wait_for_takeoff(0)
    return made


def send(made: Fleet, way: Any) -> None:
    if isinstance(way[0], float):
        made.go_to(0, way)
    else:
        made.follow(0, way)


def flown(made: Fleet, time_s: float) -> list[tuple[Point, bool]]:
    """Where it is at each tick until then, and whether it has reached what it was sent to."""
    seen = list[tuple[Point, bool]]()

    def watch(fleet: Fleet) -> None:
        x, y, z = fleet.positions()[0].tolist()
        seen.append(((x, y, z), bool(fleet.reached()[0])))

    made.advance_to(made.now_s + time_s, watch)
    return seen


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("first", ["sent", "risen"])
def test_it_rises_straight_up_and_then_goes_where_it_was_sent(way: Any, first: str) -> None:
    """(P-TAKEOFF)"""
    made = fleet()
    if first == "sent":
        send(made, way)
        assert {psn for psn, _ in flown(made, 2.0)} == {(0.0, 0.0, 0.0)}
        made.take_off(0, up=True)
    else:
        made.take_off(0, up=True)
        send(made, way)
    seen = flown(made, 20.0)
    assert all(math.hypot(x, y) < 0.1 for (x, y, z), _ in seen if z < 0.8)
    assert not any(reached and math.dist(psn, GOAL) > 0.3 for psn, reached in seen)
    assert seen[-1][1]
    made.take_off(0, up=False)
    send(made, (0.0, 0.0, 1.0))  # for the next time
    down = flown(made, 10.0)
    assert all(math.dist(psn[:2], GOAL[:2]) < 0.3 for psn, _ in down)
    assert down[-1][0][2] < 0.05
    made.take_off(0, up=True)
    assert math.dist(flown(made, 20.0)[-1][0], (0.0, 0.0, 1.0)) < 0.3


def test_who_was_sent_nowhere_rises_and_stays_above() -> None:
    made = fleet()
    made.take_off(0, up=True)
    assert flown(made, 6.0)[-1][0] == pytest.approx((0.0, 0.0, 1.0), abs=0.05)
    made.take_off(0, up=True)
    send(made, GOAL)
    assert flown(made, 10.0)[-1][1]


def test_a_way_is_planned_from_above_where_something_is_in_the_way() -> None:
    made = fleet(WALLED)
    send(made, (2.0, 1.0, 0.9))
    made.take_off(0, up=True)
    seen = flown(made, 30.0)
    assert seen[-1][1]
    assert all(math.hypot(x, y) < 0.1 for (x, y, z), _ in seen if z < 0.8 and x < 0.9)
    assert not any(1.0 < x < 1.4 and y < 2.0 and z < 1.2 for (x, y, z), _ in seen)


def test_where_there_is_no_way_from_above_it_is_told() -> None:
    made = fleet()
    send(made, (9.0, 0.0, 1.0))
    made.take_off(0, up=True)
    seen = flown(made, 6.0)
    assert not any(reached for _, reached in seen)
    assert made.sensed().plights[0].goal == (9.0, 0.0, 1.0)


def test_the_example_does_what_it_claims() -> None:
    done = koord.simulate(EXAMPLE, rounds=200)
    assert done.ending.value == "all robots have stopped"
    assert len(done.figures.robots) == 16
    assert not done.broken


def test_a_drone_without_attitude_follows_a_path_on_the_ground() -> None:
    text = PROGRAM[: PROGRAM.index("Rise:")].replace("pos target", "pos[] path")
    text = text.replace("        boolean takeoff\n", "") + SLIDE
    config = koord.read_configuration(koord.Source("one.yaml", CONFIGURATION % "simple"))
    done = koord.simulate(koord.Source("slide.krd", text), config, rounds=100)
    assert done.ending.value == "all robots have stopped"


SLIDE = """\
Go:
    pre: stage == 0
    eff:
        Motion.path = [pos(0.0, 0.0, 0.0), pos(2.0, 1.0, 0.0)]
        stage = 1

End:
    pre: stage == 1 and Motion.reached
    eff: stop
"""
